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

from ..soils import NEGLIGIBLE

RADIUS = 0.01
COLUMN = (8, 4, 14)
"""Spheres along x, y, z."""


def surface_angle_deg(positions_m):
    """Slope of a heap that falls off along x [deg]: a line through the tops of slices one diameter wide, from
    85 to 15 % of the heap's height, where neither the wall behind it nor the foot bends it."""
    x, z = positions_m[:, 0], positions_m[:, 2] - positions_m[:, 2].min()
    slices = np.floor(x / (2.0 * RADIUS)).astype(int)
    tops = np.array([z[slices == s].max(initial=0.0) for s in range(slices.max() + 1)])
    middle = (np.arange(len(tops)) + 0.5) * 2.0 * RADIUS
    slope = (tops > 0.15 * tops.max()) & (tops < 0.85 * tops.max())
    if slope.sum() < 3:  # it stands like a wall, or is a layer
        return 90.0 if tops.max() > 8.0 * RADIUS else 0.0
    return -math.degrees(math.atan(np.polyfit(middle[slope], tops[slope], 1)[0]))


def heap_angle_deg(soil, friction, rolling, adhesion):
    """Slope after one second [deg]; `adhesion` is the largest attraction of a pair over a sphere's weight."""
    weight = 1800.0 * 4.0 / 3.0 * math.pi * RADIUS**3 * 9.81
    row = {
        "stiffness_newton_per_m": 5e3, "tangential_stiffness_newton_per_m": 4e3,
        "damping_newton_s_per_m": 1.7, "tangential_damping_newton_s_per_m": 1.5,
        "cohesive_stiffness_newton_per_m": max(adhesion * weight / 5e-4, NEGLIGIBLE),
        "static_friction": friction, "sliding_friction": friction,
        "rolling_friction": max(rolling, NEGLIGIBLE),
        "equilibrium_overlap_m": 5e-4, "cohesion_range_m": 5e-4,
    }  # fmt: skip
    engine = soil.engine(
        soil={
            "bin": {"length_m": 0.8, "width_m": 0.09, "depth_m": 0.34},
            "particles": {"radius_m": RADIUS, "density_kg_per_m3": 1800.0},
            "bed": {"kind": "grid", "spacing_m": 0.02},
            "law": {"kind": "cohesive_linear", "combining_rule": "none", "particle": row, "boundary": row},
            "time_step_s": 1e-4,
        }
    )
    cells = np.stack(np.meshgrid(*map(range, COLUMN), indexing="ij"), axis=-1).reshape(-1, 3)
    corner = np.array((0.0, engine.bed.lower_m[1], engine.bed.lower_m[2])) + RADIUS
    jitter = np.random.default_rng(4).uniform(0.0, 2e-3, cells.shape)
    engine.place(corner + 0.0215 * cells + jitter)
    engine.start(())
    for tick in range(12_000):
        engine.advance(tick, ())
    return surface_angle_deg(engine.positions_m())


@pytest.mark.slow
def test_friction_makes_a_heap(soil):
    """Flat without it; about 20 degrees with."""
    assert abs(heap_angle_deg(soil, 0.0, 0.0, 0.0)) < 6.0
    assert 13.0 < heap_angle_deg(soil, 0.5, 0.0, 0.0) < 25.0


@pytest.mark.full
def test_friction_rolling_friction_and_adhesion_each_steepen_a_heap(soil):
    """Flat; about 20 degrees; 10 more with rolling friction, 5 more with adhesion of one weight, and both
    together add up. Heaps that differ in their first places only differ by some 2 degrees."""
    flat = heap_angle_deg(soil, 0.0, 0.0, 0.0)
    sliding = heap_angle_deg(soil, 0.5, 0.0, 0.0)
    rolling = heap_angle_deg(soil, 0.5, 0.2, 0.0)
    adhesive = heap_angle_deg(soil, 0.5, 0.0, 1.0)
    both = heap_angle_deg(soil, 0.5, 0.2, 0.2)
    assert abs(flat) < 6.0
    assert 13.0 < sliding < 25.0
    assert sliding + 5.0 < rolling < 40.0
    assert sliding + 4.0 < adhesive < 40.0
    assert both > rolling
