"""The elasto-plastic adhesive law (EEPA) against its closed two-body loop, its energies and its limits.

Reference: Thakur et al., Granular Matter 16 (2014) 383-400, written anew with the largest overlap as memory.
"""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pydantic import ValidationError

from subsoil_ros.contact_laws.base import YES, ContactMotion, ContactState, Features
from subsoil_ros.contact_laws.elasto_plastic_adhesive.law import ElastoPlasticAdhesiveLaw
from subsoil_ros.dem.contact import at_size, contact, normal_potential
from subsoil_ros.limits.stable_steps import step_limits
from subsoil_ros.loading.loader import load_scene
from tests.physics.impacts import laboratory
from tests.soils import BOOKED, PLASTIC

RADIUS, MASS = 0.01, 1800.0 * 4.0 / 3.0 * math.pi * 0.01**3
ROW = {
    "youngs_modulus_pa": 1e7, "poisson_ratio": 0.3, "contact_plasticity": 0.75,
    "static_friction": 0.0, "sliding_friction": 0.0,
}  # fmt: skip
STICKY = ROW | {"surface_energy_joule_per_m2": 300.0}
FEATURES = Features(YES, YES, YES)
NONE = (0.0, 0.0, 0.0)
STEP_S = 1e-6

# one, with all branches: loads, unloads, pulls, loads again to beyond, lets go
WAY = np.concatenate(
    [
        np.linspace(0.0, 4e-4, 401), np.linspace(4e-4, 2.5e-4, 151), np.linspace(2.5e-4, 3e-4, 51),
        np.linspace(3e-4, 1e-4, 201), np.linspace(1e-4, 6e-4, 501), np.linspace(6e-4, 1e-7, 600),
    ]
)  # fmt: skip


def law_of(row, exponent=1.0, **more):
    """The law, particles and boundary alike."""
    return ElastoPlasticAdhesiveLaw(
        kind="elasto_plastic_adhesive", exponent=exponent, particle=row, boundary=row, **more
    )


def numbers_of(law):
    """Of two particles."""
    pair = law.pair(1.0, 0.5 * RADIUS, 0.5 * MASS)
    return pair, law.numbers_of(pair, 0.5 * RADIUS)


def at_rest(own=(0.0, 0.0)):
    """State of a contact without springs."""
    return ContactState(NONE, NONE, own)


def pressed(law, way, own=(0.0, 0.0)):
    """Normal force [N], energy (n, 2) that yielding and adhesion took [J] and memory along overlaps `way`, at
    rest at each."""
    force, booked, motion, state = [], [], ContactMotion((1.0, 0.0, 0.0), NONE, NONE), at_rest(own)
    for overlap in way:
        f, _, state, sinks = contact(overlap, motion, state, STEP_S, law, FEATURES)
        force.append(-f[0])
        booked.append(sinks[5:])
    return np.array(force), np.array(booked), state.own


def published(way, pair, n):
    """Force along `way` as the paper writes it."""
    k1, k2, part = pair.stiffness, pair.unloading_stiffness, pair.contact_plasticity
    largest, k_adhesive, found = 0.0, 0.0, []
    for overlap in way:
        if overlap > largest:
            largest = overlap
            plastic = part ** (1.0 / n) * largest
            pull = min(pair.adhesion_root * math.sqrt(plastic), 0.5 * k2 * plastic**n)
            k_adhesive = pull * k2 / (k2 * plastic**n - pull) if pull > 0.0 else 0.0
        unloads = k2 * (overlap**n - part * largest**n)
        if unloads >= k1 * overlap**n:
            force = k1 * overlap**n
        elif unloads > -k_adhesive * overlap**n:
            force = unloads
        else:
            force = -k_adhesive * overlap**n
            largest = ((1.0 + k_adhesive / k2) * overlap**n / part) ** (1.0 / n)
        found.append(force)
    return np.array(found)


@pytest.mark.parametrize("row", [ROW, STICKY], ids=["plastic", "adhesive"])
@pytest.mark.parametrize("exponent", [1.0, 1.5])
def test_loop_is_the_published_one(row, exponent):
    """Loading, unloading, pulling, loading from there: to 1e-9 of the largest force."""
    pair, law = numbers_of(law_of(row, exponent))
    force, _, _ = pressed(law, WAY)
    expected = published(WAY, pair, exponent)
    assert_allclose(force, expected, atol=1e-9 * expected.max(), rtol=0.0)
    assert (force.min() < -0.01 * force.max()) == (row is STICKY)


@pytest.mark.parametrize("exponent", [1.0, 1.5])
def test_every_branch_books_what_it_takes(exponent):
    """On every stretch the work of the motion is what is stored and what is booked, second order in the
    stretch; plastic work and adhesion only take."""
    _, law = numbers_of(law_of(STICKY | {"pull_off_newton": 0.1}, exponent))
    errors = []
    for finer in (1, 4):
        way = np.interp(np.linspace(0, len(WAY) - 1, finer * (len(WAY) - 1) + 1), np.arange(len(WAY)), WAY)
        kept, stored, found, booked, last = (0.0, 0.0), 0.0, [], [], 0.0
        for before, overlap in zip(np.r_[0.0, way], way, strict=False):
            force, taken, kept = pressed(law, [overlap], kept)
            now = normal_potential(overlap, at_rest(kept), law, FEATURES)
            work = 0.5 * (last + force[0]) * (overlap - before)
            found.append(work - (now - stored) - taken.sum())
            booked.append(taken[0])
            assert taken[0, 1] == 0.0 or force[0] < 0.0  # adhesion takes only where it pulls
            assert taken[0].min() == 0.0
            stored, last = now, force[0]
        errors.append(abs(np.sum(found[1:])) / np.sum(booked))
        assert np.min(booked) >= -1e-18
    assert errors[0] < 5e-3
    assert errors[1] < 0.3 * errors[0]


def test_a_loop_loses_what_its_triangle_holds():
    """Walton and Braun: of k1 d^2 / 2 the part 1 - k1 / k2 is lost, and all of it is booked."""
    pair, law = numbers_of(law_of(ROW))
    way = np.concatenate([np.linspace(0.0, 4e-4, 20001), np.linspace(4e-4, 0.0, 20001)])
    _, booked, kept = pressed(law, way)
    brought = 0.5 * pair.stiffness * 4e-4**2
    assert booked.sum(axis=0) == pytest.approx((0.75 * brought, 0.0), rel=1e-3)
    assert normal_potential(0.0, at_rest(kept), law, FEATURES) == 0.0


@pytest.mark.parametrize("exponent", [1.0, 1.5])
def test_pull_off_is_that_of_the_surface_energy(exponent):
    """The largest attraction is 3/2 pi dgamma a with a^2 = 2 R p, or half of k2 p^n where that is less."""
    pair, law = numbers_of(law_of(STICKY, exponent))
    plastic = 0.75 ** (1.0 / exponent) * 4e-4
    way = np.concatenate([np.linspace(0.0, 4e-4, 11), np.linspace(4e-4, 0.0, 40001)])
    force, _, _ = pressed(law, way)
    wanted = 1.5 * math.pi * 300.0 * math.sqrt(2.0 * 0.5 * RADIUS * plastic)
    assert wanted < 0.5 * pair.unloading_stiffness * plastic**exponent
    assert force.min() == pytest.approx(-wanted, rel=1e-3)
    glued = law._replace(adhesion_root=1e3 * law.adhesion_root)
    force, _, _ = pressed(glued, way)
    assert force.min() == pytest.approx(-0.5 * pair.unloading_stiffness * plastic**exponent, rel=1e-3)


def test_without_plasticity_it_is_elastic():
    """No memory, no loss: a linear spring, or Hertz's."""
    for exponent in (1.0, 1.5):
        pair, law = numbers_of(law_of(ROW | {"contact_plasticity": 0.0}, exponent))
        force, booked, _ = pressed(law, WAY)
        assert_allclose(force, pair.stiffness * WAY**exponent, rtol=1e-12)
        assert np.abs(booked).max() < 1e-18


def test_what_attracts_limits_friction_too():
    """At no normal force, where the spring pulls as much as it once was pressed, adhesion still presses."""
    row = STICKY | {"static_friction": 0.5, "sliding_friction": 0.5}
    _, law = numbers_of(law_of(row))
    _, _, kept = pressed(law, [4e-4])
    overlap = kept[0]  # the spring is slack there
    motion = ContactMotion((1.0, 0.0, 0.0), (0.0, 10.0, 0.0), NONE)
    force, *_ = contact(overlap, motion, at_rest(kept), 1e-4, law, FEATURES)
    assert abs(force[0]) < 1e-9
    assert -force[1] == pytest.approx(0.5 * kept[1] * law.unloading_stiffness * overlap, rel=1e-6)


@pytest.mark.parametrize("exponent", [1.0, 1.5])
def test_impact(soil, exponent):
    """Head on, without adhesion: the restitution of the spring's loop, whatever the speed, and the books
    close."""
    s = 0.75 ** (1.0 / exponent)
    square = (1.0 - s ** (exponent + 1.0) - (exponent + 1.0) * s**exponent * (1.0 - s)) / 0.25
    for speed in (0.2, 1.0):
        engine = laboratory(
            soil, law_of(ROW, exponent).model_dump(exclude_none=True), RADIUS, 1800.0, 500, True, 24.0
        )
        engine.place([(0.04, 0, -0.06), (0.06, 0, -0.06)], [(speed, 0, 0), (-speed, 0, 0)])
        engine.start(())
        before = engine.energy()
        for tick in range(6000):
            engine.advance(tick, ())
        v = engine.velocities_m_per_s()
        assert (v[1, 0] - v[0, 0]) / (2.0 * speed) == pytest.approx(math.sqrt(square), rel=0.01)
        after = engine.energy()
        assert after.total_joule == pytest.approx(before.total_joule, rel=2e-3)
        assert after.sinks_joule["yielding"] == pytest.approx((1.0 - square) * before.kinetic_joule, rel=0.01)


@pytest.mark.parametrize("energy", [300.0, 0.0])
def test_a_slow_impact_sticks_by_adhesion_alone(soil, energy):
    """Two spheres that meet slowly stay together, those without adhesion do not, whatever the dashpot; the
    books close."""
    row = STICKY | {"restitution": 0.5, "surface_energy_joule_per_m2": energy}
    engine = laboratory(soil, law_of(row).model_dump(exclude_none=True), RADIUS, 1800.0, 2000, True, 24.0)
    engine.place([(0.04, 0, -0.06), (0.06, 0, -0.06)], [(0.05, 0, 0), (-0.05, 0, 0)])
    engine.start(())
    before = engine.energy()
    for tick in range(20000):
        engine.advance(tick, ())
    x, v = engine.positions_m(), engine.velocities_m_per_s()
    after = engine.energy()
    assert after.total_joule == pytest.approx(before.total_joule, rel=0.01)
    if energy > 0.0:
        assert x[1, 0] - x[0, 0] < 2.0 * RADIUS
        assert after.kinetic_joule < 1e-3 * before.kinetic_joule
    else:  # the dashpot takes its part where the spring presses, the yielding sqrt(1 - lambda_p)
        assert x[1, 0] - x[0, 0] > 2.0 * RADIUS
        assert 0.8 < (v[1, 0] - v[0, 0]) / 0.1 / (0.5 * 0.5) < 1.0


@pytest.mark.parametrize("exponent", [1.0, 1.5])
def test_numbers_of_a_size_are_those_of_the_pair(exponent):
    """From a reduced radius of 1 m and mass of 1 kg the kernels find what the law says of a size."""
    row = STICKY | {
        "restitution": 0.5, "pull_off_newton": 0.1, "rolling_friction": 0.1, "static_friction": 0.4,
    }  # fmt: skip
    law = law_of(row, exponent)
    for ratio in (1.0, 1.5):
        direct = law.numbers_of(law.pair(ratio, 0.004, 0.003), 0.004)
        unit = law.numbers_of(law.pair(ratio, 1.0, 1.0), 1.0)
        assert_allclose(at_size(unit, 0.004, 0.003), direct, rtol=1e-12)


@pytest.mark.parametrize("exponent", [1.0, 1.5])
def test_unlike_layers(exponent):
    """The same seen from either side, and between equals that of one."""
    one = law_of(STICKY | {"restitution": 0.5}, exponent)
    other = law_of(ROW | {"contact_plasticity": 0.3, "youngs_modulus_pa": 3e7, "restitution": 0.8}, exponent)
    mixed, turned = one.mixed_pair(other, 1.0, 0.005, 0.003), other.mixed_pair(one, 1.0, 0.005, 0.003)
    assert mixed == turned
    assert (mixed.contact_plasticity, mixed.adhesion_root) == (0.75, 0.0)
    assert one.mixed_pair(one, 1.0, 0.005, 0.003) == one.pair(1.0, 0.005, 0.003)


@pytest.mark.parametrize("exponent", [1.0, 1.5])
@pytest.mark.parametrize("row", ["particle", "boundary"])
def test_the_step_follows_from_unloading(exponent, row):
    """The stiffer it unloads, between particles or at walls, the shorter the step: with the root of k2."""

    def limit_s(plasticity):
        law = law_of(ROW, exponent).model_dump(exclude_none=True)
        law[row]["contact_plasticity"] = plasticity
        soil = {
            "bin": {"length_m": 0.2, "width_m": 0.2, "depth_m": 0.1}, "law": law,
            "particles": {"radius_m": RADIUS, "density_kg_per_m3": 1800.0},
            "bed": {"kind": "grid", "spacing_m": 2.0 * RADIUS},
        }  # fmt: skip
        scene = load_scene({"name": "steps", "duration_s": 0.1, "soil": soil})
        return step_limits(scene.scene.particle_soil)[0].limit_s

    assert limit_s(0.9999) / limit_s(0.99) == pytest.approx(0.1, rel=0.01)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"contact_plasticity": 1.0}, "less than 1"),
        ({"contact_plasticity": -0.1}, "greater than or equal to 0"),
        ({"surface_energy_joule_per_m2": -1.0}, "greater than or equal to 0"),
        ({"pull_off_newton": -1.0}, "greater than or equal to 0"),
        ({"restitution": 0.0}, "greater than 0"),
        (
            {"surface_energy_joule_per_m2": 1.0, "contact_plasticity": 0.0},
            "where no contact is left that sticks",
        ),
    ],
)
def test_bad_values_are_refused(change, words):
    """By the name of the key."""
    with pytest.raises(ValidationError, match=rf"(?s){next(iter(change))}.*{words}"):
        law_of(ROW | change)


def test_other_exponents_are_refused():
    """Only 1 and 1.5 are computed."""
    with pytest.raises(ValidationError, match=r"exponent: given 2, allowed are 1 and 1\.5"):
        law_of(ROW, 2.0)


def test_contacts_that_begin_pressed_have_yielded_before(soil):
    """No energy is lost before the first step, however far spheres overlap where they are laid out."""
    document = {
        "bin": {"length_m": 0.12, "width_m": 0.1, "depth_m": 0.1},
        "particles": {"radius_m": 0.01, "density_kg_per_m3": 1800.0},
        "bed": {"kind": "grid", "spacing_m": 0.0195},
        "law": PLASTIC,
        **BOOKED,
    }
    engine = soil.engine(soil=document)
    engine.start(())
    assert engine.max_overlap_m() > 4e-4
    assert not any(engine.energy().sinks_joule.values())
