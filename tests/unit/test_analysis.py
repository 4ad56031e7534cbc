"""Series, window, summary and figures of a run, from bags with known content."""

import argparse
import csv
import json
import math
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
from rich.console import Console

from subsoil_ros.analysis.figures import draw_figures
from subsoil_ros.analysis.poses import posed_vertices_m
from subsoil_ros.analysis.series import read_series, write_series_csv
from subsoil_ros.analysis.smoothing import running_mean
from subsoil_ros.analysis.soil_cut import nearest_times_ns
from subsoil_ros.analysis.summary import print_summary, summarize, write_summary
from subsoil_ros.analysis.window import metrics_window, tip_x_m
from subsoil_ros.cli import bag as bag_verb
from subsoil_ros.cli import report as report_verb
from subsoil_ros.errors import InputError, RecordingError
from subsoil_ros.messages import (
    BodyState,
    CouplingReport,
    ForceState,
    Grant,
    GroupForce,
    JointReaction,
    MechanismState,
    SoilCloud,
    SoilState,
    ToolMotion,
    ToolMotions,
    ToolWrench,
    ToolWrenches,
)
from subsoil_ros.recording.bag_writer import BagWriter
from subsoil_ros.scene.loader import ResolvedScene, load_scene
from subsoil_ros.scene.meshes import ToolMesh

SCENES = Path(__file__).parents[2] / "config/scenes"
INTERVAL_NS = 30_000
SERIES_TICKS = 4
TICKS = 42  # not a multiple: the last tick is a series tick of its own
SMALL_BIN = ("soil.bin.width_m=0.1", "soil.bin.depth_m=0.36", "soil.bin.length_m=0.5")
SHORT = (
    f"duration_s={TICKS * INTERVAL_NS * 1e-9:.9f}",
    f"coupling.interval_ns={INTERVAL_NS}",
    f"record.series_ticks={SERIES_TICKS}",
    "report.settle_s=0",
)


def full_machine(*overrides: str) -> ResolvedScene:
    """The paper's machine with share and wheels as tools."""
    return load_scene(SCENES / "subsoiler_1s300.yaml", (*SMALL_BIN, *SHORT, *overrides))


def tine(*overrides: str) -> ResolvedScene:
    """A tool on a path, no mechanism."""
    return load_scene(SCENES / "tine.yaml", (*SMALL_BIN, *SHORT, *overrides))


def machine_alone() -> ResolvedScene:
    """The machine without soil."""
    return load_scene(SCENES / "mechanism_only.yaml", SHORT)


class Run:
    """Made-up records of a scene: the machine goes forward by 10 mm a tick, all else is random."""

    def __init__(self, resolved: ResolvedScene) -> None:
        self.resolved = resolved
        self.records: dict[tuple[int, type], object] = {}
        self._rng = np.random.default_rng(3)
        for tick in range(resolved.timing.tick_count):
            for record in self._tick(tick):
                self.records[tick, type(record)] = record

    def _numbers(self, count: int) -> list[float]:
        return [float(v) for v in self._rng.standard_normal(count) * 10.0 ** self._rng.integers(-9, 3, count)]

    def _tick(self, tick: int) -> list[object]:
        scene = self.resolved.scene
        head = ("run", tick, (tick + 1) * INTERVAL_NS)
        forward = 0.01 * (tick + 1)
        places = {
            name: (body.position_m[0] + forward, body.position_m[1], body.angle_rad + 0.1 * math.sin(tick))
            for name, body in (scene.mechanism.bodies if scene.mechanism else {}).items()
        }
        motions, wrenches = [], []
        for name, tool in scene.tools.items():
            x_m, z_m, phi_rad = places.get(tool.body, (forward - 0.17, 0.1, 0.02))
            motions.append(ToolMotion(name, x_m, tool.lateral_m, z_m, phi_rad, *self._numbers(3)))
            groups = tuple(GroupForce(group, *self._numbers(3)) for group in tool.groups)
            wrenches.append(ToolWrench(name, *self._numbers(7), 5, groups))
        found: list[object] = [Grant("run", tick), ToolMotions(*head, tuple(motions))]
        if scene.soil is not None:
            found += [ToolWrenches(*head, tuple(wrenches)), SoilState(*head, 300, 7, 0, 2, *self._numbers(5))]
            positions = self._rng.random((300, 3)) * (0.5, 0.1, 0.36) - (0.0, 0.05, 0.36)
            speeds = 0.3 * self._rng.random(300)
            found.append(SoilCloud(tick, head[2], positions.astype("f4"), speeds.astype("f4")))
        if scene.mechanism is not None:
            bodies = tuple(BodyState(name, *place, *self._numbers(6)) for name, place in places.items())
            joints = tuple(JointReaction(name, *self._numbers(3)) for name in scene.mechanism.joints)
            kinds = {name: force.kind for name, force in scene.mechanism.forces.items()}
            forces = tuple(
                ForceState(n, *self._numbers(3)) for n, kind in kinds.items() if kind != "point_load"
            )
            found.append(MechanismState(*head, *self._numbers(9), bodies, joints, forces))
        return [*found, CouplingReport(*head, *self._numbers(5), 0.5 * tick)]

    def is_series(self, tick: int) -> bool:
        return (tick + 1) % SERIES_TICKS == 0 or tick == self.resolved.timing.tick_count - 1

    def series_ticks(self, count: int | None = None) -> list[int]:
        return [tick for tick in range(count or self.resolved.timing.tick_count) if self.is_series(tick)]

    def column(self, kind: type, take) -> list:
        """What `take` finds in the records of every series tick."""
        return [take(self.records[tick, kind]) for tick in self.series_ticks()]

    def write(self, directory: Path, count: int | None = None) -> Path:
        """The run as a folder of `subsoil run`, its first `count` ticks."""
        directory.mkdir()
        self.resolved.write(directory / "scene.yaml")
        writer = BagWriter(directory / "bag", self.resolved.scene, self.resolved.timing)
        for (tick, kind), record in self.records.items():
            wanted = kind in (Grant, ToolMotions, ToolWrenches) or self.is_series(tick)
            if wanted and (count is None or tick < count):
                writer.write(record)
        writer.close()
        return directory


@pytest.fixture(scope="module")
def machine(tmp_path_factory) -> tuple[Run, Path]:
    """The full machine, recorded."""
    run = Run(full_machine())
    return run, run.write(tmp_path_factory.mktemp("machine") / "run")


def test_series_are_the_numbers_of_the_engines(machine):
    """Each column of a bag with a mechanism and soil holds exactly what was recorded."""
    run, directory = machine
    series = read_series(directory / "bag", run.resolved.scene)
    ticks = run.series_ticks()
    assert next(iter(series.columns)) == "time_s"
    np.testing.assert_array_equal(series["time_s"], [(tick + 1) * INTERVAL_NS * 1e-9 for tick in ticks])
    expected = {
        "draft_newton": (MechanismState, lambda s: s.draft_newton),
        "draft.share_newton": (ToolWrenches, lambda w: -w.tools[0].force_x_newton),
        "draft.wheels_newton": (
            ToolWrenches, lambda w: -(w.tools[1].force_x_newton + w.tools[2].force_x_newton)
        ),
        "spring.H9_spring.force_newton": (MechanismState, lambda s: s.forces[0].force_newton),
        "body.shank.z_m": (MechanismState, lambda s: s.bodies[0].z_m),
        "body.frame.angular_velocity_rad_per_s": (MechanismState, lambda s: s.bodies[6].phi_rate_rad_per_s),
        "joint.H8_shank_hinge.force_z_newton": (MechanismState, lambda s: s.joints[7].force_z_newton),
        "mechanism.driver_work_joule": (MechanismState, lambda s: s.driver_work_joule),
        "tool.wheel_left.angle_rad": (ToolMotions, lambda m: m.tools[1].phi_rad),
        "tool.shank.torque_y_newton_m": (ToolWrenches, lambda w: w.tools[0].torque_y_newton_m),
        "tool.shank.blade.force_x_newton": (ToolWrenches, lambda w: w.tools[0].groups[1].force_x_newton),
        "soil.kinetic_energy_joule": (SoilState, lambda s: s.kinetic_energy_joule),
        "soil.particle_count": (SoilState, lambda s: s.particle_count),
        "coupling.residual_ratio": (CouplingReport, lambda c: c.residual_ratio),
    }  # fmt: skip
    for name, (kind, take) in expected.items():
        np.testing.assert_array_equal(series[name], run.column(kind, take), err_msg=name)


def test_series_have_no_wall_time(machine):
    """Equal runs have equal series: no column depends on how fast the computer was."""
    run, directory = machine
    series = read_series(directory / "bag", run.resolved.scene)
    assert not [name for name in series.columns if "wall" in name]
    assert series.wall_time_s == 0.5 * (TICKS - 1)


def test_csv_gives_back_the_same_bits(machine, tmp_path):
    """series.csv read by another reader has the bits of every number, and counts stay integers."""
    run, directory = machine
    series = read_series(directory / "bag", run.resolved.scene)
    write_series_csv(series, tmp_path / "series.csv")
    with (tmp_path / "series.csv").open() as stream:
        heading, *rows = csv.reader(stream)
    assert heading == list(series.columns)
    assert len(rows) == len(run.series_ticks())
    for place, name in enumerate(heading):
        np.testing.assert_array_equal([float(row[place]) for row in rows], series[name])
    assert {row[heading.index("soil.particle_count")] for row in rows} == {"300"}


def test_draft_without_mechanism_is_the_pull_against_the_soil(tmp_path):
    """A tool on a path is pulled with minus the soil's force, and there are no wheels to split off."""
    run = Run(tine())
    series = read_series(run.write(tmp_path / "run") / "bag", run.resolved.scene)
    pull = run.column(ToolWrenches, lambda w: -w.tools[0].force_x_newton)
    np.testing.assert_array_equal(series["draft_newton"], pull)
    np.testing.assert_array_equal(series["draft.share_newton"], pull)
    assert "draft.wheels_newton" not in series


def test_a_run_cut_short_has_its_complete_rows(tmp_path):
    """Series end with the last complete series tick; the summary says that the run is not complete."""
    run = Run(tine())
    directory = run.write(tmp_path / "run", count=14)
    series = read_series(directory / "bag", run.resolved.scene)
    np.testing.assert_array_equal(series["time_s"], [tick * INTERVAL_NS * 1e-9 for tick in (4, 8, 12)])
    summary = summarize(directory / "bag", run.resolved, {})
    assert (summary["complete"], summary["ticks"], summary["steps"]) == (False, 12, 12)


def test_a_bag_without_a_series_tick_is_an_error(tmp_path):
    """A run that ended before its first series tick is told so, not given empty statistics."""
    run = Run(tine())
    directory = run.write(tmp_path / "run", count=2)
    with pytest.raises(RecordingError, match="not one complete series tick"):
        read_series(directory / "bag", run.resolved.scene)


def test_tip_moves_with_the_shank(machine):
    """The tip's place is the reference arm turned by the shank's angle, about its centre of mass."""
    run, directory = machine
    scene = run.resolved.scene
    series = read_series(directory / "bag", scene)
    shank, (tip_x, tip_z) = scene.mechanism.bodies["shank"], scene.report.tip_m
    arm = complex(tip_x - shank.position_m[0], tip_z - shank.position_m[1])
    turned = arm * np.exp(1j * (series["body.shank.angle_rad"] - shank.angle_rad))  # phi from x to z
    np.testing.assert_allclose(tip_x_m(series, scene), series["body.shank.x_m"] + turned.real, rtol=1e-14)


def test_window_is_where_the_tip_is_inside_and_the_wheels_are_clear(machine):
    """Rows count from the tip's entry plus the margin until the wheels come to the end of the bin."""
    run, directory = machine
    scene = run.resolved.scene
    scene = scene.model_copy(update={"report": scene.report.model_copy(update={"window_inside_m": 0.15})})
    bin_ = scene.soil.bin.model_copy(update={"length_m": 1.0})
    scene = scene.model_copy(update={"soil": scene.soil.model_copy(update={"bin": bin_})})
    series = read_series(directory / "bag", scene)
    window = metrics_window(series, scene)
    tip, wheel = tip_x_m(series, scene), series["tool.wheel_left.x_m"]
    expected = (tip >= 0.15) & (tip <= 0.85) & (wheel <= 0.75)
    assert expected.any()
    assert not expected.all()
    np.testing.assert_array_equal(window.rows, expected)
    assert not window.whole_run


def test_empty_window_means_the_whole_run_and_says_so(machine):
    """A bin too short for the margin leaves no row; the summary then covers the run, and tells."""
    run, directory = machine
    summary = summarize(directory / "bag", run.resolved, {})
    assert summary["window"]["whole_run"]
    assert summary["window"]["rows"] == len(run.series_ticks())
    assert summary["draft_newton_mean"] == summary["run.draft_newton_mean"]


def test_settling_is_left_out(tmp_path):
    """Metrics start after report.settle_s; extremes of the whole run stay available."""
    run = Run(tine("report.settle_s=0.0008", "report.tip_m=null"))
    directory = run.write(tmp_path / "run")
    series = read_series(directory / "bag", run.resolved.scene)
    summary = summarize(directory / "bag", run.resolved, {"mode": "direct"}, series)
    late = series["time_s"] > 0.0008
    assert 0 < late.sum() < len(series)
    draft = series["draft_newton"]
    assert summary["draft_newton_mean"] == np.mean(draft[late])
    assert (summary["draft_newton_min"], summary["draft_newton_max"]) == (
        draft[late].min(),
        draft[late].max(),
    )
    assert (summary["run.draft_newton_min"], summary["run.draft_newton_max"]) == (draft.min(), draft.max())
    wall_s = 0.5 * (TICKS - 1)
    assert (summary["mode"], summary["wall_s"], summary["particle_count"]) == ("direct", wall_s, 300)
    assert summary["real_time_factor"] == pytest.approx(TICKS * INTERVAL_NS * 1e-9 / wall_s, rel=1e-12)
    write_summary(summary, tmp_path / "summary.json")
    assert json.loads((tmp_path / "summary.json").read_text()) == summary


def printed(summary: dict, run: Run, directory: Path) -> str:
    """What print_summary prints, on one line."""
    console = Console(width=200, record=True, file=(directory / "printed.txt").open("w"))
    print_summary(summary, run.resolved.scene, directory, console)
    return " ".join(console.export_text().split())


def test_printed_summary_names_everything_asked_for(machine):
    """Metrics, counts, times, residual, the paper's values beside, and where the files are."""
    run, directory = machine
    summary = summarize(directory / "bag", run.resolved, {"whole_wall_s": 99.0})
    text = printed(summary, run, directory)
    for piece in (
        "draft [N]", "of it share [N]", "of it wheels [N]", "spring force", "share angle [rad]",
        "height [mm]", "300 particles", f"{TICKS} steps", "20.5 s wall time (99.0 s with start-up)",
        "real-time factor", "residual",
        "363 to 1000 N", "contradicts itself", "no row of it lies in the window", str(directory / "bag"),
        "figures",
    ):  # fmt: skip
        assert piece in text, piece


def test_note_of_the_scene_is_printed(tmp_path):
    """A scene's warning cannot be overlooked."""
    run = Run(tine("report.note=not the paper [at all]"))
    directory = run.write(tmp_path / "run")
    text = printed(summarize(directory / "bag", run.resolved, {}), run, directory)
    assert "NOTE: not the paper [at all]" in text
    assert "contradicts" not in text


@pytest.mark.parametrize(
    ("make", "expected"),
    [
        (full_machine, {"draft", "spring_force", "share_angle", "shank_height", "soil_cut"}),
        (tine, {"draft", "soil_cut"}),
        (machine_alone, {"draft", "spring_force", "share_angle", "shank_height"}),
    ],
)
def test_figures_are_what_the_run_has(make, expected, tmp_path):
    """A run draws the figures it has data for, none of them blank; the others are absent."""
    run = Run(make())
    directory = run.write(tmp_path / "run")
    paths = draw_figures(directory / "bag", run.resolved, directory / "figures")
    assert {path.stem for path in paths} == expected
    assert sorted(paths) == sorted((directory / "figures").iterdir())
    for path in paths:
        image = matplotlib.image.imread(path)[:, :, :3]
        assert image.shape[0] > 400
        assert image.shape[1] > 400
        middle = image[image.shape[0] // 4 : -image.shape[0] // 4, image.shape[1] // 4 : -image.shape[1] // 4]
        coloured = np.ptp(middle, axis=2) > 0.2  # curves and particles; frame, grid and window are not
        assert coloured.sum() > 400


def test_cut_has_three_times():
    """The clouds nearest to start, middle and end are shown, or three of all if the window has fewer."""
    times = [100_000_000 * k for k in range(1, 11)]
    assert nearest_times_ns(times, (0.31, 0.78)) == [300_000_000, 500_000_000, 800_000_000]
    assert nearest_times_ns(times, (0.5, 0.5)) == [100_000_000, 500_000_000, 1_000_000_000]
    assert nearest_times_ns(times[:2], (0.0, 1.0)) == times[:2]
    assert nearest_times_ns([], (0.0, 1.0)) == []


def test_outline_is_turned_with_the_tool():
    """A quarter turn by phi takes the body's x axis up, and the turn is counted from the reference pose."""
    corner = np.array([[0.3, 0.1, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    facets = np.array([[0, 1, 2]], dtype=np.int32)
    mesh = ToolMesh(corner, facets, np.zeros(1, dtype=np.int32), ("share",))
    motion = ToolMotion("shank", 2.0, 0.35, 5.0, 0.2 + math.pi / 2, 0.0, 0.0, 0.0)
    world = posed_vertices_m(mesh, motion, 0.2)
    np.testing.assert_allclose(world, [[2.0, 0.1, 5.3], [2.0, 0.0, 5.0], [1.0, 0.0, 5.0]], atol=1e-15)


def test_running_mean_keeps_straight_lines():
    """Centred means leave the inside of a straight line where it is, and a constant everywhere."""
    line = np.arange(20.0)
    np.testing.assert_allclose(running_mean(line, 5)[2:-2], line[2:-2], rtol=1e-13)
    np.testing.assert_allclose(running_mean(np.full(20, 7.0), 6), 7.0, rtol=1e-13)
    assert running_mean(np.array([3.0]), 9) == [3.0]


def verb(module, *words: str) -> int:
    """Runs one verb of the command line."""
    parser = argparse.ArgumentParser()
    module.add_arguments(parser)
    return module.run(parser.parse_args(words))


def test_report_makes_everything_anew(tmp_path, capsys):
    """`subsoil report` writes series, summary and figures from bag and scene, and keeps the run's facts."""
    run = Run(tine())
    directory = run.write(tmp_path / "run")
    (directory / "summary.json").write_text(
        json.dumps({"whole_wall_s": 12.5, "mode": "nodes", "draft_newton_mean": 1})
    )
    assert verb(report_verb, str(directory)) == 0
    summary = json.loads((directory / "summary.json").read_text())
    assert (summary["whole_wall_s"], summary["mode"]) == (12.5, "nodes")
    series = read_series(directory / "bag", run.resolved.scene)
    assert summary["run.draft_newton_mean"] == np.mean(series["draft_newton"])
    assert (directory / "series.csv").read_text().startswith("time_s,draft_newton,")
    assert (directory / "figures/draft.png").is_file()
    assert "draft [N]" in capsys.readouterr().out


def test_report_refuses_a_folder_without_a_run(tmp_path):
    """A wrong folder is bad input."""
    with pytest.raises(InputError, match="no folder of a run"):
        verb(report_verb, str(tmp_path))


def test_bag_verbs(tmp_path, capsys):
    """`subsoil bag info` lists topics with counts; `subsoil bag recover` mends a cut bag in its place."""
    run = Run(tine())
    directory = run.write(tmp_path / "run")
    assert verb(bag_verb, "info", str(directory)) == 0
    row = next(line for line in capsys.readouterr().out.splitlines() if "/subsoil/tool_wrenches" in line)
    assert str(TICKS) in row
    assert verb(bag_verb, "recover", str(directory)) == 0
    assert "is whole" in capsys.readouterr().out
    (directory / "bag/metadata.yaml").unlink()
    path = next((directory / "bag").glob("*.mcap"))
    path.write_bytes(path.read_bytes()[:-40])
    assert verb(bag_verb, "recover", str(directory)) == 0
    assert "mended" in capsys.readouterr().out
    assert verb(bag_verb, "info", str(directory)) == 0


def test_report_of_the_papers_scene_writes_the_table(tmp_path, capsys):
    """The paper's numbers beside ours on the screen, as CSV, JSON and Markdown, and what cannot hold."""
    run = Run(full_machine())
    directory = run.write(tmp_path / "run")
    assert verb(report_verb, str(directory)) == 0
    shown = capsys.readouterr().out
    assert "Impossible: the spring in 2231 N of tension" in shown
    document = json.loads((directory / "reproduction.json").read_text())
    assert {row["quantity"] for row in document["rows"]} >= {"draft, cycle", "draft, run", "spring force"}
    assert (directory / "reproduction.csv").is_file()
    assert (directory / "reproduction.md").is_file()
    assert (directory / "figures/reproduction.png").is_file()
