"""The soil engine under global damping, which brings particles to rest.

For beds that settle without friction the law is that of the scene with what resists sliding and turning
taken out, and its adhesion too where asked. The damper of the contacts affects only the way to rest, so it is
lowered to allow a large step.
"""

import dataclasses
import math
from typing import Any, NamedTuple

from ...contact_laws.base import ContactLaw
from ...contact_laws.dampers import DampedValues, restitution_at
from ...limits.stable_steps import Timing
from ...loading.loader import ResolvedScene
from ...scene.pair_laws import layer_soils, pair_values, particle_mass_kg, particle_values, sphere_mass_kg
from ...scene.soil import Soil
from ...strict_model import StrictModel
from ..bed import Bed, OnProgress, RestProgress, ignore_progress
from ..engine import SoilEngine
from .bed_geometry import SKIN

_SLIDING = (
    "tangential_stiffness_newton_per_m", "tangential_damping_newton_s_per_m", "static_friction",
    "sliding_friction", "rolling_friction",
)  # fmt: skip
_ADHESION = "cohesive_stiffness_newton_per_m"
_DAMPING = "damping_newton_s_per_m"
_STIFFNESS = "stiffness_newton_per_m"

SETTLING_GRAVITY = 9.81
"""[m/s2] while settling, also where the scene has none."""

DAMPING_RATIO = 0.3
"""Largest damping ratio of a contact while settling: the step grows five times, with C = 2.6 N s/m."""

COORDINATION = 12.0
"""Contacts per particle for which the step while settling is stable: no packing of equal spheres has more
touching neighbours (of unequal ones the large have more, but more mass still)."""

STEP_SAFETY = 0.8
"""Part of the stable step that is taken while settling: the margin is small, as COORDINATION is a bound."""

SETTLING_OVERLAP = 0.005
"""Overlap over the radius that the lowest contacts have under the weight of the bed while particles without
adhesion settle: half of the 1 % that calibrations allow in work. Stiffer contacts only shorten the step; they
get their own stiffness back before the bed is bonded."""

STEPS_PER_DAMPING = 5
"""Soil steps between two applications of the global damping: each application is a pass over all
particles. With more steps between them, velocities would fall in larger jumps."""

TICKS_PER_LOOK = 20
"""Applications of the global damping between two looks at the speed: each look scans all contacts."""

PATIENCE = 3
"""Largest number of times that a bed which still moves too fast settles for `longest_s` again. In a bed of a
few hundred particles one that falls raises the energy so far; it comes to rest in that time."""

RELAX_PERIODS = 260.0
"""Longest relaxation in periods of a contact, 2 pi sqrt(m / K). A bed of stiff contacts with little adhesion
never comes to full rest without friction: its particles keep creeping, held back by the global damping alone.
After so many periods a tenth of their weight is out of balance, which friction in the run holds. It is
2 s under the paper's law, whose beds come to rest long before."""


class Rest(NamedTuple):
    """Speed that counts as rest, longest time to reach it, and energy above which that time is repeated."""

    speed_m_per_s: float  # rms
    longest_s: float
    moving_joule: float = math.inf  # kinetic


def relaxed_rest(radius_m: float, contact_rate_per_s: float) -> Rest:
    """Rest after relaxation: 1 % of the radius in a second; a faster bed would settle in the run."""
    return Rest(0.01 * radius_m, RELAX_PERIODS * 2.0 * math.pi / contact_rate_per_s)


def smooth_soil(soil: Soil, *, adhesive: bool) -> Soil:
    """The soil without friction, its contacts damped DAMPING_RATIO at most.

    Unless `adhesive`, it has no adhesion and is no stiffer than SETTLING_OVERLAP asks for. Layers keep what
    is left of their own laws.
    """
    law = _smooth_law(soil, adhesive=adhesive)
    layers = soil.layers and tuple(
        layer.model_copy(update={"law": _smooth_law(whole, adhesive=adhesive)})
        for layer, whole in zip(soil.layers, layer_soils(soil), strict=True)
    )
    return soil.model_copy(update={"law": law, "layers": layers, **of_the_preparation(soil)})


def of_the_preparation(soil: Soil) -> dict[str, Any]:
    """Values of keys of a soil that the preparation sets itself: a bed serves runs of every kind."""
    skin = SKIN * soil.particles.mean_volume_radius_m
    return {
        "skin_m": skin,
        "precision": "float64",
        "engine": "own",
        "device": "cpu",
        "monitors": None,
        "bonds": None,
    }


def _smooth_law(soil: Soil, *, adhesive: bool) -> ContactLaw:
    """The law of a soil, without those of its layers, after smooth_soil."""
    without = _SLIDING if adhesive else (*_SLIDING, _ADHESION)
    pair, _ = pair_values(soil)
    softened = 1.0 if adhesive else min(1.0, settling_stiffness_newton_per_m(soil) / pair.stiffness)
    wanted = 2.0 * DAMPING_RATIO * math.sqrt(0.5 * particle_mass_kg(soil) * softened * pair.stiffness)
    same_ratio = math.sqrt(softened)
    lowered = min(same_ratio, wanted / pair.damping) if pair.damping > 0.0 else 1.0

    def smooth(row: StrictModel) -> StrictModel:
        changes = {key: 0.0 for key in without if getattr(row, key, None) is not None}
        for key, factor in ((_STIFFNESS, softened), (_DAMPING, lowered)):
            if getattr(row, key, None) is not None:
                changes[key] = factor * getattr(row, key)
        if isinstance(row, DampedValues) and row.restitution is not None:
            changes["restitution"] = max(row.restitution, restitution_at(DAMPING_RATIO))
        return row.model_copy(update=changes)

    rows = {
        key: smooth(getattr(soil.law, key))
        for key in type(soil.law).model_fields
        if isinstance(getattr(soil.law, key), StrictModel)
    }
    return soil.law.model_copy(update=rows)


def settling_stiffness_newton_per_m(soil: Soil) -> float:
    """Stiffness of a pair that overlaps by SETTLING_OVERLAP under the bed's weight.

    The pair carries the stress on the floor over the square of a diameter. The bed counts as solid: an upper
    bound of its weight.
    """
    radius = soil.particles.mean_volume_radius_m
    stress_pa = soil.particles.density_kg_per_m3 * SETTLING_GRAVITY * soil.bin.depth_m
    return stress_pa * (2.0 * radius) ** 2 / (SETTLING_OVERLAP * radius)


def settling_step_s(soil: Soil) -> float:
    """Stable step of a smooth soil [s]: dampers m / (z C), springs 2 / sqrt(2 z K / (3 m)).

    m is that of the smallest particle; the worst of all pairs of layers binds.
    """
    radius, limits, layers = soil.particles.bounds_m[0], [], layer_soils(soil)
    for layer in layers:
        mass = sphere_mass_kg(layer, radius)
        others = [particle_values(layer, other, 0.5 * radius, 0.5 * mass) for other in layers]
        for values in (*others, pair_values(layer)[1]):
            stiffest = max(values.stiffness, values.contact_adhesion, values.adhesion)
            limits.append(2.0 / math.sqrt(2.0 * COORDINATION * stiffest / (3.0 * mass)))
            if values.damping > 0.0:
                limits.append(mass / (COORDINATION * values.damping))
    return STEP_SAFETY * min(limits)


class Settling:
    """Particles in a box on their way to rest."""

    def __init__(
        self,
        resolved: ResolvedScene,
        threads: int,
        *,
        soil: Soil,
        step_s: float,
        gravity_m_per_s2: float,
        on_progress: OnProgress = ignore_progress,
    ) -> None:
        self.soil = soil
        pair, radius = pair_values(soil)[0], soil.particles.mean_volume_radius_m
        stress_pa = 0.5 * soil.particles.density_kg_per_m3 * SETTLING_GRAVITY * soil.bin.depth_m
        pair = pair.linear_at(pair.loaded_m(stress_pa * (2.0 * radius) ** 2))
        self.contact_rate_per_s = math.sqrt(pair.stiffness / particle_mass_kg(soil))
        """sqrt(K / m) of a pair, half way down."""
        self.interval_s = STEPS_PER_DAMPING * step_s
        """Time between two applications of the global damping."""
        scene = resolved.scene.model_copy(
            update={"soil": soil, "mechanism": None, "tools": {}, "gravity_m_per_s2": gravity_m_per_s2}
        )
        nanoseconds = max(STEPS_PER_DAMPING, round(self.interval_s * 1e9))
        timing = Timing(nanoseconds, tick_count=1, soil_steps=STEPS_PER_DAMPING, mechanism_steps=0)
        self._resolved = dataclasses.replace(resolved, scene=scene, timing=timing)
        self._threads, self._on_progress = threads, on_progress

    def engine(self, bed: Bed) -> SoilEngine:
        """An engine with this bed, not started."""
        return SoilEngine(self._resolved, bed, self._threads)

    def potential_joule(self, bed: Bed) -> float:
        """Energy of position of a bed: contacts, walls and gravity."""
        return self.engine(bed).potential_joule()

    def run(self, bed: Bed, rest: Rest, damping_per_s: float, phase: str) -> Bed:
        """The bed at rest, or after the longest time it is given; its particles in the same order."""
        return bed_of(self.settled(bed, rest, damping_per_s, phase), bed)

    def settled(self, bed: Bed, rest: Rest, damping_per_s: float, phase: str) -> SoilEngine:
        """The engine with this bed at rest, or after the longest time it is given; a bed that then has more
        energy than `rest.moving_joule` goes on for as long again, PATIENCE times at most."""
        engine = self.engine(bed)
        engine.start(())
        kept = math.exp(-damping_per_s * self.interval_s)
        longest = math.ceil(rest.longest_s / self.interval_s)
        for tick in range((1 + PATIENCE) * longest):
            again, begun = divmod(tick, longest)
            if again and not begun and engine.state("", 0, 0).kinetic_energy_joule <= rest.moving_joule:
                break
            engine.advance(tick, ())
            engine.damp(kept)
            if tick % TICKS_PER_LOOK == TICKS_PER_LOOK - 1:
                speed, limit_s = engine.state("", 0, 0).rms_speed_m_per_s, (1 + again) * rest.longest_s
                self._on_progress(
                    RestProgress(phase, tick * self.interval_s, limit_s, speed, rest.speed_m_per_s)
                )
                if speed < rest.speed_m_per_s:
                    break
        return engine


def bed_of(engine: SoilEngine, bed: Bed) -> Bed:
    """The bed that an engine was made with, as it is now."""
    kinetic = engine.state("", 0, 0).kinetic_energy_joule
    return dataclasses.replace(bed, positions_m=engine.positions_m(), kinetic_energy_joule=kinetic)
