"""Joints: one module per kind, with its equations, derivatives, right-hand sides, reaction and table row.

A new kind needs a class in scene/mechanism.py, a module here (see SceneKind) and a line in MODULE_OF_SCENE;
CONTRIBUTING.md adds one. Its kernels are made of rows.py where that fits.
"""

from collections.abc import Callable
from typing import Any, Protocol

import numpy as np

from ...scene.mechanism import Driver, Fixed, PointOnLine, Prismatic, Revolute
from ..function_tables import FunctionList
from ..geometry import ReferencePoses
from . import driver, fixed, point_on_line, prismatic, revolute, rod, rotation_lock
from .rows import RELATIVE_DRIVER, ROD, ROTATION_LOCK, Reaction


class JointKind(Protocol):
    """The module of a kind; `joint` is a row of the table. The kernels write rows of Phi, unscaled."""

    residual: Callable[..., None]  # (joint, q, turns, residual)
    jacobian: Callable[..., None]  # (joint, q, turns, jacobian): Phi_q
    gamma: Callable[..., None]  # (joint, q, turns, v, gamma): Phi_q q'', added

    def columns(self, joint: np.void) -> list[list[int]]:
        """Return the coordinates that each of its rows depends on."""

    def angle_rows(self, joint: np.void) -> tuple[bool, ...]:
        """Return for each of its rows whether it is in radians; the others are in metres."""

    def reaction(self, joint: np.void, q: np.ndarray, turns: np.ndarray, pushes: np.ndarray) -> Reaction:
        """Return the reaction on body_b; `pushes` is the force of every row along its residual [N, N m]."""


class SceneKind(JointKind, Protocol):
    """The module of a kind that scenes have."""

    KIND: int  # a number of its own, below DRIVER

    def fill(self, row: np.void, joint: Any, poses: ReferencePoses, functions: FunctionList) -> None:
        """Fill in the row of the table of a joint of the scene; its number of rows of Phi follows."""


MODULE_OF_SCENE: dict[type, SceneKind] = {
    Revolute: revolute,
    Prismatic: prismatic,
    PointOnLine: point_on_line,
    Fixed: fixed,
    Driver: driver,
}

KINDS: dict[int, JointKind] = {
    **{module.KIND: module for module in MODULE_OF_SCENE.values()},
    ROD: rod,
    ROTATION_LOCK: rotation_lock,
    RELATIVE_DRIVER: driver,
}


def kind_of(joint: np.void) -> JointKind:
    """The module of a row of the table."""
    return KINDS[int(joint["kind"])]
