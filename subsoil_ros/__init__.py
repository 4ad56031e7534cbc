"""Soil-tool co-simulation: discrete-element soil and a planar machine in lockstep.

`load_scene`, `check`, `run` and `read_run` are the public interface. For machines and soils of other
programs there are `serve`, the protocols `Machine` and `ExternalSoil`, what they exchange (`ToolMotion`,
`SpatialMotion`, `ToolWrench`) and `MujocoMachine`. Each is imported when it is first used.
"""

from typing import TYPE_CHECKING

from ._version import __version__

if TYPE_CHECKING:
    from .api.check_scene import check
    from .api.load import load_scene
    from .api.read import read_run
    from .api.run_scene import run
    from .coupling.external import ExternalSoil, Machine
    from .coupling.mujoco_machine import MujocoMachine
    from .messages import SpatialMotion, ToolMotion, ToolWrench
    from .ros.nodes.serve import serve

__all__ = [
    "ExternalSoil",
    "Machine",
    "MujocoMachine",
    "SpatialMotion",
    "ToolMotion",
    "ToolWrench",
    "__version__",
    "check",
    "load_scene",
    "read_run",
    "run",
    "serve",
]

_MODULES = {
    "Machine": "coupling.external",
    "MujocoMachine": "coupling.mujoco_machine",
    "ExternalSoil": "coupling.external",
    "SpatialMotion": "messages",
    "ToolMotion": "messages",
    "ToolWrench": "messages",
    "check": "api.check_scene",
    "load_scene": "api.load",
    "read_run": "api.read",
    "run": "api.run_scene",
    "serve": "ros.nodes.serve",
}


def __getattr__(name: str) -> object:
    if name not in _MODULES:
        raise AttributeError(f"module '{__name__}' has no attribute '{name}'")
    from importlib import import_module

    if name == "serve":
        from .extras import require_ros

        require_ros("subsoil_ros.serve", "give the machine or the soil to run()")
    return getattr(import_module(f".{_MODULES[name]}", __name__), name)


def __dir__() -> list[str]:
    return sorted(__all__)
