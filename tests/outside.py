"""A machine and a soil of another maker: a block that falls on a field of springs, with its closed form."""

from pathlib import Path
from typing import Any

import numpy as np

from subsoil_ros import ToolMotion, ToolWrench

MESH = Path(__file__).parents[1] / "examples" / "three_point_hitch" / "tine.stl"
MASS_KG, STIFFNESS, DAMPING, GRAVITY = 100.0, 1.0e5, 1.0e3, 9.81


def document(**more: Any) -> dict[str, Any]:
    """A scene whose machine and soil are both from outside: one tool, 0.3 s."""
    return {
        "name": "outside",
        "duration_s": 0.3,
        "soil": {"model": "external", "bin": {"length_m": 1.0, "width_m": 1.0, "depth_m": 0.5}},
        "tools": {"foot": {"path": {"external": True}, "groups": {"foot": {"mesh": str(MESH)}}}},
        "coupling": {"communication_step_ns": 100_000},
        "record": {"checkpoint_s": 0.1, "series_ticks": 10},
        **more,
    }


def depth_m(time_s: Any) -> Any:
    """Depth of the block after `time_s`: m d'' + c d' + k d = m g from rest at the surface."""
    decay = 0.5 * DAMPING / MASS_KG
    swing = np.sqrt(STIFFNESS / MASS_KG - decay**2)
    rest = MASS_KG * GRAVITY / STIFFNESS
    wave = np.cos(swing * time_s) + decay / swing * np.sin(swing * time_s)
    return rest * (1.0 - np.exp(-decay * time_s) * wave)


class Block:
    """Falls in z, exactly so under the force held through a tick."""

    def __init__(self, interval_s: float = 1e-4) -> None:
        self.effective_mass_kg = {"foot": MASS_KG}
        self._interval_s, self._state = interval_s, np.zeros(2)  # z [m], dz/dt [m/s]

    def initial_motions(self) -> list[ToolMotion]:
        """At rest on the surface."""
        z, speed = self._state.tolist()
        return [ToolMotion("foot", 0.0, 0.0, z, 0.0, 0.0, speed, 0.0)]

    def advance(self, tick: int, wrenches: tuple[ToolWrench, ...]) -> list[ToolMotion]:
        """A tick further."""
        acceleration = wrenches[0].force_z_newton / MASS_KG - GRAVITY
        self._state[0] += self._interval_s * (self._state[1] + 0.5 * acceleration * self._interval_s)
        self._state[1] += acceleration * self._interval_s
        return self.initial_motions()

    def state_arrays(self) -> dict[str, Any]:
        """Height and speed."""
        return {"state": self._state}

    def restore(self, arrays: Any) -> None:
        """Goes on from them."""
        self._state = np.array(arrays["state"])


class SpringField:
    """Wrench = -k depth - c speed, below z = 0."""

    def start(self, motions: tuple[ToolMotion, ...]) -> list[ToolWrench]:
        """Of the start pose."""
        self._z, self._force = motions[0].z_m, self._of(motions[0])
        return [ToolWrench("foot", 0.0, 0.0, self._force, 0.0, 0.0, 0.0, 0.0, 1)]

    def advance(self, tick: int, motions: tuple[ToolMotion, ...]) -> list[ToolWrench]:
        """Of the tick's end; work by the trapezoidal rule."""
        force = self._of(motions[0])
        work = 0.5 * (self._force + force) * (motions[0].z_m - self._z)
        self._z, self._force = motions[0].z_m, force
        return [ToolWrench(motions[0].tool, 0.0, 0.0, force, 0.0, 0.0, 0.0, work, 1)]

    def state_arrays(self) -> dict[str, Any]:
        """Where the tool was, and its force."""
        return {"z": np.array(self._z), "force": np.array(self._force)}

    def restore(self, arrays: Any) -> None:
        """Goes on from them."""
        self._z, self._force = float(arrays["z"]), float(arrays["force"])

    def _of(self, motion: ToolMotion) -> float:
        return -STIFFNESS * motion.z_m - DAMPING * motion.velocity_z_m_per_s if motion.z_m < 0.0 else 0.0
