"""Each program of `make bench` measures its smallest case; no test looks at a time."""

import json
from pathlib import Path

import pytest

from benchmarks import mechanism, roofline, soil
from benchmarks.run_cache import FailedRun, find_kept_run, kept_run
from benchmarks.scene_phases import PHASES
from benchmarks.soil_cases import GRID, cohesive_case
from subsoil_ros.analysis.summary import flattened
from subsoil_ros.api.execution import execute
from subsoil_ros.dem.tools.surface import ToolSurface
from subsoil_ros.experiments.run_cache import find_run, keep_run
from tests.unit.experiments.test_run_cache import FAST_PULL, SCENES, TOO_FAST, scene


def small(folder, *, quick=True):
    """A bed of some hundred particles; the plate moves 7.5 mm, so that lists are rebuilt."""
    return [cohesive_case(GRID, (0.3, 0.12, 0.2), 300, "small", folder)]


def test_soil(monkeypatch, capsys):
    """Every phase has a part of the time (a renamed kernel would have none); clocks are taken off again."""
    plain = ToolSurface.forces
    monkeypatch.setattr(soil, "throughput_cases", small)
    monkeypatch.setattr(soil, "scaling_cases", lambda folder, counts: small(folder))
    monkeypatch.setattr(roofline, "TRIAD_DOUBLES", 1000)
    soil.main(["--quick", "--json"])
    result = json.loads(capsys.readouterr().out)
    line, phases = result["throughput"][0], result["phases"]["small"]
    assert line["rebuild_count"] > 0
    assert 0.0 < line["contacts_per_particle"] <= line["listed_pairs_per_particle"]
    assert set(phases) == {*PHASES, "other"}
    assert all(part > 0.0 for part in phases.values())
    assert sum(phases.values()) == pytest.approx(1.0)
    assert ToolSurface.forces is plain


def test_mechanism(capsys):
    """Costs of the machine and of two chains; Exudyn's where it is installed."""
    mechanism.main(["--largest", "2"])
    printed = capsys.readouterr().out
    assert "Adams-Moulton PECE" in printed
    assert printed.split()[-4::2] == ["1", "2"]


@pytest.mark.full
def test_lockstep(monkeypatch, capsys):
    """Real processes over DDS: three, and four with the recorder; HELICS where it is installed."""
    from benchmarks import lockstep  # imports rclpy

    monkeypatch.delenv("ROS_DOMAIN_ID", raising=False)
    monkeypatch.setattr(lockstep, "QUICK_TICKS", 300)
    monkeypatch.setattr(lockstep, "WARM_UP_TICKS", 100)
    lockstep.main(["--quick", "--json"])
    result = json.loads(capsys.readouterr().out)
    for key, names in (
        ("lockstep", {"mechanism", "soil", "coupler"}),
        ("lockstep_recorded", {"mechanism", "soil", "coupler", "recorder"}),
    ):
        assert result[key]["processes"] == len(names)
        assert result[key]["exchanges"] == 199
        assert set(result[key]["nodes"]) <= names  # a run too short to be sampled twice gives none


def test_a_benchmark_keeps_its_runs_as_a_sweep_does(tmp_path: Path) -> None:
    """Found by either of the two, with its bag where that is asked for; what fails is told and not kept."""
    tine, cache = SCENES / "tine.yaml", tmp_path / "runs"
    assert find_kept_run(tine, cache, FAST_PULL) is None
    summary = kept_run(tine, cache, FAST_PULL)
    made = find_run(cache, scene().scene_hash)
    assert made is not None
    assert summary == {**flattened(made.summary), "folder": str(made.folder)}
    assert summary == find_kept_run(tine, cache, FAST_PULL)
    assert (made.failure, made.facts["exit_status"]) == (None, 0)
    assert [path.name for path in cache.iterdir()] == [made.folder.name]
    assert not (made.folder / "bag").exists()
    kept_run(tine, cache, FAST_PULL, keep_bag=True)
    assert (made.folder / "bag").is_dir()
    again = keep_run(tmp_path / "sweep", scene(), execute(scene()))
    assert kept_run(tine, tmp_path / "sweep", FAST_PULL)["folder"] == str(again.folder)
    assert (again.folder / "series.csv").read_bytes() == (made.folder / "series.csv").read_bytes()
    with pytest.raises(FailedRun, match=r"(?s)exit 3: .* fast, the soil file"):
        kept_run(tine, tmp_path / "failed", (*FAST_PULL, TOO_FAST))
    assert not list((tmp_path / "failed").iterdir())
