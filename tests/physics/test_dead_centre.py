"""The dead centre of a shank's spring, against figures by hand."""

import math
from pathlib import Path

import numpy as np

from subsoil_ros.analysis.dead_centre import past_dead_centre_s
from subsoil_ros.loading.loader import load_scene

SCENES = Path(__file__).parents[2] / "config/scenes"


def test_dead_centre():
    """The lug stands 0.25 m above the hinge, the spring's other end 0.40 m ahead of it: the spring points
    through the hinge when the shank has turned back by atan(0.40 / 0.25), 1.012 rad, against the frame."""
    scene = load_scene(SCENES / "mechanism_only.yaml").scene
    times, dead = np.linspace(0.0, 1.0, 11), math.atan2(0.40, 0.25)
    frame = np.full(11, -0.2)
    columns = {"time_s": times, "body.frame.angle_rad": frame}
    upright = scene.mechanism.bodies["shank"].angle_rad
    for reached, expected in ((0.99 * dead, None), (1.01 * dead, 0.5)):
        turned = np.where(times < 0.45, 0.5 * reached, reached)
        found = past_dead_centre_s(scene, {**columns, "body.shank.angle_rad": upright + frame - turned})
        assert found == expected
