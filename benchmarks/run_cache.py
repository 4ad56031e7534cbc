"""Runs of a benchmark: each is run once in a process of its own, and kept as a sweep keeps them."""

import csv
import json
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from subsoil_ros import __version__
from subsoil_ros.analysis.summary import flattened
from subsoil_ros.api.execution import code_digest, machine_name
from subsoil_ros.experiments.run_cache import CachedRun, find_run, keep_folder
from subsoil_ros.loading.loader import ResolvedScene, load_scene
from subsoil_ros.yaml_document import Document, dump_yaml

Summary = dict[str, Any]


class FailedRun(Exception):
    """A run that ended with an error; its text is the run's own."""


def write_scene(document: Document, path: Path) -> Path:
    """Writes a document as a scene file."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(dump_yaml(document), encoding="utf-8")
    return path


def kept_run(
    scene: Path, folder: Path, overrides: Sequence[str] = (), threads: int = 1, *, keep_bag: bool = False
) -> Summary:
    """Summary of a direct run by dotted paths, and its `folder`; from `folder` where it has been run before.

    keep_bag: also its bag and the figures of `subsoil report`.

    Raises:
        SubsoilError: the scene cannot be used.
        FailedRun: the run failed.
    """
    resolved = load_scene(scene, overrides)
    kept = find_run(folder, resolved.scene_hash)
    if kept is None or kept.failure is not None or (keep_bag and not (kept.folder / "bag").is_dir()):
        kept = _run(scene, resolved, folder, overrides, threads, keep_bag)
    return _with_folder(kept)


def find_kept_run(scene: Path, folder: Path, overrides: Sequence[str] = ()) -> Summary | None:
    """Summary of a run that kept_run has made; none where it has not."""
    kept = find_run(folder, load_scene(scene, overrides).scene_hash)
    return None if kept is None or kept.failure is not None else _with_folder(kept)


def _with_folder(kept: CachedRun) -> Summary:
    return {**flattened(kept.summary), "folder": str(kept.folder)}


def _run(
    scene: Path, resolved: ResolvedScene, cache: Path, overrides: Sequence[str], threads: int, keep_bag: bool
) -> CachedRun:
    cache.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=".part-", dir=cache) as part:
        made = Path(part) / "run"
        changes = [word for text in overrides for word in ("--set", text)]
        words = ["run", str(scene), "--out", str(made), "--mode", "direct", "--threads", str(threads)]
        _subsoil(*words, *changes)
        if keep_bag:
            _subsoil("report", str(made))
        else:
            shutil.rmtree(made / "bag")
        shutil.rmtree(made / "checkpoints", ignore_errors=True)
        summary = json.loads((made / "summary.json").read_text(encoding="utf-8"))
        facts = {
            "failure": None,
            "exit_status": 0,
            "wall_s": None,  # not timed as a study does
            "cpu_s": None,
            "whole_wall_s": summary["run"]["whole_wall_s"],
            "threads": threads,
            "at_once": 1,
            "machine": machine_name(),
            "version": __version__,
            "code": code_digest(),
        }
        return keep_folder(cache, resolved.scene_hash, made, facts)


def _subsoil(*words: str) -> None:
    """A verb in a process of its own. Raises FailedRun."""
    command = [sys.executable, "-m", "subsoil_ros.cli.main", *words]
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    if ended.returncode != 0:
        raise FailedRun(f"subsoil {' '.join(words[:2])}: exit {ended.returncode}: {ended.stderr.strip()}")


def read_rows(path: Path) -> list[dict[str, str]]:
    """Rows of a table in CSV, as they are written."""
    with path.open(newline="", encoding="utf-8") as stream:
        return list(csv.DictReader(stream))


def write_rows(path: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """Writes a table as CSV, columns as in its first row, and as JSON beside it."""
    path.with_suffix(".json").write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
    with path.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.DictWriter(stream, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
