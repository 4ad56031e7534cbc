"""Soil as a formula: draft of a tine over its depth and speed, with a strength that varies along the field.

    python examples/external_soil/formula.py --out runs/external

The mean has the form of ASABE D497.7, draft per depth A + C v^2 (v in m/s; A and C give some 1 kN at 0.15 m);
strength varies by a fifth over 0.12 m of travel, as soil that fails in blocks does.
"""

import argparse
import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import subsoil_ros as subsoil
from subsoil_ros.messages import ToolMotion, ToolWrench, work_joule

A_NEWTON_PER_M, C_NEWTON_S2_PER_M3 = 6000.0, 1600.0
VARIATION, WAVELENGTH_M = 0.2, 0.12
FULL_M_PER_S = 0.2
"""Speed of the tip from which on the soil is fully pushed; without a rise the force would jump at rest."""

TIP_M = (0.10, -0.45)
"""Of the tine, from its centre of mass in the reference pose."""


class Formula:
    """Answers the motion of the tine with a draft at its tip."""

    def start(self, motions: tuple[ToolMotion, ...]) -> list[ToolWrench]:
        """Return the wrench at the start pose."""
        self._last = motions[0]
        return [self._wrench(motions[0])]

    def advance(self, tick: int, motions: tuple[ToolMotion, ...]) -> list[ToolWrench]:
        """Return the wrench over a tick; its work is that of force and torque on the motion in it."""
        before, after = self._last, motions[0]
        self._last = after
        one = self._wrench(after)
        force = (one.force_x_newton, 0.0, 0.0)
        torque = (0.0, one.torque_y_newton_m, 0.0)
        return [replace(one, work_joule=work_joule(force, torque, before, after))]

    def state_arrays(self) -> dict[str, float]:
        """The formula keeps nothing but the last pose, which is part of the checkpoint already."""
        return {}

    def restore(self, arrays: object) -> None:
        """Nothing to restore."""

    def _wrench(self, motion: ToolMotion) -> ToolWrench:
        cosine, sine = math.cos(motion.angle_rad), math.sin(motion.angle_rad)
        x = cosine * TIP_M[0] - sine * TIP_M[1]
        z = sine * TIP_M[0] + cosine * TIP_M[1]
        depth = max(0.0, -(motion.z_m + z))
        speed = motion.velocity_x_m_per_s - motion.angular_velocity_rad_per_s * z
        strength = 1.0 + VARIATION * math.sin(2.0 * math.pi * (motion.x_m + x) / WAVELENGTH_M)
        pushed = min(1.0, max(0.0, speed / FULL_M_PER_S))
        draft = pushed * strength * depth * (A_NEWTON_PER_M + C_NEWTON_S2_PER_M3 * speed**2)
        return ToolWrench(motion.tool, -draft, 0.0, 0.0, 0.0, -draft * z, 0.0, 0.0, int(draft > 0.0))


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description="Pull a sprung tine through soil that is a formula.")
    parser.add_argument("--out", type=Path, metavar="DIR", help="folder of results (default: none are kept)")
    parser.add_argument("--duration", type=float, default=2.0, metavar="S", help="simulated seconds (2)")
    args = parser.parse_args(arguments)
    scene = Path(__file__).with_name("tine.yaml")
    run = subsoil.run(scene, args.out, overrides={"duration_s": args.duration}, soil=Formula())
    draft, angle = run.series["draft_newton"], run.series["body.tine.angle_rad"]
    print(f"draft {draft.mean():.0f} N, from {draft.min():.0f} to {draft.max():.0f} N")
    print(f"the tine swings by {angle.max() - angle.min():.3f} rad")
    print(f"energy residual of the exchange: {run.summary['energy']['residual_ratio']:.1e}")


if __name__ == "__main__":
    main()
