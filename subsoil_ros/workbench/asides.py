"""Work beside the page, each piece in a process of its own with limits of time and memory.

python -m subsoil_ros.workbench.asides tools SCENE    # the tools at their depth
python -m subsoil_ros.workbench.asides series RUN     # the draft so far, its mean, and the soil
"""

import asyncio
import base64
import json
import os
import resource
import sys
from pathlib import Path
from typing import Any

COMMAND = (sys.executable, "-m", "subsoil_ros.cli.main")
"""Of `subsoil`, in this installation."""

LONGEST_S = 60
LARGEST_BYTES = 8 << 30
"""Of one piece of work: no scene on one machine needs more to be checked."""

COLUMNS = 84
"""Of the words of a command on the page."""

ROOM = asyncio.Semaphore(2)
"""For pieces of work at once."""

MOST_PARTICLES = 10_000
"""Of the soil that is drawn: every second, third ... particle where there are more."""

MOST_POINTS = 1000
"""Of a curve: about the pixels of its width."""


async def check(file: Path) -> dict[str, Any]:
    """What `subsoil check` says of a scene, whether it can run, and its tools at their depth as STL."""
    (status, out, err), tools = await asyncio.gather(
        said(*COMMAND, "check", str(file), longest_s=LONGEST_S), ask("tools", file)
    )
    return {"stl": None} | tools | {"ok": not status, "words": out + err}


async def ask(work: str, subject: Path) -> dict[str, Any]:
    """Do one piece of work; its answer, or {"error": why there is none}."""
    words = (sys.executable, "-m", __name__, work, str(subject))
    status, out, err = await said(*words, longest_s=LONGEST_S)
    if status:
        return {"error": (err.strip().splitlines() or [f"ended with {status}"])[-1]}
    answer: dict[str, Any] = json.loads(out)
    return answer


async def said(*words: str, longest_s: float) -> tuple[int, str, str]:
    """Exit status, output and errors of a command, limited in time and memory; two at once, others wait."""
    async with ROOM:
        process = await asyncio.create_subprocess_exec(
            *words, stdin=asyncio.subprocess.DEVNULL, stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.PIPE, env=os.environ | {"COLUMNS": str(COLUMNS)},
        )  # fmt: skip
        try:
            _, most = resource.prlimit(process.pid, resource.RLIMIT_AS)
            limit = LARGEST_BYTES if most == resource.RLIM_INFINITY else min(LARGEST_BYTES, most)
            resource.prlimit(process.pid, resource.RLIMIT_AS, (limit, limit))
            out, err = await asyncio.wait_for(process.communicate(), longest_s)
        except asyncio.TimeoutError:
            return 1, "", f"took longer than {longest_s:.0f} s"
        finally:
            if process.returncode is None:  # also where the page went away
                process.kill()
        return process.returncode or 0, out.decode(errors="replace"), err.decode(errors="replace")


def tools(file: Path) -> dict[str, Any]:
    """The tools of a scene at their depth, as STL in base64, and their bounds [m].

    Raises:
        SceneError: the scene or a mesh is wrong.
    """
    import numpy as np
    import trimesh

    from ..loading.loader import load_scene
    from ..scene.tool_mesh import load_tool_mesh

    resolved, shown = load_scene(file), []
    for name, tool in resolved.scene.tools.items():
        mesh = load_tool_mesh(resolved.directory, resolved.scene, name)
        height_m = tool.path.start_z_m if tool.path else 0.0
        shown.append(trimesh.Trimesh(mesh.vertices_m + np.array([0.0, 0.0, height_m]), mesh.facets))
    whole = trimesh.util.concatenate(shown)
    stl = base64.b64encode(trimesh.exchange.stl.export_stl(whole)).decode()
    return {"stl": stl, "bounds_m": whole.bounds.tolist()}


def series(folder: Path) -> dict[str, Any]:
    """Time [s] and draft [N] so far, duration [s] of the scene, the mean in words, and the newest soil.

    The soil is positions (n, 3) [m] and colours (n, 3), yellow for the fastest hundredth of the particles.
    """
    import numpy as np

    from ..api.read import read_run
    from ..recording.joined import open_record

    run = read_run(folder)
    soil: dict[str, Any] = {"positions_m": [], "colours": []}
    record = open_record(folder / "bag")
    if times := record.cloud_times_ns():
        step_ns = run.scene.timing.communication_step_ns
        (cloud, *_) = record.clouds(step_ns, at=lambda time_ns: time_ns == times[-1])
        positions, speeds = np.asarray(cloud.positions_m), np.asarray(cloud.speeds_m_per_s)
        some = slice(None, None, 1 + len(positions) // MOST_PARTICLES)
        positions, speeds = positions[some], speeds[some]
        moved = np.clip(speeds / max(float(np.percentile(speeds, 99)), 1e-3), 0.0, 1.0)[:, None]
        colours = (1.0 - moved) * [0.45, 0.32, 0.2] + moved * [0.95, 0.8, 0.1]
        soil = {
            "positions_m": positions.round(4).tolist(), "colours": colours.round(2).tolist(),
        }  # fmt: skip
    time_s = run.series["time_s"].to_numpy()
    draft = run.series["draft_newton"].to_numpy()
    known = (run.summary or {}).get("series", {}).get("draft_newton", {})
    half = (known.get("stationarity") or {}).get("mean_half_width")
    mean = f"{known['mean']:.0f} N" if known.get("mean") is not None else ""
    mean += "" if half is None else f" +- {half:.0f} N"
    every = max(1, len(time_s) // MOST_POINTS)
    return {
        "time_s": time_s[::every].tolist(), "draft_newton": draft[::every].tolist(),
        "duration_s": run.scene.scene.duration_s, "soil": soil, "mean": mean,
    }  # fmt: skip


if __name__ == "__main__":
    name, subject = sys.argv[1:]
    json.dump({"tools": tools, "series": series}[name](Path(subject)), sys.stdout)
