"""Drag of a plate through dry sand, by the density of the bed: its waves, and the band in which soil fails.

    python -m validation.plate_drag drag DIR [--fractions 0.57 0.6 0.63] [--depths-mm 140] [--radii-mm 5]
        [--froude 0.1] [--grains-wide 10] [--ends 5] [--seed 1] [--processes 2] [--threads 1]
    python -m validation.plate_drag table DIR

The experiment of N. Gravish, P. Umbanhowar, D. Goldman, Phys. Rev. Lett. 105 (2010) 128301: an upright plate
dragged through dry beads of 0.3 mm, 38 mm wide and 70 mm deep, 230 grains. Without cohesion, at low speed and
for grains small against the plate, its depth d is the only length and (density) g d^2 the only force by
width. The drag of few particles is noisy: on a plate of 8 by 4 grains, each matters. So the plate here is a
slice of an endless one, as wide as its field is periodic, and its top is level with the soil, so that what it
heaps up flows over it and the drag is steady. Soil: dry_sand in a bed of each solid fraction.

`drag` pulls the plate through a field and leaves a table of travel, drag and shear band in DIR for each run
that is not there yet. `table` judges them from FIRST depths on: mean drag over (density) g d^2 and the width,
deviation about the trend over the mean, that of the waves in each octave of wavelength over d, the
strongest wavelength and whether it stands out of red noise, the travel between failures with the scatter from
one to the next, the band's angle. The strength of the sand at each density:
`python -m validation.materials --solid-fractions`.
"""

import argparse
import csv
import itertools
import math
import sys
import tempfile
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.signal import periodogram

from subsoil_ros.analysis.failure_cycles import failure_cycles
from subsoil_ros.analysis.spectra import spectrum
from subsoil_ros.analysis.stationarity import stationarity
from subsoil_ros.dem.build import build_engine
from subsoil_ros.loading.files import shipped_material
from subsoil_ros.loading.material_file import read_material
from subsoil_ros.messages import ToolMotion

from .blades import GRAVITY_M_PER_S2
from .laboratory import Laboratory

Values = NDArray[np.float64]

SOIL, THICK = "dry_sand", 0.1
"""Thickness of the plate over its depth (chosen: a radius or more, several times the largest overlap, so
that no particle passes through)."""

BELOW = 0.6
"""Soil below the plate over the depth (chosen)."""

FIRST, DEPTHS = 2.0, 12.0
"""Over the depth: travel from which on it counts, and up to which."""

ROW, LOOK = 0.02, 0.1
"""Over the depth: travel of a row of the table, and that between two looks at the soil."""

SMOOTHED_ROWS = 3
"""In which failures are looked for (chosen: a twentieth of a depth)."""

OCTAVES = (0.0625, 0.125, 0.25, 0.5, 1.0, 2.0, 4.0)
"""Bounds of wavelengths over the depth."""

MOVES, FLANKS = 0.5, (0.75, 0.25)
"""Soil moves with the plate at this part of its way; parts between which the width of a band is taken."""

LAYERS = np.linspace(-0.8, -0.2, 7)
"""Heights over the depth at which the edge of the moving soil is looked for."""


class Run(NamedTuple):
    """One plate."""

    fraction: float
    depth_m: float
    radius_m: float
    froude: float  # speed over sqrt(g d)
    grains_wide: float  # period of the field over the mean diameter: it averages over so many grains
    ends: float  # lengths of the window ahead and behind over the depth; 3 is too short
    seed: int

    @property
    def speed_m_per_s(self) -> float:
        """Of the plate."""
        return self.froude * math.sqrt(GRAVITY_M_PER_S2 * self.depth_m)

    @property
    def width_m(self) -> float:
        """Of the slice."""
        return round(2.0 * self.grains_wide * self.radius_m, 4)

    @property
    def name(self) -> str:
        """Of its files."""
        place = f"{1e2 * self.fraction:g}_{1e3 * self.depth_m:g}mm_r{1e3 * self.radius_m:g}_f{self.froude:g}"
        return f"{place}_w{self.grains_wide:g}_e{self.ends:g}_s{self.seed}"


def read_name(name: str) -> Run:
    """The run of a file."""
    fraction, depth, radius, *others, seed = name.split("_")
    froude, wide, ends = (float(word[1:]) for word in others)
    return Run(
        1e-2 * float(fraction), 1e-3 * float(depth[:-2]), 1e-3 * float(radius[1:]), froude, wide, ends,
        int(seed[1:]),
    )  # fmt: skip


class Look(NamedTuple):
    """Soil at one moment: x of the plate's face [m], numbers (n,) and places (n, 3) [m] of particles."""

    tip_m: float
    identity: NDArray[np.int64]
    position_m: Values


def band(before: Look, after: Look, run: Run) -> tuple[float, float]:
    """Angle of the front of the moving soil against the horizontal [deg] and its width along the way [m];
    NaN where there is none."""
    depth, way = run.depth_m, after.tip_m - before.tip_m
    _, first, last = np.intersect1d(before.identity, after.identity, True, return_indices=True)
    was, now = before.position_m[first], after.position_m[last]
    x, _, z = (0.5 * (was + now)).T - np.array([[0.5 * (before.tip_m + after.tip_m)], [0.0], [0.0]])
    moved = (now - was)[:, 0] / way
    edges, widths = [], []
    for height in LAYERS:
        near = (x > 0.0) & (np.abs(z - height * depth) < 1.5 * run.radius_m)
        edge, inner, outer = falls_to(x[near], moved[near], (MOVES, *FLANKS), run.radius_m)
        edges.append(edge)
        widths.append(outer - inner)
    known = np.isfinite(edges)
    if known.sum() < len(LAYERS) - 2:
        return math.nan, math.nan
    slope = np.polyfit(LAYERS[known] * depth, np.asarray(edges)[known], 1)[0]
    return math.degrees(math.atan2(1.0, slope)), float(np.nanmean(np.where(known, widths, np.nan)))


def falls_to(x: Values, values: Values, levels: Sequence[float], reach: float) -> list[float]:
    """Where the mean of values (n,) about x falls below each level for the first time, from x = 0 on; NaN
    where it does not. Means have triangular weights over two `reach` to each side."""
    places = np.arange(0.0, float(x.max(initial=0.0)), 0.25 * reach)
    weights = np.maximum(0.0, 1.0 - np.abs(places[:, None] - x) / (2.0 * reach))
    total = weights.sum(axis=1)
    means = (weights @ values) / np.where(total > 0.0, total, np.nan)
    below = [np.flatnonzero(means < level) for level in levels]
    return [float(places[rows[0]]) if len(rows) else math.nan for rows in below]


def plate_mesh(folder: Path, run: Run) -> str:
    """Its face at x = 0, its edges at z = 0 and the depth, wider than the field."""
    size = np.array((THICK * run.depth_m, 3.0 * run.width_m, run.depth_m))
    plate = trimesh.creation.box(size)
    plate.apply_translation((-0.5 * size[0], 0.0, 0.5 * size[2]))
    path = folder / "plate.stl"
    plate.export(path)
    return str(path)


def drag(run: Run, directory: Path, threads: int) -> str:
    """Pulls a plate and writes its table; returns its name."""
    depth, begin, ends = run.depth_m, 0.02 * run.depth_m, run.ends * run.depth_m
    box = {
        "length_m": round((DEPTHS + 1.0) * depth + ends, 3),
        "width_m": run.width_m,
        "depth_m": round((1.0 + BELOW) * depth, 3),
        "sides": "periodic",
    }
    soil = {
        "material": SOIL, "bin": box, "window": {"ahead_m": ends, "behind_m": ends},
        "particles": {"radius_m": run.radius_m}, "bed": {"seed": run.seed, "solid_fraction": run.fraction},
    }  # fmt: skip
    with tempfile.TemporaryDirectory() as folder:
        tools = {"plate": {"path": {}, "groups": {"plate": {"mesh": plate_mesh(Path(folder), run)}}}}
        document = {"name": "plate", "duration_s": 1.0, "tools": tools, "soil": soil}
        scene = Laboratory(Path(folder)).resolve(document)
        engine = build_engine(scene, threads)
        step = run.speed_m_per_s * scene.timing.communication_step_s

        def at(tick: int) -> tuple[ToolMotion, ...]:
            x = begin + step * (tick + 1)
            return (ToolMotion("plate", x, 0.0, -depth, 0.0, run.speed_m_per_s, 0.0, 0.0),)

        engine.start(at(-1))

    def look(tick: int) -> Look:
        p = engine.particles()
        free = ~p.held
        return Look(begin + step * (tick + 1), p.identity[free], np.array(p.position[free]))

    part, rows_of_look = Path(directory / f".{run.name}.part"), round(LOOK / ROW)
    ticks_of_row = max(1, round(ROW * depth / step))
    before, angle, width, forces, rows = look(-1), math.nan, math.nan, [], 0
    with part.open("w", newline="", encoding="utf-8") as stream:
        table = csv.writer(stream)
        table.writerow(("travel_m", "drag_newton", "lift_newton", "band_deg", "band_width_m"))
        for tick in range(round(DEPTHS * depth / step)):
            wrench = engine.advance(tick, at(tick))[0]
            forces.append((-wrench.force_x_newton, wrench.force_z_newton))
            if len(forces) < ticks_of_row:
                continue
            rows += 1
            if rows % rows_of_look == 0:
                now = look(tick)
                angle, width = band(before, now, run)
                before = now
            pulled, lifted = np.mean(forces, axis=0)
            row = (step * (tick + 1), pulled, lifted, angle, width)
            table.writerow(f"{value:.6g}" for value in row)
            forces, angle, width = [], math.nan, math.nan
    part.rename(directory / f"{run.name}.csv")
    return run.name


class Judged(NamedTuple):
    """What a run tells; lengths over the depth."""

    run: Run
    drag: float  # mean over (density) g d^2 w
    drag_half_width: float  # 95 %
    deviation: float  # about the trend, over the mean
    octaves: tuple[float, ...]  # deviation of the waves in each, over the mean
    strongest: float  # wavelength
    stands_out: bool  # of red noise
    travel: float  # between failures
    travel_half_width: float
    travel_scatter: float  # standard deviation over mean
    band_deg: float  # median
    band_quartiles_deg: tuple[float, float]
    band_width_diameters: float


def judged(path: Path) -> Judged:
    """Of a table."""
    run = read_name(path.stem)
    rows: Any = np.genfromtxt(path, delimiter=",", names=True)
    counts = rows["travel_m"] > FIRST * run.depth_m
    travel, pulled = rows["travel_m"][counts] / run.depth_m, rows["drag_newton"][counts]
    steady = stationarity(travel, pulled)
    step = float(np.median(np.diff(travel)))
    found = spectrum(step, pulled)
    smooth = np.convolve(pulled, np.full(SMOOTHED_ROWS, 1.0 / SMOOTHED_ROWS), "same")[2:-2]
    cycles = failure_cycles(travel[2:-2], travel[2:-2], smooth)
    if steady is None or found is None or cycles is None:
        raise SystemExit(f"{path}: {len(pulled)} rows after {FIRST:g} depths; pull farther")
    frequency, density = periodogram(pulled, 1.0 / step, "hann", detrend="linear")
    waves = np.divide(1.0, frequency, out=np.full_like(frequency, np.inf), where=frequency > 0.0)
    parts = [
        math.sqrt(density[(waves >= low) & (waves < high)].sum() / density.sum())
        * steady.deviation
        / steady.mean
        for low, high in itertools.pairwise(OCTAVES)
    ]
    bulk = run.fraction * read_material(shipped_material(Path(SOIL)), SOIL).density_kg_per_m3
    scale = bulk * GRAVITY_M_PER_S2 * run.depth_m**2 * run.width_m
    angles = rows["band_deg"][counts]
    angles = angles[np.isfinite(angles)]
    quartiles = np.percentile(angles, (25.0, 50.0, 75.0)) if len(angles) else np.full(3, math.nan)
    width = np.nanmedian(rows["band_width_m"][counts]) * math.sin(math.radians(float(quartiles[1])))
    return Judged(
        run, steady.mean / scale, steady.mean_half_width / scale, steady.deviation / steady.mean,
        tuple(parts),
        1.0 / found.dominant_hz, found.significant, cycles.travel.mean, cycles.travel.half_width,
        float(cycles.travel_m.std(ddof=1) / cycles.travel_m.mean()), float(quartiles[1]),
        (float(quartiles[0]), float(quartiles[2])), float(width) / (2.0 * run.radius_m),
    )  # fmt: skip


def as_text(one: Judged) -> str:
    """A row of the table."""
    run = one.run
    cells = [
        f"{run.fraction:.2f} | {1e3 * run.depth_m:g} | {1e3 * run.radius_m:g}",
        f"{run.froude:g} | {run.grains_wide:g} | {run.ends:g} | {run.seed}",
        f"{one.drag:.2f} +- {one.drag_half_width:.2f} | {one.deviation:.1%}",
        ", ".join(f"{1e2 * part:.1f}" for part in one.octaves),
        f"{one.strongest:.2f}{'' if one.stands_out else ' (noise)'}",
        f"{one.travel:.2f} +- {one.travel_half_width:.2f} | {one.travel_scatter:.2f}",
        f"{one.band_deg:.0f} ({one.band_quartiles_deg[0]:.0f} to {one.band_quartiles_deg[1]:.0f})",
        f"{one.band_width_diameters:.1f}",
    ]
    return "| " + " | ".join(cells) + " |"


HEADS = (
    "fraction", "d mm", "r mm", "Froude", "grains wide", "held at d", "seed", "drag", "deviation",
    "by octave %", "strongest", "between failures", "scatter", "band deg", "band width",
)  # fmt: skip


def runs_of(args: argparse.Namespace) -> Iterator[Run]:
    """All that were asked for."""
    for fraction in args.fractions:
        for depth in args.depths_mm:
            for radius in args.radii_mm:
                yield Run(
                    fraction, 1e-3 * depth, 1e-3 * radius, args.froude, args.grains_wide, args.ends, args.seed
                )


def main(arguments: Sequence[str] | None = None) -> int:
    """Drags plates, or judges what was dragged."""
    parser = argparse.ArgumentParser(prog="python -m validation.plate_drag", description=main.__doc__)
    parser.add_argument("part", choices=["drag", "table"])
    parser.add_argument("directory", type=Path, nargs="?", metavar="DIR", default=Path("runs/plate_drag"))
    parser.add_argument("--fractions", nargs="+", type=float, default=[0.57, 0.60, 0.63])
    parser.add_argument("--depths-mm", nargs="+", type=float, default=[140.0])
    parser.add_argument("--radii-mm", nargs="+", type=float, default=[5.0])
    parser.add_argument("--froude", type=float, default=0.1)
    parser.add_argument("--grains-wide", type=float, default=10.0, help="period of the field, in diameters")
    parser.add_argument("--ends", type=float, default=5.0, help="held layers ahead and behind, in depths")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--threads", type=int, default=1, help="of each process")
    args = parser.parse_args(arguments)
    if args.part == "drag":
        args.directory.mkdir(parents=True, exist_ok=True)
        asked = [run for run in runs_of(args) if not (args.directory / f"{run.name}.csv").is_file()]
        with ProcessPoolExecutor(args.processes) as pool:
            for name in pool.map(partial(drag, directory=args.directory, threads=args.threads), asked):
                print(name, flush=True)
        return 0
    tables = sorted(args.directory.glob("*_e*_s*.csv"))
    if not tables:
        parser.error(f"{args.directory}: holds no table; give the DIR of a finished `drag`")
    print("| " + " | ".join(HEADS) + " |\n" + "|---" * len(HEADS) + "|")
    for path in tables:
        print(as_text(judged(path)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
