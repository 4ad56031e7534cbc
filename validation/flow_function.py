"""Measure the unconfined strength after a preload, for plastic and for elastic contacts.

    python -m validation.flow_function [--preloads-kpa 5 20 80] [--seeds 1] [--processes 2]

Endless cells of one packing, equal but for the law: the adhesion of PLASTIC spheres grows with the largest
force (elasto_plastic_adhesive), that of ELASTIC ones is constant. Each cell bears the preload on all three
axes, is released, and is then shortened without lateral stress. Exit status 1 where the strength of the
plastic one does not grow by GROWS (a factor) from the least to the largest preload, or that of the elastic
one changes by more than FLAT. Thakur et al., Granular Matter 16 (2014) 383-400, show the same of powders.
"""

import argparse
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor

import numpy as np

from subsoil_ros.experiments.element_tests import CELL_DIAMETERS, prepare_cell, unconfined_strength_pa
from subsoil_ros.loading.loader import load_scene
from subsoil_ros.scene.material import RADIUS_SPREAD

from .laboratory import Document

RADIUS_M = 0.01
ROW: Document = {
    "youngs_modulus_pa": 1.5e7, "poisson_ratio": 0.3, "restitution": 0.5, "static_friction": 0.3,
    "sliding_friction": 0.3, "rolling_friction": 0.1,
}  # fmt: skip
"""Load with 80 kN/m, as the shipped materials do."""

LAWS: dict[str, Document] = {
    "plastic": ROW | {"contact_plasticity": 0.75, "surface_energy_joule_per_m2": 300.0},
    "elastic": ROW | {"contact_plasticity": 0.0, "pull_off_newton": 4.0},
}
GROWS, FLAT = 2.0, 0.15
"""Factor from the least to the largest preload (chosen: attraction goes with the root of the plastic overlap,
so by 4 for 16 times the preload; half of that growth is clear), and a part that is small against it."""


def strength_pa(law: str, preload_pa: float, seed: int) -> float:
    """Of one cell."""
    edge = CELL_DIAMETERS * 2.0 * (1.0 + RADIUS_SPREAD) * RADIUS_M
    box = {"length_m": edge, "width_m": edge, "depth_m": edge}
    sizes = {"kind": "uniform", "min_radius_m": 0.0085, "max_radius_m": 0.0115, "seed": seed}
    row = LAWS[law]
    soil = {
        "bin": box, "particles": {"sizes": sizes, "density_kg_per_m3": 2400.0},
        "bed": {"kind": "tiled", "seed": seed, "solid_fraction": 0.6}, "skin_m": 0.003,
        "law": {"kind": "elasto_plastic_adhesive", "particle": row, "boundary": row},
    }  # fmt: skip
    return unconfined_strength_pa(
        prepare_cell(load_scene({"name": law, "duration_s": 1.0, "soil": soil})), preload_pa
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Prints the table. Returns 1 where a law does not do what it should."""
    parser = argparse.ArgumentParser(prog="python -m validation.flow_function", description=main.__doc__)
    parser.add_argument("--preloads-kpa", nargs="+", type=float, default=[5.0, 20.0, 80.0])
    parser.add_argument("--seeds", nargs="+", type=int, default=[1])
    parser.add_argument("--processes", type=int, default=2)
    args = parser.parse_args(arguments)
    print("| law | preload kPa | unconfined strength kPa |\n|---|---|---|")
    over: dict[str, list[float]] = {}
    with ProcessPoolExecutor(args.processes) as pool:
        jobs = {
            (law, preload): [pool.submit(strength_pa, law, 1e3 * preload, seed) for seed in args.seeds]
            for law in LAWS
            for preload in args.preloads_kpa
        }
        for (law, preload), job in jobs.items():
            found = float(np.mean([one.result() for one in job]))
            over.setdefault(law, []).append(found)
            print(f"| {law} | {preload:g} | {1e-3 * found:.2f} |", flush=True)
    grown = {law: values[-1] / values[0] for law, values in over.items()}
    return int(grown["plastic"] < GROWS or abs(grown["elastic"] - 1.0) > FLAT)


if __name__ == "__main__":
    sys.exit(main())
