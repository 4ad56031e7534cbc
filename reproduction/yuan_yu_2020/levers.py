"""Levers of a shank that hangs on a hinge and leans on a spring, from the scene's own points.

Moments about the hinge, in the reference pose, forces of the soil on the share: with the draft D (minus the
soil's force along x) at a depth h below the hinge, and the spring's force S (compression positive) on the arm
r, the shank stands still where

    S r = D h + weight part;   S = D h / r + S_0

S_0 is the spring's force without soil. Compression must hold a shank that the soil pushes back, as in the
paper.
"""

import cmath
import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..scene.mechanism import Revolute, SpringDamper
from ..scene.model import Scene

SHARE_DEPTH_PART = 0.73
"""Where the share's load acts, part of the tip's depth (derived: 0.22 of 0.30 m, the centroid of share and
foot in the declared machine); a report uses the measured place instead."""


@dataclass(frozen=True)
class Levers:
    """Of one shank. Lengths [m] and angles in the reference pose."""

    hinge_m: tuple[float, float]  # x, z
    spring_arm_m: float
    tip_lever_m: float  # of a draft at the tip: the longest there is
    share_lever_m: float  # of a draft where the share is loaded
    surface_lever_m: float  # of a draft at the surface: the shortest
    mass_kg: float
    inertia_kg_m2: float  # of the shank about the hinge
    com_arm_m: tuple[float, float]  # from the hinge to the centre of mass
    stiffness_newton_per_m: float
    unloaded_newton: float  # of the spring that carries the shank's weight alone

    @property
    def stiffness_newton_m_per_rad(self) -> float:
        """Of the spring about the hinge."""
        return self.stiffness_newton_per_m * self.spring_arm_m**2

    @property
    def frequency_hz(self) -> float:
        """Of the shank on its spring, without soil."""
        return math.sqrt(self.stiffness_newton_m_per_rad / self.inertia_kg_m2) / (2.0 * math.pi)

    def spring_newton(self, draft_newton: float) -> float:
        """The spring's force at rest under a draft on the share."""
        return self.unloaded_newton + draft_newton * self.share_lever_m / self.spring_arm_m

    def draft_newton(self, spring_newton: float, lever_m: float) -> float:
        """Draft at a lever that holds the spring at a force."""
        return (spring_newton - self.unloaded_newton) * self.spring_arm_m / lever_m

    def inertial_newton(self, angle_range_rad: float, period_s: float) -> float:
        """Spring force that swings the shank's inertia, a sine of that range and period."""
        acceleration = 0.5 * angle_range_rad * (2.0 * math.pi / period_s) ** 2
        return self.inertia_kg_m2 * acceleration / self.spring_arm_m

    def swing_height_m(self, angle_range_rad: float) -> float:
        """Largest rise of the centre of mass by a swing of that range to one side of the reference pose."""
        x, z = self.com_arm_m
        angles = np.linspace(-angle_range_rad, angle_range_rad, 2001)
        heights = np.sin(angles) * x + np.cos(angles) * z
        return max(float(np.ptp(heights[:1001])), float(np.ptp(heights[1000:])))


def levers_of(scene: Scene) -> Levers | None:
    """Of the shank and the spring that the scene's report names; None where it has no such pair, or a draft
    does not compress that spring."""
    mechanism, report = scene.mechanism, scene.report
    if mechanism is None or report.shank is None or report.spring is None or report.tip_m is None:
        return None
    spring = mechanism.forces.get(report.spring)
    if not isinstance(spring, SpringDamper) or not spring.stiffness_newton_per_m:
        return None
    shank, pair = report.shank, {spring.body_a, spring.body_b}
    hinges = [
        joint
        for joint in mechanism.joints.values()
        if isinstance(joint, Revolute) and {joint.body_a, joint.body_b} == pair and shank in pair
    ]
    if len(hinges) != 1:
        return None
    body, hinge = mechanism.bodies[shank], np.array(hinges[0].point_m)
    on_shank, other = spring.point_b_m, spring.point_a_m
    if spring.body_a == shank:
        on_shank, other = other, on_shank
    along = np.array(on_shank) - np.array(other)  # compression pushes the shank this way
    along = along / np.linalg.norm(along)
    lug = np.array(on_shank) - hinge
    turn = lug[0] * along[1] - lug[1] * along[0]  # moment of 1 N of compression, phi sense
    if turn <= 0.0:  # a draft stretches this spring: not the machine of the paper
        return None
    com = np.array(body.position_m) - hinge
    # moments about the hinge: weight -m g x, spring S turn, draft D at depth h: -D h
    weight_moment = -body.mass_kg * scene.gravity_m_per_s2 * float(com[0])
    depth = -report.tip_m[1]
    height = float(hinge[1])
    return Levers(
        hinge_m=(float(hinge[0]), height),
        spring_arm_m=float(turn),
        tip_lever_m=height + depth,
        share_lever_m=height + SHARE_DEPTH_PART * depth,
        surface_lever_m=height,
        mass_kg=body.mass_kg,
        inertia_kg_m2=body.inertia_kg_m2 + body.mass_kg * float(com @ com),
        com_arm_m=(float(com[0]), float(com[1])),
        stiffness_newton_per_m=spring.stiffness_newton_per_m,
        unloaded_newton=-weight_moment / float(turn),
    )


def rest_angle_rad(scene: Scene) -> float | None:
    """Angle of the shank against an upright frame at which its weight rests on the spring; None as
    levers_of."""
    found = levers_of(scene)
    if found is None:
        return None
    spring, lug, anchor = _spring_from_hinge(scene, found)
    stiffness = float(spring.stiffness_newton_per_m or 0.0)
    com = complex(*found.com_arm_m)

    def moment(angle: float) -> float:
        """About the hinge, phi sense; complex numbers stand for (x, z)."""
        turn = complex(math.cos(angle), math.sin(angle))
        arm = lug * turn
        along = arm - anchor
        push = stiffness * (spring.free_length_m - abs(along)) + spring.preload_newton
        force = push * along / abs(along)
        weight = -found.mass_kg * scene.gravity_m_per_s2 * (com * turn).real
        return (arm.conjugate() * force).imag + weight

    from scipy.optimize import brentq

    widest = 0.5  # the shank hangs within 30 degrees of its working pose
    if moment(-widest) * moment(widest) > 0.0:
        return None
    return float(brentq(moment, -widest, widest, xtol=1e-12))


def past_dead_centre_s(scene: Scene, columns: Mapping[str, NDArray[np.float64]]) -> float | None:
    """When the shank had been pushed back so far that its spring pointed through the hinge; None if never.

    From there on the spring folds the shank up. columns: of a run's series, each (n,). None also where
    levers_of finds no such shank.
    """
    found = levers_of(scene)
    if found is None or scene.mechanism is None:
        return None
    spring, lug, anchor = _spring_from_hinge(scene, found)
    shank = str(scene.report.shank)
    frame = spring.body_b if spring.body_a == shank else spring.body_a
    angle = np.zeros(len(columns["time_s"]))
    for body, sign in ((shank, 1.0), (frame, -1.0)):
        if body in scene.mechanism.bodies:  # the ground does not turn
            angle += sign * (columns[f"body.{body}.angle_rad"] - scene.mechanism.bodies[body].angle_rad)
    past = np.flatnonzero(angle <= cmath.phase(anchor / lug))
    return float(columns["time_s"][past[0]]) if len(past) else None


def _spring_from_hinge(scene: Scene, levers: Levers) -> tuple[SpringDamper, complex, complex]:
    """The spring, its point on the shank and the other one, x + i z from the hinge."""
    assert scene.mechanism is not None
    spring = scene.mechanism.forces[str(scene.report.spring)]
    assert isinstance(spring, SpringDamper)
    on_shank, other = spring.point_b_m, spring.point_a_m
    if spring.body_a == scene.report.shank:
        on_shank, other = other, on_shank
    hinge = complex(*levers.hinge_m)
    return spring, complex(*on_shank) - hinge, complex(*other) - hinge
