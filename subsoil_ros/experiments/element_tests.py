"""Element tests: strength and stiffness of a soil in a cell that repeats itself along x, y and z.

The cell is an endless bed (dem.packing.periodic_sample). It has no walls, no lid and no cut, so stress and
strain are uniform, and results are properties of the soil alone. It is strained along its axes; a servo holds
the stress of axes that have a given one. There is no gravity.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..dem.bed import Bed, ignore_progress
from ..dem.packing.periodic_sample import at_pressure, endless_soil, solid_fraction
from ..dem.packing.relaxation import Settling
from ..dem.packing.replicate import cached_sample
from ..errors import RunError
from ..limits.soil_at_work import WORKING_STRESS_PA
from ..limits.stable_steps import SAFETY, step_limits
from ..loading.loader import ResolvedScene
from ..scene.pair_laws import pair_values
from ..scene.soil import Soil

CELL_DIAMETERS = 12.0
"""Edge of the cell over the largest diameter: two seeds then differ by 3 % in strength."""

INERTIAL_NUMBER = 1e-3
"""Inertial number of the straining: quasi-static (GDR MiDi, Eur. Phys. J. E 14 (2004) 341)."""

LEAST_PA = (2.5e3, 5e3, 10e3)
"""Least stresses of a series: on the plane of failure 4 to 40 kPa, as before a tool at 0.1 to 0.4 m."""

PEAK_STRAIN, CRITICAL_STRAIN = 0.15, 0.30
"""Largest strain of a test for the peak, and the strain of a test up to the critical state. A test for the
peak that ends without one, or a volume that still changes at the end, shows that they are too small."""

PAST_PEAK, LOOKS_FOR_PEAK = 0.03, 100
"""Strain without a higher peak after which a test for the peak ends, and looks from check to check: a check
only costs time."""

RESIDUAL_PART = 0.15
"""Last part of the strain, over which the stress of the critical state is averaged."""

SMOOTHED_STRAIN = 0.005
"""Strain over which a stress is averaged; a longer mean would lower the peak."""

LATERAL_PA = 500.0
"""Pressure at the start of a tension test: small against any tension worth a test."""

HELD, HELD_LOOKS, LONGEST_HOLD = 0.02, 100, 5000
"""A test begins when the mean stress along each axis over so many looks is within this part of its pressure,
at the latest after the longest hold."""

NEIGHBOURS = 6.5
"""Contacts of a particle, assumed for an estimate of the attraction."""

RELEASE_LOOKS = 500
"""Looks over which a preload is removed: slower than stress waves cross a cell."""

GAIN, FOLLOWED = 0.3, 0.1
"""Gains of the servo: parts of a missing stress, over K / d, that the next strain and the mean strain rate
correct. With these, stresses are held to 2 %."""

FASTEST = 5.0
"""Largest strain rate of the servo over that of the test; a larger one would be less quasi-static."""


class Cell(NamedTuple):
    """Soil to be tested."""

    resolved: ResolvedScene
    sample: Bed  # pressed, under springs of its own
    threads: int


class PlaneStrain(NamedTuple):
    """Compression along z, strain along y 0, stress along x constant; arrays (n,), compression positive."""

    strain: NDArray[np.float64]
    greatest_pa: NDArray[np.float64]
    least_pa: NDArray[np.float64]
    volume_strain: NDArray[np.float64]  # growth of the volume over that at the start
    held_pa: float  # nominal least stress
    density_kg_per_m3: float  # at the start

    def smoothed(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Least and greatest stress [Pa], each the mean over SMOOTHED_STRAIN, or all of a shorter test."""
        rows = round(SMOOTHED_STRAIN / self.strain[-1] * len(self.strain))
        window = np.ones(min(max(rows, 1), len(self.strain)))
        least, greatest = (
            np.convolve(stress, window / window.sum(), "valid")
            for stress in (self.least_pa, self.greatest_pa)
        )
        return least, greatest

    def peak_pa(self) -> tuple[float, float]:
        """Least and greatest stress where their ratio is largest."""
        least, greatest = self.smoothed()
        at = int(np.argmax(greatest / least))
        return float(least[at]), float(greatest[at])

    def peak_strain(self) -> float:
        """Strain at the peak, at the end of the averaged interval."""
        least, greatest = self.smoothed()
        return float(self.strain[int(np.argmax(greatest / least)) + len(self.strain) - len(least)])

    def critical_pa(self) -> tuple[float, float]:
        """Least and greatest stress, means over the last RESIDUAL_PART of the strain."""
        last = self.strain > (1.0 - RESIDUAL_PART) * self.strain[-1]
        return float(self.least_pa[last].mean()), float(self.greatest_pa[last].mean())

    @property
    def held_to(self) -> float:
        """Largest relative deviation of the smoothed least stress from the nominal one."""
        return float(np.abs(self.smoothed()[0] / self.held_pa - 1.0).max())


class Strength(NamedTuple):
    """Strength of a Mohr-Coulomb soil."""

    cohesion_pa: float
    friction_angle_deg: float


def rumpf_pa(bonds: float, attraction_newton: float, distance_m: float) -> float:
    """Tensile strength by Rumpf, sigma = solid fraction z F / (pi d^2); `bonds` is solid fraction z.

    F is the largest attraction of a pair, d the distance of two particles, z the number of neighbours of one.
    Source: H. Rumpf, Chem. Ing. Tech. 42 (1970) 538-540, before z is replaced by pi over the porosity.
    """
    return bonds * attraction_newton / (math.pi * distance_m**2)


def fit_strength(least_pa: Sequence[float], greatest_pa: Sequence[float]) -> Strength:
    """sigma_1 = K_p sigma_3 + 2 c sqrt(K_p), K_p = (1 + sin phi) / (1 - sin phi), by least squares."""
    k_p, at_zero = np.polyfit(least_pa, greatest_pa, 1)
    angle = math.asin((k_p - 1.0) / (k_p + 1.0))
    return Strength(float(at_zero) / (2.0 * math.sqrt(k_p)), math.degrees(angle))


def prepare_cell(resolved: ResolvedScene, threads: int = 1, edge_m: float | None = None) -> Cell:
    """Prepare a cell with the particles of a scene whose bed is tiled; edge_m: CELL_DIAMETERS by default."""
    soil = resolved.scene.particle_soil
    assert soil is not None
    edge = edge_m or CELL_DIAMETERS * 2.0 * soil.particles.bounds_m[1]
    return Cell(resolved, cached_sample(resolved, edge, ignore_progress), threads)


class _Strained:
    """A cell at rest at a pressure, under the law of its scene, ready to be strained."""

    def __init__(self, cell: Cell, pressure_pa: float) -> None:
        whole = cell.resolved.scene.particle_soil
        assert whole is not None
        loose = endless_soil(whole, cell.sample.periods_m[0])
        wider = {"bonds": whole.bonds, "skin_m": max(loose.skin_m, whole.skin_m)} if whole.bonds else {}
        self.soil = soil = loose.model_copy(update=wider)  # bonds are made under pressure

        def settling(of: Soil) -> Settling:
            return Settling(
                cell.resolved, cell.threads, soil=of, step_s=SAFETY * step_limits(of)[0].limit_s,
                gravity_m_per_s2=0.0,
            )  # fmt: skip

        bed = at_pressure(settling(loose), cell.sample, pressure_pa, ignore_progress)
        strained = settling(soil)
        self.look_s = strained.interval_s
        self.engine = engine = strained.engine(bed)
        engine.start(())
        self._stress_pa = np.diagonal(engine.stress_pa())  # at the end of the last look
        self._tick = 0
        self._drift = np.zeros(3)
        pair, diameter = pair_values(soil)[0], 2.0 * soil.particles.mean_volume_radius_m
        self._modulus_pa = pair.linear_at(pair.loaded_m(pressure_pa * diameter**2)).max_stiffness / diameter
        bonded_pa = 0.0
        if soil.bonds is not None:
            section = soil.bonds.radius_over_particle**2
            self._modulus_pa += 0.25 * math.pi * section * soil.bonds.youngs_modulus_pa
            bonded_pa = section * soil.bonds.tensile_strength_pa
        attraction = rumpf_pa(solid_fraction(bed, whole) * NEIGHBOURS, pair.peak_attraction, diameter)
        speed = math.sqrt((pressure_pa + attraction + bonded_pa) / soil.particles.density_kg_per_m3)
        self.rate_per_s = INERTIAL_NUMBER * speed / diameter
        self._hold(pressure_pa)

    def _hold(self, pressure_pa: float) -> None:
        """Hold a pressure until the tangential springs, absent in a bed at rest, have their forces.

        Raises:
            RunError: the pressure is not reached.
        """
        looks: list[NDArray[np.float64]] = []
        while len(looks) < LONGEST_HOLD:
            looks.append(self.advance((0.0, 0.0, 0.0), (pressure_pa,) * 3))
            if len(looks) % HELD_LOOKS == 0:
                found = np.mean(looks[-HELD_LOOKS:], axis=0)
                if np.abs(found / pressure_pa - 1.0).max() < HELD:
                    self._drift[:] = 0.0
                    return
        raise RunError(
            f"element test: {pressure_pa:g} Pa wanted along x, y and z, found {found}; give the law dampers"
        )

    def advance(self, rates_per_s: Sequence[float], held_pa: Sequence[float | None]) -> NDArray[np.float64]:
        """Strain the cell for some steps; return (3,) stresses along the axes. Rates are positive in
        extension; an axis with a stress in `held_pa` gets the rate that holds it."""
        rates = np.array(rates_per_s)
        for axis, held in enumerate(held_pa):
            if held is not None:
                missed = (self._stress_pa[axis] - held) / (self._modulus_pa * self.look_s)
                bound = FASTEST * self.rate_per_s
                self._drift[axis] = np.clip(self._drift[axis] + FOLLOWED * missed, -bound, bound)
                rates[axis] = np.clip(GAIN * missed + self._drift[axis], -bound, bound)
        self.engine.resize(1.0 + rates * self.look_s)
        self.engine.advance(self._tick, ())
        self._tick += 1
        self._stress_pa = np.diagonal(self.engine.stress_pa())
        return self._stress_pa

    def largest_pa(self, end_strain: float, sign: float) -> float:
        """Largest tension (sign 1) or pressure (-1) along z while strained, without stress along x and y."""
        height, largest = self.engine.bed.periods_m[2], 0.0
        while sign * (self.engine.bed.periods_m[2] / height - 1.0) < end_strain:
            stress = self.advance((0.0, 0.0, sign * self.rate_per_s), (0.0, 0.0, None))
            largest = max(largest, -sign * float(stress[2]))
        return largest

    @property
    def volume_m3(self) -> float:
        """Of the cell."""
        return float(np.prod(self.engine.bed.periods_m))

    @property
    def density_kg_per_m3(self) -> float:
        """Of the cell."""
        return solid_fraction(self.engine.bed, self.soil) * self.soil.particles.density_kg_per_m3


def plane_strain(
    cell: Cell, least_pa: float, end_strain: float = PEAK_STRAIN, *, to_peak: bool = True
) -> PlaneStrain:
    """Compress a cell along z by a part `end_strain` of its height; with `to_peak` only until its strain is
    PAST_PEAK beyond the peak."""
    element = _Strained(cell, least_pa)
    height, volume = element.engine.bed.periods_m[2], element.volume_m3
    density = element.density_kg_per_m3
    rows: list[tuple[float, float, float, float]] = []

    def curve() -> PlaneStrain:
        strain, greatest, least, grown = np.array(rows).T
        return PlaneStrain(strain, greatest, least, grown, least_pa, density)

    while not rows or rows[-1][0] < end_strain:
        stress = element.advance((0.0, 0.0, -element.rate_per_s), (least_pa, None, None))
        short = 1.0 - element.engine.bed.periods_m[2] / height
        rows.append((short, float(stress[2]), float(stress[0]), element.volume_m3 / volume - 1.0))
        due = to_peak and len(rows) % LOOKS_FOR_PEAK == 0 and short > PAST_PEAK
        if due and short - curve().peak_strain() > PAST_PEAK:
            break
    return curve()


def confined_modulus_pa(cell: Cell, from_pa: float = LEAST_PA[-1], to_pa: float = WORKING_STRESS_PA) -> float:
    """Stress over strain along z between two stresses, at no strain along x and y: secant [Pa]."""
    element = _Strained(cell, from_pa)
    height = element.engine.bed.periods_m[2]
    strain, stress = [0.0], [from_pa]
    while stress[-1] < to_pa:
        found = element.advance((0.0, 0.0, -element.rate_per_s), (None, None, None))
        strain.append(1.0 - element.engine.bed.periods_m[2] / height)
        stress.append(float(found[2]))
        if strain[-1] > CRITICAL_STRAIN:
            raise RunError(
                f"confined compression: {stress[-1]:.3g} Pa at a strain of {CRITICAL_STRAIN:g}, less than "
                f"{to_pa:g} Pa; make the contacts stiffer"
            )
    low, high = np.interp((from_pa, to_pa), np.maximum.accumulate(stress), strain)
    return float((to_pa - from_pa) / (high - low))


def tensile_strength_pa(cell: Cell, end_strain: float = PEAK_STRAIN) -> float:
    """Largest tension along z while it is drawn out, without stress along x and y [Pa]."""
    element = _Strained(cell, LATERAL_PA)
    return element.largest_pa(end_strain, 1.0)


def unconfined_strength_pa(cell: Cell, preload_pa: float, end_strain: float = PEAK_STRAIN) -> float:
    """Largest stress along z while it is shortened, without stress along x and y, after all three axes bore
    `preload_pa` and were released [Pa]: a point of the soil's flow function.

    Raises:
        RunError: released, the cell does not come to rest.
    """
    element = _Strained(cell, preload_pa)
    for look in range(1, LONGEST_HOLD + 1):
        held = max(preload_pa * (1.0 - look / RELEASE_LOOKS), 0.0)
        stress = element.advance((0.0, 0.0, 0.0), (held,) * 3)
        if held == 0.0 and np.abs(stress).max() < HELD * preload_pa:
            break
    else:
        raise RunError(
            f"unconfined compression: {preload_pa:g} Pa released, {stress} Pa are left along x, y and z; "
            "give the law dampers"
        )
    return element.largest_pa(end_strain, -1.0)
