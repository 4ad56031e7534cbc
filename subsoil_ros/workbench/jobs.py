"""Runs of a project: processes of `subsoil run`, as many at once as there are cores.

All that is known of them is in files: a page, or its server, may end and begin again at any time. A run that
was asked for is runs/NAME.job, from then on with the number of its process; what it says is in runs/NAME.log.
"""

import json
import os
import signal
import subprocess
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import psutil

from ..errors import InputError
from .asides import COMMAND
from .project import Project, checked

LAST_LINES = 5
"""Of the log of a run that failed."""


@dataclass(frozen=True)
class Job:
    """A run as its files show it."""

    name: str
    scene: str
    state: str  # queued, running, done, stopped, failed
    detail: str = ""  # why it failed

    @property
    def goes_on(self) -> bool:
        """Whether it has a process, or waits for one."""
        return self.state in ("queued", "running")


def ask_for(project: Project, name: str, scene: str, resume: str | None = None) -> None:
    """Put a run into the queue.

    Raises:
        InputError: a name cannot be used, there is such a run, or there is none to resume.
    """
    folder, file = project.run_folder(name), project.scene_file(scene)
    if folder.exists() or _job_file(project, name).exists():
        raise InputError(f"{name}: there is a run of this name; choose another")
    words = ["run", str(file), "--mode", "direct", "--out", str(folder)]
    if resume is not None:
        earlier = project.run_folder(resume)
        if not earlier.is_dir():
            raise InputError(f"{resume}: there is no such run to go on from")
        words[1:2] = [str(earlier / "scene.yaml")]
        words += ["--resume", str(earlier)]
    project.runs.mkdir(exist_ok=True)
    _keep(project, name, {"asked_ns": time.time_ns(), "scene": scene, "words": words, "pid": None})


def start_due(project: Project) -> None:
    """Start runs of the queue, the oldest first, while a core is free."""
    waiting = [job for job in jobs(project) if job.state == "queued"]
    running = sum(job.state == "running" for job in jobs(project))
    for job in waiting[: max(0, (os.cpu_count() or 1) - running)]:
        asked = json.loads(_job_file(project, job.name).read_text())
        with (project.runs / f"{job.name}.log").open("wb") as log:
            process = subprocess.Popen(
                [*COMMAND, *asked["words"]],
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                start_new_session=True,
                cwd=project.folder,
            )
        _keep(project, job.name, asked | {"pid": process.pid})


def stop(project: Project, name: str) -> None:
    """End a run: it writes a checkpoint and its results so far. One that waits leaves the queue."""
    file = _job_file(project, name)
    asked = json.loads(file.read_text())
    if asked["pid"] is None:
        file.unlink()
    elif _is_running(asked["pid"], asked["words"]):
        os.kill(asked["pid"], signal.SIGINT)


def jobs(project: Project) -> list[Job]:
    """All runs, in the order in which they were asked for; those of the command line too."""
    asked = {path.stem: json.loads(path.read_text()) for path in project.runs.glob("*.job")}
    known = [_job(project, name, asked[name]) for name in sorted(asked, key=lambda n: asked[n]["asked_ns"])]
    others = {path.parent.name for path in project.runs.glob("*/summary.json")} - {job.name for job in known}
    return [*(Job(name, "", *_outcome(project, name)) for name in sorted(others)), *known]


def _job(project: Project, name: str, asked: dict[str, Any]) -> Job:
    if asked["pid"] is None:
        return Job(name, asked["scene"], "queued")
    if _is_running(asked["pid"], asked["words"]):
        return Job(name, asked["scene"], "running")
    return Job(name, asked["scene"], *_outcome(project, name))


def _outcome(project: Project, name: str) -> tuple[str, str]:
    """State and detail of a run that has ended."""
    with suppress(OSError, ValueError, KeyError):
        run = json.loads((project.runs / name / "summary.json").read_text())["run"]
        why = run.get("failure") or ""
        return ("stopped" if "SIGINT" in why else "failed" if why else "done"), why
    try:
        lines = (project.runs / f"{name}.log").read_text(errors="replace").splitlines()
    except OSError:
        lines = []
    return "failed", "\n".join(lines[-LAST_LINES:])


def _is_running(pid: int, words: list[str]) -> bool:
    """Whether the process is there, and is the one that was started with these words."""
    with suppress(psutil.Error):
        process = psutil.Process(pid)
        return process.status() != psutil.STATUS_ZOMBIE and process.cmdline()[-len(words) :] == words
    return False


def _job_file(project: Project, name: str) -> Path:
    return project.runs / f"{checked(name)}.job"


def _keep(project: Project, name: str, asked: dict[str, object]) -> None:
    part = project.runs / f".{name}.part"
    part.write_text(json.dumps(asked))
    os.replace(part, _job_file(project, name))
