"""`subsoil bench lockstep --json`: one object with the cost of an exchange."""

import argparse
import json

import pytest

from subsoil_ros.cli import bench
from subsoil_ros.cli._shared import bench_lockstep

pytestmark = [pytest.mark.ros, pytest.mark.slow]


def test_bench_prints_one_json_object(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Three processes, four with the recorder; every node's share is there, HELICS where installed."""
    monkeypatch.delenv("ROS_DOMAIN_ID", raising=False)
    monkeypatch.setattr(bench_lockstep, "QUICK_TICKS", 1500)
    monkeypatch.setattr(bench_lockstep, "WARM_UP_TICKS", 200)
    parser = argparse.ArgumentParser()
    bench.add_arguments(parser)
    assert bench.run(parser.parse_args(["lockstep", "--json", "--quick"])) == 0
    result = json.loads(capsys.readouterr().out)
    for key, names in (
        ("lockstep", {"mechanism", "soil", "coupler"}),
        ("lockstep_recorded", {"mechanism", "soil", "coupler", "recorder"}),
    ):
        cost = result[key]
        assert cost["processes"] == len(names)
        assert cost["exchanges"] == 1299
        assert 0.0 < cost["wall_us_p10"] <= cost["wall_us_median"] <= cost["wall_us_p90"]
        assert set(cost["nodes"]) <= names  # a run too short to be sampled twice gives none
    assert result["helics"] is None or result["helics"]["wall_us_median"] > 0.0
