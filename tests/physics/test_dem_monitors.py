"""Monitors of a running soil: they stop lost physics, name it, and leave healthy runs alone."""

import json
import logging

import numpy as np
import pytest
from numpy.testing import assert_allclose

from subsoil_ros.cli.main import main
from subsoil_ros.dem.build import build_engine
from subsoil_ros.dem.monitors import MotionSums, half_step_sums, refuse_lost_numbers
from subsoil_ros.dem.particles import Kinematics, Loads, Masses, Particles
from subsoil_ros.errors import InputError, PhysicsError, SceneError
from subsoil_ros.messages import SoilState
from subsoil_ros.recording.bag_reader import BagReader

TOO_LARGE = {"time_step_s": 1.2e-4, "allow": ["unstable_time_step"]}
"""1.3 times the limit of the grid bed itself (z = 6: 94 us), 2.2 times that of a dense one."""


def with_soil(maker, gravity=9.81, allow=(), **changes):
    """The small scene with other keys of its soil."""
    soil = maker.scene().document["soil"] | changes
    return maker.scene(soil=soil, gravity_m_per_s2=gravity, allow=list(allow))


def run(engine, ticks, motions=()):
    """Starts, and advances so many ticks."""
    engine.start(motions)
    for tick in range(ticks):
        engine.advance(tick, motions)


def shaken(scene):
    """An engine whose bed starts with random spins of 1 rad/s."""
    engine = build_engine(scene)
    place = engine.bed.positions_m
    engine.place(place, None, np.random.default_rng(0).normal(0.0, 1.0, place.shape))
    return engine


def test_alternation_of_equal_opposite_and_growing_motions():
    """0 for a steady motion, 1 for one that reverses; of (u, w) half a step before and after, in between:
    ((w - u) / 2)^2 over it plus ((w + u) / 2)^2."""
    masses = mass, inertia = Masses(0.5, 0.25)
    step = 0.125
    place, still = np.zeros((4, 3)), np.zeros((4, 3))
    before = np.random.default_rng(1).normal(size=(4, 3))

    def velocity_reversal(after):
        spin, torque = 0.5 * (before + after), inertia * (after - before) / step
        return MotionSums(
            *half_step_sums(Kinematics(place, still, spin), Loads(still, torque), masses, step)
        ).velocity_reversal

    assert velocity_reversal(before) == 0.0
    assert velocity_reversal(-before) == 1.0
    assert velocity_reversal(0.5 * before) == pytest.approx(0.25**2 / (0.25**2 + 0.75**2))
    of_velocity = half_step_sums(Kinematics(place, still, still), Loads(mass * before, still), masses, step)
    assert MotionSums(*of_velocity).velocity_reversal == 1.0
    assert_allclose(of_velocity[1], (0.5 * step * before) ** 2 @ np.ones(3) @ np.ones(4))


def test_a_step_too_large_is_stopped_with_its_cause(soil):
    """The bed spins, the run stops within 400 steps, and says what to do."""
    with pytest.raises(
        PhysicsError, match=r"tick \d+: velocities reverse .*max_velocity_reversal 0.2.*smaller"
    ):
        run(shaken(with_soil(soil, **TOO_LARGE)), 400)


def test_the_state_shows_the_spin_that_hides_at_whole_steps(soil):
    """Kinetic energy of the state, spin at whole steps, is that of calm soil; the rms spin tells."""
    engine = shaken(with_soil(soil, **TOO_LARGE, monitors=None))
    run(engine, 400)
    state = engine.state("", 399, 0)
    spinning = (
        0.5 * 0.4 * engine.mass_kg * 0.01**2 * state.rms_angular_velocity_rad_per_s**2 * state.particle_count
    )
    assert state.rms_angular_velocity_rad_per_s > 5.0
    assert state.kinetic_energy_joule < 0.01 * spinning


def test_a_tool_in_a_bed_at_a_stable_step_stops_nothing(soil, one, at):
    """A box ploughs at 1 m/s, all monitors on, the energy's too."""
    scene = soil.scene(
        soil=soil.scene().document["soil"] | {"monitors": {"every_steps": 1, "max_energy_defect": 0.05}},
        tools=one(soil.box(0.03, 0.04, 0.03)),
    )
    engine = build_engine(scene)
    engine.start(at(0.03, -0.03))
    for tick in range(400):
        engine.advance(tick, at(0.03 + 5.0e-5 * (tick + 1), -0.03, vx=1.0))


def test_the_energy_book_alone_finds_the_step_too_large(soil):
    """What spins is fed from nowhere: the defect passes a twentieth of all that was exchanged."""
    only = {"max_velocity_reversal": None, "max_pair_overlap_radii": None, "max_energy_defect": 0.05}
    with pytest.raises(PhysicsError, match=r"the energy book is off by .*max_energy_defect 0.05"):
        run(shaken(with_soil(soil, **TOO_LARGE, monitors=only)), 400)


def test_a_deep_overlap_of_two_particles_is_stopped(soil):
    """Two particles at 40 m/s against each other: K_X would need more than their diameter to stop them."""
    engine = build_engine(with_soil(soil, monitors={"every_steps": 1, "max_pair_overlap_radii": 1.5}))
    engine.place([[0.04, 0.0, -0.05], [0.065, 0.0, -0.05]], [[40.0, 0.0, 0.0], [-40.0, 0.0, 0.0]])
    with pytest.raises(PhysicsError, match=r"two particles overlap by 1\.\d+ radii, allowed is .* 1.5"):
        run(engine, 100)


@pytest.mark.parametrize("part", ["position", "velocity", "angular_velocity"])
def test_what_is_no_number_is_named_by_its_particle(part):
    """Also a spin, which moves no particle: identity, state, last force."""
    particles = Particles.at_rest(np.zeros((3, 3)), np.array([7, 5, 6]), np.float64)
    refuse_lost_numbers("tick 3", particles)
    getattr(particles, part)[1, 2] = np.nan
    with pytest.raises(PhysicsError, match=r"tick 3: particle 5 is no longer a number, 0 others.*last force"):
        refuse_lost_numbers("tick 3", particles)


def test_numbers_lost_in_a_run_are_found_at_the_next_look(soil):
    """Spins too large for a square: no particle moves, so no list is rebuilt; the look finds them."""
    engine = build_engine(with_soil(soil, gravity=0.0, monitors={"every_steps": 10}))
    engine.place([[0.04, 0.0, -0.05], [0.0585, 0.0, -0.05]], None, [[0.0, 1e308, 0.0], [0.0, 1e308, 0.0]])
    with pytest.raises(PhysicsError, match=r"tick \d: particle [01] is no longer a number"):
        run(engine, 10)


def lost_run(maker, velocity, **changes):
    """One particle of three leaves at `velocity`; 400 steps, a look every ten."""
    engine = build_engine(with_soil(maker, monitors={"every_steps": 10}, **changes))
    place = [[0.03, 0.02, -0.05], [0.06, 0.0, -0.05], [0.09, -0.02, -0.05]]
    engine.place(place, [[0.0, 0.0, 0.0], velocity, [0.0, 0.0, 0.0]])
    run(engine, 400)
    return engine


@pytest.mark.parametrize(
    "velocity", [(0.0, 0.0, -60.0), (0.0, 60.0, 0.0), (-60.0, 0.0, 0.0), (60.0, 0.0, 0.0), (0.0, 0.0, 30.0)]
)
def test_a_particle_that_leaves_is_counted_and_named(soil, caplog, velocity):
    """Through floor, side and ends, and far above: counted for good, warned of once, named with its tick."""
    with caplog.at_level(logging.WARNING):
        engine = lost_run(soil, velocity)
    (lost,) = engine.lost_particles
    assert engine.state("", 399, 0).lost_particle_count == 1
    assert lost.identity == 1
    assert np.dot(np.array([lost.x_m, lost.y_m, lost.z_m]) - (0.06, 0.0, -0.05), velocity) > 0.0
    assert 0 < lost.tick < 400
    assert lost.tick % 10 == 9
    assert [record.message.count("particle 1 at") for record in caplog.records] == [1]


def test_more_lost_particles_than_allowed_stop_the_run(soil):
    """The bound of the scene, the particle, and what to do."""
    with pytest.raises(PhysicsError, match=r"1 of 3 particles have left .*max_lost_particles 0; use"):
        lost_run(soil, (0.0, 0.0, -60.0), max_lost_particles=0)


@pytest.mark.parametrize(
    ("place", "words"),
    [
        ([], "no particle"),
        ([[0.05, 0.0, -0.3]], "outside|inside the bin"),
        ([[0.05, np.nan, -0.05]], "centres inside the bin"),
    ],
)
def test_particles_are_placed_inside_the_bin_only(soil, place, words):
    """Outside it, or nowhere: refused with the box."""
    with pytest.raises(InputError, match=words):
        build_engine(soil.scene()).place(np.array(place).reshape(-1, 3))


def test_placed_velocities_are_finite_and_as_many_as_particles(soil):
    """One row each."""
    engine = build_engine(soil.scene())
    with pytest.raises(InputError, match="1 rows of velocity, 0 finite; they must be 1, all finite"):
        engine.place([[0.05, 0.0, -0.05]], [[np.inf, 0.0, 0.0]])
    with pytest.raises(InputError, match="2 rows of angular_velocity"):
        engine.place([[0.05, 0.0, -0.05]], None, np.zeros((2, 3)))


def test_a_step_is_forced_by_name_only(soil):
    """The refusal names the entry of `allow`; with 'auto' there is nothing that it is about."""
    with pytest.raises(SceneError, match=r"above the stable limit .*allow: \[unstable_time_step\]"):
        with_soil(soil, time_step_s=1.2e-4)
    with pytest.raises(SceneError, match="'unstable_time_step' is about a number"):
        with_soil(soil, time_step_s="auto", allow=["unstable_time_step"])


def test_a_stopped_run_leaves_a_readable_bag_and_exit_status_3(soil, tmp_path, capsys):
    """`subsoil run`: what was recorded before the stop can be read, the summary has the failure."""
    path = with_soil(soil, **TOO_LARGE).path
    out = tmp_path / "out"
    jitter = ["--set", "soil.bed.jitter_m=0.0005", "--set", "duration_s=0.1"]
    assert main(["run", str(path), "--out", str(out), "--mode", "direct", *jitter]) == 3
    said = capsys.readouterr()
    assert "allow: unstable_time_step: the step 120 us is above the stable limit 53.7 us" in said.out
    assert "velocities reverse sign from one step to the next" in said.err
    summary = json.loads((out / "summary.json").read_text())
    assert "max_velocity_reversal" in summary["run"]["failure"]
    assert summary["scene"]["allow"] == ["unstable_time_step"]
    assert not summary["run"]["complete"]
    assert [state.tick for state in BagReader(out / "bag").records(SoilState)] == [-1, 19, 39, 59, 79, 99]


@pytest.mark.parametrize("mode", ["direct", "nodes"])
def test_lost_particles_are_in_the_summary(soil, tmp_path, capsys, mode):
    """A soft floor lets the bottom layer through: one line for people, three keys for programs, whether the
    soil is in this process or in one of its own."""
    scene = with_soil(soil, gravity=300.0, max_lost_particles=1000)
    row = scene.document["soil"]["law"]["boundary"] | {"stiffness_newton_per_m": 150.0}
    path = with_soil(
        soil,
        gravity=300.0,
        max_lost_particles=1000,
        law=scene.document["soil"]["law"] | {"boundary": row},
        monitors={"max_velocity_reversal": None, "max_pair_overlap_radii": None},
    ).path
    out = tmp_path / "out"
    assert main(["run", str(path), "--out", str(out), "--mode", mode, "--set", "duration_s=0.05"]) == 0
    summary = json.loads((out / "summary.json").read_text())
    assert summary["particles"]["lost_count"] > 0
    assert 0.0 < summary["particles"]["first_lost_s"] <= 0.05
    said, named = capsys.readouterr().out, summary["particles"]["first_lost"]
    assert "particles left the domain" in said
    assert len(named) == min(3, summary["particles"]["lost_count"])
    for lost in named:
        place = ", ".join(f"{x:.3f}" for x in lost["position_m"])
        assert f"particle {lost['identity']} at ({place}) m" in said
        assert lost["position_m"][2] < 0.0
        assert 0.0 < lost["time_s"] <= 0.05
