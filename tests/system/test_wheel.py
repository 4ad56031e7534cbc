"""The wheel: everything that the package needs at run time is in it, and it works away from the sources."""

import json
import os
import shutil
import subprocess
import sys
import sysconfig
import venv
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SOURCES = [
    "LICENSE", "README.md", "config", "launch", "msg_defs", "package.xml", "pyproject.toml", "resource",
    "scripts", "setup.cfg", "setup.py", "subsoil_ros",
]  # fmt: skip
SHIPPED = (
    "scenes/*.yaml", "templates/*.yaml", "meshes/*.stl", "soils/*.yaml", "materials/*.yaml",
    "calibration/*.yaml", "presets/*.yaml", "references/*.yaml", "studies/*.yaml", "foxglove/*.json",
    "rviz/*.rviz", "*.json",
)  # fmt: skip


def run(command: list[str | Path], directory: Path, **environment: str) -> str:
    """Standard output of a command that must succeed."""
    kept = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    done = subprocess.run(
        command, cwd=directory, env={**kept, **environment}, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def program(tmp_path_factory) -> Path:
    """The command `subsoil` of a fresh environment into which the wheel was installed.

    The libraries it needs are those of this environment, which a path file names; the package itself is not
    among them, because an editable install is not followed from there.
    """
    folder = tmp_path_factory.mktemp("wheel")
    sources = folder / "sources"
    sources.mkdir()
    for name in SOURCES:
        source = ROOT / name
        if source.is_dir():
            shutil.copytree(
                source, sources / name, symlinks=True, ignore=shutil.ignore_patterns("__pycache__")
            )
        elif source.is_file():
            shutil.copy2(source, sources / name)
    pip = [sys.executable, "-m", "pip"]
    run([*pip, "wheel", "--no-deps", "--no-build-isolation", "--wheel-dir", folder, sources], folder)
    shutil.rmtree(sources)
    prefix = folder / "env"
    venv.create(prefix, symlinks=True, with_pip=False)
    (wheel,) = folder.glob("*.whl")
    run([*pip, "--python", prefix / "bin/python", "install", "--no-deps", "--no-index", wheel], folder)
    version = f"python{sys.version_info.major}.{sys.version_info.minor}"
    libraries = prefix / "lib" / version / "site-packages/libraries.pth"
    libraries.write_text(sysconfig.get_path("purelib") + "\n")
    return prefix / "bin/subsoil"


def test_shipped_files(program):
    """Every file of config/ but programs is in the environment."""
    share = program.parents[1] / "share/subsoil_ros/config"
    for pattern in SHIPPED:
        wanted = {path.name for path in (ROOT / "config").glob(pattern)}
        assert wanted
        assert {path.name for path in share.glob(pattern)} == wanted


@pytest.mark.full
def test_it_runs_without_the_sources(program, tmp_path):
    """In an empty folder: a shipped scene by name, a new scene, its run, its report as a page."""
    shown = run([program, "check", "subsoiler_1s300_quick"], tmp_path)
    assert "share/subsoil_ros/config" in shown.replace("\n", "")
    run([program, "new", "first", "--template", "wedge"], tmp_path)
    command = [
        program,
        "run",
        "first/scene.yaml",
        "--out",
        "out",
        "--mode",
        "direct",
        "--set",
        "duration_s=0.02",
    ]
    cache = str(tmp_path / "cache")  # kernels are kept by their place, and this one goes
    run(command, tmp_path, XDG_CACHE_HOME=cache)
    assert json.loads((tmp_path / "out/summary.json").read_text())["run"]["complete"]
    run([program, "report", "out", "--html"], tmp_path)
    assert (tmp_path / "out/report.html").is_file()


def test_no_folder_is_left_out():
    """Every file of config/ but the program that makes the meshes is one of those above."""
    config = ROOT / "config"
    shipped = {path for pattern in SHIPPED for path in config.glob(pattern)}
    there = {path for path in config.rglob("*.*") if path.suffix not in (".py", ".pyc")}
    assert there == shipped
