"""What follows from a scene: pair laws, stable soil steps, ticks, coupling bounds."""

import math
from dataclasses import dataclass

from ..errors import SceneError
from ..ticks import NANOSECONDS_PER_SECOND, tick_count
from .model import Scene
from .soil import Soil, WetValues

DENSE_COORDINATION = 10.4
"""Damped contacts per particle of random close packing under the wet law (SOIL_FINDINGS.md). A cubic
grid starts with 6, but where a tool compacts it, it comes near this, so the limits use it."""

SAFETY = 0.9
"""Part of the smallest limit that `time_step_s: auto` takes (chosen)."""

MECHANISM_INTERVAL_NS = 500_000
"""Tick of a scene without soil (chosen: 1/250 of the fastest mode of the paper's machine, 8 Hz)."""


@dataclass(frozen=True)
class PairValues:
    """Law of one kind of pair, SI; what the contact kernels take."""

    stiffness: float  # K_X [N/m]
    tangential_stiffness: float  # K_Y = K_Z [N/m]
    damping: float  # C_X [N s/m]
    tangential_damping: float  # C_Y = C_Z [N s/m]
    adhesion: float  # K_B [N/m]
    rest_overlap: float  # delta_c [m]
    reach: float  # delta_B [m]
    static_friction: float
    sliding_friction: float
    rolling_friction: float

    @property
    def contact_adhesion(self) -> float:
        """K_C = K_B delta_B / delta_c [N/m] (eq. 20)."""
        return self.adhesion * self.reach / self.rest_overlap

    @property
    def peak_attraction(self) -> float:
        """Largest attraction, at touch: K_B delta_B [N]."""
        return self.adhesion * self.reach


def _series(first: float, second: float) -> float:
    """Two springs (or dampers) in series, eq. 15, 16, 18; zero if either is."""
    total = first + second
    return first * second / total if total > 0.0 else 0.0


def pair_values(soil: Soil) -> tuple[PairValues, PairValues]:
    """Laws of the pairs particle-particle and particle-boundary.

    Body values are combined as two springs in series. Distances and friction are not combined: those
    of the row stand for the pair.
    """
    law = soil.law
    combined = law.values_are == "body"

    def pair(first: WetValues, second: WetValues) -> PairValues:
        def value(key: str) -> float:
            return _series(getattr(first, key), getattr(second, key)) if combined else getattr(second, key)

        return PairValues(
            stiffness=value("stiffness_newton_per_m"),
            tangential_stiffness=value("tangential_stiffness_newton_per_m"),
            damping=value("damping_newton_s_per_m"),
            tangential_damping=value("tangential_damping_newton_s_per_m"),
            adhesion=value("adhesion_newton_per_m"),
            rest_overlap=second.rest_overlap_m,
            reach=second.reach_m,
            static_friction=second.static_friction,
            sliding_friction=second.sliding_friction,
            rolling_friction=second.rolling_friction,
        )

    return pair(law.particle, law.particle), pair(law.particle, law.boundary)


def particle_mass_kg(soil: Soil) -> float:
    """Mass of one sphere [kg]."""
    return soil.particles.density_kg_per_m3 * 4.0 / 3.0 * math.pi * soil.particles.radius_m**3


@dataclass(frozen=True)
class StepLimit:
    """Largest stable soil step for one cause."""

    cause: str
    limit_s: float


def step_limits(soil: Soil, coordination: float = DENSE_COORDINATION) -> tuple[StepLimit, ...]:
    """Stable steps of explicit integration, smallest first.

    Dampers, z contacts per particle: neighbours in opposite motion see the rate 2 z C / m, equal spins
    (4/3) z C l^2 / I with I = 0.4 m r^2 and the arm l = r - delta_c / 2; stable for step x rate <= 2.
    Springs: the same modes, omega^2 = 2 z (K_X + 2 K_Y) / (3 m) and (4/3) z K_Y l^2 / I; step <= 2 / omega.
    """
    pair, _ = pair_values(soil)
    mass = particle_mass_kg(soil)
    radius = soil.particles.radius_m
    arm = radius - 0.5 * pair.rest_overlap
    inertia = 0.4 * mass * radius**2
    z = coordination
    name = f"coordination {z:g}, particle {mass * 1e3:.3g} g"
    limits = []

    def add(cause: str, rate: float, *, spring: bool) -> None:
        if rate > 0.0:
            limits.append(StepLimit(cause, 2.0 / (math.sqrt(rate) if spring else rate)))

    damping = max(pair.damping, pair.tangential_damping)
    add(
        f"damping {pair.tangential_damping:g} N s/m acting on spin, {name}",
        4.0 / 3.0 * z * pair.tangential_damping * arm**2 / inertia,
        spring=False,
    )
    add(f"damping {damping:g} N s/m acting on translation, {name}", 2.0 * z * damping / mass, spring=False)
    add(
        f"stiffness {pair.stiffness:g} and {pair.tangential_stiffness:g} N/m of the bed, {name}",
        2.0 * z * (pair.stiffness + 2.0 * pair.tangential_stiffness) / (3.0 * mass),
        spring=True,
    )
    add(
        f"tangential stiffness {pair.tangential_stiffness:g} N/m acting on spin, {name}",
        4.0 / 3.0 * z * pair.tangential_stiffness * arm**2 / inertia,
        spring=True,
    )
    add(f"stiffness {pair.stiffness:g} N/m of a single pair", 2.0 * pair.stiffness / mass, spring=True)
    return tuple(sorted(limits, key=lambda item: item.limit_s))


@dataclass(frozen=True)
class Timing:
    """Integer time of a run."""

    interval_ns: int  # one tick, one exchange
    tick_count: int
    soil_steps: int  # per tick; 0 without soil
    mechanism_steps: int  # per tick; 0 without mechanism

    @property
    def interval_s(self) -> float:
        """Length of a tick [s]."""
        return self.interval_ns * 1e-9

    @property
    def soil_step_s(self) -> float:
        """Length of a soil step [s]."""
        return self.interval_ns * 1e-9 / self.soil_steps


def _refuse_step(given_s: float, limit: StepLimit, key: str) -> None:
    if given_s > limit.limit_s:
        raise SceneError(
            f"{key}: {given_s:.3g} s is above the stable limit {limit.limit_s:.3g} s ({limit.cause}). "
            f"Use 'auto', or at most {limit.limit_s:.2g} s: a larger step does not blow up, it silently "
            "lowers the draft."
        )


def derive_timing(scene: Scene) -> Timing:
    """Ticks and steps of a scene.

    Raises:
        SceneError: a soil step above its limit, or an interval that is no whole number of soil steps.
    """
    interval = scene.coupling.interval_ns
    soil_steps = 0
    if scene.soil is None:
        interval_ns = MECHANISM_INTERVAL_NS if interval == "auto" else interval
    else:
        limit = step_limits(scene.soil)[0]
        step = scene.soil.time_step_s
        if step != "auto":
            _refuse_step(step, limit, "soil.time_step_s")
        if interval == "auto":
            if step == "auto":
                interval_ns = int(SAFETY * limit.limit_s * 1e6) * 1000  # whole microseconds
                interval_ns = interval_ns or int(SAFETY * limit.limit_s * NANOSECONDS_PER_SECOND)
            else:
                interval_ns = round(step * NANOSECONDS_PER_SECOND)
            if interval_ns < 1:
                raise SceneError(
                    f"soil.law: the stable step {limit.limit_s:.3g} s ({limit.cause}) is below the clock's "
                    "resolution of 1 ns; lower the damping or use larger particles"
                )
            soil_steps = 1
        else:
            interval_ns = interval
            largest = SAFETY * limit.limit_s if step == "auto" else step
            soil_steps = max(1, math.ceil(interval_ns * 1e-9 / largest - 1e-9))
            if step != "auto" and abs(soil_steps * step - interval_ns * 1e-9) > 1e-9 * step:
                raise SceneError(
                    f"coupling.interval_ns: {interval_ns} is no whole number of soil.time_step_s {step:g} s; "
                    f"use a multiple of {round(step * 1e9)} or time_step_s: auto"
                )
    return Timing(
        interval_ns=interval_ns,
        tick_count=tick_count(scene.duration_s, interval_ns),
        soil_steps=soil_steps,
        mechanism_steps=scene.coupling.mechanism_steps if scene.mechanism else 0,
    )
