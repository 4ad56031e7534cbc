"""Runs of a project: processes of `subsoil run`, as many at once as there are cores.

All that is known of them is in files: a page, or its server, may end and begin again at any time. A run that
was asked for is runs/NAME.job, later with the number of its process; what it says is in runs/NAME.log. Its
scene is as it was when the run was asked for: the hidden file .NAME.run.yaml beside the scene.
"""

import fcntl
import json
import os
import signal
import subprocess
import time
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import IO, Any

import psutil

from ..errors import InputError
from .asides import COMMAND
from .project import Project, checked, is_name, write

LAST_BYTES = 1000
"""Of the log of a run that failed."""


@dataclass(frozen=True)
class Job:
    """A run as its files show it."""

    name: str
    scene: str
    state: str  # queued, running, stopping, done, stopped, failed
    detail: str = ""  # why it failed

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


def ask_for(project: Project, name: str, scene: str, resume: str | None = None) -> None:
    """Put a run into the queue.

    Raises:
        InputError: a name cannot be used, there is such a run, or there is none to resume.
        OSError: the scene cannot be read, or the disk is full.
    """
    folder = project.run_folder(name)
    if folder.exists() or _job_file(project, name).exists():
        raise InputError(f"{name}: there is a run of this name; choose another")
    project.runs.mkdir(exist_ok=True)
    words = ["--mode", "direct", "--out", str(folder)]
    if resume is None:
        asked = _asked_file(project, name)
        text = project.scene_file(scene).read_bytes()
        write(asked, text)
        words = ["run", str(asked), *words]
        if not any(line.startswith(b"name:") for line in text.splitlines()):
            words += ["--set", f"name={scene}"]
    else:
        earlier = project.run_folder(resume)
        if not earlier.is_dir():
            raise InputError(f"{resume}: there is no such run to go on from")
        words = ["run", str(earlier / "scene.yaml"), *words, "--resume", str(earlier)]
    _keep(project, name, {"asked_ns": time.time_ns(), "scene": scene, "words": words, "pid": None})


def start_due(project: Project) -> None:
    """Start runs of the queue, the oldest first, while a core is free."""
    found = jobs(project)
    running = sum(job.state in ("running", "stopping") for job in found)
    waiting = [job.name for job in found if job.state == "queued"]
    for name in waiting[: max(0, (os.cpu_count() or 1) - running)]:
        asked = _asked(project, name)
        _keep(project, name, asked | {"pid": 0})  # never started twice, whatever happens here
        with (project.runs / f"{name}.log").open("wb") as log:
            process = subprocess.Popen(
                [*COMMAND, *asked["words"]],
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                start_new_session=True,
                cwd=project.folder,
            )
        _keep(project, name, asked | {"pid": process.pid})


def stop(project: Project, name: str) -> None:
    """End a run: it writes a checkpoint and its results so far. One that waits leaves the queue."""
    asked = _asked(project, name)
    state = _job(project, name, asked).state if asked else ""
    if state == "queued":
        _asked_file(project, name).unlink(missing_ok=True)
        _job_file(project, name).unlink()
    elif state == "running":  # a second signal would end it at once, without results
        _keep(project, name, asked | {"stopping": True})
        os.kill(asked["pid"], signal.SIGINT)


def jobs(project: Project) -> list[Job]:
    """All runs, in the order in which they were asked for; those of the command line before them."""
    files = [path.stem for path in project.runs.glob("*.job") if is_name(path.stem)]
    asked = {name: found for name in files if (found := _asked(project, name))}
    others = {path.parent.name for path in project.runs.glob("*/summary.json")} - asked.keys()
    return [
        *(Job(name, "", *_outcome(project, name)) for name in sorted(filter(is_name, others))),
        *(
            _job(project, name, asked[name])
            for name in sorted(asked, key=lambda name: asked[name]["asked_ns"])
        ),
    ]


def _job(project: Project, name: str, asked: dict[str, Any]) -> Job:
    if asked["pid"] is None:
        return Job(name, asked["scene"], "queued")
    if _is_running(asked["pid"], asked["words"]):
        return Job(name, asked["scene"], "stopping" if asked.get("stopping") else "running")
    return Job(name, asked["scene"], *_outcome(project, name, stopped=bool(asked.get("stopping"))))


def _outcome(project: Project, name: str, *, stopped: bool = False) -> tuple[str, str]:
    """State and detail of a run that has ended; stopped: by the workbench."""
    summary, log = project.runs / name / "summary.json", project.runs / f"{name}.log"
    with suppress(OSError, ValueError, KeyError, TypeError, AttributeError):
        why = _failure(summary, summary.stat().st_mtime_ns)
        return ("stopped" if stopped or "SIGINT" in why else "failed" if why else "done"), why
    with suppress(OSError):
        return ("stopped" if stopped else "failed"), _end_of(log, log.stat().st_mtime_ns)
    return "failed", ""


@lru_cache(maxsize=4096)
def _failure(summary: Path, _: int) -> str:
    """Why a run failed; empty: it did not. The second argument tells versions of the file apart."""
    return str(json.loads(summary.read_text())["run"].get("failure") or "")


@lru_cache(maxsize=4096)
def _end_of(log: Path, _: int) -> str:
    with log.open("rb") as stream:
        stream.seek(-min(LAST_BYTES, log.stat().st_size), os.SEEK_END)
        return stream.read().decode(errors="replace").strip()


def _is_running(pid: int, words: list[str]) -> bool:
    """Whether the process is there, and is the one that was started with these words."""
    with suppress(psutil.Error):
        process = psutil.Process(pid)
        return process.status() != psutil.STATUS_ZOMBIE and process.cmdline()[-len(words) :] == words
    return False


def _asked(project: Project, name: str) -> dict[str, Any]:
    """What a .job file says; empty where it is none of ours."""
    with suppress(OSError, ValueError, KeyError, TypeError):
        found: dict[str, Any] = json.loads(_job_file(project, name).read_text())
        if isinstance(found["asked_ns"], int) and isinstance(found["words"], list) and found["words"]:
            return {"pid": None, "scene": ""} | found
    return {}


def _job_file(project: Project, name: str) -> Path:
    return project.runs / f"{checked(name)}.job"


def _asked_file(project: Project, name: str) -> Path:
    return project.folder / f".{checked(name)}.run.yaml"


def _keep(project: Project, name: str, asked: dict[str, Any]) -> None:
    write(_job_file(project, name), json.dumps(asked).encode())
