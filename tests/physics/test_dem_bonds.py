"""Bonds that break for good (Potyondy and Cundall 2004): beams, strengths, energies and their limits."""

import math

import numpy as np
import pytest
from numba import njit
from numpy.testing import assert_allclose, assert_array_equal
from pydantic import ValidationError

from subsoil_ros.dem.bed import Bed
from subsoil_ros.dem.blocks import BLOCK
from subsoil_ros.dem.bonds.kernel import BondArrays, bond_of_pair
from subsoil_ros.dem.build import build_engine
from subsoil_ros.dem.engine import SoilEngine
from subsoil_ros.limits.stable_steps import step_limits
from subsoil_ros.scene.soil import Bonds
from tests.soils import LINEAR, NEGLIGIBLE

RADIUS, DENSITY = 0.01, 1800.0
MASS = DENSITY * 4.0 / 3.0 * math.pi * RADIUS**3
LENGTH, SECTION = 2.0 * RADIUS, math.pi * RADIUS**2
MODULUS, PART = 1e7, 0.4
NORMAL = MODULUS * SECTION / LENGTH
SHEAR = PART * NORMAL
BENDING, TORSION = 0.25 * RADIUS**2 * NORMAL, 0.5 * RADIUS**2 * SHEAR
STRONG = BondArrays(
    np.empty(0), np.empty((0, 2)), PART, math.sqrt(PART), 1e30, 1e30, 0.0, RADIUS, NORMAL, 0.0
)
ALONG = np.array((LENGTH, 0.0, 0.0))
NONE = np.zeros(3)

CEMENT = {
    "youngs_modulus_pa": 1e7, "stiffness_ratio": 2.5, "tensile_strength_pa": 2e4, "cohesion_pa": 4e4,
    "friction_angle_deg": 30.0,
}  # fmt: skip
UNBREAKABLE = CEMENT | {"tensile_strength_pa": 1e5, "cohesion_pa": 1e9, "damping_ratio": 0.0}
NO_CONTACT = dict.fromkeys(LINEAR["particle"], 0.0) | {"stiffness_newton_per_m": NEGLIGIBLE}


@njit
def _bond(apart, relative, spin_i, spin_j, slip, turn, step, numbers):
    return bond_of_pair(
        (apart[0], apart[1], apart[2]), (relative[0], relative[1], relative[2]),
        ((spin_i[0], spin_i[1], spin_i[2]), (spin_j[0], spin_j[1], spin_j[2])),
        (LENGTH, RADIUS, 0.0, NORMAL, 0.0), 1.0, (slip[0], slip[1], slip[2]), (turn[0], turn[1], turn[2]),
        step, numbers,
    )  # fmt: skip


def bond(apart=ALONG, slip=NONE, turn=NONE, numbers=STRONG, relative=NONE, spins=(NONE, NONE), step=0.0):
    """What bond_of_pair gives, vectors as arrays."""
    vectors = (np.asarray(item, float) for item in (apart, relative, *spins, slip, turn))
    found = _bond(*vectors, float(step), numbers)
    return tuple(np.array(item) if isinstance(item, tuple) else item for item in found)


def test_springs_are_those_of_a_beam():
    """E A / L, its part in shear, E I / L, and J in torsion; equal and opposite, no couple left over."""
    _, force, on_i, on_j, *_, stored, _ = bond((LENGTH * 1.001, 0.0, 0.0))
    assert_allclose(force, (1e-3 * LENGTH * NORMAL, 0.0, 0.0), rtol=1e-9)
    assert_allclose(stored, 0.5 * NORMAL * (1e-3 * LENGTH) ** 2, rtol=1e-9)
    _, force, on_i, on_j, *_, stored, _ = bond(slip=(0.0, 1e-5, 2e-5))
    assert_allclose(force, (0.0, -1e-5 * SHEAR, -2e-5 * SHEAR), rtol=1e-12)
    assert_allclose(on_i + on_j, np.cross(ALONG, force), rtol=1e-12)
    assert_allclose(stored, 0.5 * SHEAR * 5e-10, rtol=1e-12)
    _, force, on_i, on_j, *_, stored, _ = bond(turn=(3e-4, 1e-4, 2e-4))
    second_moment = 0.25 * math.pi * RADIUS**4
    wanted = -np.array((TORSION * 3e-4, *(MODULUS * second_moment / LENGTH * np.array((1e-4, 2e-4)))))
    assert_allclose(on_i, wanted, rtol=1e-12)
    assert_allclose(on_i + on_j, 0.0, atol=1e-20)
    assert_allclose(stored, 0.5 * (TORSION * 9e-8 + BENDING * 5e-8), rtol=1e-12)
    assert_allclose(force, 0.0, atol=1e-20)


@pytest.mark.parametrize(
    ("load", "strength_pa"),
    [
        ("tension", 5e3), ("bending", 5e3), ("shear", 8e3), ("torsion", 8e3), ("shear under pressure", 8e3),
        ("both tensions", 5e3),
    ],
)  # fmt: skip
def test_breaks_at_its_strength(load, strength_pa):
    """At 1 - 1e-9 of what its stress allows it is whole, at 1 + 1e-9 it is not, and then nothing is left."""
    numbers = STRONG._replace(tension=5e3, cohesion=8e3, slope=math.tan(0.5))
    pull = strength_pa * SECTION
    pressure_pa = 2e3
    for part, holds in ((1.0 - 1e-9, True), (1.0 + 1e-9, False)):
        state = {
            "tension": {"apart": ALONG * (1.0 + part * pull / NORMAL / LENGTH)},
            "bending": {"turn": (0.0, part * pull * RADIUS / 4.0 / BENDING, 0.0)},
            "shear": {"slip": (0.0, 0.0, part * pull / SHEAR)},
            "torsion": {"turn": (part * pull * RADIUS / 2.0 / TORSION, 0.0, 0.0)},
            "shear under pressure": {
                "apart": ALONG * (1.0 - pressure_pa * SECTION / NORMAL / LENGTH),
                "slip": (0.0, part * (8e3 + pressure_pa * math.tan(0.5)) * SECTION / SHEAR, 0.0),
            },
            "both tensions": {
                "apart": ALONG * (1.0 + 0.5 * part * pull / NORMAL / LENGTH),
                "turn": (0.0, 0.0, 0.5 * part * pull * RADIUS / 4.0 / BENDING),
            },
        }[load]
        found = bond(**state, numbers=numbers)
        assert found[0] == holds
        assert np.any(found[1:4]) == holds


def test_carried_as_a_rigid_body():
    """Turned once about a skew axis, a loaded bond has its old forces, to second order in the step."""
    axis = np.array((1.0, 2.0, -1.5)) / math.sqrt(7.25)
    loaded = (ALONG * 1.01, (0.0, 1e-4, 2e-4), (3e-3, 1e-3, 2e-3))
    _, force, on_i, *_, stored, _ = bond(*loaded)
    errors = []
    for steps in (1000, 4000):
        angle = 2.0 * math.pi / steps
        spin = axis * 2.0 * math.tan(0.5 * angle)  # over one second: it carries the chord's length
        apart, slip, turn = map(np.array, loaded)
        for _ in range(steps):
            after = _turned(apart, axis, angle)
            found = bond(after, slip, turn, relative=apart - after, spins=(spin, spin), step=1.0)
            apart, slip, turn = after, found[4], found[5]
        assert_allclose(found[2], on_i, rtol=2e-4)
        assert found[6] == pytest.approx(stored, rel=1e-6)
        errors.append(np.linalg.norm(found[1] - force) / np.linalg.norm(force))
    assert errors[0] < 2e-4
    assert errors[1] < 0.08 * errors[0]


def _turned(vector, axis, angle):
    across = np.cross(axis, vector)
    along = axis * (axis @ vector)
    return along + math.cos(angle) * (vector - along) + math.sin(angle) * across


def scene(soil, bonds, *overrides, law=NO_CONTACT, **changes):
    """A small bin under dry springs, or none, with bonds."""
    rows = {"kind": "linear", "particle": LINEAR["particle"] | law, "boundary": LINEAR["boundary"]}
    found = soil.scene(*overrides, **changes)
    document = found.document
    document["soil"] |= {"law": rows, "bed": {"kind": "grid", "spacing_m": "rest"}}
    if bonds is not None:
        document["soil"]["bonds"] = bonds
    return soil.resolve(document)


def stood(soil, bonds, positions, *, held=None, gravity=0.0, step_s=1e-5, law=NO_CONTACT):
    """An engine with spheres at `positions`, not started."""
    resolved = scene(
        soil, bonds, f"gravity_m_per_s2={gravity}", f"soil.time_step_s={step_s}", "soil.bin.depth_m=0.4",
        "soil.bin.length_m=0.6", law=law, allow=["unstable_time_step"],
    )  # fmt: skip
    bed = Bed(np.array(positions), (0.0, -0.3, -0.4), (0.6, 0.3), held=held)
    return SoilEngine(resolved, bed, book=True)


@pytest.mark.full
def test_two_spheres_swing_as_their_spring(soil):
    """Undamped: sqrt(k / reduced mass), energy kept; with a damping ratio the swing decays as it says."""
    for ratio in (0.0, 0.1):
        engine = stood(soil, UNBREAKABLE | {"damping_ratio": ratio}, [(0.3, 0.0, -0.2), (0.32, 0.0, -0.2)])
        speed = 1e-3
        engine.place([(0.3, 0.0, -0.2), (0.32, 0.0, -0.2)], [(-speed, 0.0, 0.0), (speed, 0.0, 0.0)])
        engine.start(())
        omega = math.sqrt(NORMAL / (0.5 * MASS))
        steps = round(2.0 * math.pi / (omega * math.sqrt(1.0 - ratio**2)) / 1e-5)
        for tick in range(steps):
            engine.advance(tick, ())
        velocity = engine.velocities_m_per_s()[1, 0]
        assert velocity == pytest.approx(
            speed * math.exp(-2.0 * math.pi * ratio / math.sqrt(1 - ratio**2)), rel=0.02
        )
        assert_allclose(engine.momentum_kg_m_per_s, 0.0, atol=1e-15)


def test_a_cantilever_hangs_as_the_sum_of_its_bonds(soil):
    """Clamped spheres under their weight: every bond slips by V / k_s and bends by M / k_b."""
    count = 6
    places = np.array([(0.2 + LENGTH * k, 0.0, -0.2) for k in range(count)])
    held = np.arange(count) == 0
    engine = stood(soil, UNBREAKABLE | {"damping_ratio": 0.3}, places, held=held, gravity=9.81)
    engine.start(())
    for tick in range(12000):
        engine.advance(tick, ())
        engine.damp(0.999)
    weight, sag = MASS * 9.81, 0.0
    for k in range(count - 1):
        beyond = np.arange(k + 1, count)  # spheres that this bond carries
        middle = LENGTH * (k + 0.5)
        moment = (weight * (LENGTH * beyond - middle)).sum()
        sag += weight * len(beyond) / SHEAR + moment / BENDING * (LENGTH * (count - 1) - middle)
    assert places[-1, 2] - engine.positions_m()[-1, 2] == pytest.approx(sag, rel=2e-3)


def test_what_breaks_is_booked(soil):
    """Two spheres torn apart: their kinetic energy and what broke make up what they had; it never heals."""
    engine = stood(soil, CEMENT | {"damping_ratio": 0.2}, [(0.3, 0.0, -0.2), (0.32, 0.0, -0.2)], step_s=1e-6)
    engine.place([(0.3, 0.0, -0.2), (0.32, 0.0, -0.2)], [(-0.2, 0.0, 0.0), (0.2, 0.0, 0.0)])
    engine.start(())
    before = engine.energy().total_joule
    for tick in range(3000):
        engine.advance(tick, ())
    book = engine.energy()
    assert engine.state("", 0, 0).broken_bond_count == 1
    strained = 0.5 * (2e4 * SECTION) ** 2 / NORMAL
    assert book.sinks_joule["bond_breakage"] == pytest.approx(strained, rel=0.02)
    assert book.sinks_joule["bond_dashpot"] > 0.0
    assert book.total_joule == pytest.approx(before, rel=2e-3)
    assert engine.cloud(0, 0).broken_parts.tolist() == [1.0, 1.0]


def settled_block(soil, bonds, *, precision="float64", threads=1, step_s=2e-5):
    """A block of 360 spheres in a cubic grid."""
    resolved = scene(
        soil, bonds, "soil.bin.length_m=0.2", "soil.bin.width_m=0.12", "soil.bin.depth_m=0.12",
        f"soil.time_step_s={step_s}", f"soil.precision={precision}", law={},
    )  # fmt: skip
    return build_engine(resolved, threads, book=True)


def shaken(engine, ticks=400, speed=0.6, first=0):
    """Thrown about by random velocities, so that bonds break and lists are built anew."""
    if first == 0:
        velocity = np.random.default_rng(3).normal(0.0, speed, (engine.particle_count, 3))
        engine.place(engine.positions_m(), velocity)
        engine.start(())
    for tick in range(first, first + ticks):
        engine.advance(tick, ())
    return engine


@pytest.mark.parametrize("precision", ["float64", pytest.param("mixed", marks=pytest.mark.full)])
def test_books_close_while_a_block_breaks(soil, precision):
    """Energy in = kept + taken, over many breakages and new lists, the better the smaller the step."""
    errors = []
    for finer in (1, 4):
        engine = settled_block(soil, CEMENT, precision=precision, step_s=2e-5 / finer)
        before = shaken(engine, 0).energy().total_joule
        shaken(engine, 600 * finer, first=1)
        book, state = engine.energy(), engine.state("", 0, 0)
        assert state.broken_bond_count > 100
        assert state.rebuild_count > 5
        errors.append(abs(book.total_joule - before) / book.turned_over_joule)
        whole, broken = engine.bond_counts()
        assert whole + broken == engine.whole_state().bonds.made.sum() / 2
    assert errors[0] < 0.02
    assert errors[1] < max(0.6 * errors[0], 2e-3)


def test_same_bits_with_threads_and_after_a_restart(soil):
    """Positions and histories do not depend on the number of threads, nor on a checkpoint in between."""
    alone = shaken(settled_block(soil, CEMENT), 300)
    together = shaken(settled_block(soil, CEMENT, threads=2), 300)
    assert_array_equal(alone.positions_m(), together.positions_m())
    half = shaken(settled_block(soil, CEMENT), 150)
    arrays = {name: np.array(array) for name, array in half.state_arrays().items()}
    again = settled_block(soil, CEMENT)
    again.place(half.bed.positions_m)
    again.restore(arrays)
    shaken(again, 150, first=150)
    for name, array in alone.state_arrays().items():
        assert_array_equal(array, again.state_arrays()[name], err_msg=name)


def test_limits_of_strength_and_stiffness(soil):
    """Written first: bonds without strength break before they act, so the run has the bits of one without
    them; without stiffness they never act nor break; without end of strength none breaks."""
    plain = shaken(settled_block(soil, None), 200).positions_m()
    weak = CEMENT | {
        "damping_ratio": 0.0,
        "tensile_strength_pa": 1e-30,
        "cohesion_pa": 1e-30,
        "friction_angle_deg": 0.0,
    }
    engine = shaken(settled_block(soil, weak), 200)
    assert_array_equal(engine.positions_m(), plain)
    assert engine.bond_counts()[0] == 0
    soft = CEMENT | {"youngs_modulus_pa": 1e-20, "tensile_strength_pa": 1e-22, "cohesion_pa": 1e30}
    engine = shaken(settled_block(soil, soft), 200)
    assert_allclose(engine.positions_m(), plain, atol=1e-14)
    engine = shaken(settled_block(soil, UNBREAKABLE), 200, speed=0.01)
    assert engine.bond_counts()[1] == 0


def test_unequal_spheres_keep_momenta(soil):
    """Two sizes: the bond has the radius of the smaller, both bodies reach to one point."""
    resolved = scene(
        soil, UNBREAKABLE, "gravity_m_per_s2=0", "soil.time_step_s=1.0e-5", allow=["unstable_time_step"]
    )
    document = resolved.document
    document["soil"]["particles"] = {
        "sizes": {"kind": "listed", "radii_m": [0.008, 0.01], "shares": [1.0, 1.0], "shares_are": "number"},
        "density_kg_per_m3": DENSITY,
    }
    document["soil"]["bed"] = {"kind": "dense_random", "seed": 0}
    places, radii = np.array([(0.05, 0.0, -0.05), (0.068, 0.0, -0.05)]), np.array((0.008, 0.01))
    engine = SoilEngine(soil.resolve(document), Bed(places, (0.0, -0.1, -0.1), (0.12, 0.1), radii_m=radii))
    velocity, spin = [(0.0, 0.01, 0.0), (0.0, -0.01, 0.0)], [(0.3, 0.0, 0.5), (-0.1, 0.2, 0.0)]
    engine.place(places, velocity, spin, radii)
    kept = engine.whole_state().bonds.state[::BLOCK]
    assert kept[[0, 7, 8]] == pytest.approx((0.018, 0.008, -0.001))
    engine.start(())
    mass = DENSITY * 4.0 / 3.0 * math.pi * radii**3

    def momenta():
        x, v, w = engine.positions_m(), engine.velocities_m_per_s(), engine.angular_velocities_rad_per_s()
        turning = (np.cross(x, v) * mass[:, None] + 0.4 * (mass * radii**2)[:, None] * w).sum(axis=0)
        return np.concatenate(((v * mass[:, None]).sum(axis=0), turning))

    before = momenta()
    for tick in range(2000):
        engine.advance(tick, ())
    assert_allclose(momenta(), before, atol=1e-3 * np.abs(before).max())
    assert abs(momenta() - before).max() < 1e-12 + 1e-6 * np.abs(before).max()


def test_stable_step_counts_the_bonds(soil):
    """Stiff bonds shorten the step with the root of their modulus; soft ones change nothing."""
    steps = [
        step_limits(scene(soil, bonds, law={}, allow=["unstable_time_step"]).scene.particle_soil)[0].limit_s
        for bonds in (
            None,
            CEMENT | {"youngs_modulus_pa": 1.0, "tensile_strength_pa": 1e-3},
            CEMENT | {"youngs_modulus_pa": 1e9, "damping_ratio": 0.0},
            CEMENT | {"youngs_modulus_pa": 4e9, "damping_ratio": 0.0},
        )
    ]
    assert steps[1] == pytest.approx(steps[0], rel=1e-3)
    assert steps[2] == pytest.approx(2.0 * steps[3], rel=0.01)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"youngs_modulus_pa": 0.0}, "greater than 0"),
        ({"tensile_strength_pa": 9e4}, "allowed is up to"),
        ({"gap_over_radius": -1.0}, "greater than or equal to 0"),
        ({"radius_over_particle": 1.5}, "less than or equal to 1"),
        ({"damping_ratio": 1.0}, "less than 1"),
    ],
)
def test_bad_values_are_refused(changes, message):
    """One message that says what is allowed."""
    with pytest.raises(ValidationError, match=message):
        Bonds.model_validate(CEMENT | changes)


def test_bonds_that_outgrow_the_lists_are_refused(soil):
    """A bond must break before its particles leave the lists of neighbours."""
    with pytest.raises(Exception, match=r"skin_m: 0.003 m given; bonds reach over gaps of up to"):
        scene(soil, CEMENT | {"gap_over_radius": 0.4}, law={})
