"""Soil tests whose results a law of particles can be fitted to, each by its target."""

import math
import tempfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...dem.engine import build_engine
from ...loading.loader import ResolvedScene, load_scene
from ...loading.seeds import seed_key
from ..soil_tests.runs import run_soil_tests
from ..soil_tests.strength import SoilStrength
from .design import DraftTarget, ReposeTarget, StrengthTarget, tip_of
from .runs import RunProgress, kept_pull, numbers

LOOSE = 1.075
"""Distance of the column's spheres over their diameter: none overlap after random shifts of 0.1 radii."""

FALLS = 7.0
"""Duration of a collapse in times of free fall from the column's height: the heap is then at rest."""

SLOPE_PART = (0.15, 0.85)
"""Part of the heap's height that the line of its slope is fitted to: foot and wall bend the slope."""


def strength_results(
    scene: ResolvedScene, target: StrengthTarget, threads: int, progress: RunProgress
) -> dict[str, float]:
    """Cohesion, friction angle and tensile strength, those that the target gives."""
    with tempfile.TemporaryDirectory() as folder:
        tests = run_soil_tests(
            scene, target.normal_pa, target.size_m, Path(folder) / "tests",
            inertial_number=target.inertial_number, plate=False, threads=threads, progress=progress,
        )  # fmt: skip
    found = SoilStrength.of(tests)
    results = {
        "cohesion_pa": found.peak.cohesion_pa,
        "friction_angle_rad": math.radians(found.peak.friction_angle_deg),
        "tensile_strength_pa": found.tensile_strength_pa or 0.0,
    }
    return {name: value for name, value in results.items() if getattr(target, name) is not None}


def draft_results(
    scene: ResolvedScene, target: DraftTarget, folder: Path, threads: int, progress: RunProgress
) -> dict[str, float]:
    """Mean draft while the tip is in the metrics window, over all beds of the target; runs are in `folder`.

    Raises InputError: seeds are given, and nothing in the bed is random.
    """
    seeds = [[f"{seed_key(scene)}={seed}"] for seed in target.seeds] or [[]]
    beds = [_changed(scene, ["record.series_ticks=1", "record.cloud_hz=0.0", *seed]) for seed in seeds]
    return {"draft_newton": float(np.mean([_draft_newton(bed, folder, threads, progress) for bed in beds]))}


def _draft_newton(scene: ResolvedScene, folder: Path, threads: int, progress: RunProgress) -> float:
    _, (tip_x, _) = tip_of(scene)
    soil = scene.scene.particle_soil
    assert soil is not None
    inside = scene.scene.report.window_inside_m
    found = kept_pull(scene, folder, "draft", threads, progress)
    window = (inside, soil.bin.length_m - inside)
    return numbers(found, tip_x, window, soil.particles.mean_volume_radius_m).draft_newton


def _changed(scene: ResolvedScene, changes: list[str]) -> ResolvedScene:
    """A resolved scene with overrides laid over it."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "changed.yaml"
        scene.write(path)
        return load_scene(path, changes)


def repose_results(
    scene: ResolvedScene, target: ReposeTarget, threads: int, progress: RunProgress
) -> dict[str, float]:
    """Slope of the heap that a loose column against the near wall falls into."""
    length, width, height = target.column_m
    gravity = scene.scene.gravity_m_per_s2
    box = f"{{length_m: {5.0 * length!r}, width_m: {width!r}, depth_m: {height!r}}}"
    duration = FALLS * math.sqrt(2.0 * height / gravity)
    changes = [f"soil.bin={box}", "soil.bed={kind: grid, spacing_m: rest}", f"duration_s={duration!r}"]
    if scene.scene.particle_soil is not None and scene.scene.particle_soil.window is not None:
        changes.append("soil.window=null")
    changes += [f"{key}=null" for key in ("tools", "mechanism", "report") if key in scene.document]
    resolved = _changed(scene, changes)
    engine = build_engine(resolved, threads)
    radius = engine.radii_m()[0]
    step = LOOSE * 2.0 * radius
    counts = [max(1, int(size / step)) for size in (length, width, height)]
    cells = np.stack(np.meshgrid(*map(range, counts), indexing="ij"), axis=-1).reshape(-1, 3)
    corner = np.array(engine.bed.lower_m) + radius
    shaken = np.random.default_rng(0).uniform(0.0, 0.1 * radius, cells.shape)
    engine.place(corner + step * cells + shaken)
    engine.start(())
    with progress("angle of repose", resolved.timing) as on_tick:
        for tick in range(resolved.timing.tick_count):
            engine.advance(tick, ())
            on_tick(tick)
    return {"angle_rad": slope_rad(engine.positions_m(), radius)}


def slope_rad(positions_m: NDArray[np.float64], radius_m: float) -> float:
    """Slope of a heap that falls off along x: a line through the tops of slices one diameter wide."""
    x, z = positions_m[:, 0], positions_m[:, 2] - positions_m[:, 2].min()
    slices = np.floor(x / (2.0 * radius_m)).astype(int)
    tops = np.array([z[slices == s].max(initial=0.0) for s in range(slices.max() + 1)])
    middle = (np.arange(len(tops)) + 0.5) * 2.0 * radius_m
    low, high = SLOPE_PART
    slope = (tops > low * tops.max()) & (tops < high * tops.max())
    if slope.sum() < 3:  # it stands like a wall, or is a layer
        return 0.5 * math.pi if tops.max() > 8.0 * radius_m else 0.0
    return -math.atan(np.polyfit(middle[slope], tops[slope], 1)[0])
