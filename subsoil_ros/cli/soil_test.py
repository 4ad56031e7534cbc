"""subsoil soil-test SCENE: strength, stiffness, density and angle of repose of the soil of a scene."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from .arguments import add_overrides, positive_count

if TYPE_CHECKING:
    from ..experiments.element_tests import Strength


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("scene", metavar="SCENE", help="scene with the soil")
    add_overrides(parser)
    parser.add_argument(
        "--threads", type=positive_count, default=1, metavar="N", help="of the soil engine (default: 1)"
    )


def run(args: argparse.Namespace) -> int:
    """Run the tests and print the results."""
    from rich.console import Console

    from ..experiments.strength_tests import measure_strength
    from ..loading.loader import load_scene
    from .output import table
    from .progress import KernelAnnouncer, working

    resolved = load_scene(args.scene, args.overrides)
    with KernelAnnouncer():
        found = measure_strength(resolved, args.threads, working)
    rows = table(resolved.scene.name)
    rows.add_row("density", f"{found.density_kg_per_m3:.4g} kg/m3")
    rows.add_row("peak", _line(found.peak))
    rows.add_row("critical state", _line(found.critical))
    rows.add_row("tensile strength", f"{1e-3 * found.tensile_strength_pa:.3g} kPa")
    rows.add_row("confined modulus", f"{1e-6 * found.confined_modulus_pa:.3g} MPa")
    heap = "a column stands" if found.repose_deg == 90.0 else f"{found.repose_deg:.0f} deg"
    rows.add_row("angle of repose", heap)
    Console().print(rows)
    return 0


def _line(found: Strength) -> str:
    return f"c = {1e-3 * found.cohesion_pa:.2f} kPa, phi = {found.friction_angle_deg:.1f} deg"
