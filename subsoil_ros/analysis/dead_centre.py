"""Whether the soil has folded a sprung shank back past the dead centre of its spring."""

import cmath
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..scene.mechanism import Revolute, SpringDamper
from ..scene.scene import Scene
from .columns import TIME, Body


class ShankSpring(NamedTuple):
    """The spring of a shank and its points in the reference pose, x + i z [m]."""

    spring: SpringDamper
    hinge: complex  # from the origin
    lug: complex  # the spring's point on the shank, from the hinge
    anchor: complex  # its other point, from the hinge

    @property
    def arm_m(self) -> float:
        """Moment of 1 N of compression about the hinge [m], phi sense."""
        along = self.lug - self.anchor
        return (self.lug.conjugate() * along).imag / abs(along)


def shank_spring(scene: Scene) -> ShankSpring | None:
    """Shank and spring that the scene's report names; None where there is no such pair on one hinge, or a
    draft does not compress the spring."""
    mechanism, report = scene.mechanism, scene.report
    if mechanism is None or report.shank is None or report.spring is None or report.tip_m is None:
        return None
    spring = mechanism.forces.get(report.spring)
    if not isinstance(spring, SpringDamper) or not spring.stiffness_newton_per_m:
        return None
    pair = {spring.body_a, spring.body_b}
    hinges = [
        joint
        for joint in mechanism.joints.values()
        if isinstance(joint, Revolute) and {joint.body_a, joint.body_b} == pair and report.shank in pair
    ]
    if len(hinges) != 1:
        return None
    on_shank, other = spring.point_b_m, spring.point_a_m
    if spring.body_a == report.shank:
        on_shank, other = other, on_shank
    hinge = complex(*hinges[0].point_m)
    found = ShankSpring(spring, hinge, complex(*on_shank) - hinge, complex(*other) - hinge)
    return found if found.arm_m > 0.0 else None


def past_dead_centre_s(scene: Scene, columns: Mapping[str, NDArray[np.float64]]) -> float | None:
    """Time at which the shank passed the dead centre: its spring points through the hinge; None if never.

    From there on the spring folds the shank up. Also None where shank_spring returns None. columns: of a
    run's series, each (n,).
    """
    found = shank_spring(scene)
    if found is None or scene.mechanism is None:
        return None
    shank = str(scene.report.shank)
    frame = found.spring.body_b if found.spring.body_a == shank else found.spring.body_a
    angle = np.zeros(len(columns[TIME]))
    for body, sign in ((shank, 1.0), (frame, -1.0)):
        if body in scene.mechanism.bodies:  # the ground does not turn
            angle += sign * (columns[Body(body).angle_rad] - scene.mechanism.bodies[body].angle_rad)
    past = np.flatnonzero(angle <= cmath.phase(found.anchor / found.lug))
    return float(columns[TIME][past[0]]) if len(past) else None
