"""subsoil study: errors by hand, the shipped designs, and a real study in miniature."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml

from subsoil_ros.cli.main import main
from subsoil_ros.errors import InputError
from subsoil_ros.experiments.run_metrics import METRICS
from subsoil_ros.experiments.run_study import study_jobs
from subsoil_ros.experiments.study_design import StudyDesign, design_of, read_design
from subsoil_ros.experiments.study_errors import Measurement, judge
from subsoil_ros.experiments.study_tables import expected_presets, markdown, wide_table
from subsoil_ros.loading.loader import load_scene

from .designs import TINY

Captured = pytest.CaptureFixture[str]
CONFIG = Path(__file__).parents[3] / "config"
DESIGNS = sorted((CONFIG / "studies").glob("*.yaml"))


def design(**changes: object) -> StudyDesign:
    """A design of three presets beside the reference."""
    content = {
        "seeds": [0, 1, 2],
        "factors": {"step": {"large": [], "huge": []}, "cloud": {"none": []}},
        "additional_references": {"r = 7 mm": {"overrides": []}},
        "metrics": ["draft_mean_newton"],
        **changes,
    }
    return StudyDesign.model_validate(content)


def runs(preset: str, wall_s: float, drafts: list[float]) -> list[Measurement]:
    """A run per draft; seeds from 0 on."""
    return [
        Measurement(preset, seed, wall_s * (1.0 + 0.01 * seed), wall_s, {"draft_mean_newton": draft})
        for seed, draft in enumerate(drafts)
    ]


def made_up() -> list[Measurement]:
    """The reference: 1000 N with a seed scatter of 20 N; `large` 1 % low on each, `huge` anyhow."""
    beds = [980.0, 1000.0, 1020.0]
    return [
        *runs("reference", 100.0, beds),
        *runs("step: large", 20.0, [bed - 10.0 + (0.5, -0.5, 0.0)[k] for k, bed in enumerate(beds)]),
        *runs("step: huge", 10.0, [940.0, 1030.0, 970.0]),
        *runs("cloud: none", 90.0, beds),
        *runs("r = 7 mm", 900.0, [1040.0]),
    ]


def test_errors_by_hand() -> None:
    """Means and intervals of paired differences, speed-ups as ratios, and the verdicts."""
    found = {item.name: item for item in judge(design(), made_up(), {})}
    large = found["step: large"].errors["draft_mean_newton"]
    assert large.mean == pytest.approx(-0.010)
    left = math.sqrt((0.3**2 + 0.5**2 + 0.2**2) / 2.0)  # scatter of value - 0.99 reference [N]
    assert large.half_width == pytest.approx(4.3027 * left / math.sqrt(3.0) / 1000.0, rel=1e-3)
    assert found["step: large"].verdict("draft_mean_newton") == "resolved"
    assert found["step: large"].speed_up == pytest.approx((5.0, 5.0, 5.0))
    assert found["step: huge"].errors["draft_mean_newton"].mean == pytest.approx(-20.0 / 1000.0)
    assert found["step: huge"].verdict("draft_mean_newton") == "within seed scatter"
    assert found["cloud: none"].verdict("draft_mean_newton") == "same"
    assert found["reference"].bound == 0.0


def test_errors_against_a_single_finer_run() -> None:
    """Against one run of 1040 N its scatter is the reference's, 20 N, here times the ratio of both."""
    found = {item.name: item for item in judge(design(), made_up(), {})}
    error = found["reference"].errors_against["r = 7 mm"]["draft_mean_newton"]
    assert error.mean == pytest.approx(-40.0 / 1040.0)
    both = 20.0 * math.sqrt(1.0 / 3.0 + (1000.0 / 1040.0) ** 2)
    assert error.half_width == pytest.approx(4.3027 * both / 1040.0, rel=1e-3)


def test_pareto_set() -> None:
    """What is beaten in time and error is out; what is cheaper or nearer than all others is in."""
    found = {item.name: item.pareto for item in judge(design(), made_up(), {})}
    # `none` costs less than the reference and is the same, so the reference is out
    assert found == {"reference": False, "step: large": True, "step: huge": True, "cloud: none": True}
    slow = [*made_up(), *runs("step: huge", 30.0, [940.0, 1030.0, 970.0])]
    assert not {item.name: item.pareto for item in judge(design(), slow, {})}["step: huge"]


def test_what_lost_its_seeds_is_in_no_pareto_set() -> None:
    """With one seed left of three, or without the quantity that is judged, nothing bounds the error."""
    left = [item for item in made_up() if item.preset != "step: huge" or item.seed == 0]
    bare = [replace(item, metrics={}) if item.preset == "cloud: none" else item for item in left]
    found = {item.name: item for item in judge(design(), bare, {})}
    for name in ("step: huge", "cloud: none"):
        assert math.isinf(found[name].bound)
        assert not found[name].pareto


def test_a_frequency_is_told_to_a_line_of_the_spectrum() -> None:
    """Lines of 0.5 Hz apart: 7 and 7.5 Hz on every seed are no resolved difference; the same is the same."""

    def measured(preset: str, hertz: float) -> list[Measurement]:
        metrics = {"draft_frequency_hz": hertz, "frequency_resolution_hz": 0.5}
        return [Measurement(preset, seed, 1.0, 1.0, metrics) for seed in range(3)]

    runs = [*measured("reference", 7.0), *measured("step: large", 7.5), *measured("step: huge", 7.0)]
    found = {item.name: item for item in judge(design(), runs, {})}
    assert found["step: large"].verdict("draft_frequency_hz") == "within seed scatter"
    assert found["step: huge"].verdict("draft_frequency_hz") == "same"


def test_a_dominant_frequency_that_the_reference_has_not() -> None:
    """There is no error to give: table, figure and preset say how many runs have it."""
    measured = [
        replace(item, metrics={**item.metrics, "draft_frequency_hz": 7.2, "frequency_resolution_hz": 0.5})
        if item.preset == "step: large" or (item.preset, item.seed) == ("step: huge", 1)
        else item
        for item in made_up()
    ]
    found_one = design(presets={"quick": {"step": "large"}}, factors={"step": {"large": [], "huge": []}})
    measured += [replace(item, preset="quick") for item in measured if item.preset == "step: large"]
    found = judge(found_one, measured, {})
    rows = {
        line.split("|")[1].strip(): line
        for line in markdown(found, found_one, measured).splitlines()
        if "|" in line
    }
    assert "dominant frequency" in rows["preset"]
    assert "(7.2 Hz in 3 of 3)" in rows["step: large"]
    assert "(7.2 Hz in 1 of 3)" in rows["step: huge"]
    assert "(none)" in rows["reference"]
    table = pd.DataFrame(wide_table(found, found_one)).set_index("preset")
    assert table["draft_frequency_hz_runs"].to_dict() == {
        "reference": 0, "step: large": 3, "step: huge": 1, "quick": 3
    }  # fmt: skip
    facts = {"machine": "two cores", "threads": 1, "code": "0"}
    presets = expected_presets(found, found_one, facts, 1.0, "scene.yaml")
    assert presets["quick"]["expected"]["notes"] == ["dominant frequency: 7.2 Hz in 3 of 3; reference: none"]
    assert "notes" not in presets["reference"]["expected"]
    none = judge(design(), made_up(), {})
    assert "Dominant frequency: no run has one" in markdown(none, design(), made_up())


def test_a_force_near_zero_is_judged_by_the_draft() -> None:
    """Vertical forces of -10, 0 and 4 N against 30 N more on each bed of 1000 N: 3 % of the draft, to 0."""
    upward = {"reference": (-10.0, 0.0, 4.0), "step: large": (20.0, 30.0, 34.0)}
    measured = [
        replace(item, metrics={**item.metrics, "vertical_mean_newton": upward[item.preset][item.seed]})
        for item in made_up()
        if item.preset in upward
    ]
    found = {item.name: item for item in judge(design(), measured, {})}
    error = found["step: large"].errors["vertical_mean_newton"]
    assert (error.mean, error.half_width) == pytest.approx((0.03, 0.0), abs=1e-12)


def test_intervals_of_records() -> None:
    """Means of 1000 +- 30 and 40 N on two seeds, and 1100 +- 33 N on one: +10 % with both widths in it."""
    widths = {("reference", 0): 30.0, ("reference", 1): 40.0, ("step: large", 0): 33.0}
    drafts = {"reference": 1000.0, "step: large": 1100.0}
    measured = [
        Measurement(
            preset, seed, 1.0, 1.0, {"draft_mean_newton": drafts[preset]}, {"draft_mean_newton": width}
        )
        for (preset, seed), width in widths.items()
    ]
    found = {item.name: item for item in judge(design(intervals="records"), measured, {})}
    assert found["reference"].values["draft_mean_newton"].half_width == pytest.approx(25.0)
    error = found["step: large"].errors["draft_mean_newton"]
    assert error.mean == pytest.approx(0.1)
    assert error.half_width == pytest.approx(math.hypot(33.0, 1.1 * 25.0) / 1000.0)
    assert found["step: large"].verdict("draft_mean_newton") == "resolved"
    first = [item for item in measured if item.seed == 0]
    alone = {item.name: item for item in judge(design(intervals="records", seeds=[0]), first, {})}
    assert alone["step: large"].bound == pytest.approx(0.1 + math.hypot(33.0, 1.1 * 30.0) / 1000.0)
    with pytest.raises(ValueError, match=r"with intervals: records it is 0\.95"):
        design(intervals="records", confidence=0.9)


def test_one_seed_says_so() -> None:
    """Numbers without intervals, and no word of a difference."""
    alone = design(seeds=[0])
    measured = [item for item in made_up() if item.seed == 0]
    found = judge(alone, measured, {})
    large = next(item for item in found if item.name == "step: large")
    assert large.verdict("draft_mean_newton") == "one seed"
    assert "One seed" in markdown(found, alone, measured)
    assert "+-" not in markdown(found, alone, measured).split("Errors against")[0]


def test_table_names_failures_and_what_is_not_resolved() -> None:
    """A preset that failed has its message; a difference within the scatter is marked."""
    measured = [item for item in made_up() if item.preset != "cloud: none"]
    found = judge(design(), measured, {"cloud: none": ["tick 7: NaN"] * 3})
    text = markdown(found, design(), measured)
    assert "- `reference`, seed 2, 100 s: mean draft 1020." in text
    assert "- `r = 7 mm`, seed 0, 900 s: mean draft 1040." in text
    assert "| cloud: none | failed: tick 7: NaN |" in text
    row = next(line for line in text.splitlines() if line.startswith("| step: huge"))
    assert "(~)" in row
    table = pd.DataFrame(wide_table(found, design())).set_index("preset")
    assert table.loc["cloud: none", "failures"] == 3
    assert table.loc["step: large", "draft_mean_newton_verdict"] == "resolved"
    assert table.loc["step: large", "draft_mean_newton_error_high"] < 0.0


OF_ANOTHER = {"limit_loam": "field_tine"}
"""Scenes of designs that are named by --design."""


@pytest.mark.full
@pytest.mark.parametrize("path", DESIGNS, ids=lambda path: path.stem)
def test_shipped_designs_fit_their_scenes(path: Path) -> None:
    """Every preset is a scene that loads, and each factor changes something."""
    scene = CONFIG / "scenes" / f"{OF_ANOTHER.get(path.stem, path.stem)}.yaml"
    assert path.stem in OF_ANOTHER or design_of(scene) == path
    found = read_design(path)
    jobs = study_jobs(str(scene), (), found.model_copy(update={"seeds": (0,)}))
    hashes = {job.point.name: job.scene.scene_hash for job in jobs}
    assert len(set(hashes.values())) == len(hashes)


def test_knobs_that_run_alone() -> None:
    """All of them, or those that are named; presets may use the others."""
    names = [preset.point.name for preset in design().all_presets()]
    alone = [preset.point.name for preset in design(one_at_a_time=["step"]).all_presets()]
    assert alone == [name for name in names if not name.startswith("cloud")]
    assert alone != names


PRESETS = {
    "fine": "reference",
    "standard": "wedge model",
    "coarse": "wedge model, 2 ms, rows of 10 ms",
    "narrow": "10 mm, 0.6 m wide, plain ground, mixed",
}


@pytest.mark.full
def test_presets_of_the_paper_are_runs_of_its_study() -> None:
    """What `check` quotes was measured of this very scene: the same hash, seed by seed."""
    scene = CONFIG / "scenes" / "subsoiler_1s300.yaml"
    found = read_design(CONFIG / "studies" / "subsoiler_1s300.yaml")
    jobs = study_jobs(str(scene), (), found.model_copy(update={"additional_references": {}}))
    order = [job.point.seed for job in jobs]
    assert order == sorted(order, key=found.seeds.index)  # near each other in time, for their ratios
    hashes = {(job.point.name, job.point.seed): job.scene.scene_hash for job in jobs}
    for preset, measured in PRESETS.items():
        key = "soil.seed" if preset in ("standard", "coarse") else "soil.bed.seed"
        resolved = load_scene(scene, [f"preset={preset}", f"{key}=1"])
        assert resolved.scene_hash == hashes[measured, 1], preset
        assert resolved.presets[preset].expected is not None
    assert list(resolved.presets) == list(PRESETS)


@pytest.mark.parametrize("preset", PRESETS)
def test_presets_of_the_paper_quote_its_study(preset: str) -> None:
    """Errors, intervals and times in the scene are those of the shipped table, to four digits."""
    resolved = load_scene(CONFIG / "scenes" / "subsoiler_1s300.yaml")
    expected = resolved.presets[preset].expected
    assert expected is not None
    studies = CONFIG.parent / "reproduction/yuan_yu_2020/results/studies"
    table = pd.read_csv(studies / "subsoiler_1s300.csv").set_index("preset")
    row = table.loc[PRESETS[preset]]
    quoted = {f"{name}_error": error for name, error in expected.errors.items()}
    quoted |= {
        f"{name}_error_vs_{reference}": error
        for reference, errors in expected.errors_against.items()
        for name, error in errors.items()
    }
    assert list(expected.errors_against) == ["r = 7 mm"]
    assert row["wall_s"] / resolved.scene.duration_s == pytest.approx(
        expected.wall_s_per_simulated_s, rel=1e-3
    )
    for column, error in quoted.items():
        found = [row[column], row[f"{column}_low"], row[f"{column}_high"]]
        name = column.removesuffix("_error")
        if PRESETS[preset] == "reference" and name in expected.errors:  # the scatter of its own mean
            half = row[f"{name}_high"] / row[name] - 1.0
            found = [0.0, -half, half]
        assert found == pytest.approx([error.mean, error.low, error.high], rel=1e-3, abs=1e-9), column
    relative = [metric.name for metric in METRICS if metric.relative]
    shown = {name for name in relative if not np.isnan(row.get(f"{name}_error", np.nan))}
    assert set(expected.errors) == shown


def test_reference_of_the_paper_is_what_was_agreed() -> None:
    """The full bin, float64, a step that its monitors let pass, exchange every step."""
    found = read_design(CONFIG / "studies" / "subsoiler_1s300.yaml")
    found = found.model_copy(update={"one_at_a_time": (), "presets": {}, "additional_references": {}})
    scene = next(iter(study_jobs(str(CONFIG / "scenes" / "subsoiler_1s300.yaml"), (), found))).scene
    soil = scene.scene.particle_soil
    assert soil is not None
    assert (soil.bin.length_m, soil.bin.width_m, soil.bin.depth_m, soil.particles.radius_m) == (
        2.0,
        1.4,
        0.4,
        0.01,
    )
    assert (soil.precision, scene.timing.soil_steps) == ("float64", 1)
    from subsoil_ros.limits.stable_steps import step_limits

    assert 0.55 < scene.timing.soil_step_s / step_limits(soil)[0].limit_s <= 0.6


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"factor": {}}, "factor: unknown key 'factor'; did you mean 'factors'?"),
        ({"seeds": []}, "seeds: given a list of 0; it must be a list of at least 1 entries"),
        ({"seeds": [1, 1]}, "seeds: one is given twice"),
        ({"presets": {"a": {"steps": "x"}}}, "presets.a: no factor 'steps'"),
        ({"presets": {"a": {"soil_step": "aut"}}}, "presets.a.soil_step: no value 'aut'"),
        ({"one_at_a_time": ["stap"]}, "one_at_a_time: no factor 'stap'"),
        ({"metrics": ["draft"]}, "metrics: no metric 'draft'"),
        ({"additional_references": {"reference": {"overrides": []}}}, "'reference' names another run"),
    ],
)
def test_bad_design(tmp_path: Path, change: dict, words: str) -> None:
    """Refused with the place."""
    path = tmp_path / "design.yaml"
    path.write_text(yaml.safe_dump({**TINY, **change}))
    with pytest.raises(InputError) as caught:
        read_design(path)
    assert words in str(caught.value)


def test_a_wrong_knob_shows_before_anything_runs(tmp_path: Path, capsys: Captured) -> None:
    """A key that the scene has not ends the study with exit status 2 and no folder."""
    path = tmp_path / "design.yaml"
    path.write_text(
        yaml.safe_dump({**TINY, "factors": {"skin": {"thin": ["soil.skn_m=0.001"]}}, "presets": {}})
    )
    scene = str(CONFIG / "scenes" / "tine.yaml")
    assert main(["study", scene, "--design", str(path), "--out", str(tmp_path / "out")]) == 2
    assert "did you mean 'skin_m'" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_runs_of_unequal_length_have_no_times_to_compare(tmp_path: Path, capsys: Captured) -> None:
    """A scene that ends when its mean is known is refused."""
    path = tmp_path / "design.yaml"
    path.write_text(
        yaml.safe_dump(design().model_dump(mode="json", exclude_defaults=True) | {"overrides": []})
    )
    words = ["study", "field_tine", "--design", str(path), "--out", str(tmp_path / "out")]
    assert main(words) == 2
    assert "add stop_when=null to the overrides" in capsys.readouterr().err


def test_list_runs_nothing(capsys: Captured) -> None:
    """--list prints every preset of a study with its size."""
    assert main(["study", "tine", "--list"]) == 0  # a shipped scene by its name
    text = capsys.readouterr().out
    assert "reference" in text
    assert "radius: 14 mm" in text
