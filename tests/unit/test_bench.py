"""`subsoil bench mechanism --json`: one object with the cost of the machine and of chains."""

import argparse
import json

import pytest

from subsoil_ros.cli import bench


def test_bench_prints_one_json_object(capsys: pytest.CaptureFixture[str]) -> None:
    """The keys are there, costs are positive; without Exudyn the comparison is null."""
    parser = argparse.ArgumentParser()
    bench.add_arguments(parser)
    assert bench.run(parser.parse_args(["mechanism", "--json", "--largest", "2"])) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["machine_us_per_step"] > 0.0
    assert result["machine_fixed_us_per_step"] > 0.0
    assert [entry["bodies"] for entry in result["chain"]] == [1, 2]
    assert (result["exudyn_us_per_step"] is None) == (result["times_faster_than_exudyn"] is None)
