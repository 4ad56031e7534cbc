"""Searches behind the workbench: what is asked for, the points in a table, and the best as a scene."""

import json
import math
from pathlib import Path

import pytest

from subsoil_ros.cli.main import parse
from subsoil_ros.errors import InputError
from subsoil_ros.loading.loader import load_scene
from subsoil_ros.workbench import jobs, searches
from subsoil_ros.workbench.project import Project, first_scene
from subsoil_ros.yaml_document import dump_yaml

RAKE, DEPTH = "tools.tine.blade.rake_deg", "tools.tine.depth_m"
DRAFT = searches.GOALS[0]
SCENE = {
    "soil": "loam",
    "tools": {"tine": {"blade": {"rake_deg": 35, "width_m": 0.06}, "depth_m": 0.2, "speed_m_per_s": 0.5}},
    "travel_m": 0.5,
    "preset": "real_time",
}
BIN = {"length_m": 2.0, "width_m": 1.5, "depth_m": 0.6}


@pytest.fixture
def project(tmp_path: Path) -> Project:
    """A project with a blade."""
    project = Project(tmp_path)
    project.write_scene("blade", dump_yaml(SCENE))
    return project


def searched(project: Project, rows: str, **changes: object) -> searches.Found:
    """What is found of a search with two seeds whose table has these rows."""
    folder = searches.folder_of(project, "first")
    folder.mkdir(parents=True, exist_ok=True)
    request = {"ranges": {RAKE: [30, 40], DEPTH: [0.1, 0.2]}, "least": DRAFT, "seeds": [1, 2]}
    (folder / "optimise.yaml").write_text(dump_yaml(request | changes))
    (folder / "trials.csv").write_text(f"run,{RAKE},{DEPTH},seed,failure,{DRAFT}\n{rows}")
    return searches.found(project, "first")


def test_keys_that_are_offered(project: Project) -> None:
    """Of tools in short, of blades, and of springs, also those of a base; of a wrong scene none."""
    assert searches.suggested(project, "blade") == (
        RAKE, "tools.tine.blade.width_m", DEPTH, "tools.tine.speed_m_per_s",
    )  # fmt: skip
    project.write_scene("share", dump_yaml(first_scene("share.stl")))
    assert searches.suggested(project, "share") == ("tools.tool.depth_m", "tools.tool.speed_m_per_s")
    project.write_scene("machine", f"base: {load_scene('three_shanks').path}\n")
    assert searches.suggested(project, "machine") == tuple(
        f"mechanism.forces.H9_{name}.stiffness_newton_per_m" for name in ("spring", "left", "right")
    )
    project.write_scene("wrong", "tools: [")
    assert searches.suggested(project, "wrong") == searches.suggested(project, "none") == ()


def test_the_command_of_a_search(project: Project) -> None:
    """It is understood by the command line; the scene is kept as it is, under its own name."""
    ranges = [(RAKE, 30, 40.0), (DEPTH, 0.1, None)]
    searches.ask_for(project, "first", "blade", ranges, least=DRAFT, trials=4, seeds="")
    (job,) = jobs.jobs(project)
    assert (job.name, job.scene, job.state, job.kind) == ("first", "blade", "queued", jobs.SEARCH)
    args = parse(json.loads((project.runs / "first.job").read_text())["words"])
    assert Path(args.scene).read_text() == project.scene_file("blade").read_text()
    assert args.vary == [f"{RAKE}=30,40.0", f"{DEPTH}=0.1,None"]
    assert (args.least, args.trials, args.seeds, args.workers) == (DRAFT, 4, None, 1)
    assert (args.overrides, args.out) == (["name='blade'"], project.folder / "searches" / "first")
    jobs.stop(project, "first")
    args.out.mkdir(parents=True)
    with pytest.raises(InputError, match="a search of this name"):
        searches.ask_for(project, "first", "blade", ranges)


def test_points_least_first(project: Project) -> None:
    """Means over the seeds with their intervals; points without a result come last and say why."""
    found = searched(
        project,
        "a,30,0.2,1,,500\nb,30,0.2,2,,520\n"
        "c,40,0.1,1,,310\nd,40,0.1,2,,300\nd,40,0.1,2,,300\n"
        "e,35,0.1,1,,200\nf,35,0.1,2,too deep,\n"
        "g,36,0.1,1,,\nh,36,0.1,2,,nan\n"
        "i,37,0.1,1,,100\n",
    )
    assert (found.keys, found.goal) == ((RAKE, DEPTH), DRAFT)
    assert [point.words() for point in found.points[:2]] == [
        ["40", "0.1", "305 +- 63.53"], ["30", "0.2", "510 +- 127.1"],
    ]  # fmt: skip
    assert {point.values[0]: point.lack for point in found.points[2:]} == {
        35.0: "too deep", 36.0: f"{DRAFT} is not known", 37.0: "a run is missing",
    }  # fmt: skip


def test_one_seed_has_no_interval(project: Project) -> None:
    (point,) = searched(project, "a,30,0.2,-1,,500\n", seeds=[]).points
    assert math.isnan(point.result.half_width)
    assert point.words() == ["30", "0.2", "500"]


@pytest.mark.parametrize("end", ["b,4", "b", "\0", "b,30,0.2,2,,x\0", 'b,40,"', "b,x,y,z,,,,,\n"])
def test_a_damaged_table_hides_nothing_else(project: Project, end: str) -> None:
    found = searched(project, f"a,30,0.2,1,,500\na,30,0.2,2,,500\n{end}")
    assert found.points[0].by_seed == {"1": 500.0, "2": 500.0}


@pytest.mark.parametrize("request_text", ["", "[", "{}", "{ranges: 3, least: a, seeds: []}"])
def test_without_a_request_nothing_is_found(project: Project, request_text: str) -> None:
    searched(project, "")
    (project.folder / "searches" / "first" / "optimise.yaml").write_text(request_text)
    (project.folder / "searches" / "first" / "trials.csv").write_text("run\n")
    assert searches.found(project, "first").points == searches.found(project, "").points == ()


def test_the_best_is_the_kept_scene_with_its_values(project: Project) -> None:
    """Also where it gives the soil by its name, and after the scene was changed."""
    kept = Path(jobs.keep_scene(project, "first", "blade")[0])
    folder = searches.folder_of(project, "first")
    folder.mkdir(parents=True)
    best = {
        "base": str(kept),
        "tools": {"tine": {"blade": {"rake_deg": 30.5}}},
        "soil": {"bin": BIN},
    }
    (folder / "best.yaml").write_text(dump_yaml(best))
    project.write_scene("blade", "changed: since\n")
    project.write_scene("best", searches.best_scene(project, "first"))
    scenes = [
        load_scene(file, {"name": "same"}) for file in (project.scene_file("best"), folder / "best.yaml")
    ]
    assert scenes[0].scene_hash == scenes[1].scene_hash
    assert scenes[0].scene_hash != load_scene(kept, {"name": "same"}).scene_hash
    kept.unlink()
    with pytest.raises(InputError, match="no such file"):
        searches.best_scene(project, "first")
