"""Soil-tool co-simulation: discrete-element soil and a planar machine in lockstep.

`load_scene`, `check`, `run` and `read_run` are the public interface. Each is imported when it is first used.
"""

from typing import TYPE_CHECKING

from ._version import __version__

if TYPE_CHECKING:
    from .api.check import check
    from .api.load import load_scene
    from .api.read import read_run
    from .api.run import run

__all__ = ["__version__", "check", "load_scene", "read_run", "run"]

_MODULES = {"check": "check", "load_scene": "load", "read_run": "read", "run": "run"}


def __getattr__(name: str) -> object:
    if name not in _MODULES:
        raise AttributeError(f"module '{__name__}' has no attribute '{name}'")
    from importlib import import_module

    return getattr(import_module(f".api.{_MODULES[name]}", __name__), name)


def __dir__() -> list[str]:
    return sorted(__all__)
