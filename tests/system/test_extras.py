"""A plain installation does what it promises, and names the extra where one is missing."""

import subprocess
import sys
from pathlib import Path

import pytest

import subsoil_ros
from subsoil_ros.cli.main import main
from subsoil_ros.errors import InputError
from subsoil_ros.extras import EXTRA_OF

ROOT = Path(__file__).parents[2]
WITHOUT = f"""
import sys
sys.modules.update(dict.fromkeys({sorted(EXTRA_OF)}))  # None: cannot be imported
"""


def plain(program: str, *arguments: object) -> None:
    """Runs a program that can import no optional library."""
    done = subprocess.run(
        [sys.executable, "-c", WITHOUT + program, *map(str, arguments)],
        cwd=ROOT, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.full
def test_direct_mode_and_bags_need_no_extra(tmp_path):
    """check, run, bag and the libraries of soil tests and calibration work in a plain installation."""
    verb = "from subsoil_ros.cli.main import main\nraise SystemExit(main(sys.argv[1:]))"
    plain(verb, "check", "tine")
    out = tmp_path / "out"
    plain(verb, "run", "mechanism_only", "--mode", "direct", "--set", "duration_s=0.01", "--out", out)
    assert (out / "summary.json").is_file()
    (bag,) = (out / "bag").glob("*.mcap")
    plain(verb, "bag", "info", bag)
    modules = ("experiments.wedge_fit", "experiments.strength_tests", "experiments.run_jobs")
    plain(f"import {', '.join(f'subsoil_ros.{module}' for module in modules)}")


@pytest.mark.parametrize(
    ("words", "extras"),
    [
        (["report", "RUN"], "report"),
        (["report", "RUN", "--html"], "report"),
        (["render", "RUN"], "render,report"),
        (["compare", "RUN", "RUN", "--out", "OUT"], "report"),
        (["sweep", "tine", "--vary", "duration_s=1,2", "--out", "OUT"], "report,study"),
        (["study", "tine", "--out", "OUT"], "report,study"),
        (["run", "tine", "--live", "--mode", "direct", "--out", "OUT"], "live"),
        (["run", "tine", "--set", "soil.device=gpu", "--mode", "direct", "--out", "OUT"], "gpu"),
    ],
    ids=lambda value: value if isinstance(value, str) else " ".join(value),
)
def test_a_missing_extra_is_named(words, extras, monkeypatch, capsys, tmp_path):
    """One message with the command that installs it, exit 2, nothing written."""
    for module in EXTRA_OF:
        monkeypatch.setitem(sys.modules, module, None)
    monkeypatch.chdir(tmp_path)
    assert main(words) == 2
    (message,) = capsys.readouterr().err.strip().splitlines()
    assert message.endswith(f"pip install 'subsoil_ros[{extras}]'")
    assert list(tmp_path.iterdir()) == []


def test_nodes_without_ros_are_refused(monkeypatch, capsys, tmp_path):
    """No ROS 2: exit 2 before anything is compiled or written, with the mode that needs none."""
    monkeypatch.setitem(sys.modules, "subsoil_msgs", None)
    assert main(["run", "tine", "--out", str(tmp_path / "out")]) == 2
    assert "give --mode direct" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(InputError, match=r"serve: needs ROS 2 .* or give the machine or the soil to run"):
        _ = subsoil_ros.serve
