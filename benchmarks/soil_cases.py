"""Soils whose throughput is measured: law, bed, and what keeps it moving, so that lists are rebuilt.

`linear` is stirred: every particle starts with a random velocity, and those of the surface fly on for
some 0.1 s. Other codes can start from the same numbers. `cohesive_linear` sticks together and would be at
rest after some ms, so a plate is dragged through it, as in the runs this engine is for.
"""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from subsoil_ros.limits.stable_steps import Timing
from subsoil_ros.loading.loader import ResolvedScene
from subsoil_ros.messages import ToolMotion
from subsoil_ros.scene.scene import Scene
from validation.laboratory import WET_BOUNDARY, WET_PARTICLE

RADIUS_M, DENSITY_KG_PER_M3 = 0.010, 1800.0

LINEAR = {
    "stiffness_newton_per_m": 1e4,
    "tangential_stiffness_newton_per_m": 8e3,
    "damping_newton_s_per_m": 10.0,
    "tangential_damping_newton_s_per_m": 0.0,
    "static_friction": 0.5,
    "sliding_friction": 0.5,
    "rolling_friction": 0.3,
}
"""Dry soil as other codes can have it: hooke/stiffness, tangential history, Coulomb, epsd2 rolling."""

LINEAR_STEP_S, LINEAR_SKIN_M = 1e-4, 0.002

WET_STEP_S, WET_SKIN_M = 4.2e-5, 0.003
"""Step, 0.78 of the stable limit, and the skin by default."""

STIR_M_PER_S = 0.25
"""Standard deviation of each component of the random velocities: the fastest particles move by half
the skin in some 15 steps, as beside a tool at 0.5 m/s."""

PLASTIC = {
    "youngs_modulus_pa": 9e5, "poisson_ratio": 0.3, "contact_plasticity": 0.75, "restitution": 0.3,
    "surface_energy_joule_per_m2": 50.0,
    **{key: WET_PARTICLE[key] for key in ("static_friction", "sliding_friction", "rolling_friction")},
}  # fmt: skip
"""Loads as stiffly as WET_PARTICLE: 5 kN/m."""

CEMENT = {
    "youngs_modulus_pa": 1e5, "tensile_strength_pa": 5e3, "cohesion_pa": 1e4, "damping_ratio": 0.0,
}  # fmt: skip
"""Bonds of 1.6 kN/m: the step of the bed without bonds is small enough for them, and few break."""

PLATE = "plate"
PLATE_SIZE_M = (0.01, 0.06, 0.30)
PLATE_SPEED_M_PER_S = 0.5
PLATE_CENTRE_Z_M = -0.05  # its lower edge at a depth of 0.2 m


@dataclass(frozen=True)
class Case:
    """One line of the table of throughputs."""

    name: str
    resolved: ResolvedScene
    steps: int  # timed
    stirred: bool

    @property
    def skin_m(self) -> float:
        """Skin of the neighbour lists."""
        assert self.resolved.scene.particle_soil is not None
        return self.resolved.scene.particle_soil.skin_m

    @property
    def precision(self) -> str:
        """`float64` or `mixed`."""
        assert self.resolved.scene.particle_soil is not None
        return self.resolved.scene.particle_soil.precision

    def motions(self, step: int) -> tuple[ToolMotion, ...]:
        """Where the plate is after `step` steps; none where the soil is stirred."""
        if self.stirred:
            return ()
        assert self.resolved.scene.particle_soil is not None
        start_x = 0.4 * self.resolved.scene.particle_soil.bin.length_m
        x = start_x + PLATE_SPEED_M_PER_S * step * self.resolved.timing.communication_step_s
        return (ToolMotion(PLATE, x, 0.0, PLATE_CENTRE_Z_M, 0.0, PLATE_SPEED_M_PER_S, 0.0, 0.0),)


def stirred_velocities(count: int, seed: int = 1) -> np.ndarray:
    """(count, 3) [m/s] initial velocities of a stirred bed."""
    return np.random.default_rng(seed).normal(0.0, STIR_M_PER_S, (count, 3))


def linear_case(bed: dict[str, Any], size_m: tuple[float, float, float], steps: int, name: str) -> Case:
    """Stirred dry soil in a bin of this size."""
    law = {"kind": "linear", "particle": LINEAR, "boundary": LINEAR}
    document = _document(law, bed, size_m, LINEAR_SKIN_M)
    return Case(name, _resolved(document, LINEAR_STEP_S, Path()), steps, stirred=True)


def cohesive_case(
    bed: dict[str, Any],
    size_m: tuple[float, float, float],
    steps: int,
    name: str,
    folder: Path,
    precision: str = "float64",
    bonds: dict[str, Any] | None = None,
) -> Case:
    """Soil of the paper with a plate in it, whose mesh is written into `folder`."""
    law = {"kind": "cohesive_linear", "particle": WET_PARTICLE, "boundary": WET_BOUNDARY}
    document = _document(law, bed, size_m, WET_SKIN_M)
    document["soil"] |= {"precision": precision, "bonds": bonds}
    return _with_plate(document, steps, name, folder)


def plastic_case(steps: int, name: str, folder: Path) -> Case:
    """The same plate in a grid of spheres that yield and stick, as soft, each touching six."""
    law = {"kind": "elasto_plastic_adhesive", "particle": PLASTIC, "boundary": PLASTIC}
    bed = {"kind": "grid", "spacing_m": 0.0195}
    return _with_plate(_document(law, bed, (0.60, 0.30, 0.40), WET_SKIN_M), steps, name, folder)


def _with_plate(document: dict[str, Any], steps: int, name: str, folder: Path) -> Case:
    trimesh.creation.box(PLATE_SIZE_M).export(folder / "plate.stl")
    document["tools"] = {PLATE: {"path": {}, "groups": {"plate": {"mesh": "plate.stl"}}}}
    return Case(name, _resolved(document, WET_STEP_S, folder), steps, stirred=False)


def _document(
    law: dict[str, Any], bed: dict[str, Any], size_m: tuple[float, float, float], skin_m: float
) -> dict[str, Any]:
    length, width, depth = size_m
    return {
        "name": "bench",
        "duration_s": 1.0,
        "soil": {
            "bin": {"length_m": length, "width_m": width, "depth_m": depth},
            "particles": {"radius_m": RADIUS_M, "density_kg_per_m3": DENSITY_KG_PER_M3},
            "bed": bed,
            "law": law,
            "skin_m": skin_m,
        },
    }


def _resolved(document: dict[str, Any], step_s: float, folder: Path) -> ResolvedScene:
    """A scene with the step as given: other codes run `linear` with one above our limit, which is made for
    a bed denser than a dry one gets."""
    timing = Timing(round(step_s * 1e9), tick_count=1, soil_steps=1, mechanism_steps=0)
    return ResolvedScene(
        scene=Scene.model_validate(document),
        path=folder / "bench",
        directory=folder,
        document=document,
        scene_hash="",
        timing=timing,
    )


GRID, DENSE = {"kind": "grid", "spacing_m": "rest"}, {"kind": "dense_random"}


def throughput_cases(folder: Path, *, quick: bool) -> list[Case]:
    """Beds and laws of the table of throughputs; `quick` leaves the large beds out."""
    cases = [
        linear_case(GRID, (0.60, 0.30, 0.41), 1000, "linear, grid 9,000"),
        linear_case(DENSE, (0.60, 0.30, 0.345), 1000, "linear, dense random 9,000"),
        cohesive_case(GRID, (0.55, 0.27, 0.364), 1000, "cohesive linear, grid 9,000", folder),
        cohesive_case(DENSE, (0.50, 0.25, 0.32), 1000, "cohesive linear, dense random 9,000", folder),
        cohesive_case(DENSE, (0.50, 0.25, 0.32), 1000, "the same, bonded", folder, bonds=CEMENT),
        plastic_case(1000, "elasto-plastic adhesive, grid 9,000", folder),
    ]
    if not quick:
        box, name = (1.80, 0.80, 0.40), "cohesive linear, dense random 130,000"
        cases += [
            linear_case(DENSE, (2.00, 1.12, 0.40), 300, "linear, dense random 130,000"),
            cohesive_case(DENSE, box, 300, f"{name}, mixed precision", folder, "mixed"),
            cohesive_case(DENSE, box, 300, name, folder),
        ]
    return cases


def scaling_cases(folder: Path, counts: tuple[int, ...]) -> list[Case]:
    """Grids of the paper's soil of about so many particles, 22 layers deep, twice as long as wide."""
    spacing, layers = 0.018, 22
    cases = []
    for count in counts:
        columns = math.sqrt(count / layers / 2.0)
        size = (2.0 * columns * spacing, columns * spacing, (layers - 1) * spacing + 2.0 * RADIUS_M)
        steps = max(200, min(1000, 30_000_000 // count))
        cases.append(cohesive_case(GRID, size, steps, f"cohesive linear, grid {count:,}", folder))
    return cases
