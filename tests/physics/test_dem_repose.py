"""Angle of repose of a collapsed column: what friction, rolling friction and adhesion do to a heap.

A loose column against the near wall of a narrow bin falls and flows out along it. Expected: spheres without
friction flow out flat; both sliding and rolling friction make the heap steeper (Y.C. Zhou, B.H. Xu, A.B. Yu,
P. Zulli, Phys. Rev. E 64 (2001) 021301), and so does cohesion of the order of the weight (S.T. Nase,
W.L. Vargas, A.A. Abatan, J.J. McCarthy, Powder Technology 116 (2001) 214-223). The bounds in
degrees are wide around what heaps of spheres usually show: 15 to 25, with rolling friction to 40 (chosen).
"""

import math

import numpy as np
import pytest

from subsoil_ros.experiments.strength_tests import repose_rad, slope_rad
from subsoil_ros.loading.loader import load_scene
from tests.soils import NEGLIGIBLE

RADIUS = 0.01


def heap_angle_deg(friction, rolling, adhesion):
    """Angle of repose [deg]; `adhesion` is the largest attraction of a pair over a sphere's weight."""
    weight = 1800.0 * 4.0 / 3.0 * math.pi * RADIUS**3 * 9.81
    row = {
        "stiffness_newton_per_m": 5e3, "tangential_stiffness_newton_per_m": 4e3,
        "damping_newton_s_per_m": 1.7, "tangential_damping_newton_s_per_m": 1.5,
        "cohesive_stiffness_newton_per_m": max(adhesion * weight / 5e-4, NEGLIGIBLE),
        "static_friction": friction, "sliding_friction": friction,
        "rolling_friction": max(rolling, NEGLIGIBLE),
        "equilibrium_overlap_m": 5e-4, "cohesion_range_m": 5e-4,
    }  # fmt: skip
    soil = {
        "bin": {"length_m": 0.4, "width_m": 0.4, "depth_m": 0.2},
        "particles": {"radius_m": RADIUS, "density_kg_per_m3": 1800.0},
        "bed": {"kind": "grid", "spacing_m": "rest"},
        "law": {"kind": "cohesive_linear", "combining_rule": "none", "particle": row, "boundary": row},
    }
    return math.degrees(repose_rad(load_scene({"name": "heap", "duration_s": 1.0, "soil": soil})))


def test_slope_of_a_heap():
    """Spheres under a line of 30 degrees against a wall; a layer; a wall."""
    x, z = np.meshgrid(np.arange(RADIUS, 0.6, RADIUS / 2.0), np.arange(0.0, 0.3, RADIUS / 4.0))
    under = z < 0.3 - math.tan(math.radians(30.0)) * x
    heap = np.column_stack([x[under], 0.0 * x[under], z[under]])
    assert slope_rad(heap, RADIUS) == pytest.approx(math.radians(30.0), abs=math.radians(1.5))
    layer = np.column_stack([x[0], 0.0 * x[0], 0.0 * x[0]])
    assert slope_rad(layer, RADIUS) == 0.0
    assert slope_rad(layer[:, ::-1], RADIUS) == pytest.approx(0.5 * math.pi)


def test_friction_makes_a_heap():
    """Flat without it; about 20 degrees with."""
    assert abs(heap_angle_deg(0.0, 0.0, 0.0)) < 6.0
    assert 13.0 < heap_angle_deg(0.5, 0.0, 0.0) < 25.0


@pytest.mark.full
def test_friction_rolling_friction_and_adhesion_each_steepen_a_heap():
    """Flat; about 20 degrees; 10 more with rolling friction, 5 more with adhesion of one weight, and both
    together add up. Heaps that differ in their first places only differ by some 2 degrees."""
    flat = heap_angle_deg(0.0, 0.0, 0.0)
    sliding = heap_angle_deg(0.5, 0.0, 0.0)
    rolling = heap_angle_deg(0.5, 0.2, 0.0)
    adhesive = heap_angle_deg(0.5, 0.0, 1.0)
    both = heap_angle_deg(0.5, 0.2, 0.2)
    assert abs(flat) < 6.0
    assert 13.0 < sliding < 25.0
    assert sliding + 5.0 < rolling < 40.0
    assert sliding + 4.0 < adhesive < 40.0
    assert both > rolling
