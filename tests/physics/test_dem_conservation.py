"""Momentum, angular momentum and energy: what contacts may not make."""

import numpy as np
import pytest

from tests.physics.impacts import dry_row, hertz, laboratory
from tests.soils import BOUNDARY, PARTICLE

EPS = np.finfo(float).eps


def angular_momentum(engine, centre):
    """(3,) about `centre` [kg m2/s]."""
    orbital = np.cross(engine.positions_m() - centre, engine.velocities_m_per_s()).sum(axis=0)
    return engine.mass_kg * (orbital + 0.4 * 0.01**2 * engine.angular_velocities_rad_per_s().sum(axis=0))


def test_a_tumbling_wet_cluster_keeps_momentum_angular_momentum_and_its_books(soil):
    """36 particles bound by adhesion, far from walls, rolling and sliding on each other: over 1e5 steps both
    momenta drift by round-off only, and the energy books close."""
    generator, steps = np.random.default_rng(5), 100_000
    engine = soil.engine(
        "gravity_m_per_s2=0", "soil.time_step_s=4e-5", "soil.bin.length_m=0.5", "soil.bin.width_m=0.5",
        "soil.bin.depth_m=0.5", "soil.bed.spacing_m=0.1", book=True,
    )  # fmt: skip
    centre = np.array((0.25, 0.0, -0.25))
    places = np.stack(np.meshgrid(range(4), range(3), range(3), indexing="ij"), axis=-1).reshape(-1, 3)
    x = 0.019 * (places - places.mean(axis=0)) + generator.uniform(-5e-4, 5e-4, places.shape)
    turn = np.array((3.0, -4.0, 5.0))
    v = np.cross(turn, x) + 0.02 * generator.normal(size=x.shape)
    engine.place(centre + x, v - v.mean(axis=0), turn + 5.0 * generator.normal(size=x.shape))
    engine.start(())
    angular, start = angular_momentum(engine, centre), engine.energy()
    for tick in range(steps):
        engine.advance(tick, ())
    # every step rounds each momentum anew, by EPS of its size and in no preferred direction
    size = engine.mass_kg * np.linalg.norm(v, axis=1).sum()
    assert np.abs(engine.momentum_kg_m_per_s).max() < size * EPS * np.sqrt(steps)
    assert np.abs(angular_momentum(engine, centre) - angular).max() < 0.05 * size * EPS * np.sqrt(steps)
    end = engine.energy()
    spent = sum(end.sinks_joule.values())
    assert np.abs(engine.positions_m() - centre).max() < 0.1  # it holds together
    assert engine.state("r", 0, 0).rebuild_count > 50
    assert min(end.sinks_joule.values()) >= 0.0
    assert spent > start.kinetic_joule
    assert min(end.sinks_joule["sliding"], end.sinks_joule["rolling"]) > 0.0
    # first order in the step: half a step over the dashpot's time m / C = 0.75 ms is 2.7 %
    assert abs(end.total_joule - start.total_joule) < 0.03 * spent


LOSSLESS = {"damping_newton_s_per_m": 0.0, "tangential_damping_newton_s_per_m": 0.0}
LAWS = {
    "linear": {
        "kind": "cohesive_linear",
        "combining_rule": "none",
        "particle": dry_row(1e5, k_t=8e4, mu=0.3, mu_r=0.1),
        "boundary": dry_row(1e5, k_t=8e4, mu=0.3, mu_r=0.1),
    },
    "hertz": hertz(5e7, 0.3, 1.0, 0.3),
    "wet": {
        "kind": "cohesive_linear",
        "particle": PARTICLE | LOSSLESS | {"cohesive_stiffness_newton_per_m": 200.0},
        "boundary": BOUNDARY | LOSSLESS | {"cohesive_stiffness_newton_per_m": 200.0},
    },
}
"""Without dashpots: all that can be lost is lost by friction."""


@pytest.mark.parametrize("surface", ["wall", "face", "edge"])
@pytest.mark.parametrize("law", LAWS)
def test_no_impact_at_any_angle_on_any_surface_gains_energy(soil, at, one, law, surface):
    """Spinning spheres hit wall, facets and edges of a bar at 3 to 87 degrees (edges to 60, most would miss):
    none leaves with more energy than it came with, and the books close."""
    step_ns, count, radius, speed = 2000, 15, 0.01, 1.0
    bar = {} if surface == "wall" else {"tools": one(soil.box(0.9, 0.06, 0.06, subdivide=2))}
    engine = laboratory(soil, LAWS[law], radius, 1800.0, step_ns, True, 6.0 * (count + 2), **bar)
    motions = () if surface == "wall" else at(0.48, -0.06)
    angle = np.radians(np.linspace(3.0, 60.0 if surface == "edge" else 87.0, count))
    gap = radius + (0.002 if law == "wet" else 0.0) + 1e-6  # just out of reach
    normal = np.array((0.0, 0.0, 1.0)) if surface != "edge" else np.array((0.0, np.sqrt(0.5), np.sqrt(0.5)))
    foot = {"wall": (0.0, engine.bed.lower_m[2]), "face": (0.0, -0.03), "edge": (0.03, -0.03)}[surface]
    place = np.array([(0.06 + 0.06 * k, *foot) + gap * normal for k in range(count)])
    # grazing along x, a little across: an edge is met askew
    along = np.array((np.sqrt(0.8), np.sqrt(0.2), 0.0))
    velocity = speed * (np.sin(angle)[:, None] * along - np.cos(angle)[:, None] * normal)
    spin = np.random.default_rng(2).normal(scale=30.0, size=(count, 3))
    engine.place(place, velocity, spin)
    engine.start(motions)
    before = engine.energy()

    def kinetic():
        v, w = engine.velocities_m_per_s(), engine.angular_velocities_rad_per_s()
        return 0.5 * engine.mass_kg * ((v * v).sum(axis=1) + 0.4 * radius**2 * (w * w).sum(axis=1))

    first = kinetic()
    touched = np.zeros(count, bool)
    for tick in range(9000):
        engine.advance(tick, motions)
        pushed = np.abs(engine.forces_newton()).max(axis=1) > 0.0
        touched |= pushed
        if touched.all() and not pushed.any():
            break
    after = engine.energy()
    gone = ~pushed
    assert touched.all()
    assert gone.sum() > count // 4  # adhesion holds some
    # the ends of contact are met to one step: (omega dt)^2 of the energy
    tolerance = 1e5 / engine.mass_kg * (step_ns * 1e-9) ** 2
    assert (kinetic()[gone] <= first[gone] * (1.0 + tolerance)).all()
    assert min(after.sinks_joule.values()) >= -1e-12
    assert abs(after.total_joule - before.total_joule) < 0.01 * before.kinetic_joule
