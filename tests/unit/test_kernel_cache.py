"""Compiled kernels never outlive the sources they were made from."""

import os
import subprocess
import sys

import pytest

from subsoil_ros.kernel_cache import kernel_cache_folder


def test_any_changed_source_changes_the_folder(tmp_path):
    """The folder follows the content of every source, not only of the file that defines a kernel."""
    caller, callee = tmp_path / "pairs.py", tmp_path / "contact.py"
    caller.write_text("calls contact")
    callee.write_text("stiffness")
    before = kernel_cache_folder([tmp_path])
    assert kernel_cache_folder([tmp_path]) == before
    callee.write_text("damping")
    assert kernel_cache_folder([tmp_path]) != before


def cache_folder_seen_by(**environment):
    """Where the engines of another process keep their kernels."""
    show = "import subsoil_ros.dem, subsoil_ros.mbd, numba; print(numba.config.CACHE_DIR)"
    kept = {k: v for k, v in os.environ.items() if k not in ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME")}
    return subprocess.run(
        [sys.executable, "-c", show], env=kept | environment, capture_output=True, text=True, check=True
    ).stdout.strip()


def test_kernels_are_kept_outside_the_package(tmp_path):
    """The engines point numba at the user's cache, and leave a folder given by the user alone."""
    plain = {"XDG_CACHE_HOME": str(tmp_path)}
    assert cache_folder_seen_by(**plain).startswith(str(tmp_path / "subsoil_ros"))
    assert cache_folder_seen_by(**plain, NUMBA_CACHE_DIR="/given") == "/given"


def test_kernels_find_a_place_without_a_home(tmp_path):
    """A home that cannot be written to: the temporary folder serves, and is found again."""
    homeless = {"HOME": "/dev/null", "TMPDIR": str(tmp_path)}
    folder = cache_folder_seen_by(**homeless)
    assert folder.startswith(str(tmp_path / f"cache-{os.getuid()}"))
    assert cache_folder_seen_by(**homeless) == folder


@pytest.mark.skipif(os.getuid() != 0, reason="only root can give a folder away")
def test_kernels_of_others_are_not_run(tmp_path):
    """A folder in the temporary folder that belongs to somebody else is not used: its kernels are code."""
    foreign = tmp_path / f"cache-{os.getuid()}"
    foreign.mkdir()
    os.chown(foreign, 12345, 12345)
    folder = cache_folder_seen_by(HOME="/dev/null", TMPDIR=str(tmp_path))
    assert folder.startswith(str(tmp_path))
    assert not folder.startswith(str(foreign) + "/")
