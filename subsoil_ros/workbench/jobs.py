"""Jobs of a project: processes of `subsoil`, as many at once as there are cores.

Most are runs. All that is known of them is in files: a page, or its server, may end and begin again at any
time. A job that was asked for is runs/NAME.job, later with the number of its process; what it says is in
runs/NAME.log. Its scene is as it was when it was asked for: the hidden file .NAME.run.yaml beside the scene.
"""

import fcntl
import json
import os
import re
import signal
import subprocess
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import IO, Any

import psutil

from ..errors import InputError
from .asides import COMMAND
from .project import Project, checked, is_name, write

RUN, SEARCH, SOIL = "run", "search", "soil"
"""Kinds of jobs."""

_LIVE = re.compile(r"ws://[\w.]+:\d+")

FIRST_LETTERS = 4000
"""Of a log: a run tells its address at its start."""

LAST_BYTES = 1000
"""Of the log of a run that failed."""


@dataclass(frozen=True)
class Job:
    """A job as its files show it."""

    name: str
    scene: str
    state: str  # queued, running, stopping, done, stopped, failed
    detail: str = ""  # why it failed
    kind: str = RUN

    @property
    def goes_on(self) -> bool:
        """Whether it has a process, or waits for one."""
        return self.state in ("queued", "running", "stopping")


def claim(project: Project) -> IO[bytes]:
    """Make this process the one that starts the project's runs, for as long as it keeps the file open.

    Raises:
        InputError: another workbench serves the project.
    """
    project.runs.mkdir(exist_ok=True)
    lock = (project.runs / ".lock").open("ab")
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        lock.close()
        raise InputError(f"{project.folder}: another workbench serves it; use that, or end it") from None
    return lock


def ask_for(
    project: Project,
    name: str,
    scene: str,
    resume: str | None = None,
    settings: Sequence[str] = (),
    live: bool = False,
) -> None:
    """Put a run into the queue; settings: KEY=VALUE; live: with a server for Foxglove.

    Raises:
        InputError: a name cannot be used, there is such a job, or there is no run to resume.
        OSError: the scene cannot be read, or the disk is full.
    """
    folder = project.run_folder(name)
    if folder.exists():
        raise InputError(f"{name}: there is a run of this name; choose another")
    if resume is None:
        words = ["run", *keep_scene(project, name, scene)]
    else:
        earlier = project.run_folder(resume)
        if not earlier.is_dir():
            raise InputError(f"{resume}: there is no such run to go on from")
        words = ["run", str(earlier / "scene.yaml"), "--resume", str(earlier)]
    words += ["--mode", "direct", "--out", str(folder)]
    if live:
        words += ["--live", "0"]
    for setting in settings:
        words += ["--set", setting]
    put(project, name, words, folder / "summary.json", scene=scene)


def keep_scene(project: Project, name: str, scene: str) -> list[str]:
    """Keep a scene as it is now for a new job; the words of a command that reads it under its own name.

    Raises:
        InputError: a name cannot be used, or there is such a job.
        OSError: the scene cannot be read, or the disk is full.
    """
    _refuse_taken(project, name)
    asked = _asked_file(project, name)
    text = project.scene_file(scene).read_bytes()
    write(asked, text)
    named = any(line.startswith(b"name:") for line in text.splitlines())
    return [str(asked), *([] if named else ["--set", f"name='{scene}'"])]


def put(
    project: Project, name: str, words: Sequence[str], product: Path, kind: str = RUN, scene: str = ""
) -> None:
    """Put a `subsoil` command into the queue; product: the file that it writes at its end.

    Raises:
        InputError: the name cannot be used, or there is such a job.
    """
    _refuse_taken(project, name)
    project.runs.mkdir(exist_ok=True)
    asked = {"asked_ns": time.time_ns(), "scene": scene, "words": list(words), "pid": None}
    _keep(project, name, asked | {"kind": kind, "product": str(product)})


def again(project: Project, name: str) -> None:
    """Put a search or a soil that ended early into the queue again; a search goes on from what it kept."""
    asked = _asked(project, name)
    if asked and not _job(project, name, asked).goes_on:
        _keep(
            project, name, asked | {"asked_ns": time.time_ns(), "pid": None, "stopping": False, "again": True}
        )


def log(project: Project, name: str) -> str:
    """The end of what a job has said."""
    file = project.runs / f"{checked(name)}.log"
    with suppress(OSError):
        return _end_of(file, file.stat().st_mtime_ns)
    return ""


def live_address(project: Project, name: str) -> str:
    """Where a run that goes on tells Foxglove of itself; empty until it does, and where it does not."""
    with suppress(OSError), (project.runs / f"{checked(name)}.log").open(errors="replace") as said:
        if found := _LIVE.search(said.read(FIRST_LETTERS)):
            return found[0]
    return ""


def _refuse_taken(project: Project, name: str) -> None:
    if _job_file(project, name).exists():
        raise InputError(f"{name}: there is a job of this name; choose another")


def start_due(project: Project) -> None:
    """Start runs of the queue, the oldest first, while a core is free."""
    found = jobs(project)
    running = sum(job.state in ("running", "stopping") for job in found)
    waiting = [job.name for job in found if job.state == "queued"]
    for name in waiting[: max(0, (os.cpu_count() or 1) - running)]:
        asked = _asked(project, name)
        _keep(project, name, asked | {"pid": 0})  # never started twice, whatever happens here
        if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # begun by `&`; a job would ignore it too
            signal.signal(signal.SIGINT, signal.default_int_handler)
        with (project.runs / f"{name}.log").open("wb") as said:
            process = subprocess.Popen(
                [*COMMAND, *asked["words"]],
                stdin=subprocess.DEVNULL,
                stdout=said,
                stderr=said,
                start_new_session=True,
                cwd=project.folder,
            )
        _keep(project, name, asked | {"pid": process.pid})


def stop(project: Project, name: str) -> None:
    """End a run: it writes a checkpoint and its results so far. One that waits leaves the queue."""
    asked = _asked(project, name)
    state = _job(project, name, asked).state if asked else ""
    if state == "queued" and asked.get("again"):
        _keep(project, name, asked | {"pid": 0, "stopping": True})
    elif state == "queued":
        _asked_file(project, name).unlink(missing_ok=True)
        _job_file(project, name).unlink()
    elif state == "running":  # a second signal would end it at once, without results
        _keep(project, name, asked | {"stopping": True})
        os.kill(asked["pid"], signal.SIGINT)


def jobs(project: Project) -> list[Job]:
    """All runs, in the order in which they were asked for; those of the command line before them."""
    files = [path.stem for path in project.runs.glob("*.job") if is_name(path.stem)]
    asked = {name: found for name in files if (found := _asked(project, name))}
    summaries = project.runs.glob("*/summary.json")
    runs = {path.parent.name for path in summaries if (path.parent / "scene.yaml").is_file()}
    others = runs - asked.keys()
    return [
        *(Job(name, "", *_outcome(project, name)) for name in sorted(filter(is_name, others))),
        *(
            _job(project, name, asked[name])
            for name in sorted(asked, key=lambda name: asked[name]["asked_ns"])
        ),
    ]


def _job(project: Project, name: str, asked: dict[str, Any]) -> Job:
    kind, stopped = asked["kind"], bool(asked.get("stopping"))
    if asked["pid"] is None:
        state, detail = "queued", ""
    elif _is_running(asked["pid"], asked["words"]):
        state, detail = "stopping" if stopped else "running", ""
    elif kind == RUN:
        state, detail = _outcome(project, name, stopped=stopped)
    elif Path(asked["product"]).is_file():
        state, detail = "done", ""
    else:
        state, detail = "stopped" if stopped else "failed", log(project, name)
    return Job(name, asked["scene"], state, detail, kind)


def _outcome(project: Project, name: str, *, stopped: bool = False) -> tuple[str, str]:
    """State and detail of a run that has ended; stopped: by the workbench."""
    summary = project.runs / name / "summary.json"
    with suppress(OSError, ValueError, KeyError, TypeError, AttributeError):
        why = _failure(summary, summary.stat().st_mtime_ns)
        return ("done" if not why else "stopped" if stopped or "SIGINT" in why else "failed"), why
    return ("stopped" if stopped else "failed"), log(project, name)


@lru_cache(maxsize=4096)
def _failure(summary: Path, _: int) -> str:
    """Why a run failed; empty: it did not. The second argument tells versions of the file apart."""
    run = json.loads(summary.read_text())["run"]
    partial = "ended before its last tick" if run.get("complete") is False else ""
    return str(run.get("failure") or partial)


@lru_cache(maxsize=4096)
def _end_of(log: Path, _: int) -> str:
    with log.open("rb") as stream:
        stream.seek(-min(LAST_BYTES, log.stat().st_size), os.SEEK_END)
        return stream.read().decode(errors="replace").strip()


def _is_running(pid: int, words: list[str]) -> bool:
    """Whether the process is there, and is the one that was started with these words.

    A process that just begins, or just ends, has no words.
    """
    with suppress(psutil.Error):
        process = psutil.Process(pid)
        ours = process.uids().real == os.getuid()  # the kernel's own have no words either
        said = process.cmdline()[-len(words) :]
        return ours and process.status() != psutil.STATUS_ZOMBIE and said in ([], words)
    return False


def _asked(project: Project, name: str) -> dict[str, Any]:
    """What a .job file says; empty where it is none of ours."""
    with suppress(OSError, ValueError, KeyError, TypeError):
        found: dict[str, Any] = json.loads(_job_file(project, name).read_text())
        if isinstance(found["asked_ns"], int) and isinstance(found["words"], list) and found["words"]:
            return {"pid": None, "scene": "", "kind": RUN, "product": ""} | found
    return {}


def _job_file(project: Project, name: str) -> Path:
    return project.runs / f"{checked(name)}.job"


def _asked_file(project: Project, name: str) -> Path:
    return project.folder / f".{checked(name)}.run.yaml"


def _keep(project: Project, name: str, asked: dict[str, Any]) -> None:
    write(_job_file(project, name), json.dumps(asked).encode())
