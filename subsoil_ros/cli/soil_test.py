"""subsoil soil-test SCENE: strength and density of the soil of a scene, and its friction on metal."""

from __future__ import annotations

import argparse
import os
import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import astuple
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import InputError
from ..experiments.soil_tests.options import INERTIAL_NUMBER, LEAST_POINTS, SHEAR_DIAMETERS
from ..extras import require
from ._shared.arguments import add_overrides

if TYPE_CHECKING:
    from ..experiments.soil_tests.curves import SoilTests
    from ..experiments.soil_tests.strength import CoulombFit, PlateFit
    from ..limits.stable_steps import Timing
    from ..loading.loader import ResolvedScene

NORMAL_PA = (5e3, 10e3, 20e3)
"""Normal stresses: from the weight of 0.3 m of soil to what the paper's soft particles can bear."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `subsoil soil-test`."""
    parser.add_argument("scene", help="scene file (.yaml) with the soil")
    parser.add_argument(
        "--out",
        metavar="DIR",
        help="folder for soil_test.json, shear.csv, plate.csv, tension.csv, soil_test.png and the scene of "
        "each test; must not exist (default: nothing is written)",
    )
    parser.add_argument(
        "--normal-pa",
        nargs="+",
        type=float,
        default=NORMAL_PA,
        metavar="PA",
        help=f"normal stresses, {LEAST_POINTS} or more (default: {' '.join(f'{p:g}' for p in NORMAL_PA)})",
    )
    parser.add_argument(
        "--size-m",
        nargs=3,
        type=float,
        metavar=("L", "W", "H"),
        help="specimen in shear: length, width, height (default, and least: 12, 8 and 8 largest diameters)",
    )
    parser.add_argument(
        "--inertial-number",
        type=float,
        default=INERTIAL_NUMBER,
        metavar="I",
        help=f"of the shear; sets the speed (default: {INERTIAL_NUMBER:g}; smaller is slower)",
    )
    add_overrides(parser)
    parser.add_argument("--threads", type=int, default=1, metavar="N", help="of the soil engine (default: 1)")


def run(args: argparse.Namespace) -> int:
    """Run the tests, print the results, write the folder.

    Raises:
        InputError: scene, numbers or folder cannot be used, or a library is missing; nothing was written.
        RunError: a test failed; nothing was written.
    """
    if args.out is not None:
        require("--out: the figure", "matplotlib")
    from ..experiments.soil_tests.runs import run_soil_tests
    from ..experiments.soil_tests.strength import write_results
    from ..loading.loader import load_scene
    from ..scene.pairs import pair_values
    from ._shared.progress import RunProgress, working

    resolved = load_scene(args.scene, args.overrides)
    if resolved.scene.particle_soil is None:
        raise InputError(f"{args.scene}: has no 'soil', so there is nothing to test")
    stresses = tuple(sorted(set(args.normal_pa)))
    if len(stresses) < LEAST_POINTS or stresses[0] <= 0.0:
        raise InputError(
            f"--normal-pa: given {' '.join(f'{p:g}' for p in args.normal_pa)}; give {LEAST_POINTS} or "
            "more different stresses above 0"
        )
    if args.inertial_number <= 0.0:
        raise InputError(f"--inertial-number: given {args.inertial_number:g}; it must be a number above 0")
    diameter = 2.0 * resolved.scene.particle_soil.particles.bounds_m[1]
    least = tuple(n * diameter for n in SHEAR_DIAMETERS)
    length, width, height = args.size_m or least
    if any(
        given < (1.0 - 1e-9) * wanted for given, wanted in zip((length, width, height), least, strict=True)
    ):
        raise InputError(
            f"--size-m: given {length:g} {width:g} {height:g}; it must be at least "
            f"{' '.join(f'{m:g}' for m in least)}, 12 x 8 x 8 of the largest diameters, {diameter:g} m; or "
            "make the particles smaller"
        )
    pair = pair_values(resolved.scene.particle_soil)[0]
    if pair.sticks and pair.adhesion == 0.0:
        raise InputError(
            f"soil.law: given '{resolved.scene.particle_soil.law.kind}' with attraction, and what sticks "
            "cannot be glued to the box under it, out of which it would slide as a block; allowed is "
            "'cohesive_linear', or this law without attraction"
        )
    runs = 2 * len(stresses) + (pair.adhesion > 0.0)  # tension too
    done: list[str] = []

    @contextmanager
    def progress(name: str, timing: Timing) -> Iterator[Callable[[int], None]]:
        done.append(name)
        with RunProgress(f"{name} ({len(done)} of {runs})", timing) as progress:
            yield progress

    with _new_folder(args.out) as folder:
        tests = run_soil_tests(
            resolved, stresses, (length, width, height), folder / "tests",
            inertial_number=args.inertial_number, threads=args.threads, progress=progress,
            working=working,
        )  # fmt: skip
        if args.out is not None:
            from ..experiments.soil_tests.figure import draw_tests

            facts = {
                "scene": resolved.scene.name,
                "scene_hash": resolved.scene_hash,
                "inertial_number": args.inertial_number,
            }
            write_results(tests, facts, folder)
            draw_tests(tests, resolved.scene.name, folder / "soil_test.png")
    _print(resolved, tests, args.out)
    return 0


@contextmanager
def _new_folder(out: str | None) -> Iterator[Path]:
    """Context of a temporary folder, renamed to `out` on success and removed on an error."""
    if out is None:
        with tempfile.TemporaryDirectory() as folder:
            yield Path(folder)
        return
    path = Path(out)
    if path.exists():
        raise InputError(f"--out {out}: exists already; results are never written over, name another")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        part = Path(tempfile.mkdtemp(dir=path.parent, prefix=f".{path.name}."))
    except OSError as error:
        raise InputError(
            f"--out {out}: cannot be created ({error.strerror}); name a folder that can"
        ) from error
    try:
        yield part
        part.chmod(0o755)
        os.rename(part, path)
    except BaseException:
        shutil.rmtree(part, ignore_errors=True)
        raise


def _print(resolved: ResolvedScene, tests: SoilTests, out: str | None) -> None:
    from rich.console import Console

    from ..experiments.soil_tests.strength import SoilStrength, shear_rows, strength_warnings
    from ._shared.tables import table

    console = Console()
    strength = SoilStrength.of(tests)
    headings = (
        "normal kPa", "peak kPa", "at", "residual kPa", "lid rises", "normal held to", "speed m/s",
        "imbalance",
    )  # fmt: skip
    for title, curves in (("direct shear", tests.shear), ("plate", tests.plate)):
        rows = table(title, headings, words=0)
        for row in shear_rows(curves):
            rows.add_row(
                f"{1e-3 * row['nominal_normal_pa']:g}",
                f"{1e-3 * row['peak_shear_pa']:.2f} under {1e-3 * row['peak_normal_pa']:.2f}",
                f"{1e3 * row['peak_displacement_m']:.1f} mm",
                f"{1e-3 * row['residual_shear_pa']:.2f} under {1e-3 * row['residual_normal_pa']:.2f}",
                f"{row['residual_dilatancy']:.2f}",
                f"{100.0 * row['normal_error']:.2g} %",
                f"{row['speed_m_per_s']:.3g}",
                f"{100.0 * row['force_imbalance']:.2g} %",
            )
        console.print(rows)
    for warning in strength_warnings(tests):
        console.print(f"warning: {warning}")
    found = table(resolved.scene.name)
    found.add_row("particles", f"{strength.particle_count:,}")
    found.add_row(
        "density", f"{strength.density_kg_per_m3:.4g} kg/m3, coordination {strength.coordination:.3g}"
    )
    found.add_row("peak", _fit(strength.peak, "c", "phi"))
    found.add_row("residual", _fit(strength.residual, "c", "phi"))
    assert strength.plate is not None
    found.add_row("on metal", _fit(strength.plate, "c_a", "delta"))
    if strength.tensile_strength_pa is not None:
        found.add_row(
            "tensile strength",
            f"{1e-3 * strength.tensile_strength_pa:.3g} kPa, broken at {strength.break_height:.2f} of the "
            f"height (Rumpf: {1e-3 * strength.rumpf_strength_pa:.3g} kPa)",
        )
    found.add_row("settlement modulus", f"{1e-3 * strength.settlement_modulus_pa:.4g} kPa in the box")
    if out is not None:
        found.add_row("written to", out)
    console.print(found)


def _fit(fit: CoulombFit | PlateFit, cohesion: str, angle: str) -> str:
    c, c_error, phi, phi_error, r_squared = astuple(fit)
    return (
        f"{cohesion} = {1e-3 * c:.2f} +- {1e-3 * c_error:.2f} kPa, {angle} = {phi:.1f} +- {phi_error:.1f} "
        f"deg, R2 = {r_squared:.4f}"
    )
