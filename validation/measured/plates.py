"""Plates pushed into a bed of particles, dragged and lifted, as in the measured sets of plates.

    python -m validation.measured.plates SET [--radii-mm R ...] [--speed V] [--seed 1] [--processes 2]

SET is a key of SETS. Every run leaves a table of depth, travel and force in results/plates; a run whose table
is there is not run again. PREDICTIONS.md says what is compared with what, and where SANDS are from.
"""

import argparse
import csv
import math
import sys
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import trimesh
from numpy.typing import NDArray

from subsoil_ros.dem.build import build_engine
from subsoil_ros.messages import ToolMotion

from ..laboratory import Document, Laboratory
from ..materials import Sand

RESULTS = Path(__file__).with_name("results") / "plates"

SANDS = {
    "repose_29": (0.56, 0.34, 0.3, 1330.0),
    "repose_29_denser": (0.60, 0.34, 0.3, 1330.0),  # one thing changed at a time, to see what would matter
    "repose_29_stronger": (0.56, 0.50, 0.3, 1330.0),
    "critical_29": (0.56, 0.30, 0.21, 1330.0),
    "critical_33": (0.56, 0.30, 0.57, 1490.0),
    "peak_34": (0.60, 0.37, 0.1, 1560.0),
    "peak_38": (0.60, 0.545, 0.1, 1560.0),
}
"""Solid fraction, friction and rolling friction of particles, and bulk density [kg/m3]. All else is that of
the shipped dry_sand. Without cohesion all radii are alike."""

SHIPPED = ("dry_sand", "sandy_loam", "loam", "clay_loam")
"""Materials of the package."""

SPEED_M_PER_S = 0.1
"""Of a plate: the inertial number, speed over the plate's length x diameter x sqrt(density / pressure), is
0.007 with particles of 4 mm below a plate of 60 mm that bears 10 kPa, and no larger in the other runs."""

ROW_M = 0.0005
"""Travel of a row of a table."""

FIELDS = ("depth_m", "travel_m", "force_x_newton", "force_z_newton")
"""Of a table: forces on the plate along x and upward."""

ABOVE_M = 0.002
"""Of the lowest edge above the surface at the start."""

BEYOND = (5.0, 5.0, 2.5)
"""Length, width and depth of the field about a round plate, over its diameter."""

BOX_M = (0.30, 0.19, 0.15)
"""About a plate 38 mm wide that is dragged 50 mm deep: five widths across the motion, and ahead of the plate
more than a passive wedge reaches."""

DRAG_M = 0.06
"""Way of a drag."""

SIDES = 64
"""Of the prism that stands for a round plate: its area is 0.2 % less than a circle's."""


class Plate(NamedTuple):
    """A plate and its way: straight in, then dragged along x or lifted."""

    soil: str
    attack_deg: float  # of a plate that rises along x; 0: level, 90: upright
    length_m: float  # along x when level
    width_m: float
    thickness_m: float
    depth_m: float  # of the lower face of a round plate, of the centre of another
    then: str = ""  # "", "drag" or "lift"
    floor_m: float = 0.0  # depth of the bed under a round plate; 0: BEYOND says it

    @property
    def round(self) -> bool:
        """Whether it is a disc, of which length and width are the diameter."""
        return self.length_m == self.width_m

    @property
    def area_m2(self) -> float:
        """Of its face."""
        return float(self.length_m * self.width_m * (0.25 * np.pi if self.round else 1.0))

    def name(self, radius_m: float, seed: int = 1, speed_m_per_s: float = SPEED_M_PER_S) -> str:
        """Of its table."""
        size = f"{1e3 * self.length_m:g}" if self.round else f"{1e3 * self.length_m:g}x{1e3 * self.width_m:g}"
        way = f"{self.attack_deg:g}deg{'_' + self.then if self.then else ''}"
        way += f"_floor{1e3 * self.floor_m:g}mm" if self.floor_m else ""
        return f"{self.soil}_{size}mm_{way}_r{1e3 * radius_m:g}_v{1e3 * speed_m_per_s:g}_s{seed}"

    def mesh(self) -> trimesh.Trimesh:
        """A disc above the origin, or a box about it."""
        if self.round:
            disc = trimesh.creation.cylinder(0.5 * self.length_m, self.thickness_m, sections=SIDES)
            disc.apply_translation((0.0, 0.0, 0.5 * self.thickness_m))
            return disc
        box = trimesh.creation.box((self.length_m, self.width_m, self.thickness_m))
        box.apply_transform(
            trimesh.transformations.rotation_matrix(-np.radians(self.attack_deg), (0.0, 1.0, 0.0))
        )
        return box


def discs(soil: str, diameters_mm: Iterable[float], depth_mm: float, thickness_mm: float) -> list[Plate]:
    """Round plates pushed in."""
    return [Plate(soil, 0.0, 1e-3 * d, 1e-3 * d, 1e-3 * thickness_mm, 1e-3 * depth_mm) for d in diameters_mm]


def submerged(soil: str) -> list[Plate]:
    """The plate of Li, Zhang and Goldman (2013) [m]: 25 by 38 mm, here 6 mm thick (more than a radius)."""
    size = (0.025, 0.038, 0.006)
    drags = [Plate(soil, attack, *size, 0.05, "drag") for attack in (0.0, 90.0, 45.0, -45.0)]
    return [*drags, Plate(soil, 0.0, *size, 0.06, "lift")]


SETS: dict[str, list[Plate]] = {
    "pavlov": discs("repose_29", (60, 80, 100), 22, 40) + discs("critical_29", (60, 80, 100), 22, 40),
    "kruger": discs("critical_33", (151,), 76, 90),
    "li": submerged("peak_38") + submerged("peak_34"),
    "pavlov_grain": discs("repose_29", (80,), 22, 40),
    "pavlov_why": [
        *(disc._replace(floor_m=m) for m in (0.06, 0.1) for disc in discs("repose_29", (60, 100), 22, 40)),
        *discs("repose_29_denser", (80,), 22, 40),
        *discs("repose_29_stronger", (80,), 22, 40),
    ],
    "li_grain": submerged("peak_38")[-1:],
    "wong": [plate for soil in SHIPPED for plate in discs(soil, (200,), 52, 80)],
}


def soil_of(plate: Plate, radius_m: float, seed: int) -> Document:
    """Keys of a scene's soil."""
    length, width, depth = (times * plate.length_m for times in BEYOND) if plate.round else BOX_M
    depth = plate.floor_m or depth
    window: Document = {}  # of a material: as long as its rupture distance
    if plate.soil in SANDS:
        fraction, friction, rolling, bulk = SANDS[plate.soil]
        soil = Sand("dry_sand", radius_m, fraction, friction, rolling).section(seed)
        soil["particles"] |= {"density_kg_per_m3": bulk / fraction}
        window = {"behind_m": 0.5 * length, "ahead_m": 0.5 * length}
    else:
        soil = {"material": plate.soil, "particles": {"radius_m": radius_m}, "bed": {"seed": seed}}
    return soil | {
        "bin": {"length_m": length + DRAG_M, "width_m": width, "depth_m": depth, "sides": "held"},
        "window": window,
    }


def ways(plate: Plate) -> Iterator[tuple[float, float, float]]:
    """Length [m] and direction (x, z) of each part of its way, from ABOVE_M over the surface."""
    yield plate.depth_m + _lowest_m(plate) + ABOVE_M, 0.0, -1.0
    if plate.then == "drag":
        yield DRAG_M, 1.0, 0.0
    elif plate.then == "lift":
        yield plate.depth_m, 0.0, 1.0


def _lowest_m(plate: Plate) -> float:
    return -float(plate.mesh().bounds[0][2])


def pushed(
    plate: Plate, radius_m: float, seed: int, speed_m_per_s: float = SPEED_M_PER_S
) -> tuple[NDArray[Any], int]:
    """Table of a plate's way with fields FIELDS, and the number of particles."""
    soil = soil_of(plate, radius_m, seed)
    x, z = 0.5 * (soil["bin"]["length_m"] - DRAG_M), _lowest_m(plate) + ABOVE_M

    def at(along: float, up: float) -> tuple[ToolMotion, ...]:
        return (ToolMotion("plate", x, 0.0, z, 0.0, speed_m_per_s * along, speed_m_per_s * up, 0.0),)

    with tempfile.TemporaryDirectory() as folder:
        mesh = Path(folder) / "plate.stl"
        plate.mesh().export(mesh)
        tools = {"plate": {"path": {}, "groups": {"plate": {"mesh": str(mesh)}}}}
        scene = Laboratory(Path(folder)).resolve(
            {"name": "plate", "duration_s": 1.0, "tools": tools, "soil": soil}
        )
        engine = build_engine(scene)
        engine.start(at(0.0, 0.0))
    step = speed_m_per_s * scene.timing.communication_step_s
    rows, tick, per_row, begin = [], 0, max(1, round(ROW_M / step)), x
    for length, along, up in ways(plate):
        forces: list[tuple[float, float]] = []
        for _ in range(round(length / step)):
            x, z = x + step * along, z + step * up
            wrench = engine.advance(tick, at(along, up))[0]
            forces.append((wrench.force_x_newton, wrench.force_z_newton))
            tick += 1
            if len(forces) == per_row:
                middle = 0.5 * step * (per_row - 1)
                rows.append((-z + up * middle, x - begin - along * middle, *np.mean(forces, axis=0)))
                forces.clear()
    return np.array(rows, dtype=[(name, float) for name in FIELDS]), engine.particle_count


def push(plate: Plate, radius_m: float, seed: int, speed_m_per_s: float) -> str:
    """Runs a plate and writes its table."""
    rows, particles = pushed(plate, radius_m, seed, speed_m_per_s)
    path = RESULTS / f"{plate.name(radius_m, seed, speed_m_per_s)}.csv"
    part = path.with_suffix(".part")
    with part.open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        table.writerow(FIELDS)
        table.writerows([f"{value:.5g}" for value in row] for row in rows)
    part.rename(path)
    return f"{path.stem}: {particles} particles"


def record(name: str) -> NDArray[Any] | None:
    """Table of a kept run; None: was not run."""
    path = RESULTS / f"{name}.csv"
    return np.genfromtxt(path, delimiter=",", names=True) if path.is_file() else None


def pressed_pa(run: NDArray[Any] | None, plate: Plate, depths_m: Iterable[float]) -> NDArray[np.float64]:
    """Pressure under a plate on its way in, at each depth; NaN where it was not run.

    The mean over 2 mm of sinkage.
    """
    wanted = np.fromiter(depths_m, float)
    if run is None:
        return np.full(len(wanted), math.nan)
    last = int(np.argmax(run["depth_m"])) + 1
    depth, force = run["depth_m"][:last], run["force_z_newton"][:last]
    return np.array([force[np.abs(depth - at) <= 0.001].mean() for at in wanted]) / plate.area_m2


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs what is missing of a set."""
    parser = argparse.ArgumentParser(prog="python -m validation.measured.plates", description=main.__doc__)
    parser.add_argument("set", choices=SETS)
    parser.add_argument("--radii-mm", nargs="+", type=float, default=[4.0])
    parser.add_argument("--speed", type=float, default=SPEED_M_PER_S, help="[m/s]")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--processes", type=int, default=2)
    args = parser.parse_args(arguments)
    RESULTS.mkdir(parents=True, exist_ok=True)
    plates = SETS[args.set]
    with ProcessPoolExecutor(args.processes, get_context("spawn")) as pool:
        jobs = [
            pool.submit(push, plate, 1e-3 * radius, args.seed, args.speed)
            for radius in sorted(args.radii_mm)
            for plate in plates
            if record(plate.name(1e-3 * radius, args.seed, args.speed)) is None
        ]
        for job in as_completed(jobs):
            print(job.result(), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
