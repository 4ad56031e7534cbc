"""Pulls through particles at the points of a design, which a wedge model is fitted to."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import RunError
from ...loading.loader import ResolvedScene, load_scene
from ...scene.wedge_soil import WedgeValues
from .design import Point, WedgeDesign, point_overrides, tip_of
from .runs import PullNumbers, RunProgress, kept_pull, numbers

START = WedgeValues(
    density_kg_per_m3=1500.0,
    cohesion_pa=1e4,
    friction_angle_rad=0.3,
    adhesion_pa=1e3,
    tool_friction_angle_rad=0.2,
)
"""Values of the wedge model before a fit."""

_WEDGE = (
    "soil={model: wedge, values: " + START.model_dump_json(exclude_none=True) + "}",
    "allow=[]",  # what the scene allows concerns its particles
)

WEDGE_STEP_M = 1e-3
"""Travel in a tick of the wedge model: a tenth of the shortest wave that is compared."""


@dataclass(frozen=True)
class Measured:
    """A point of the design and its runs."""

    point: Point
    scene: ResolvedScene  # on the wedge model
    tip_x_m: float
    numbers: list[PullNumbers]  # one per replicate
    used: bool  # in the fit

    def mean(self, name: str) -> Any:
        """Mean of a number over the replicates."""
        return np.mean([getattr(item, name) for item in self.numbers], axis=0)

    def scatter(self, name: str) -> float:
        """Largest relative departure of a replicate from their mean; 0 with one."""
        values = np.array([getattr(item, name) for item in self.numbers])
        return float(np.max(np.abs(values / values.mean() - 1.0)))


def measure(
    scene: ResolvedScene, design: WedgeDesign, folder: Path, threads: int, progress: RunProgress
) -> list[Measured]:
    """Run the points that are not in the cache, and evaluate all. Raises RunError as kept_pull does."""
    found = []
    name, _ = tip_of(scene)
    shortest = shortest_wave_m(scene)
    for used, points in ((True, design.fit), (False, design.check)):
        for point in points:
            runs = []
            for replicate in range(point.replicates):
                resolved = load_scene(scene.path, point_overrides(scene, design, point, replicate))
                label = f"{point.name}, run {replicate + 1} of {point.replicates}"
                tip_x = _tip_x_m(scene, point)
                found_pull = kept_pull(resolved, folder, label, threads, progress)
                runs.append(numbers(found_pull, tip_x, design.window_m, shortest))
            step = f"coupling.communication_step_ns={round(1e9 * WEDGE_STEP_M / point.speed_m_per_s)}"
            changes = [
                change
                for change in point_overrides(scene, design, point, 0)
                if not change.startswith("soil.") or change.startswith("soil.bin")  # particles are not there
            ]
            wedge = load_scene(scene.path, (*changes, *_WEDGE, step))
            found.append(Measured(point, wedge, _tip_x_m(scene, point), runs, used))
    groups = scene.scene.tools[name].groups
    if any(len(item.numbers[0].mean_x_newton) != len(groups) for item in found):
        raise RunError(f"{folder}: a cached run has other groups than {', '.join(groups)}; remove the folder")
    return found


def shortest_wave_m(scene: ResolvedScene) -> float:
    """Shortest wavelength that is compared, a radius: shorter waves are of single contacts."""
    soil = scene.scene.particle_soil
    assert soil is not None
    return soil.particles.mean_volume_radius_m


def _tip_x_m(scene: ResolvedScene, point: Point) -> float:
    _, (x, z) = tip_of(scene)
    return math.cos(point.tilt_rad) * x - math.sin(point.tilt_rad) * z
