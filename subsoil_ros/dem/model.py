"""What stays the same during a run: a soil as its kernels take it."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..contact_laws.base import Features
from ..contact_laws.features import books_energy
from ..errors import InputError
from ..loading.loader import ResolvedScene
from ..scene.pair_laws import layer_soils, pair_values, particle_mass_kg
from ..scene.soil import Soil
from .bed import Bed
from .contact import history_parity, law_features, soil_laws
from .mixture import ContactModel, Mixture, law_tables, material_at, reaches_m
from .particles import Masses, Particles
from .periodic import TOOL_SKIN, periods


@dataclass(frozen=True)
class SoilModel:
    """Numbers and laws of a soil. SI."""

    soil: Soil
    features: Features  # of the law; the period of an endless bed follows its size
    precision: type  # float64, or float32 for all but positions and boundaries
    gravity_m_per_s2: float
    step_s: float
    soil_steps: int  # in a tick
    last_step_only: bool  # coupling.force is tick_end: the exchanged force is that of the last step
    smallest_m: float
    radius_m: float  # of all, or the largest
    mass_kg: float  # of all, or of one of mean volume
    inertia_kg_m2: float  # of all
    density_kg_per_m3: np.ndarray  # (layers,)
    pair_law: Any  # ContactLaw.numbers, in `precision`
    wall_law: Any
    tool_law: Any
    pair_laws: np.ndarray  # Mixture.laws
    wall_laws: np.ndarray
    tool_laws: np.ndarray
    parity: np.ndarray  # (components,) of what the law keeps of a contact, see history_parity
    reach_m: float  # between two centres in a neighbour list, the skin included
    wall_reach_m: float
    tool_reach_m: float
    largest_tool_overlap_m: float

    @property
    def booked(self) -> bool:
        """Whether every energy sink is booked."""
        return books_energy(self.features)

    @property
    def layers(self) -> int:
        """Number of materials."""
        return len(self.density_kg_per_m3)

    def particles(
        self,
        position_m: np.ndarray,
        radii_m: np.ndarray | None,
        materials: np.ndarray | None,
        held: np.ndarray | None = None,
        identity: np.ndarray | None = None,
    ) -> Particles:
        """Particles at rest, at a copy of `position_m` (n, 3); without `materials`, by their depth.

        Raises:
            InputError: the soil has sizes, and no radii are given.
        """
        if identity is None:
            identity = np.arange(len(position_m), dtype=np.int32)
        p = Particles.at_rest(np.array(position_m), identity, self.precision, held)
        sizes = self.soil.particles.sizes
        if sizes is not None or self.soil.layers is not None:
            if radii_m is None and sizes is not None:
                raise InputError("radii_m: is missing; a soil with particles.sizes needs one per particle")
            given = np.full(p.count, self.radius_m) if sizes is None else radii_m
            radius = np.array(given, np.float64)
            if materials is None:
                materials = material_at(self.soil, -position_m[:, 2])
            p.make_unequal(radius, np.array(materials, np.int64), self.density_kg_per_m3)
        return p

    def masses(self, p: Particles) -> Masses:
        """Masses for the kernels."""
        return Masses(p.mass, p.inertia) if p.unequal else Masses(self.mass_kg, self.inertia_kg_m2)

    def at_pairs(self, p: Particles, step_s: float) -> ContactModel:
        """Contacts of two particles, in `precision`."""
        step, radius = self.precision(step_s), self.precision(self.radius_m)
        return ContactModel(self.pair_law, self._mixture(p, radius, self.pair_laws), self.features, step)

    def seen_at_pairs(self, p: Particles) -> tuple[Any, Mixture, Features]:
        """Contacts of two particles for readings, in float64: ContactModel but for the step."""
        return self.wall_law, self._mixture(p, self.radius_m, self.pair_laws), self.features

    def at_walls(self, p: Particles, step_s: float = 0.0) -> ContactModel:
        """Contacts of particles and walls."""
        mixture = self._mixture(p, self.radius_m, self.wall_laws)
        return ContactModel(self.wall_law, mixture, self.features, step_s)

    def at_tools(self, p: Particles, step_s: float = 0.0) -> ContactModel:
        """Contacts of particles and tools."""
        mixture = self._mixture(p, self.radius_m, self.tool_laws)
        return ContactModel(self.tool_law, mixture, self.features, step_s)

    def _mixture(self, p: Particles, radius: float, laws: np.ndarray) -> Mixture:
        return Mixture(radius, p.radius, p.mass, p.material, laws, self.layers)

    def clearance_m(self, p: Particles) -> np.ndarray:
        """(n,) distance of a centre from a boundary at which nothing presses."""
        rest = np.array([pair_values(layer)[1].rest_overlap for layer in layer_soils(self.soil)])
        return p.radius - rest[p.material] if p.unequal else np.full(p.count, self.radius_m - rest[0])


def soil_model(resolved: ResolvedScene, bed: Bed, *, book: bool = False) -> SoilModel:
    """The model of a scene's soil in a bed. Energy is booked with `book`, or where the scene balances it.

    Raises:
        InputError: the scene has no soil of particles.
    """
    soil, timing = resolved.scene.particle_soil, resolved.timing
    if soil is None:
        raise InputError(f"{resolved.path}: has no 'soil', so it needs no soil engine")
    book = book or (soil.monitors is not None and soil.monitors.max_energy_defect is not None)
    features = law_features(soil, book=book, periodic=periods(bed))
    precision = np.float32 if soil.precision == "mixed" else np.float64
    law, wall_law, tool_law = soil_laws(soil)
    pair_laws, wall_laws, tool_laws = law_tables(soil, features)
    smallest, radius = soil.particles.bounds_m  # equal, or smallest and largest radius
    mass = particle_mass_kg(soil)
    between_pairs, at_walls = reaches_m(soil)
    return SoilModel(
        soil=soil,
        features=features,
        precision=precision,
        gravity_m_per_s2=resolved.scene.gravity_m_per_s2,
        step_s=timing.soil_step_s,
        soil_steps=timing.soil_steps,
        last_step_only=resolved.scene.exchanged_force == "tick_end",
        smallest_m=smallest,
        radius_m=radius,
        mass_kg=mass,
        inertia_kg_m2=0.4 * mass * radius**2,
        density_kg_per_m3=np.array([layer.particles.density_kg_per_m3 for layer in layer_soils(soil)]),
        pair_law=soil.law.numbers(*np.array(law, precision)),
        wall_law=wall_law,
        tool_law=tool_law,
        pair_laws=pair_laws,
        wall_laws=wall_laws,
        tool_laws=tool_laws,
        parity=history_parity(soil.law),
        reach_m=2.0 * radius + between_pairs + soil.skin_m,
        wall_reach_m=radius + at_walls + soil.skin_m,
        tool_reach_m=radius + at_walls + TOOL_SKIN * soil.skin_m,
        largest_tool_overlap_m=soil.max_tool_overlap_m or 2.0 * soil.particles.mean_volume_radius_m,
    )
