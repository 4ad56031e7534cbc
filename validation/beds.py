"""S13 to S15: extremes of the number of particles, the duration and the speed."""

import resource

import numpy as np

from subsoil_ros.api.check_scene import BYTES_OF_PROCESS, BYTES_PER_PARTICLE
from subsoil_ros.dem.build import build_engine
from subsoil_ros.dem.engine import SoilEngine

from .cases import REFUSED, RIGHT, Cases, Outcome, must, refused, right, stopped
from .laboratory import GRAVITY, MASS, RADIUS, Document, Laboratory, advance, placed, tool_at, wet
from .laws import CALM_M_PER_S, ROOM_M, at_rest
from .steps import DEFECT

CASES = Cases()

CREEP_M = 1e-3 * RADIUS


@CASES.add("S13a", RIGHT)
def one_particle(laboratory: Laboratory) -> Outcome:
    """One particle falls, and comes to rest."""
    resolved = laboratory.soil(wet(), ROOM_M)
    floor = build_engine(resolved).bed.lower_m[2]
    start = floor + 0.06
    engine = placed(resolved, [[0.05, 0.0, start]], [[0.0, 0.0, 0.0]])
    step, steps = resolved.timing.soil_step_s, 1500
    advance(engine, steps)
    fallen = start - engine.positions_m()[0, 2]
    expected = 0.5 * GRAVITY * (steps * step) ** 2
    must(abs(fallen - expected) < 1e-12, f"fell {fallen} m, {expected} expected")
    advance(engine, 20_000)
    overlap = floor + RADIUS - engine.positions_m()[0, 2]
    stiffness = 1.0 / (1.0 / 10_000.0 + 1.0 / 16_000.0)
    rest = 0.002 + MASS * GRAVITY / stiffness
    must(abs(overlap - rest) < 1e-9, f"overlap {overlap} m, {rest} expected")
    return right(f"fell {fallen:.6f} m ({expected:.6f}), rests at {1e3 * overlap:.6f} mm ({1e3 * rest:.6f})")


@CASES.add("S13b", REFUSED)
def no_particle(laboratory: Laboratory) -> Outcome:
    """No particle: bin smaller than one, none placed, a tool in the place of all."""
    engine = build_engine(laboratory.soil())
    refused(lambda: engine.place(np.empty((0, 3))), "given no particle")
    away = build_engine(laboratory.soil(tool=laboratory.box(1.0, 1.0, 1.0)))
    refused(lambda: away.start(tool_at(0.06, -0.05)), "overlap every particle")
    return refused(lambda: build_engine(laboratory.soil(size_m=(0.015, 0.1, 0.1))), "holds no particle")


@CASES.add("S13c", RIGHT, long=True)
def a_million(laboratory: Laboratory) -> Outcome:
    """A million particles."""
    resolved = laboratory.soil(size_m=(1.8, 1.8, 1.8))
    found = at_rest(resolved, 20)
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    expected = BYTES_OF_PROCESS + BYTES_PER_PARTICLE * 1e6
    must(memory < expected, f"{memory / 1e9} GB, `check` says {expected / 1e9} GB")
    return right(f"{found}; {memory / 1e9:.2f} GB")


def resting(laboratory: Laboratory, steps: int) -> str:
    """A dense random bed under the whole law; counted after 10,000 steps in which it settles."""
    engine = build_engine(laboratory.soil(bed={"kind": "dense_random"}))
    engine.start(())
    advance(engine, 10_000)
    place, before = engine.positions_m(), engine.state("", 0, 0)
    advance(engine, steps)
    moved = float(np.linalg.norm(engine.positions_m() - place, axis=1).max())
    after = engine.state("", 0, 0)
    must(moved < CREEP_M, f"a particle moved by {moved} m in {steps} steps")
    allowed = max(before.rms_speed_m_per_s, CALM_M_PER_S)
    must(after.rms_speed_m_per_s <= allowed, f"rms speed {after.rms_speed_m_per_s} m/s, before {allowed} m/s")
    return (
        f"{steps} steps, {engine.particle_count} particles: creep {moved / RADIUS:.2g} r, rms speed "
        f"{before.rms_speed_m_per_s:.2g} to {after.rms_speed_m_per_s:.2g} m/s"
    )


@CASES.add("S14", RIGHT)
def resting_bed(laboratory: Laboratory) -> Outcome:
    """Resting dense bed, 20,000 steps."""
    return right(resting(laboratory, 20_000))


@CASES.add("S14", RIGHT, long=True)
def resting_bed_for_long(laboratory: Laboratory) -> Outcome:
    """Resting dense bed, a million steps."""
    return right(resting(laboratory, 1_000_000))


def fired(laboratory: Laboratory, law: Document, speed: float = 100.0) -> SoilEngine:
    """A resting bed, and a particle over it that comes down at this speed [m/s]."""
    resolved = laboratory.soil(law, max_lost_particles=0)
    bed = build_engine(resolved).bed.positions_m
    place = np.vstack([bed, [0.06, 0.0, 0.03]])
    velocity = np.zeros_like(place)
    velocity[-1, 2] = -speed
    return placed(resolved, place.tolist(), velocity.tolist())


def flown(engine: SoilEngine) -> str:
    """What became of the particle by the energy book."""
    before = engine.energy()
    advance(engine, 400)
    after, state = engine.energy(), engine.state("", 0, 0)
    defect = abs(after.total_joule - before.total_joule) / (after.turned_over_joule + before.kinetic_joule)
    must(
        defect < DEFECT and state.lost_particle_count == 0,
        f"defect {defect}, {state.lost_particle_count} lost",
    )
    return f"{before.kinetic_joule:.1f} J, defect {defect:.2g}"


@CASES.add("S15a", RIGHT)
def fired_at_a_soft_bed(laboratory: Laboratory) -> Outcome:
    """Particle fired into the bed: 100 m/s by the book, 200 m/s stopped."""
    found = flown(fired(laboratory, wet()))
    twice = fired(laboratory, wet(), 200.0)
    outcome = stopped(lambda: advance(twice, 400), "two particles overlap by .* radii|left the domain")
    return right(f"{found}; 200 m/s: {outcome.found.split(',')[0]}")


@CASES.add("S15b", RIGHT)
def fired_at_a_hard_bed(laboratory: Laboratory) -> Outcome:
    """The same under Hertz's law, 1 GPa."""
    row = {
        "youngs_modulus_pa": 1e9, "poisson_ratio": 0.3, "restitution": 0.5,
        "static_friction": 0.5, "sliding_friction": 0.5, "rolling_friction": 1e-20,
    }  # fmt: skip
    law = {"kind": "hertz_mindlin", "particle": row, "boundary": row}
    return right(flown(fired(laboratory, law)))
