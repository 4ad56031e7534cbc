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
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from subsoil_ros.analysis.dead_centre import shank_spring
from subsoil_ros.scene.scene import Scene

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
    """Of the shank and the spring that the scene's report names; None as shank_spring."""
    found = shank_spring(scene)
    if found is None:
        return None
    assert scene.mechanism is not None
    assert scene.report.tip_m is not None
    body = scene.mechanism.bodies[str(scene.report.shank)]
    com = complex(*body.position_m) - found.hinge
    # moments about the hinge: weight -m g x, spring S arm, draft D at depth h: -D h
    weight_moment = -body.mass_kg * scene.gravity_m_per_s2 * com.real
    depth, height = -scene.report.tip_m[1], found.hinge.imag
    return Levers(
        hinge_m=(found.hinge.real, height),
        spring_arm_m=found.arm_m,
        tip_lever_m=height + depth,
        share_lever_m=height + SHARE_DEPTH_PART * depth,
        surface_lever_m=height,
        mass_kg=body.mass_kg,
        inertia_kg_m2=body.inertia_kg_m2 + body.mass_kg * abs(com) ** 2,
        com_arm_m=(com.real, com.imag),
        stiffness_newton_per_m=float(found.spring.stiffness_newton_per_m or 0.0),
        unloaded_newton=-weight_moment / found.arm_m,
    )


def rest_angle_rad(scene: Scene) -> float | None:
    """Angle of the shank against an upright frame at which its weight rests on the spring; None as
    shank_spring."""
    levers, found = levers_of(scene), shank_spring(scene)
    if levers is None or found is None:
        return None
    spring, com = found.spring, complex(*levers.com_arm_m)

    def moment(angle: float) -> float:
        """About the hinge, phi sense; complex numbers stand for (x, z)."""
        turn = cmath.rect(1.0, angle)
        arm = found.lug * turn
        along = arm - found.anchor
        push = levers.stiffness_newton_per_m * (spring.free_length_m - abs(along)) + spring.preload_newton
        force = push * along / abs(along)
        weight = -levers.mass_kg * scene.gravity_m_per_s2 * (com * turn).real
        return (arm.conjugate() * force).imag + weight

    widest = 0.5  # the shank hangs within 30 degrees of its working pose
    if moment(-widest) * moment(widest) > 0.0:
        return None
    return float(brentq(moment, -widest, widest, xtol=1e-12))
