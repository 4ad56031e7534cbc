"""Command line and package start at once: nothing imports what it does not use."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import subsoil_ros
from subsoil_ros.cli.main import VERBS

ROOT = Path(__file__).parents[2]
HEAVY = {
    "dask", "imageio", "jinja2", "matplotlib", "numba", "numpy", "pandas", "pydantic", "pyvista", "rclpy",
    "rosbags", "scipy", "trimesh", "vtkmodules",
}  # fmt: skip
"""Each takes 50 ms or more to import."""


def imported(*words: str) -> set[str]:
    """The heavy modules that a command has imported when it ends."""
    code = (
        "import json, sys\nfrom subsoil_ros.cli.main import main\n"
        f"try:\n    main({list(words)!r})\nexcept SystemExit:\n    pass\n"
        "print()\nprint(json.dumps(sorted({name.partition('.')[0] for name in sys.modules})))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=True,
    )
    return HEAVY & set(json.loads(done.stdout.splitlines()[-1]))


@pytest.mark.parametrize(
    "words", [["--help"], ["--version"], *([verb, "--help"] for verb in VERBS), ["bag", "info", "--help"]],
    ids=" ".join,
)  # fmt: skip
def test_help_imports_nothing_heavy(words):
    """Help needs no arrays, no plots and no ROS."""
    assert imported(*words) == set()


def test_help_names_every_verb():
    """`subsoil --help` lists the verbs with what they do."""
    done = subprocess.run(
        [sys.executable, "-m", "subsoil_ros.cli.main", "--help"],
        env={**os.environ, "PYTHONPATH": str(ROOT), "COLUMNS": "200"},
        capture_output=True,
        text=True,
        check=True,
    )
    assert "JSON Schema of scene files" in done.stdout
    assert set(re.findall(r"^    ([a-z-]+)", done.stdout, re.MULTILINE)) == set(VERBS)


def test_importing_the_package_imports_nothing_else() -> None:
    """The public names are listed, and no library is loaded before one of them is used."""
    program = (
        "import sys, subsoil_ros as s; heavy = {'numpy', 'yaml', 'pydantic', 'numba'} & set(sys.modules);"
        "print(sorted(heavy), dir(s)); s.load_scene"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == f"[] {sorted(subsoil_ros.__all__)}"
    with pytest.raises(AttributeError, match="no attribute 'simulate'"):
        subsoil_ros.simulate  # noqa: B018
