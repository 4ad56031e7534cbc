"""Prints, as JSON, a digest of a small ploughed bed's whole motion for every number of threads asked for.

Run as `python soil_digest.py SCENE THREADS...`. Digested every 50 steps: positions, velocities, spins,
forces, energy stored in contacts and springs, and what the tool felt. Contact histories act through these.
"""

import hashlib
import json
import math
import sys

from subsoil_ros.dem.build import build_engine
from subsoil_ros.loading.loader import load_scene
from subsoil_ros.messages import ToolMotion

STEPS, EVERY = 4_000, 50


def tool(time_s: float) -> tuple[ToolMotion, ...]:
    """A bar that is swept to and fro through the bed, and turned."""
    x, rate = 0.15 + 0.08 * math.sin(9.0 * time_s), 0.72 * math.cos(9.0 * time_s)
    return (ToolMotion("tool", x, 0.0, -0.04, 3.0 * time_s, rate, 0.0, 3.0),)


def digest(scene: str, threads: int) -> dict[str, object]:
    """Digest of the motion, rebuilds, and how far particles went [m]."""
    engine = build_engine(load_scene(scene), threads)
    step_s, total = 4e-5, hashlib.sha256()
    wrenches = engine.start(tool(0.0))
    for tick in range(STEPS):
        if tick % EVERY == 0:
            for array in (
                engine.positions_m(), engine.velocities_m_per_s(), engine.angular_velocities_rad_per_s(),
                engine.forces_newton(),
            ):  # fmt: skip
                total.update(array.tobytes())
            total.update(repr((engine.energy().stored_joule, wrenches)).encode())
        wrenches = engine.advance(tick, tool((tick + 1) * step_s))
    total.update(engine.positions_m().tobytes())
    moved = float(abs(engine.displacements_m()).max())
    return {"digest": total.hexdigest(), "rebuilds": engine.state("", 0, 0).rebuild_count, "moved_m": moved}


if __name__ == "__main__":
    print(json.dumps({n: digest(sys.argv[1], int(n)) for n in sys.argv[2:]}))
