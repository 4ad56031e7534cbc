"""Each program of `make bench` measures its smallest case; no test looks at a time."""

import json

import pytest

from benchmarks import mechanism, roofline, soil
from benchmarks.scene_phases import PHASES
from benchmarks.soil_cases import GRID, cohesive_case
from subsoil_ros.dem.tools.surface import ToolSurface


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


@pytest.mark.ros
@pytest.mark.slow
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
