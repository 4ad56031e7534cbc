"""Compiled kernels never outlive the sources they were made from."""

import os
import subprocess
import sys

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


def test_kernels_are_kept_outside_the_package(tmp_path):
    """The engines point numba at the user's cache, and leave a folder given by the user alone."""
    show = "import subsoil_ros.dem, subsoil_ros.mbd, numba; print(numba.config.CACHE_DIR)"
    kept = {k: v for k, v in os.environ.items() if k != "NUMBA_CACHE_DIR"}
    plain = kept | {"XDG_CACHE_HOME": str(tmp_path)}

    def folder(environment):
        return subprocess.run(
            [sys.executable, "-c", show], env=environment, capture_output=True, text=True, check=True
        ).stdout.strip()

    assert folder(plain).startswith(str(tmp_path / "subsoil_ros"))
    assert folder(plain | {"NUMBA_CACHE_DIR": "/given"}) == "/given"
