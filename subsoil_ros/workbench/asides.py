"""Work beside the page, each piece in a process of its own with limits of time and memory.

python -m subsoil_ros.workbench.asides tools SCENE    # the tools at their depth
python -m subsoil_ros.workbench.asides series RUN     # the draft so far, its mean, and the soil
python -m subsoil_ros.workbench.asides watch RUN      # the same of a run that goes on, again and again
"""

import asyncio
import base64
import json
import os
import resource
import select
import struct
import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

COMMAND = (sys.executable, "-m", "subsoil_ros.cli.main")
"""Of `subsoil`, in this installation."""

LONGEST_S = 60
LARGEST_BYTES = 8 << 30
"""Of one piece of work: no scene on one machine needs more to be checked."""

COLUMNS = 84
"""Of the words of a command on the page."""

ROOM, DRAWING_ROOM = asyncio.Semaphore(2), asyncio.Semaphore(1)
"""For pieces of work at once, and for reports and comparisons, which take longer."""

MOST_FAULTS = 200
"""Of a mesh that are drawn."""

PERIOD_S, DRAFT_S, IDLE_S = 0.05, 1.0, 3.0
"""Between two looks at a bag that grows; between two drafts; from the last question to the end of a watch."""

HEAD = struct.Struct("<II")
"""Bytes of the draft, in JSON, and of the soil that a watch tells; 0: as they were."""


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


async def said(*words: str, longest_s: float, room: asyncio.Semaphore = ROOM) -> tuple[int, str, str]:
    """Exit status, output and errors of a command, limited in time and memory; it waits for room."""
    async with room:
        process = await asyncio.create_subprocess_exec(
            *words, stdin=asyncio.subprocess.DEVNULL, stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.PIPE, env=os.environ | {"COLUMNS": str(COLUMNS)},
        )  # fmt: skip
        try:
            _limit(process)
            out, err = await asyncio.wait_for(process.communicate(), longest_s)
        except asyncio.TimeoutError:
            return 1, "", f"took longer than {longest_s:.0f} s"
        finally:
            if process.returncode is None:  # also where the page went away
                process.kill()
                await process.wait()
        return process.returncode or 0, out.decode(errors="replace"), err.decode(errors="replace")


def _limit(process: asyncio.subprocess.Process) -> None:
    _, most = resource.prlimit(process.pid, resource.RLIMIT_AS)
    limit = LARGEST_BYTES if most == resource.RLIM_INFINITY else min(LARGEST_BYTES, most)
    resource.prlimit(process.pid, resource.RLIMIT_AS, (limit, limit))


class Watch:
    """What a process of `asides watch` tells of a run, for as long as a page asks for it."""

    def __init__(self, folder: Path) -> None:
        self.answer: dict[str, Any] = {}
        self.soil = b""
        self.asked_s = time.monotonic()
        self._task = asyncio.create_task(self._follow(folder))
        self._task.add_done_callback(lambda _: _watches.pop(folder))

    async def _follow(self, folder: Path) -> None:
        process = await asyncio.create_subprocess_exec(
            sys.executable, "-m", __name__, "watch", str(folder),
            stdin=asyncio.subprocess.PIPE, stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.DEVNULL, limit=1 << 20,
        )  # fmt: skip
        try:
            _limit(process)
            assert process.stdout is not None
            while time.monotonic() - self.asked_s < IDLE_S:
                with suppress(asyncio.TimeoutError):
                    head = await asyncio.wait_for(process.stdout.readexactly(HEAD.size), IDLE_S)
                    answer, soil = [await process.stdout.readexactly(size) for size in HEAD.unpack(head)]
                    self.answer = json.loads(answer) if answer else self.answer
                    self.soil = soil or self.soil
        except (asyncio.IncompleteReadError, ProcessLookupError):  # it has ended
            await asyncio.sleep(IDLE_S)
        finally:
            if process.returncode is None:
                process.kill()
                await process.wait()


_watches: dict[Path, Watch] = {}


def watched(folder: Path) -> Watch:
    """The watch of a run that goes on; ask again within IDLE_S to keep it."""
    if (watch := _watches.get(folder)) is None:
        watch = _watches[folder] = Watch(folder)
    watch.asked_s = time.monotonic()
    return watch


def newest_soil(folder: Path, after_s: float) -> bytes:
    """The soil of a run that is watched (live.py: soil_bytes) if it is not of that time, else b""."""
    watch = _watches.get(folder)
    if watch is None or watch.soil[:8] == struct.pack("<d", after_s):
        return b""
    return watch.soil


def tools(file: Path) -> dict[str, Any]:
    """The tools of a scene at their depth, as STL in base64, their bounds [m], and the key of the seed.

    Of a single tool whose file is damaged: the file as it is, and its faults, pairs of points.

    Raises:
        SceneError: the scene is wrong, or a file cannot be read.
    """
    import numpy as np
    import trimesh

    from ..errors import InputError, SceneError
    from ..experiments.sweep_points import seed_key
    from ..loading.loader import load_scene
    from ..scene.tool_mesh import load_tool_mesh

    shown = []
    try:
        resolved = load_scene(file)
        for name, tool in resolved.scene.tools.items():
            mesh = load_tool_mesh(resolved.directory, resolved.scene, name)
            height_m = tool.path.start_z_m if tool.path else 0.0
            shown.append(trimesh.Trimesh(mesh.vertices_m + np.array([0.0, 0.0, height_m]), mesh.facets))
    except SceneError:
        return _damaged(file)
    seeds = {}
    with suppress(InputError):  # a bed in rows has none
        seeds["seed_key"] = seed_key(resolved)
    return _drawn(trimesh.util.concatenate(shown)) | seeds


def _drawn(mesh: Any) -> dict[str, Any]:
    from trimesh.exchange.stl import export_stl

    stl = base64.b64encode(export_stl(mesh)).decode()
    return {"stl": stl, "bounds_m": mesh.bounds.tolist()}


def _damaged(file: Path) -> dict[str, Any]:
    """The tool file of a scene in short: edges of one facet alone, and of facets without area."""
    import numpy as np
    from trimesh.grouping import group_rows

    from ..scene.cad_mesh import read_cad
    from ..scene.tool_mesh import flat_facets
    from .project import form_of

    form = form_of(file.read_text(encoding="utf-8"))
    if form is None or not (path := file.parent / form["mesh"]).is_file():
        return {}
    mesh, _ = read_cad(path, path.name)
    edges = [*mesh.edges[group_rows(mesh.edges_sorted, require_count=1)]]
    for facet in mesh.faces[flat_facets(mesh)]:
        edges += zip(facet, np.roll(facet, 1), strict=True)
    faults = mesh.vertices[np.array(edges[:MOST_FAULTS], int).reshape(-1, 2)]
    return _drawn(mesh) | {"faults_m": faults.tolist()}


def series(folder: Path) -> dict[str, Any]:
    """The draft of a run (live.py: drawn) and, in base64, its last soil (soil_bytes)."""
    import numpy as np

    from ..api.read import read_run
    from ..recording.joined import open_record
    from .live import drawn, soil_bytes

    run = read_run(folder)
    soil = b""
    record = open_record(folder / "bag")
    if times := record.cloud_times_ns():
        step_ns = run.scene.timing.communication_step_ns
        (cloud, *_) = record.clouds(step_ns, at=lambda time_ns: time_ns == times[-1])
        soil = soil_bytes(cloud)
    known = (run.summary or {}).get("series", {}).get("draft_newton", {})
    half = (known.get("stationarity") or {}).get("mean_half_width")
    time_s, draft = (run.series[name].to_numpy(np.float64) for name in ("time_s", "draft_newton"))
    answer = drawn(time_s, draft, run.scene.scene.duration_s, known.get("mean"), half)
    return answer | {"soil": base64.b64encode(soil).decode()}


def watch(folder: Path) -> None:
    """Tell the draft and the newest soil of a run that goes on, as they grow, until standard input ends."""
    from .live import GrowingRun

    run, told, due_s = None, b"", 0.0
    while not select.select([sys.stdin], [], [], PERIOD_S)[0]:
        if run is None:
            if (file := next((folder / "bag").glob("*.mcap"), None)) is None:
                continue
            run = GrowingRun(folder, file)
        answer, soil = b"", run.look()
        if time.monotonic() > due_s:
            answer, due_s = json.dumps(run.draft()).encode(), time.monotonic() + DRAFT_S
            told, answer = answer, b"" if answer == told else answer
        if answer or soil:
            sys.stdout.buffer.write(HEAD.pack(len(answer), len(soil)) + answer + soil)
            sys.stdout.buffer.flush()


if __name__ == "__main__":
    name, subject = sys.argv[1:]
    if name == "watch":
        watch(Path(subject))
    else:
        json.dump({"tools": tools, "series": series}[name](Path(subject)), sys.stdout)
