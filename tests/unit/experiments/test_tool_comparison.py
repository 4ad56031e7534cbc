"""Tools beside each other: the verdict in words, quantities over fields, intervals that are not known."""

import json
import math
import shutil
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from subsoil_ros.analysis.intervals import Interval, t_quantile
from subsoil_ros.cli.compare import LEAST_FIELDS, MOST_FIELDS
from subsoil_ros.experiments.run_cache import CachedRun
from subsoil_ros.experiments.run_sweep import Sweep
from subsoil_ros.experiments.sweep_points import Variation, one_soil
from subsoil_ros.experiments.tool_comparison import Side, quantities_of_runs, quantities_over_fields
from subsoil_ros.experiments.verdict import cautions, quantity_rows, verdicts
from subsoil_ros.figures.comparison import Difference, Source
from subsoil_ros.loading.loader import load_scene


@pytest.mark.parametrize(
    ("ratio", "half", "fields", "words"),
    [
        (0.915, 0.025, 1, "b needs 6.0 to 11.0 % less draft than a: shown in this field"),
        (1.10, 0.02, 3, "b needs 8.0 to 12.0 % more draft than a: shown"),
        (1.00, 0.02, 1, "b and a need the same draft to 2.0 %: shown in this field"),
        (
            0.98,
            0.06,
            1,
            "b against a: not resolved, -8.0 to +4.0 % of draft; runs 4.0 times as long would resolve a "
            "difference of 3 %",
        ),
        (0.98, 0.06, 3, "b against a: not resolved, -8.0 to +4.0 % of draft; some 5 fields in all"),
        (0.98, math.nan, 1, "b against a: no verdict"),
        (0.98, 0.0, 1, "b against a: no verdict"),
    ],
)  # fmt: skip
def test_the_verdict_follows_the_interval(ratio: float, half: float, fields: int, words: str) -> None:
    """Of the difference of the means over shared times, as a part of the first; none without an interval."""
    found = [
        Difference("draft_newton", "mean", (900.0, 1.0)),
        Difference("draft_newton", "shared_mean", (1000.0, 1000.0 * ratio), (0.0, 1.0), (0.0, half)),
        Difference("tool.tine.force_z_newton", "shared_mean", (1.0, 2.0), (0.0, 0.1), (0.0, 0.1)),
    ]
    (line,) = verdicts(found, ["a", "b"], fields)
    assert line.startswith(words)


def side(folder: Path, label: str, drafts: Mapping[int, float], verdict: str = "no drift seen") -> Side:
    """Runs as folders with what the comparison reads: side force a tenth, section of 0.05 m2."""
    runs = {}
    for seed, draft in drafts.items():
        at = folder / f"{label}{seed}"
        at.mkdir()
        runs[seed] = CachedRun(at)
        (at / "scene.yaml").write_text("soil: {bed: {seed: 0}}\ntools: {tine: {}, gauge: {role: wheel}}\n")
        series = {
            "draft_newton": {"mean": draft, "stationarity": {"verdict": verdict, "drift": 0.2}},
            "tool.tine.force_z_newton": {"mean": -0.2 * draft + seed},
            "tool.tine.force_y_newton": {"mean": 0.1 * draft},
            "tool.gauge.force_z_newton": {"mean": 1e6},
        }
        summary = {"window": {}, "run": {}, "series": series, "disturbance": {"area_m2": 0.05}}
        (at / "summary.json").write_text(json.dumps(summary))
    return Side(label, runs)


def test_equal_seeds_are_paired(tmp_path: Path) -> None:
    """Fields that differ by hundreds of newtons: Student's t of the differences alone; forces in parts of the
    draft, without wheels; a section that is equal in all fields has no interval."""
    one = side(tmp_path, "one", {1: 1000.0, 2: 1200.0, 3: 1400.0})
    two = side(tmp_path, "two", {1: 901.0, 2: 1100.0, 3: 1299.0})
    found = {item.column: item for item in quantities_over_fields([one, two])}
    assert list(found) == [
        "draft_newton",
        "vertical_force_newton",
        "side_force_newton",
        "loosened_section_m2",
    ]
    draft, upward = found["draft_newton"], found["vertical_force_newton"]
    assert draft.values == (1200.0, 1100.0)
    assert draft.half_widths[1] == pytest.approx(4.3027 / math.sqrt(3.0), rel=1e-4)
    assert upward.against_first(1) == pytest.approx((20.0, 20.0 / 1200.0))
    assert math.isnan(found["loosened_section_m2"].half_widths[1])
    headings, rows = quantity_rows(list(found.values()), ["one", "two"])
    assert headings == ["quantity", "one", "two", "two - one", "in %"]
    assert rows[0][1:] == ["1200", "1100", "-100 +- 2.484", "-8.3 +- 3.2"]
    assert rows[3][1:] == ["500", "500", "+0", "+0.0"]


def test_power_is_that_of_all_tools_at_their_own_speeds(tmp_path: Path) -> None:
    """Without a mechanism: 1000 N at 0.5 m/s and, on the second tool, at 0.25 m/s make 750 W."""
    times = 0.01 * np.arange(400)
    columns = {"time_s": times, "draft_newton": np.full(400, 2000.0)}
    for name, speed in (("tine", 0.5), ("gauge", 0.25)):
        columns[f"tool.{name}.force_x_newton"] = np.full(400, -1000.0)
        columns[f"tool.{name}.velocity_x_m_per_s"] = np.full(400, speed)
    sides = [side(tmp_path, label, {1: 2000.0}) for label in ("one", "two")]
    for item in sides:
        document = item.first.summary | {"loads": {"power": {"draft_watt": {"mean": 750.0}}}}
        (item.first.folder / "summary.json").write_text(json.dumps(document))
    fresh = [Side(item.label, {1: CachedRun(item.first.folder)}) for item in sides]
    sources = [Source(item.label, columns, (1.0, 3.0)) for item in fresh]
    found = {item.column: item for item in quantities_of_runs(fresh, sources)}
    assert found["power_watt"].values == pytest.approx((750.0, 750.0))


def test_drift_and_unlike_soils_are_said(tmp_path: Path) -> None:
    """In how many fields and by how much; which parts of the soil differ."""
    one = side(tmp_path, "one", {1: 1.0, 2: 2.0}, "drifts")
    two = side(tmp_path, "two", {1: 1.0, 2: 2.0})
    for seed, run in two.runs.items():
        soil = f"soil: {{bed: {{seed: {seed}}}, window: {{}}}}\n"
        (run.folder / "scene.yaml").write_text(soil)
    few, drifts, unlike = cautions([one, two])
    assert few.startswith("two fields: ")
    assert drifts.startswith("one: its draft drifts, by +20 % over the window")
    assert drifts.endswith("(2 of 2 fields)")
    assert unlike.startswith("two and one differ in soil.bed: ")


def test_errors_and_range_of_a_wedge_model_are_said(tmp_path: Path) -> None:
    """A difference may be that of the model, the more where it is extrapolated."""
    one = side(tmp_path, "one", {1: 1.0, 2: 2.0, 3: 3.0})
    for run in one.runs.values():
        (run.folder / "scene.yaml").write_text("soil: {model: wedge}\n")
    (out, *_) = one.runs.values()
    beyond = out.summary | {"loads": {"extrapolated": {"tine": {"rake_rad": {"part": 0.2}}}}}
    (out.folder / "summary.json").write_text(json.dumps(beyond))
    runs = {seed: CachedRun(run.folder) for seed, run in one.runs.items()}
    model, left = cautions([Side("one", runs)])
    assert model.startswith("drafts of a wedge model err by up to 7 % in loam")
    assert left.startswith("one: left the range in which its wedge model was fitted")
    assert left.endswith("(1 of 3 fields)")


@pytest.mark.parametrize(
    ("interval", "words"),
    [
        (Interval(-4.21, 0.0, 3), "-4.21"),
        (Interval(-4.21, math.nan, 1), "-4.21"),
        (Interval(-4.21, 1e-14, 3), "-4.21"),
        (Interval(-4.21, 0.0031, 3), "-4.21 +- 0.003"),
        (Interval(-4.21, 0.31, 3), "-4.21 +- 0.31"),
    ],
)
def test_no_interval_is_printed_as_zero(interval: Interval, words: str) -> None:
    """Seeds that change nothing are no certainty."""
    assert interval.text(".2f") == words


def test_scenes_in_short_get_one_soil(tmp_path: Path) -> None:
    """The finest particles and the largest field that one of the tools asks for; what a scene gives stays."""
    scenes = []
    for name in ("share", "shank"):
        path = tmp_path / f"{name}.yaml"
        mesh = load_scene("tine").directory / f"../meshes/{name}.stl"
        path.write_text(
            f"soil: loam\ntools: {{tine: {{mesh: {mesh}, depth_m: 0.2, speed_m_per_s: 0.5}}}}\ntravel_m: 3\n",
            encoding="utf-8",
        )
        scenes.append(path)
    apart = [load_scene(path) for path in scenes]
    together = [load_scene(path, one_soil(apart)) for path in scenes]
    soils = [scene.scene.particle_soil for scene in together]
    finest = min(scene.scene.particle_soil.particles.bounds_m for scene in apart)
    assert [soil.particles.bounds_m for soil in soils] == [pytest.approx(finest)] * 2
    assert apart[0].scene.particle_soil.particles != apart[1].scene.particle_soil.particles
    assert soils[0].bin == soils[1].bin != apart[1].scene.particle_soil.bin
    assert len({scene.scene.tools["tine"].setback_m for scene in together}) == 1
    given = [load_scene(path, ["soil.particles.radius_m=0.02"]) for path in scenes]
    assert not any("radius_m" in change for change in one_soil(given))


def test_sweeps_over_meshes_have_one_soil(tmp_path: Path) -> None:
    """Tools that would derive other particles and fields get the same ones; files lie beside the scene."""
    meshes = load_scene("tine").directory / "../meshes"
    for name in ("share", "shank"):
        shutil.copy(meshes / f"{name}.stl", tmp_path)
    scene = tmp_path / "tine.yaml"
    scene.write_text(
        "soil: loam\ntools: {tine: {mesh: share.stl, depth_m: 0.2, speed_m_per_s: 0.5}}\ntravel_m: 3\n",
        encoding="utf-8",
    )
    vary = (Variation("tools.tine.mesh", ("share.stl", "shank.stl")),)
    first, second = (job.scene.scene for job in Sweep(str(scene), (), vary).jobs())
    assert first.tools != second.tools
    assert first.particle_soil.particles == second.particle_soil.particles
    assert first.particle_soil.bin == second.particle_soil.bin


@pytest.mark.parametrize("percent", [0.5, 1.0, 2.5])
def test_intervals_that_decide_when_to_stop(percent: float) -> None:
    """Normal differences of deviation 1, fields added as by --until: the true mean is held in 91 to 95 %."""
    drawn = np.random.default_rng(3).normal(size=(40_000, MOST_FIELDS))
    count = np.arange(1, MOST_FIELDS + 1)
    mean = drawn.cumsum(axis=1) / count
    spread = np.sqrt(np.maximum((drawn**2).cumsum(axis=1) - count * mean**2, 0.0) / np.maximum(count - 1, 1))
    half = np.array([1.0, *(t_quantile(n - 1) for n in count[1:])]) * spread / np.sqrt(count)
    narrow = half <= percent
    narrow[:, : LEAST_FIELDS - 1], narrow[:, -1] = False, True
    at = narrow.argmax(axis=1)[:, None]
    held = np.abs(np.take_along_axis(mean, at, 1)) <= np.take_along_axis(half, at, 1)
    assert 0.905 <= held.mean() <= 0.955
