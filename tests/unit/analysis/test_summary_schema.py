"""summary.json: real runs against its JSON Schema."""

import argparse
import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import jsonschema
import pytest

import subsoil_ros
from subsoil_ros.analysis.summary import SCHEMA_VERSION, RunColumn, flattened
from subsoil_ros.cli import schema as schema_verb
from subsoil_ros.errors import RunError
from tests.unit.analysis.made_up_runs import Run, full_machine, tine

ROOT = Path(__file__).parents[3]
SCHEMA = json.loads((ROOT / "config/summary.schema.json").read_text())
WEDGE = {
    "soil": {"model": "wedge", "file": str(ROOT / "config/soils/paper_grid.yaml")},
    "duration_s": 0.3,
    "record.series_ticks": 3,
    "report.window_inside_m": 0.0,
}
TOO_FAST = {
    "tools.tine.path.speed_x_m_per_s": {"kind": "ramp", "start_value": 0.5, "end_value": 4.0, "end_s": 0.3}
}


def check(summary: Mapping[str, Any]) -> None:
    """Raise jsonschema's error for a summary that the schema does not allow."""
    jsonschema.Draft202012Validator(SCHEMA).validate(summary)


def test_schema_is_current(tmp_path: Path) -> None:
    """The file is what `subsoil schema --summary` writes, valid, and of the version that summaries name."""
    parser = argparse.ArgumentParser()
    schema_verb.add_arguments(parser)
    schema_verb.run(parser.parse_args(["--summary", "--out", str(tmp_path / "schema.json")]))
    assert json.loads((tmp_path / "schema.json").read_text()) == SCHEMA
    jsonschema.Draft202012Validator.check_schema(SCHEMA)
    assert SCHEMA["$defs"]["Summary"]["properties"]["schema_version"]["const"] == SCHEMA_VERSION


def test_numbers_that_are_not_finite_become_null() -> None:
    """Whole numbers stay whole, and what the run does not have is left out."""
    column = RunColumn(mean=float("nan"), min=-2, max=float("inf"), std=0.5)
    assert json.dumps(column.model_dump(exclude_unset=True)) == (
        '{"mean": null, "min": -2, "max": null, "std": 0.5}'
    )


def test_schema_describes_objects_that_are_closed() -> None:
    """Every object of the schema lists its keys, so that a key that it does not know is an error."""

    def objects(node: Any) -> Iterator[dict[str, Any]]:
        if isinstance(node, dict):
            if node.get("type") == "object":
                yield node
            for value in node.values():
                yield from objects(value)

    assert all("additionalProperties" in item for item in objects(SCHEMA))


def test_summaries_of_runs(tmp_path: Path) -> None:
    """A machine without soil, a tine and a machine as made up for particles, a tine on the wedge model."""
    check(subsoil_ros.run("mechanism_only", overrides={"duration_s": 0.02}).summary)
    wedge = subsoil_ros.run("tine", tmp_path / "wedge", overrides=WEDGE)
    check(wedge.summary)
    assert wedge.summary == json.loads((tmp_path / "wedge" / "summary.json").read_text())
    for name, made in (("tine", tine()), ("machine", full_machine())):
        check(subsoil_ros.read_run(Run(made).write(tmp_path / name)).summary)


def test_summary_of_a_failed_run(tmp_path: Path) -> None:
    """It names the failure, and has the metrics of what was recorded before."""
    with pytest.raises(RunError):
        subsoil_ros.run("tine", tmp_path / "run", overrides={**WEDGE, **TOO_FAST})
    summary = json.loads((tmp_path / "run" / "summary.json").read_text())
    check(summary)
    assert not summary["run"]["complete"]
    assert "fitted up to" in summary["run"]["failure"]
    assert summary["series"]


def test_summary_of_a_run_without_a_bag() -> None:
    """Nothing but the scene and how the run went."""
    summary = subsoil_ros.run("tine", overrides={**WEDGE, "record.bag": False}).summary
    check(summary)
    assert set(summary) == {"schema_version", "scene", "run"}


def test_other_keys_are_refused() -> None:
    """The schema is closed: the test above would see a key that is not documented."""
    summary = subsoil_ros.run("tine", overrides=WEDGE).summary
    for place in (summary, summary["run"], summary["series"]["draft_newton"], summary["loads"]):
        place["unknown"] = 1
        with pytest.raises(jsonschema.ValidationError, match="unknown"):
            check(summary)
        del place["unknown"]


def test_paths_are_keys_joined_by_dots() -> None:
    """A column's own dots stand in its path."""
    summary = {"series": {"body.arm.x_m": {"mean": 1.0, "run": {"max": None}}}, "lists": [1, 2]}
    assert flattened(summary) == {
        "series.body.arm.x_m.mean": 1.0, "series.body.arm.x_m.run.max": None, "lists": [1, 2],
    }  # fmt: skip
