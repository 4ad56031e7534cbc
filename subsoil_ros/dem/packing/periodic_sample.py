"""A sample of soil that is periodic along x, y and z: random spheres pressed to a solid fraction.

1. Random points, at a solid fraction 0.06 below the given one, are pushed apart without friction.
2. Box and positions shrink together, slowly, until the contacts carry a pressure. Frictionless spheres jam
   at random close packing, spheres with friction at a lower fraction (Silbert, Soft Matter 6 (2010) 2918). So
   the friction of this step is adjusted until the given solid fraction is met.

The springs of the contacts are linear and belong to no soil, so one sample serves every law. `at_pressure`
brings it to rest under the law of a scene at a given pressure.
"""

import dataclasses
import math
from typing import NamedTuple

import numpy as np

from ...contact_laws.linear.law import LinearLaw
from ...errors import SceneError
from ...limits.stable_steps import SAFETY, step_limits
from ...loading.loader import ResolvedScene
from ...scene.bed_kinds import TiledBed
from ...scene.sizes import sampled_radii_m
from ...scene.soil import Bin, Soil
from ..bed import Bed, OnProgress, RestProgress, radii_of
from ..engine import SoilEngine
from .relaxation import (
    DAMPING_RATIO,
    Rest,
    Settling,
    of_the_preparation,
)  # fmt: skip

START_BELOW = 0.06
"""Wanted solid fraction less that of the points that are parted: looser ones take longer to press, denser
ones touch before their friction counts."""

PRESSED_OVERLAP = 0.002
"""Overlap over the mean radius of contacts that carry the pressure of a sample, p (2 r)^2 / (K r): it changes
the solid fraction by 0.3 %."""

_STIFFNESS, _DENSITY = 1e5, 2500.0
"""Stiffness of contacts [N/m] and density of spheres [kg/m3]. Pressure and damping scale with them, so they
set the unit of time only."""

INERTIAL_NUMBER = 1e-3
"""Inertial number of the pressing, rate x diameter x sqrt(density / pressure): quasi-static below (GDR MiDi,
Eur. Phys. J. E 14 (2004) 341)."""

PARTING_S, PARTING_DAMPING = 30.0, 10.0
"""Length of step 1 in periods of a contact, and its global damping over sqrt(K / m), far above critical: no
particle flies."""

PRESSING_DAMPING = 0.02
"""Global damping while pressing over sqrt(K / m): at five times that the frictionless sample carries a fifth
of its pressure before it jams."""

PRESSURE_GAIN = 2.0
"""Part of the missing pressure that the box would make up for between two looks if no contact slid. As
contacts do slide, it reaches the pressure without swinging."""

PRESSURE_TOLERANCE = 0.05
"""A sample counts as pressed if its pressure is met to this part, and its overlaps nearly so."""

REST_SPEED = 1e-4
"""Rms speed of a sample at rest over r sqrt(K / m), a twentieth of that of swinging by PRESSED_OVERLAP."""

TICKS_PER_LOOK = 10
"""Applications of the global damping between two looks at the pressure: a look computes three energies."""

LONGEST_LOOKS = 3000
"""A sample that is not at rest after so many looks is given up: five times what the slowest took."""

FRICTIONLESS = 1e-9
"""Friction without effect; not zero, so that the compiled code is that of other frictions."""

ROLLING = 0.1
"""Rolling friction of the pressing over its friction: without it none gives less than 0.562 (measured)."""

JAMMED_AT = (
    (0.530, 1.0), (0.545, 0.59), (0.562, 0.345), (0.571, 0.26), (0.600, 0.11), (0.617, 0.05), (0.630, 0.02),
    (0.640, FRICTIONLESS),
)  # fmt: skip
"""Solid fraction that a friction of the pressing gives, where the search for it starts (measured: radii
within 15 %, 2,000 to 9,000 particles)."""

FRACTION_TOLERANCE = 0.005
"""Part of the wanted solid fraction by which a sample may miss it: a quarter of replicate.LARGEST_CHANGE."""

LONGEST_SEARCH = 6
"""Tiles that are pressed at most to find the friction; two or three usually suffice."""


class PressedSample(NamedTuple):
    """An endless bed, and how it was made."""

    bed: Bed
    solid_fraction: float
    friction: float  # of the pressing


def solid_fraction(bed: Bed, soil: Soil) -> float:
    """Volume of the spheres of an endless bed over its own; overlaps count twice."""
    return float((4.0 / 3.0 * np.pi * radii_of(bed, soil) ** 3).sum() / np.prod(bed.periods_m))


def pressed_sample(resolved: ResolvedScene, edge_m: float, on_progress: OnProgress) -> PressedSample:
    """A sample of about this edge [m] with the particles and the solid fraction of a scene's tiled bed."""
    soil = resolved.scene.particle_soil
    assert soil is not None
    assert isinstance(soil.bed, TiledBed)
    particles, wanted = soil.particles, soil.bed.solid_fraction
    radius = particles.mean_volume_radius_m
    count = round(wanted * edge_m**3 / (4.0 / 3.0 * math.pi * radius**3))
    radii = np.full(count, radius) if particles.sizes is None else sampled_radii_m(particles.sizes, count)
    volume = float((4.0 / 3.0 * np.pi * radii**3).sum())
    edge = (volume / (wanted - START_BELOW)) ** (1.0 / 3.0)
    corner = np.array((0.0, -0.5 * edge, -edge))
    points = np.random.default_rng(soil.bed.seed).uniform(size=(count, 3)) * edge + corner
    bed = Bed(points, (0.0, -0.5 * edge, -edge), (edge, 0.5 * edge), radii_m=radii, sides="endless")
    return pressed(Pressing(resolved, soil, bed, 1, on_progress))


class Pressing:
    """Random points in an endless box, pushed apart, before they are pressed."""

    def __init__(
        self,
        resolved: ResolvedScene,
        soil: Soil,
        points: Bed,
        threads: int,
        on_progress: OnProgress,
    ) -> None:
        self.soil, self._on_progress = soil, on_progress
        self._of = resolved, threads
        parting = self._settling(points, FRICTIONLESS)
        rate = parting.contact_rate_per_s
        rest = Rest(0.0, PARTING_S * 2.0 * math.pi / rate)
        self._parted = parting.run(points, rest, PARTING_DAMPING * rate, "parting")

    def _settling(self, bed: Bed, mu: float) -> Settling:
        springs = endless_soil(under_springs(self.soil, mu), bed.periods_m[0])
        return Settling(
            *self._of, soil=springs, step_s=SAFETY * step_limits(springs)[0].limit_s,
            gravity_m_per_s2=0.0, on_progress=self._on_progress,
        )  # fmt: skip

    def at(self, friction: float) -> PressedSample:
        """The box pressed together with this friction."""
        pressure_pa = PRESSED_OVERLAP * _STIFFNESS / (4.0 * self.soil.particles.mean_volume_radius_m)
        settling = self._settling(self._parted, friction)
        bed = at_pressure(settling, self._parted, pressure_pa, self._on_progress)
        return PressedSample(bed, solid_fraction(bed, self.soil), friction)


def pressed(pressing: Pressing) -> PressedSample:
    """The box pressed with the friction that gives the solid fraction of its tiled bed.

    The fraction of small boxes scatters; if LONGEST_SEARCH of them miss it, the nearest is returned.
    """
    assert isinstance(pressing.soil.bed, TiledBed)
    fractions, frictions = np.array(JAMMED_AT).T
    wanted = aim = pressing.soil.bed.solid_fraction
    tried: dict[float, PressedSample] = {}  # by the fraction looked up in the table
    while len(tried) < LONGEST_SEARCH and aim not in tried:
        tried[aim] = sample = pressing.at(float(np.interp(aim, fractions, frictions)))
        if abs(sample.solid_fraction - wanted) <= FRACTION_TOLERANCE * wanted:
            return sample
        found = {at: one.solid_fraction for at, one in tried.items()}
        looser = max((at for at in found if found[at] < wanted), default=None)
        denser = min((at for at in found if found[at] > wanted), default=None)
        if looser is None or denser is None:
            aim = float(np.clip(aim + wanted - sample.solid_fraction, fractions[0], fractions[-1]))
        else:
            part = (wanted - found[looser]) / (found[denser] - found[looser])
            aim = looser + part * (denser - looser)
    return min(tried.values(), key=lambda sample: abs(sample.solid_fraction - wanted))


def _springs(friction: float, radius_m: float) -> LinearLaw:
    """Law of the pressing. Tangential values are usual parts of normal ones; the fraction is met with any."""
    mass_kg = _DENSITY * 4.0 / 3.0 * math.pi * radius_m**3
    damping = 2.0 * DAMPING_RATIO * math.sqrt(0.5 * mass_kg * _STIFFNESS)
    values = {
        "stiffness_newton_per_m": _STIFFNESS, "tangential_stiffness_newton_per_m": 0.8 * _STIFFNESS,
        "damping_newton_s_per_m": damping, "tangential_damping_newton_s_per_m": 0.5 * damping,
        "static_friction": friction, "sliding_friction": friction, "rolling_friction": ROLLING * friction,
    }  # fmt: skip
    return LinearLaw.model_validate({"kind": "linear", "particle": values, "boundary": values})


def endless_soil(soil: Soil, edge_m: float) -> Soil:
    """The soil of a scene as a cube that repeats itself."""
    box = Bin(length_m=edge_m, width_m=edge_m, depth_m=edge_m)
    box = box.model_copy(update={"sides": "endless"})
    changes = {"bin": box, "layers": None, "surface": None, "window": None} | of_the_preparation(soil)
    return soil.model_copy(update=changes)


def under_springs(soil: Soil, friction: float) -> Soil:
    """The particles of a scene under linear springs of this friction in place of its law."""
    alike = {"reference_radius_m": None, "density_kg_per_m3": _DENSITY}
    changes = {
        "law": _springs(friction, soil.particles.mean_volume_radius_m),
        "particles": soil.particles.model_copy(update=alike), "tool_stiffness_factor": 1.0, "layers": None,
    }  # fmt: skip
    return soil.model_copy(update=changes | of_the_preparation(soil))


def sample_soil(soil: Soil, edge_m: float) -> Soil:
    """The soil that a sample is kept in the cache for: any with these particles."""
    return endless_soil(under_springs(soil, 0.0), edge_m)


def at_pressure(settling: Settling, bed: Bed, pressure_pa: float, on_progress: OnProgress) -> Bed:
    """Resize an endless bed, and the springs of its contacts, until it is at rest at this pressure.

    Raises:
        SceneError: it does not come to rest.
    """
    engine = settling.engine(bed)
    engine.start(())
    soil, rate = settling.soil, settling.contact_rate_per_s
    radius = soil.particles.mean_volume_radius_m
    fastest = INERTIAL_NUMBER / (2.0 * radius * math.sqrt(soil.particles.density_kg_per_m3 / pressure_pa))
    look_s = TICKS_PER_LOOK * settling.interval_s
    kept = math.exp(-PRESSING_DAMPING * rate * settling.interval_s)
    rest = REST_SPEED * radius * rate
    strain_rate, tick = fastest, 0
    for _ in range(LONGEST_LOOKS):
        for _ in range(TICKS_PER_LOOK):
            engine.resize(1.0 - strain_rate * settling.interval_s)
            engine.advance(tick, ())
            engine.damp(kept)
            tick += 1
        pressure, modulus = _pressure_pa(engine)
        missing = pressure_pa - pressure
        wanted_rate = PRESSURE_GAIN * missing / (3.0 * modulus * look_s) if modulus > 0.0 else math.inf
        strain_rate = min(max(wanted_rate, -fastest), fastest)
        speed = engine.state("", 0, 0).rms_speed_m_per_s
        longest_s = LONGEST_LOOKS * look_s
        on_progress(RestProgress("pressing", tick * settling.interval_s, longest_s, speed, rest))
        if abs(missing) < PRESSURE_TOLERANCE * pressure_pa and speed < rest:
            break
    else:
        raise SceneError(
            f"soil.bed: the tile carries {pressure:.3g} Pa at an rms speed of {speed:.3g} m/s; it must be "
            f"{pressure_pa:.3g} Pa within {PRESSURE_TOLERANCE:.0%} below {rest:.3g} m/s; use another "
            "soil.bed.solid_fraction, or a soil.law with dampers"
        )
    return dataclasses.replace(engine.bed, positions_m=engine.positions_m())


def _pressure_pa(engine: SoilEngine, strain: float = 1e-5) -> tuple[float, float]:
    """Pressure of an endless bed and its bulk modulus without sliding, from its energy at three sizes [Pa].

    The springs along the contacts are not stretched by a change of size.
    """
    volume = float(np.prod(engine.bed.periods_m))
    joule = []
    for scale in (1.0, 1.0 + strain, (1.0 - strain) / (1.0 + strain)):
        engine.resize(scale)
        joule.append(engine.potential_joule())
    engine.resize(1.0 / (1.0 - strain))
    middle, large, small = joule
    slope = (large - small) / (2.0 * strain)  # dE / d ln(edge) = -3 p V
    curvature = (large - 2.0 * middle + small) / strain**2
    return -slope / (3.0 * volume), max(0.0, curvature / (9.0 * volume))
