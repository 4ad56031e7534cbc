"""Software and machine that a run was made with."""

import platform
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from .._version import __version__

PACKAGES = ("numpy", "numba", "llvmlite", "scipy", "pydantic", "trimesh", "mcap", "rosbags", "ros-rclpy")
"""Packages whose versions may change results, or how they are recorded."""


def versions() -> dict[str, str]:
    """Versions by name, with system and processor; packages that are not installed are left out."""
    found = {"subsoil_ros": __version__, "python": platform.python_version()}
    for package in PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            continue
    return found | {"system": platform.platform(), "processor": processor_name()}


def processor_name() -> str:
    """Model of this machine's processor; its architecture where the system does not give the model."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()
