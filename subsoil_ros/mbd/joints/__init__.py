"""Joints: one module per kind, with its equations, derivatives, right-hand sides, reaction and table row.

A new kind needs
- an entry in scene/mechanism.py: a class with a `kind` of its own, in the union `Joint`;
- a number in table.py, below DRIVER unless its rows depend on time;
- a module here: kernels `residual`, `jacobian` and `gamma` (made of rows.py where that fits), functions
  `columns`, `angle_rows`, `fill` and `reaction` (see JointKind);
- its lines in KINDS and MODULE_OF_SCENE below, and in the four kernels of constraints.py;
- a row in docs/mechanism.md and a test in closed form (tests/physics/test_mbd_joints.py).
"""

from types import ModuleType
from typing import Protocol

import numpy as np

from ...scene.mechanism import Driver, Fixed, PointOnLine, Prismatic, Revolute
from . import driver, fixed, point_on_line, prismatic, revolute, rod, rotation_lock
from .rows import (
    DRIVER,
    FIXED,
    POINT_ON_LINE,
    PRISMATIC,
    RELATIVE_DRIVER,
    REVOLUTE,
    ROD,
    ROTATION_LOCK,
    Reaction,
)


class JointKind(Protocol):
    """Functions of a module beside its kernels and `fill`; `joint` is a row of the table."""

    def columns(self, joint: np.void) -> list[list[int]]:
        """Return the coordinates that each of its rows depends on."""

    def angle_rows(self, joint: np.void) -> tuple[bool, ...]:
        """Return for each of its rows whether it is in radians; the others are in metres."""

    def reaction(self, joint: np.void, q: np.ndarray, turns: np.ndarray, pushes: np.ndarray) -> Reaction:
        """Return the reaction on body_b; `pushes` is the force of every row along its residual [N, N m]."""


KINDS: dict[int, JointKind] = {
    REVOLUTE: revolute,
    PRISMATIC: prismatic,
    FIXED: fixed,
    POINT_ON_LINE: point_on_line,
    ROD: rod,
    ROTATION_LOCK: rotation_lock,
    DRIVER: driver,
    RELATIVE_DRIVER: driver,
}

MODULE_OF_SCENE: dict[type, ModuleType] = {
    Revolute: revolute,
    Prismatic: prismatic,
    PointOnLine: point_on_line,
    Fixed: fixed,
    Driver: driver,
}


def kind_of(joint: np.void) -> JointKind:
    """The module of a row of the table."""
    return KINDS[int(joint["kind"])]
