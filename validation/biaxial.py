"""Plane-strain strength of a soil of particles: a biaxial test between smooth plates.

    python -m validation.biaxial [--soils sand loam] [--seeds N]

A block of soil, one period wide, stands on a smooth floor against a smooth wall. There is no gravity. A
side plate holds the least stress constant while a top plate moves down at constant speed; nothing is cut,
glued or clamped. The peak is where the ratio of greatest to least stress is largest. A straight line
through the peaks at several least stresses, sigma_1 = K_p sigma_3 + 2 c sqrt(K_p), gives cohesion and
friction angle in plane strain, the state of the soil before a wide blade.
"""

import argparse
import dataclasses
import math
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from subsoil_ros.dem.beds.prepare import prepare_bed
from subsoil_ros.dem.engine import SoilEngine
from subsoil_ros.messages import ToolMotion

from .laboratory import Document, Laboratory, box_mesh
from .soils import DENSITY, LAWS, RADIUS_M, soil_section

LENGTH_M, WIDTH_M, HEIGHT_M = 0.18, 0.15, 0.36
"""Of the block: 12 x 10 x 24 diameters, as high as a shear band needs to end in plates on both sides."""

LEAST_PA = (1e3, 2e3, 4e3)
"""Stress before a blade at 0.15 m: its own weight is up to 2.3 kPa."""

INERTIAL_NUMBER = 1e-3  # of the top plate: quasi-static (GDR MiDi 2004)
STRAIN = 0.10
"""Of the height, over which the peak is sought."""

SETTLED = 0.05
"""Both stresses are within this part of the least one before the top plate starts."""

SERVO_S = 0.01
"""In which a plate would make up for a missing stress in soil of MODULUS_PA (chosen: it does not swing)."""

MODULUS_PA = 3e6  # chosen: of the order of stiffness over diameter, 5e6
LONGEST_TICKS = 400_000
"""A test that is not over by then is given up: nine times the longest (chosen)."""

PLATE_M = 0.1  # thickness


class Strength(NamedTuple):
    """Of a Mohr-Coulomb soil."""

    cohesion_pa: float
    friction_deg: float


def biaxial(laboratory: Laboratory, soil: str, seed: int, least_pa: float) -> np.ndarray:
    """(n, 3) axial strain, greatest and least stress [Pa] while the top plate comes down."""
    box = {"length_m": LENGTH_M, "width_m": WIDTH_M, "depth_m": HEIGHT_M, "sides": "periodic"}
    section = soil_section(soil, 0.0, seed, box)
    section["bed"] = section["bed"] | {"floor": "plane"}
    wide = WIDTH_M + 0.2
    tools: Document = {
        "side": box_mesh(laboratory.folder, PLATE_M, wide, 2.0 * HEIGHT_M),
        "top": box_mesh(laboratory.folder, 2.0 * LENGTH_M, wide, PLATE_M),
    }
    plates = {name: {"path": {}, "groups": {"plate": {"mesh": mesh}}} for name, mesh in tools.items()}
    scene = laboratory.resolve(
        {"name": soil, "duration_s": 1.0, "gravity_m_per_s2": 0.0, "soil": section, "tools": plates}
    )
    bed = prepare_bed(scene, SoilEngine)
    assert bed.period_m is not None
    bed = dataclasses.replace(bed, upper_m=(2.0 * LENGTH_M, bed.upper_m[1]))  # the side plate instead
    engine = SoilEngine(scene, bed=bed)
    step, width = scene.timing.communication_step_s, bed.period_m
    place, speed, stress, drift = np.array([LENGTH_M, RADIUS_M]), np.zeros(2), np.zeros(2), np.zeros(2)
    fastest = INERTIAL_NUMBER * HEIGHT_M / (2.0 * RADIUS_M) * math.sqrt(least_pa / DENSITY)

    def plates_at() -> tuple[ToolMotion, ...]:
        x, z = place + 0.5 * PLATE_M
        return (
            ToolMotion("side", x, 0.0, 0.0, 0.0, speed[0], 0.0, 0.0),
            ToolMotion("top", LENGTH_M, 0.0, z, 0.0, 0.0, speed[1], 0.0),
        )

    engine.start(plates_at())
    rows, pressing, tick, height = [], False, 0, 0.0
    while tick < LONGEST_TICKS:
        size = np.array([place[0], place[1] - bed.lower_m[2]])
        missed = (stress - least_pa) * size / (MODULUS_PA * SERVO_S)
        drift += np.where(np.abs(missed + drift) < 5.0 * fastest, missed * step / (10.0 * SERVO_S), 0.0)
        speed[:] = np.clip(missed + drift, -5.0 * fastest, 5.0 * fastest)
        if pressing:
            speed[1] = -fastest
        place += speed * step
        side, top = engine.advance(tick, plates_at())
        stress[:] = side.force_x_newton / (size[1] * width), top.force_z_newton / (size[0] * width)
        tick += 1
        if not pressing and tick % 200 == 0 and (np.abs(stress / least_pa - 1.0) < SETTLED).all():
            pressing, height = True, size[1]
        if pressing:
            rows.append((1.0 - size[1] / height, stress[1], stress[0]))
            if rows[-1][0] > STRAIN:
                return np.array(rows)
    raise RuntimeError(
        f"{soil}, {least_pa:g} Pa: the plates do not hold their stress; {stress} Pa in the end"
    )


def peak_pa(curve: np.ndarray) -> tuple[float, float]:
    """Least and greatest stress [Pa] where their ratio, over half a per cent of strain, is largest."""
    window = np.ones(max(1, round(0.005 / STRAIN * len(curve))))
    greatest, least = (np.convolve(curve[:, k], window / window.sum(), "valid") for k in (1, 2))
    at = int(np.argmax(greatest / least))
    return float(least[at]), float(greatest[at])


def strength(laboratory: Laboratory, soil: str, seeds: int) -> Strength:
    """Peak strength by least squares over all stresses and beds."""
    peaks = [
        peak_pa(biaxial(laboratory, soil, seed, least)) for seed in range(1, seeds + 1) for least in LEAST_PA
    ]
    least, greatest = np.array(peaks).T
    k_p, at_zero = np.polyfit(least, greatest, 1)
    angle = math.asin((k_p - 1.0) / (k_p + 1.0))
    return Strength(float(at_zero) / (2.0 * math.sqrt(k_p)), math.degrees(angle))


def main(arguments: Sequence[str] | None = None) -> int:
    """Prints cohesion and friction angle of the soils."""
    parser = argparse.ArgumentParser(prog="python -m validation.biaxial", description=main.__doc__)
    parser.add_argument("--soils", nargs="+", choices=list(LAWS), default=list(LAWS))
    parser.add_argument("--seeds", type=int, default=2)
    args = parser.parse_args(arguments)
    print("| soil | c kPa | phi deg |\n|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        for soil in args.soils:
            found = strength(Laboratory(Path(folder)), soil, args.seeds)
            print(f"| {soil} | {found.cohesion_pa * 1e-3:.2f} | {found.friction_deg:.1f} |", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
