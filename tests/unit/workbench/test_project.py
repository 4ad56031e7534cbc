"""The files behind the workbench: names, forms, and the queue of runs."""

import json
import os
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from subsoil_ros.errors import InputError
from subsoil_ros.workbench import jobs
from subsoil_ros.workbench.project import (
    LARGEST_TOOL_BYTES,
    Project,
    checked,
    first_scene,
    form_of,
    soils,
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


def test_shipped_soils_are_offered() -> None:
    assert {"loam", "dry_sand", "sandy_loam", "clay_loam"} <= set(soils())


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


@pytest.mark.parametrize(
    "text", ["", "{}", "[]", "3", "{", '{"asked_ns": 1, "words": []}', '{"asked_ns": "a"}']
)
def test_files_of_others_are_no_runs(project: Project, text: str) -> None:
    """A damaged one does not hide the rest."""
    jobs.ask_for(project, "first", "pull")
    (project.runs / "other.job").write_text(text)
    (project.runs / "a b.job").write_text(text)
    (project.runs / "made").mkdir()
    (project.runs / "made" / "summary.json").write_text(text)
    assert [(job.name, job.state) for job in jobs.jobs(project)] == [("made", "failed"), ("first", "queued")]
