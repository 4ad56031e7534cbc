"""Largest soil step where a tool has compacted the soil: a run is resumed with other steps.

    subsoil run config/scenes/subsoiler_1s300.yaml --mode direct --threads 2 --out RUN
    python benchmarks/step_safety.py RUN [--parts 0.8 0.7 0.6 0.4] [--simulated 0.06]

It resumes from the newest checkpoint, with the tools at the speed they have there. Printed for six equal
parts of the time: the velocity reversal indicator (dem.monitors; 1: every velocity reverses sign from one
step to the next), and the mean force of the first tool against x.
"""

import argparse
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from statistics import fmean

import numpy as np

from subsoil_ros.coupling.checkpoints import CouplingState
from subsoil_ros.coupling.protocol import SOIL
from subsoil_ros.dem.build import build_engine
from subsoil_ros.dem.engine import SoilEngine
from subsoil_ros.limits.stable_steps import step_limits
from subsoil_ros.loading.loader import load_scene
from subsoil_ros.messages import ToolMotion
from subsoil_ros.recording.checkpoint import newest_valid

LOOKS = 6


def moved_on(motion: ToolMotion, interval_s: float) -> ToolMotion:
    """A tick later, with unchanged velocities."""
    return replace(
        motion,
        x_m=motion.x_m + interval_s * motion.velocity_x_m_per_s,
        z_m=motion.z_m + interval_s * motion.velocity_z_m_per_s,
        angle_rad=motion.angle_rad + interval_s * motion.angular_velocity_rad_per_s,
    )


def looks(soil: SoilEngine, motions: tuple[ToolMotion, ...], interval_s: float, ticks: int) -> list[str]:
    """Alternation and mean force at the ends of equal parts of the time."""
    found, forces = [], []
    for tick in range(ticks):
        motions = tuple(moved_on(motion, interval_s) for motion in motions)
        forces.append(-soil.advance(tick, motions)[0].force_x_newton)
        if (tick + 1) % (ticks // LOOKS) == 0:
            found.append(f"{soil.velocity_reversal:.4f} ({fmean(forces):.0f} N)")
            forces = []
    return found


def main() -> None:
    """Goes on with each step."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("run", type=Path)
    parser.add_argument("--parts", type=float, nargs="+", default=[0.8, 0.7, 0.6, 0.4])
    parser.add_argument("--simulated", type=float, default=0.06, metavar="SECONDS")
    parser.add_argument("--threads", type=int, default=2)
    args = parser.parse_args()
    checkpoint, _ = newest_valid(args.run / "checkpoints")
    state: Mapping[str, np.ndarray] = checkpoint.read_part(SOIL)
    motions = CouplingState.of(checkpoint).motions
    particle_soil = load_scene(args.run / "scene.yaml").scene.particle_soil
    if particle_soil is None:
        raise SystemExit(f"{args.run}: has no particles, so its soil has no limit of the step")
    limit = step_limits(particle_soil)[0]
    print(f"{limit.limit_s * 1e6:.1f} us: {limit.cause}; from t = {checkpoint.time_s:.3f} s")
    for part in args.parts:
        step = f"{part * limit.limit_s:.3e}"
        given = [
            f"soil.time_step_s={step}",
            "coupling.communication_step_ns=auto",
            "soil.monitors.max_velocity_reversal=1.0",
        ]
        resolved = load_scene(args.run / "scene.yaml", given)
        soil = build_engine(resolved, args.threads)
        soil.restore({name: array.copy() for name, array in state.items()})
        interval_s = resolved.timing.communication_step_s
        found = looks(soil, motions, interval_s, int(args.simulated / interval_s))
        print(f"{part:.2f} of it, {float(step) * 1e6:.1f} us:", "  ".join(found), flush=True)


if __name__ == "__main__":
    main()
