"""What `subsoil report` and `subsoil bag` write and print."""

import argparse
import json

import numpy as np
import pytest

from subsoil_ros.analysis.series import read_series
from subsoil_ros.cli import bag as bag_verb
from subsoil_ros.cli import report as report_verb
from subsoil_ros.errors import InputError
from tests.unit.analysis.made_up_runs import TICKS, Run, full_machine, tine


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
        json.dumps({"run": {"whole_wall_s": 12.5, "mode": "nodes"}, "series": 1})
    )
    assert verb(report_verb, str(directory)) == 0
    summary = json.loads((directory / "summary.json").read_text())
    assert (summary["run"]["whole_wall_s"], summary["run"]["mode"]) == (12.5, "nodes")
    series = read_series(directory / "bag", run.resolved.scene)
    assert summary["series"]["draft_newton"]["run"]["mean"] == np.mean(series["draft_newton"])
    assert (directory / "series.csv").read_text().startswith("time_s,draft_newton,")
    assert (directory / "figures/draft.png").is_file()
    assert (directory / "results.csv").read_text().startswith("quantity,value,half_width,unit\ndraft,")
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
    assert "is complete" in capsys.readouterr().out
    (directory / "bag/metadata.yaml").unlink()
    path = next((directory / "bag").glob("*.mcap"))
    path.write_bytes(path.read_bytes()[:-40])
    assert verb(bag_verb, "recover", str(directory)) == 0
    assert "recovered" in capsys.readouterr().out
    assert verb(bag_verb, "info", str(directory)) == 0


def test_report_shows_the_reference(tmp_path, capsys):
    """The values that the scene's reference file gives: on the screen, as CSV, and in the page."""
    directory = Run(full_machine()).write(tmp_path / "run")
    assert verb(report_verb, str(directory), "--html") == 0
    assert "series.body.shank.z_m.run.moving_10ms.range" in capsys.readouterr().out
    rows = (directory / "reference.csv").read_text().splitlines()
    assert len(rows) == 11
    assert rows[1].startswith("series.draft_newton.moving_10ms.min,N,")
    page = (directory / "report.html").read_text()
    assert "<td>particle radius</td>" in page[: page.index('id="warnings"')]
    assert "draft [N]" in page[page.index("const plots") :]
    assert "<h2>Beside Yuan &amp; Yu (2020)</h2>" in page
    assert "contradicts itself" in page
