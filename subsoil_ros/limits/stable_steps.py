"""Stable soil steps and ticks of a scene."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

from ..errors import SceneError
from ..scene.pair_laws import boundary_values, layer_soils, particle_values, sphere_mass_kg
from ..scene.scene import Scene
from ..scene.soil import Soil
from ..ticks import NANOSECONDS_PER_SECOND, tick_count

DENSE_COORDINATION = 10.4
"""Damped contacts per particle of random close packing under the cohesive linear law. A cubic
grid starts with 6, but where a tool compacts it, it comes near this, so the limits use it."""

SAFETY = 0.6
"""Part of the smallest limit that `time_step_s: auto` takes (measured, validation/soil_engine.md: at rest the
densest neighbourhoods of a dense random bed damp faster than its mean coordination, and leave 0.86 of it;
the wedge that a share compacts, up to 16 damped contacts a particle, spins from 0.69 on, is calm at 0.63)."""

DENSE_CALM = 0.41
"""Part of the limit set by dampers at which a dense random bed stayed calm before the paper's machine (22
us); at 0.6 it spun and was stopped on three beds of three (reproduction/yuan_yu_2020/accuracy.md). Limits
set by springs fall with the root of the coordination only."""

REDUCED_INTERVAL_NS = 1_000_000
"""Tick of a scene on the wedge model: its springs and wheels swing a hundred times slower."""

PREDICTED_INTERVAL_NS = 2_000_000
"""The same where the machine predicts its motion: the residual is half of what 1 ms has with a held force
(validation/wedge.md). A controller, which counts in ticks, keeps 1 ms."""

MECHANISM_INTERVAL_NS = 500_000
"""Tick of a scene without soil: 1/250 of the period of the paper's machine's fastest mode, 8 Hz."""


MAX_OVERLAP = 0.05
"""Bound of overlap over radius of a soil at work: beyond it springs, not friction, resist compaction. Dampers
of laws with a varying stiffness are taken there."""

LARGEST_STEP_COUNT = 1_000_000
"""Largest number of soil steps in a tick: one of 100,000 particles then takes a day."""


@dataclass(frozen=True)
class StepLimit:
    """Largest stable soil step for one cause."""

    cause: str
    limit_s: float
    damped: bool = False  # set by dampers, else by springs


def step_limits(soil: Soil, coordination: float = DENSE_COORDINATION) -> tuple[StepLimit, ...]:
    """Stable steps of explicit integration, smallest first.

    Dampers, z contacts per particle: neighbours in opposite motion see the rate 2 z C / m, equal spins
    (4/3) z C l^2 / I with I = 0.4 m r^2 and the arm l = r - delta_c / 2; stable for step x rate <= 2.
    Springs: the same modes, omega^2 = 2 z (K_X + 2 K_Y) / (3 m) and (4/3) z K_Y l^2 / I; step <= 2 / omega.
    K_X is the steepest slope of the normal force: K_C, below the rest overlap, where it is larger.
    Walls and tools do not give way: a particle in a corner has three contacts, rates (C_X + 2 C_Y) / m and
    2 C_Y l^2 / I, the same of the springs.

    Of unlike particles the worst one binds: (a + b)^2 <= 2 a^2 + 2 b^2, contact by contact, bounds each of
    these rates of the whole bed by its largest over single particles, and the smallest of a layer has the
    largest z / m (neighbours grow with the square of the radius at most, mass with its cube) under the
    stiffest of its pairs.

    Bonds act beside the contacts: rates of dampers, and squares of frequencies, add up. Where waves set the
    limit of the springs, dampers are those at an overlap of MAX_OVERLAP.
    """
    layers, named = layer_soils(soil), [""]
    if soil.layers:
        named = [f", layer {layer.name}" for layer in soil.layers]
    waves = [found for found in map(_wave_limit, layers) if found is not None]
    if waves:
        slowest = min(waves, key=lambda item: item.limit_s)
        of_bonds = [bond for layer in layers for bond in _bond_limits(layer, coordination).values()]
        dampers = [
            found
            for layer, where in zip(layers, named, strict=True)
            for limits in (
                _boundary_limits(layer, where),
                *(_particle_limits(layer, other, coordination, where) for other in layers),
            )
            for found in limits.values()
            if found.damped
        ]
        worst = [_beside(min(dampers, key=lambda item: item.limit_s), of_bonds)] if dampers else []
        return tuple(sorted((_beside(slowest, of_bonds), *worst, *of_bonds), key=lambda item: item.limit_s))
    smallest: dict[str, StepLimit] = {}
    for layer, where in zip(layers, named, strict=True):
        bonds = _bond_limits(layer, coordination)
        candidates = [bonds]
        for other in layers:
            found_here = _particle_limits(layer, other, coordination, where)
            candidates.append(
                {
                    kind: _beside(limit, (bonds[kind],) if kind in bonds else ())
                    for kind, limit in found_here.items()
                }
            )
        for limits in (*candidates, _boundary_limits(layer, where)):
            for kind, found in limits.items():
                if kind not in smallest or found.limit_s < smallest[kind].limit_s:
                    smallest[kind] = found
    return tuple(sorted(smallest.values(), key=lambda item: item.limit_s))


def _particle_limits(soil: Soil, other: Soil, z: float, named: str) -> dict[str, StepLimit]:
    """Limits of the smallest particle of `soil` among particles of `other`, by kind of motion.

    As z of its own size fit around it, z ((r1 + r2) / (2 r2))^2 of another size do: cross-sections r2^2 on a
    sphere of r1 + r2. With the dampers of such a pair, C ~ (2 r1 r2 / (r1 + r2))^2, the rate is that of like
    ones.
    """
    radius = soil.particles.bounds_m[0]
    own, others = soil.particles.mean_volume_radius_m, other.particles.mean_volume_radius_m
    z *= ((own + others) / (2.0 * others)) ** 2
    mass = sphere_mass_kg(soil, radius)
    pair = particle_values(soil, other, 0.5 * radius, 0.5 * mass).linear_at(MAX_OVERLAP * radius)
    arm = radius - 0.5 * pair.rest_overlap
    inertia = 0.4 * mass * radius**2
    name = f"coordination {z:g}, particle {mass * 1e3:.3g} g{named}"
    stiffness, tangential = pair.max_stiffness, pair.tangential_stiffness
    damping, sliding = max(pair.damping, pair.tangential_damping), pair.tangential_damping
    return _limits(
        {
            "spin, dampers": (
                f"damping {sliding:g} N s/m acting on rotation, {name}",
                4.0 / 3.0 * z * sliding * arm**2 / inertia,
            ),
            "translation, dampers": (
                f"damping {damping:g} N s/m acting on translation, {name}",
                2.0 * z * damping / mass,
            ),
        },
        {
            "translation, springs": (
                f"stiffness {stiffness:g} and {tangential:g} N/m of the bed, {name}",
                2.0 * z * (stiffness + 2.0 * tangential) / (3.0 * mass),
            ),
            "spin, springs": (
                f"tangential stiffness {tangential:g} N/m acting on rotation, {name}",
                4.0 / 3.0 * z * tangential * arm**2 / inertia,
            ),
            "pair": (f"stiffness {stiffness:g} N/m of a single pair", 2.0 * stiffness / mass),
        },
    )


def _limits(
    rates: dict[str, tuple[str, float]], squares: dict[str, tuple[str, float]]
) -> dict[str, StepLimit]:
    """Limits by kind of motion, from cause and rate [1/s] of dampers, squared frequency [1/s2] of springs."""
    damped = {kind: StepLimit(cause, 2.0 / rate, True) for kind, (cause, rate) in rates.items() if rate > 0.0}
    return damped | {
        kind: StepLimit(cause, 2.0 / math.sqrt(square))
        for kind, (cause, square) in squares.items()
        if square > 0.0
    }


def _bond_limits(soil: Soil, z: float) -> dict[str, StepLimit]:
    """Limits of the smallest particle of `soil` among z bonds and nothing else, by kind of motion.

    Opposite spins of neighbours see bending and torsion, equal ones shear; of each the larger counts.
    """
    if soil.bonds is None:
        return {}
    radius = soil.particles.bounds_m[0]
    mass = sphere_mass_kg(soil, radius)
    own = soil.bonds.radius_over_particle * radius
    normal = soil.bonds.youngs_modulus_pa * math.pi * own**2 / (2.0 * radius)
    shear = normal / soil.bonds.stiffness_ratio
    damper = 2.0 * soil.bonds.damping_ratio * math.sqrt(0.5 * mass * normal)
    sliding = damper / math.sqrt(soil.bonds.stiffness_ratio)
    inertia = 0.4 * mass * radius**2

    def turning(slip: float, bending: float, torsion: float) -> float:
        across = max(2.0 / 3.0 * slip * radius**2, 2.0 / 3.0 * bending + torsion / 3.0)
        return 2.0 * z * across / inertia

    rates = {
        "spin, dampers": turning(
            sliding, math.sqrt(0.1) * own**2 * damper, math.sqrt(0.2) * own**2 * sliding
        ),
        "translation, dampers": 2.0 * z * max(damper, sliding) / mass,
    }
    squares = {
        "translation, springs": 2.0 * z * (normal + 2.0 * shear) / (3.0 * mass),
        "spin, springs": turning(shear, 0.25 * own**2 * normal, 0.5 * own**2 * shear),
        "pair": 2.0 * normal / mass,
    }
    cause = f"bonds of {normal:.3g} and {shear:.3g} N/m"
    named = [
        {kind: (f"{cause}, {kind}", value) for kind, value in found.items()} for found in (rates, squares)
    ]
    return _limits(*named)


def _beside(limit: StepLimit, others: Iterable[StepLimit]) -> StepLimit:
    """A limit set by springs or dampers, combined with those of others of the same kind beside them."""
    alike = [other for other in others if other.damped == limit.damped]
    if not alike:
        return limit
    power = 1.0 if limit.damped else 2.0
    total = limit.limit_s**-power + max(other.limit_s**-power for other in alike)
    return StepLimit(f"{limit.cause}, with {alike[0].cause}", total ** (-1.0 / power), limit.damped)


def _boundary_limits(soil: Soil, named: str) -> dict[str, StepLimit]:
    """Limits of the smallest particle of `soil` in a corner of walls or tools, which do not give way."""
    radius = soil.particles.bounds_m[0]
    mass = sphere_mass_kg(soil, radius)
    wall = boundary_values(soil, radius, mass).linear_at(MAX_OVERLAP * radius)
    stiffest = wall.stiffened(max(1.0, soil.tool_stiffness_factor))
    normal, damping, sliding_damping = stiffest.max_stiffness, stiffest.damping, stiffest.tangential_damping
    tangential = wall.tangential_stiffness
    arm = radius - wall.rest_overlap
    turning = 2.0 * arm**2 / (0.4 * radius**2)  # of two walls beside a turn, over the mass
    spring = max(normal + 2.0 * tangential, turning * tangential) / mass
    damper = max(damping + 2.0 * sliding_damping, turning * sliding_damping) / mass
    name = f"at walls and tools, particle {mass * 1e3:.3g} g{named}"
    return _limits(
        {"boundary, dampers": (f"damping {damping:g} and {sliding_damping:g} N s/m {name}", damper)},
        {"boundary, springs": (f"stiffness {normal:g} and {tangential:g} N/m {name}", spring)},
    )


def _wave_limit(soil: Soil) -> StepLimit | None:
    """Limit set by waves in the smallest particle of `soil`; None if springs and dampers set the limits."""
    found = soil.law.wave_limit(soil.particles.bounds_m[0], soil.particles.density_kg_per_m3)
    if found is None:
        return None
    cause, limit = found
    stiffer = max(1.0, soil.tool_stiffness_factor)
    tools = "" if stiffer == 1.0 else f", over the root of tool_stiffness_factor {stiffer:g}"
    return StepLimit(f"{cause}{tools}", limit / math.sqrt(stiffer))


def step_notes(scene: Scene, step_s: float) -> tuple[str, ...]:
    """Notes of a run on its soil step: a limit that is exceeded or near."""
    soil, notes = scene.particle_soil, []
    assert soil is not None
    limits = step_limits(soil)
    damped = next((found for found in limits if found.damped), None)
    dense = scene.mechanism is not None and soil.bed.kind in ("dense_random", "tiled")
    if dense and damped is not None and step_s > DENSE_CALM * damped.limit_s:
        notes.append(
            f"soil.time_step_s: {step_s * 1e6:.4g} us is {step_s / damped.limit_s:.2f} of the limit set by "
            "dampers: a random bed that a tool compacts may spin, and be stopped; at "
            f"{DENSE_CALM:g} of it, {DENSE_CALM * damped.limit_s * 1e6:.3g} us, the paper's machine ran"
        )
    limit = limits[0]
    if step_s > limit.limit_s:
        notes.append(
            f"allow: unstable_time_step: the step {step_s * 1e6:.4g} us is above the stable limit "
            f"{limit.limit_s * 1e6:.4g} us; the results are no prediction"
        )
    return tuple(notes)


@dataclass(frozen=True)
class Timing:
    """Integer time of a run."""

    communication_step_ns: int  # one tick, one exchange
    tick_count: int
    soil_steps: int  # per tick; 0 without soil
    mechanism_steps: int  # per tick; 0 without mechanism

    @cached_property
    def communication_step_s(self) -> float:
        """Length of a tick [s]."""
        return self.communication_step_ns * 1e-9

    @cached_property
    def soil_step_s(self) -> float:
        """Length of a soil step [s]."""
        return self.communication_step_ns * 1e-9 / self.soil_steps


def _refuse_step(scene: Scene, given_s: float, limit: StepLimit) -> None:
    if given_s > limit.limit_s and "unstable_time_step" not in scene.allow:
        raise SceneError(
            f"soil.time_step_s: {given_s:.3g} s is above the stable limit {limit.limit_s:.3g} s "
            f"({limit.cause}). Use 'auto', or at most {limit.limit_s:.2g} s: a larger step does not blow "
            "up, it silently lowers the draft. To study that, add allow: [unstable_time_step]."
        )


def derive_timing(scene: Scene) -> Timing:
    """Ticks and steps of a scene.

    Raises:
        SceneError: a soil step above its limit, or an interval that is no whole number of soil steps.
    """
    interval = scene.coupling.communication_step_ns
    soil_steps = 0
    soil = scene.particle_soil
    if soil is None:
        if interval == "soil_step":
            raise SceneError(
                "coupling.communication_step_ns: soil_step, but there are no particles; give nanoseconds, or "
                "auto"
            )
        default_ns = MECHANISM_INTERVAL_NS if scene.soil is None else REDUCED_INTERVAL_NS
        if scene.predicts_motion and scene.controller is None:
            default_ns = PREDICTED_INTERVAL_NS
        communication_step_ns = default_ns if interval == "auto" else interval
        soil_steps = 0 if scene.soil is None else 1
    else:
        limit = step_limits(soil)[0]
        step = soil.time_step_s
        if step != "auto":
            _refuse_step(scene, step, limit)
        max_s = SAFETY * limit.limit_s
        if isinstance(interval, str):
            if step == "auto":
                communication_step_ns = int(max_s * 1e6) * 1000  # whole microseconds
                communication_step_ns = communication_step_ns or int(max_s * NANOSECONDS_PER_SECOND)
            else:
                communication_step_ns = round(step * NANOSECONDS_PER_SECOND)
            if communication_step_ns < 1:
                raise SceneError(
                    f"soil.law: the stable step {limit.limit_s:.3g} s ({limit.cause}) is below the clock's "
                    "resolution of 1 ns; lower the damping or use larger particles"
                )
            soil_steps = 1
        else:
            communication_step_ns = interval
            largest = max_s if step == "auto" else step
            if communication_step_ns * 1e-9 > LARGEST_STEP_COUNT * largest:
                raise SceneError(
                    f"coupling.communication_step_ns: {communication_step_ns} would take more than "
                    f"{LARGEST_STEP_COUNT:,} soil steps of {largest:.3g} s ({limit.cause}); lower it, or the "
                    "stiffness and damping of soil.law"
                )
            soil_steps = max(1, math.ceil(communication_step_ns * 1e-9 / largest - 1e-9))
            if step != "auto" and abs(soil_steps * step - communication_step_ns * 1e-9) > 1e-9 * step:
                raise SceneError(
                    f"coupling.communication_step_ns: {communication_step_ns} is no whole number of "
                    f"soil.time_step_s {step:g} s; use a multiple of {round(step * 1e9)} or time_step_s: auto"
                )
    return Timing(
        communication_step_ns=communication_step_ns,
        tick_count=tick_count(scene.duration_s, communication_step_ns),
        soil_steps=soil_steps,
        mechanism_steps=scene.coupling.mechanism_steps if scene.mechanism else 0,
    )
