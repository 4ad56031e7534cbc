"""The files behind the workbench: names, forms, and the queue of runs."""

import json
import os
from contextlib import suppress
from pathlib import Path
from typing import Any

import psutil
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from subsoil_ros.errors import InputError
from subsoil_ros.workbench import jobs
from subsoil_ros.workbench.project import (
    BLADE,
    FLAT_BLADE,
    LARGEST_TOOL_BYTES,
    Project,
    cause_of,
    checked,
    first_scene,
    form_of,
    with_form,
)
from subsoil_ros.yaml_document import dump_yaml, parse_yaml


@pytest.fixture
def project(tmp_path: Path) -> Project:
    """A project with a plate and a scene around it, 0.5 m of a wedge model."""
    trimesh.creation.box((0.02, 0.1, 0.4)).export(tmp_path / "plate.stl")
    project = Project(tmp_path)
    scene = first_scene("plate.stl") | {"travel_m": 0.5}
    scene["tools"]["tool"]["depth_m"] = 0.15
    project.write_scene("pull", dump_yaml(scene))
    return project


@given(st.text(max_size=80))
def test_no_name_leaves_the_folder(name: str) -> None:
    """Whatever is asked for: a file in the folder itself, or a refusal."""
    project = Project(Path("/project"))
    with suppress(InputError):
        file = project.scene_file(name)
        assert file.parent == project.folder
        assert os.path.normpath(file) == str(file)


@pytest.mark.parametrize("name", ["", "..", "a/b", "a\\b", "a.b", ".a", "-a", "a" * 61, "a\0", "é"])
def test_names_that_are_refused(name: str) -> None:
    with pytest.raises(InputError, match="1 to 60 letters"):
        checked(name)


def test_uploads_are_kept_under_a_plain_name(project: Project) -> None:
    """Of a kind that is read, no larger than is allowed, and never over another file."""
    assert project.add_tool("../../my tine (2).STL", b"solid") == "my_tine_2.stl"
    assert project.add_tool("my tine (2).stl", b"solid") == "my_tine_2.stl"
    assert project.tools() == ["my_tine_2.stl", "plate.stl"]
    for name, content, why in (
        ("my_tine_2.stl", b"other", "another file of this name"),
        ("tine.exe", b"", "of no kind that is read"),
        ("tine.stl", bytes(LARGEST_TOOL_BYTES + 1), "are allowed"),
        ("/.stl", b"", "of no kind that is read"),
    ):
        with pytest.raises(InputError, match=why):
            project.add_tool(name, content)


def test_the_form_changes_its_keys_alone(project: Project) -> None:
    text = project.scene_file("pull").read_text()
    form = form_of(text)
    assert form is not None
    assert (form["mesh"], form["soil"], form["depth_m"], form["unit"]) == ("plate.stl", "loam", 0.15, None)
    changes = {"depth_m": 0.1, "unit": "mm", "preset": None}
    commented = with_form(f"# firm\n{text}", changes)
    assert commented.startswith("# firm\n")
    changed: Any = parse_yaml(commented, "scene")
    whole: Any = parse_yaml(text, "scene")
    del whole["preset"]
    whole["tools"]["tool"] |= {"depth_m": 0.1, "unit": "mm"}
    assert changed == whole


@pytest.mark.parametrize(
    "text",
    [
        "",
        "a: [",
        "tools: 3",
        "tools: {a: {}, b: {}}",
        "tools: {a: {path: {}}}",
        "{soil: loam, tools: {a: {mesh: a.stl, depth_m: 10 cm}}}",
        "{soil: {}, tools: {a: {mesh: a.stl}}}",
    ],
)
def test_other_scenes_have_no_form(text: str) -> None:
    assert form_of(text) is None


def test_a_flat_blade_takes_the_place_of_a_file_and_gives_it_back(project: Project) -> None:
    text = project.scene_file("pull").read_text()
    turned = with_form(text, {"unit": "mm", "up": "y", "turn_deg": 90.0})
    shown = form_of(turned)
    assert shown is not None
    assert (shown["unit"], shown["up"], shown["turn_deg"], shown["rake_deg"]) == ("mm", "y", 90.0, None)
    blade = with_form(turned, {"mesh": FLAT_BLADE})
    tool = {"blade": BLADE, "depth_m": 0.15, "speed_m_per_s": 0.5}
    assert parse_yaml(blade, "scene")["tools"] == {"tool": tool}
    shown = form_of(with_form(blade, {"rake_deg": 40.0}))
    assert shown is not None
    assert (shown["mesh"], shown["rake_deg"], shown["width_m"]) == (FLAT_BLADE, 40.0, 0.06)
    back = with_form(with_form(turned, {"turn_deg": None, "unit": None, "up": None}), {"mesh": FLAT_BLADE})
    assert parse_yaml(with_form(back, {"mesh": "plate.stl"}), "scene") == parse_yaml(text, "scene")
    assert form_of(text.replace("depth_m", "rotation_deg: [10, 0, 0]\n    depth_m")) is None


@pytest.mark.parametrize(
    ("message", "field"),
    [
        (
            "tools.tool: depth 0.02 m is outside the range 0.14 to 0.26 m that soil.file was fitted in",
            "depth_m",
        ),
        ("tools.depth: speed 9 m/s is outside the range 0.5 to 4 m/s that soil.file", "speed_m_per_s"),
        ("tools.tool: inertial number 0.83 of tool tool, 9 m/s at 0.2 m", "speed_m_per_s"),
        ("tools.tool.mesh: /depth/a.stl: is 0.000176 m large; correct its unit: in the file", "unit"),
        ("tools.tool: is wholly below the surface; if its file has y upwards, give 'up: y'", "up"),
        ("pull.yaml: tools.tool.groups.tool.mesh: /speed/hole.stl: is not watertight", "mesh"),
        ("pull.yaml: travel_m: given 0; it must be a number above 0", "travel_m"),
        ("pull.yaml: preset slow: is none; choose one of fine", "preset"),
        ("pull.yaml: soil.material: given 'mud'; there is no such file or shipped soil", "soil"),
        ("pull.yaml: unknown key 'colour'", None),
    ],
)
def test_messages_stand_at_the_field_that_they_are_about(message: str, field: str | None) -> None:
    assert cause_of(message) == field


def test_soils_are_the_shipped_ones_and_those_of_the_project(project: Project) -> None:
    (project.folder / "soils").mkdir()
    (project.folder / "soils" / "mine_material.yaml").touch()
    (project.folder / "soils" / "mine.yaml").touch()
    offered = project.soils()
    assert offered[0] == "soils/mine_material.yaml"
    assert {"loam", "dry_sand", "sandy_loam", "clay_loam"} <= set(offered[1:])


def test_a_command_that_has_written_its_file_is_done(project: Project) -> None:
    """A search or a calibration goes on from what it has kept."""
    product = project.folder / "soils" / "mine_material.yaml"
    jobs.put(project, "mine", ["calibrate"], product, jobs.SOIL)
    with pytest.raises(InputError, match="a job of this name"):
        jobs.ask_for(project, "mine", "pull")
    file = project.runs / "mine.job"
    file.write_text(json.dumps(json.loads(file.read_text()) | {"pid": 0, "stopping": True}))
    (project.runs / "mine.log").write_text("set 3 of 12")
    (job,) = jobs.jobs(project)
    assert (job.kind, job.state, job.detail) == (jobs.SOIL, "stopped", "set 3 of 12")
    jobs.again(project, "mine")
    assert jobs.jobs(project)[0].state == "queued"
    file.write_text(json.dumps(json.loads(file.read_text()) | {"pid": 0}))
    product.parent.mkdir()
    product.touch()
    assert jobs.jobs(project)[0].state == "done"


def test_one_that_waits_leaves_the_queue(project: Project) -> None:
    jobs.ask_for(project, "first", "pull")
    jobs.stop(project, "first")
    assert jobs.jobs(project) == []


def test_another_process_of_the_number_is_not_the_run(project: Project) -> None:
    """After a restart of the machine a number may be that of any process: it is left alone."""
    jobs.ask_for(project, "first", "pull")
    file = project.runs / "first.job"
    file.write_text(json.dumps(json.loads(file.read_text()) | {"pid": os.getpid()}))
    assert jobs.jobs(project)[0].state == "failed"
    jobs.stop(project, "first")


def test_a_run_that_just_begins_goes_on(project: Project, monkeypatch: pytest.MonkeyPatch) -> None:
    """Between fork and exec a process has no words."""
    jobs.ask_for(project, "first", "pull")
    file = project.runs / "first.job"
    file.write_text(json.dumps(json.loads(file.read_text()) | {"pid": os.getpid()}))
    monkeypatch.setattr(psutil.Process, "cmdline", lambda _: [])
    assert [job.state for job in jobs.jobs(project)] == ["running"]


def test_a_run_that_was_killed_is_not_done(project: Project) -> None:
    """`subsoil report` of its bag knows of no failure, and that its last tick is missing."""
    folder = project.runs / "killed"
    folder.mkdir(parents=True)
    (folder / "scene.yaml").touch()
    (folder / "summary.json").write_text('{"run": {"complete": false}}')
    (job,) = jobs.jobs(project)
    assert (job.state, job.detail) == ("failed", "ended before its last tick")


@pytest.mark.parametrize(
    "text", ["", "{}", "[]", "3", "{", '{"asked_ns": 1, "words": []}', '{"asked_ns": "a"}']
)
def test_files_of_others_are_no_runs(project: Project, text: str) -> None:
    """A damaged one does not hide the rest."""
    jobs.ask_for(project, "first", "pull")
    (project.runs / "other.job").write_text(text)
    (project.runs / "a b.job").write_text(text)
    for name in ("made", "made_so_far"):  # the second is a report of a run that goes on, and none itself
        (project.runs / name).mkdir()
        (project.runs / name / "summary.json").write_text(text)
    (project.runs / "made" / "scene.yaml").touch()
    assert [(job.name, job.state) for job in jobs.jobs(project)] == [("made", "failed"), ("first", "queued")]
