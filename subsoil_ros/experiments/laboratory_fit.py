"""Particles fitted to a laboratory's soil, by element tests.

Two numbers are sought: friction of the particles, for the friction angle, and one for the cohesion, which
depends on the law (particle_forms.py). Without cohesion the second is the rolling friction, where the angle
of the critical state is given. Everything else follows from a rule: stiffness from the overlap at
work or from the confined modulus, dampers from a restitution, density from the bulk density, the friction on
metal from that of the laboratory.
"""

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple, NoReturn

import numpy as np
from numpy.typing import NDArray

from ..analysis.intervals import t_quantile
from ..errors import InputError
from ..limits.soil_at_work import WORKING_STRESS_PA
from ..limits.stable_steps import MAX_OVERLAP
from ..loading.loader import load_scene
from ..scene.material import VERSION, Interval, LaboratorySoil, Material, mean_volume_radius_m, sizes_about
from ..yaml_document import Document
from .element_tests import (
    CELL_DIAMETERS,
    CRITICAL_STRAIN,
    LEAST_PA,
    PEAK_STRAIN,
    Cell,
    PlaneStrain,
    confined_modulus_pa,
    fit_strength,
    plane_strain,
    prepare_cell,
    tensile_strength_pa,
)
from .particle_forms import FORMS, REST_OVERLAP, ROLLING_FRICTION, Wanted
from .run_jobs import connected

if TYPE_CHECKING:
    from distributed import Client

SEEDS = (101, 102, 103, 104)
"""Seeds of the cells of the fit; scenes have other seeds unless they set these."""

FRICTIONS = (0.02, 1.2)
"""Least and largest friction of particles: beyond the largest, spheres roll and the angle hardly grows."""

START_FRICTION, ANGLE_DEG, PER_FRICTION_DEG = 0.32, 32.0, 35.0
"""Start of the search, measured: a friction, its friction angle, and the angle's growth with friction."""

PER_FRICTION = 1.2
"""Relative growth of cohesion with friction, likewise measured."""

COHESION_OVER_TENSION = 0.55
"""Cohesion over tensile strength, likewise measured."""

CRITICAL_DEG, PEAK_PER_ROLLING_DEG, CRITICAL_PER_ROLLING_DEG = 26.0, 25.0, 28.0
"""Critical angle with the usual rolling friction, and growth of both angles with it, likewise measured."""

TOLERANCE = (0.3, 0.02, 50.0)
"""The search ends when the angle is met to so many degrees and the cohesion to this part or pressure [Pa]."""

MODULUS_TOLERANCE, LONGEST_STIFFENING = 0.05, 4
"""Relative tolerance of the confined modulus, and most changes of the stiffness to meet it."""

LONGEST_SEARCH = 12
"""Most sets that are tested: five to eight usually suffice."""

Say = Callable[[str], None]


class _Tested(NamedTuple):
    """Results of one set, one row per seed."""

    angle_deg: NDArray[np.float64]
    cohesion_pa: NDArray[np.float64]
    density_kg_per_m3: NDArray[np.float64]
    critical: NDArray[np.float64] | None  # rows as of _critical; None: not tested

    @property
    def sought(self) -> NDArray[np.float64]:
        """Angle, and cohesion or critical angle, (2, seeds)."""
        second = self.cohesion_pa if self.critical is None else self.critical[:, 0]
        return np.array((self.angle_deg, second))

    def mean(self) -> NDArray[np.float64]:
        """Of what is sought."""
        return np.asarray(self.sought.mean(axis=1))


def calibrate(
    soil: LaboratorySoil, radius_m: float, workers: int, say: Say, law: str = "cohesive_linear"
) -> Material:
    """Fit particles of mean radius `radius_m` to a laboratory's soil, with tests on `workers` processes.

    law: one of FORMS.

    Raises:
        InputError: the friction angle or the confined modulus cannot be reached (the message has the possible
            range); or bonds for a soil without cohesion.
    """
    if law == "bonded" and soil.cohesion_pa == 0.0:
        raise InputError(
            f"--law bonded: soil '{soil.name}' has cohesion_pa 0 and nothing for bonds to bear; leave --law "
            "out, or give a soil with cohesion"
        )
    with connected(None, workers) as (client, _):
        return _Fit(soil, radius_m, client, say, law).material()


class _Fit:
    def __init__(self, soil: LaboratorySoil, radius_m: float, client: "Client", say: Say, law: str) -> None:
        self._soil, self._radius, self._client, self._say = soil, radius_m, client, say
        self._form = FORMS[law]
        self._critical_deg = soil.critical_friction_angle_deg  # if given, rolling friction is sought
        self._fitted = self._form.fitted if self._critical_deg is None else "rolling_friction"
        self._mean_radius = mean_volume_radius_m(radius_m)
        self._density = soil.bulk_density_kg_per_m3 / soil.solid_fraction
        self._given_stiffness = 0.0  # by the confined modulus [N/m]
        self._sets = 0

    def material(self) -> Material:
        """Return the fitted material."""
        soil = self._soil
        start = START_FRICTION + (soil.friction_angle_deg - ANGLE_DEG) / PER_FRICTION_DEG
        if self._critical_deg is None:
            per_unit = COHESION_OVER_TENSION * self._form.tension_per_unit(self._wanted(0.0))
            slope = np.array(((PER_FRICTION_DEG, 0.0), (PER_FRICTION * soil.cohesion_pa, per_unit)))
            second = soil.cohesion_pa / per_unit
        else:
            slope = np.array(((PER_FRICTION_DEG, PEAK_PER_ROLLING_DEG), (0.0, CRITICAL_PER_ROLLING_DEG)))
            above = (self._critical_deg - CRITICAL_DEG) / CRITICAL_PER_ROLLING_DEG
            second = max(ROLLING_FRICTION + above, 0.25 * ROLLING_FRICTION)
            start -= PEAK_PER_ROLLING_DEG / PER_FRICTION_DEG * (second - ROLLING_FRICTION)
        at = np.array((float(np.clip(start, *FRICTIONS)), second))
        self._say(f"pressing {len(SEEDS)} cells")
        self._over_seeds(_pressed, at)
        at, slope, tested = self._search(at, slope)
        for _ in range(LONGEST_STIFFENING):
            if not self._stiffened(at):
                break
            at, slope, tested = self._search(at, slope)
        self._density *= soil.bulk_density_kg_per_m3 / float(tested.density_kg_per_m3.mean())
        return self._measured(at, tested, slope)

    def _search(
        self, at: NDArray[np.float64], slope: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], _Tested]:
        """Broyden's method: friction and attraction that meet both targets, slope of the results, results."""
        second = self._soil.cohesion_pa if self._critical_deg is None else self._critical_deg
        wanted = np.array((self._soil.friction_angle_deg, second))
        tested, free = self._tested(at), wanted[1] > 0.0
        while not self._met(tested, wanted):
            missing = wanted - tested.mean()
            if self._sets >= LONGEST_SEARCH:
                raise InputError(
                    f"{self._soil.name}: {self._sets} sets did not meet friction_angle_deg and "
                    f"{self._sought}; the last made {self._shown(tested)}: give others"
                )
            step = np.linalg.solve(slope, missing) if free else np.array((missing[0] / slope[0, 0], 0.0))
            to = np.clip(at + step, (FRICTIONS[0], 0.25 * at[1]), (FRICTIONS[1], 4.0 * at[1]))
            if to[0] == at[0] and to[0] in FRICTIONS and abs(missing[0]) > TOLERANCE[0]:
                self._refuse_angle(float(at[1]))
            before, at, moved = tested, to, to - at
            tested = self._tested(at)
            error = tested.mean() - before.mean() - slope @ moved
            scaled = moved / np.array((0.1, max(at[1], 1e-9) * 0.2)) ** 2  # both numbers have equal weight
            slope = slope + np.outer(error, scaled) / float(moved @ scaled)
        return at, slope, tested

    def _met(self, tested: _Tested, wanted: NDArray[np.float64]) -> bool:
        off = np.abs(tested.mean() - wanted)
        degrees, part, pressure = TOLERANCE
        if self._critical_deg is not None:
            return bool((off <= degrees).all())
        enough = wanted[1] == 0.0 or off[1] <= max(part * wanted[1], pressure)
        return bool(off[0] <= degrees and enough)

    def _tested(self, at: NDArray[np.float64]) -> _Tested:
        if self._critical_deg is None:
            peak, critical = np.array(self._over_seeds(_strength, at)), None
        else:
            peak, critical = np.array(self._over_seeds(_peak_and_critical, at)).swapaxes(0, 1)
        self._sets += 1
        found = _Tested(peak[:, 0], peak[:, 1], peak[:, 2], critical)
        self._say(f"set {self._sets}: friction {at[0]:.3f}, {self._fitted} {at[1]:.3g}: {self._shown(found)}")
        return found

    @property
    def _sought(self) -> str:
        return "cohesion_pa" if self._critical_deg is None else "critical_friction_angle_deg"

    def _shown(self, tested: _Tested) -> str:
        angle, second = tested.mean()
        kpa = self._critical_deg is None
        return f"{angle:.2f} degrees, " + (f"{1e-3 * second:.3g} kPa" if kpa else f"critical {second:.2f}")

    def _over_seeds(self, test: Callable[[Document], Any], at: NDArray[np.float64]) -> list[Any]:
        documents = [self._document(at, seed) for seed in SEEDS]
        return list(self._client.gather(self._client.map(test, documents, pure=False)))

    def _document(self, at: NDArray[np.float64], seed: int) -> Document:
        """A scene with these particles, and nothing else."""
        edge = CELL_DIAMETERS * 2.0 * sizes_about(self._radius)["max_radius_m"]
        section = self._material_at(at, {}, {}).section(self._radius)
        section["bed"]["seed"] = section["particles"]["sizes"]["seed"] = seed
        box = {"length_m": edge, "width_m": edge, "depth_m": edge}
        return {"name": self._soil.name, "duration_s": 1.0, "soil": section | {"bin": box}}

    def _wanted(self, second: float) -> Wanted:
        attraction, rolling = self._parts(second)
        return Wanted(self._soil, self._radius, self._density, self._stiffness(attraction), rolling)

    def _parts(self, second: float) -> tuple[float, float]:
        """Attraction and rolling friction of which one is sought."""
        return (second, ROLLING_FRICTION) if self._critical_deg is None else (0.0, second)

    def _material_at(
        self, at: NDArray[np.float64], fitted: dict[str, Interval], measured: dict[str, Interval]
    ) -> Material:
        second = float(at[1])
        found = self._form.sections(self._wanted(second), float(at[0]), self._parts(second)[0])
        return Material(
            version=VERSION,
            soil=self._soil,
            radius_m=self._radius,
            density_kg_per_m3=self._density,
            law=found["law"],
            bonds=found.get("bonds"),
            fitted=fitted,
            measured=measured,
        )

    def _stiffened(self, at: NDArray[np.float64]) -> bool:
        """Adjust the stiffness to the wanted confined modulus; return whether it changed.

        Raises:
            InputError: overlaps would be larger than the rules of stiffness allow.
        """
        wanted_pa = self._soil.confined_modulus_pa
        if wanted_pa is None:
            return False
        found_pa = float(np.mean(self._over_seeds(_modulus, at)))
        if abs(found_pa / wanted_pa - 1.0) <= MODULUS_TOLERANCE:
            return False
        attraction, _ = self._parts(float(at[1]))
        stiffness = self._stiffness(attraction) * wanted_pa / found_pa
        least = self._least_stiffness(attraction)
        if stiffness < least:
            raise InputError(
                f"confined_modulus_pa: given {wanted_pa:g} Pa; it must be about "
                f"{wanted_pa * least / stiffness:.3g} Pa or more: softer particles overlap by more than "
                f"{MAX_OVERLAP:.0%} of their radius at {WORKING_STRESS_PA * 1e-3:g} kPa, or by more than "
                f"{REST_OVERLAP:.0%} by attraction alone; leave it out to take the softest that do not"
            )
        self._given_stiffness = stiffness
        self._sets = 0
        return True

    def _least_stiffness(self, attraction: float) -> float:
        at_work = 4.0 * self._mean_radius * WORKING_STRESS_PA / MAX_OVERLAP
        pressed = attraction / (REST_OVERLAP * self._mean_radius) if self._form.presses else 0.0
        return max(at_work, pressed)

    def _stiffness(self, attraction: float) -> float:
        """Stiffness of a pair [N/m]."""
        return max(self._given_stiffness, self._least_stiffness(attraction))

    def _refuse_angle(self, second: float) -> NoReturn:
        ends = [float(self._tested(np.array((end, second))).mean()[0]) for end in FRICTIONS]
        raise InputError(
            f"friction_angle_deg: given {self._soil.friction_angle_deg:g}; spheres of this solid fraction "
            f"and cohesion reach {ends[0]:.1f} to {ends[1]:.1f} degrees; give one in between, or another "
            "solid_fraction"
        )

    def _measured(self, at: NDArray[np.float64], tested: _Tested, slope: NDArray[np.float64]) -> Material:
        """Results with intervals from the scatter of the seeds; the last slope of the search converts them to
        those of the fitted numbers."""
        rows: dict[str, NDArray[np.float64]] = {
            "friction_angle_deg": tested.angle_deg,
            "cohesion_pa": tested.cohesion_pa,
        }
        critical = tested.critical
        if critical is None:
            critical = np.array(self._over_seeds(_critical, at))
        rows["bulk_density_kg_per_m3"] = critical[:, 2]
        rows["critical_friction_angle_deg"], rows["critical_cohesion_pa"] = critical[:, 0], critical[:, 1]
        rows["confined_modulus_pa"] = np.array(self._over_seeds(_modulus, at))
        if self._parts(float(at[1]))[0] > 0.0:
            rows["tensile_strength_pa"] = np.array(self._over_seeds(_tension, at))
        measured = {key: _interval(found) for key, found in rows.items()}
        free = 2 if at[1] > 0.0 else 1
        scatter = np.atleast_2d(np.cov(tested.sought[:free]))
        inverse = np.linalg.inv(slope[:free, :free])
        count = len(SEEDS)
        half = t_quantile(count - 1) * np.sqrt(np.diag(inverse @ scatter @ inverse.T) / count)
        fitted = {
            key: Interval(value=float(value), low=float(value - width), high=float(value + width))
            for key, value, width in zip(("static_friction", self._fitted), at, half, strict=False)
        }
        return self._material_at(at, fitted, measured)


def _interval(found: NDArray[np.float64]) -> Interval:
    """Mean and its 95 % interval (Student)."""
    mean = float(found.mean())
    half = t_quantile(len(found) - 1) * float(found.std(ddof=1)) / math.sqrt(len(found))
    return Interval(value=mean, low=mean - half, high=mean + half)


def _pressed(document: Document) -> Cell:
    return prepare_cell(load_scene(document))


_Strength = tuple[float, float, float]
"""Friction angle [deg], cohesion [Pa], and density [kg/m3] at the start of the tests."""


def _strength(document: Document) -> _Strength:
    """At the peak."""
    return _strength_of(_series(document, PEAK_STRAIN, to_peak=True), PlaneStrain.peak_pa)


def _critical(document: Document) -> _Strength:
    """In the critical state."""
    return _peak_and_critical(document)[1]


def _peak_and_critical(document: Document) -> tuple[_Strength, _Strength]:
    curves = _series(document, CRITICAL_STRAIN, to_peak=False)
    return _strength_of(curves, PlaneStrain.peak_pa), _strength_of(curves, PlaneStrain.critical_pa)


def _series(document: Document, end_strain: float, *, to_peak: bool) -> list[PlaneStrain]:
    cell = _pressed(document)
    return [plane_strain(cell, least, end_strain, to_peak=to_peak) for least in LEAST_PA]


def _strength_of(
    curves: list[PlaneStrain], stresses_pa: Callable[[PlaneStrain], tuple[float, float]]
) -> _Strength:
    strength = fit_strength(*zip(*map(stresses_pa, curves), strict=True))
    density = float(np.mean([curve.density_kg_per_m3 for curve in curves]))
    return strength.friction_angle_deg, strength.cohesion_pa, density


def _modulus(document: Document) -> float:
    return confined_modulus_pa(_pressed(document))


def _tension(document: Document) -> float:
    return tensile_strength_pa(_pressed(document))
