"""Every kind of joint and force element of a scene has its module, and the modules agree with each other."""

from typing import get_args

import numpy as np
import pytest

from subsoil_ros.mbd import forces, joints
from subsoil_ros.mbd.joints.rows import JOINT
from subsoil_ros.scene import mechanism


def test_every_kind_of_a_scene_is_registered() -> None:
    """The unions of the scene's model and the two registrations name the same classes."""
    assert set(joints.MODULE_OF_SCENE) == set(get_args(get_args(mechanism.Joint)[0]))
    assert set(forces.MODULE_OF_SCENE) == set(get_args(get_args(mechanism.Force)[0]))


@pytest.mark.parametrize("kind", joints.KINDS)
def test_a_joint_has_as_many_rows_everywhere(kind: int) -> None:
    """Coordinates, units and the reaction's pushes are given row by row."""
    joint = np.zeros(1, dtype=JOINT)[0]
    joint["kind"], joint["body_b"], joint["point_b"] = kind, 1, (1.0, 0.0)
    module = joints.KINDS[kind]
    rows = len(module.columns(joint))
    assert len(module.angle_rows(joint)) == rows
    turns = np.array([[1.0, 0.0], [1.0, 0.0]])
    assert len(module.reaction(joint, np.zeros(6), turns, np.ones(rows))) == 3
