"""Runs that a benchmark needs: each in a process of its own, once, kept by the hash of its scene.

A folder appears under its name when its run is whole, so what was stopped goes on with the next run. Bags are
removed unless they are asked for: a summary holds what is compared.
"""

import csv
import json
import shutil
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from subsoil_ros.scene.document import Document, dump_yaml
from subsoil_ros.scene.loader import load_scene

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
    """Summary of a direct run of a scene, from `folder` where it has been run before.

    Raises:
        SubsoilError: the scene cannot be used.
        FailedRun: the run failed.
    """
    out = _run_folder(scene, folder, overrides)
    if not (out / "summary.json").is_file():
        part = out.with_name(f"{out.name}.part")
        shutil.rmtree(part, ignore_errors=True)
        out.parent.mkdir(parents=True, exist_ok=True)
        words = [sys.executable, "-m", "subsoil_ros.cli.main", "run", str(scene), "--out", str(part)]
        words += ["--mode", "direct", "--threads", str(threads)]
        words += [word for text in overrides for word in ("--set", text)]
        ended = subprocess.run(words, capture_output=True, text=True, check=False)
        if ended.returncode != 0:
            raise FailedRun(f"{out.name}: exit {ended.returncode}: {ended.stderr.strip()}")
        if keep_bag:
            report = [sys.executable, "-m", "subsoil_ros.cli.main", "report", str(part)]
            subprocess.run(report, capture_output=True, text=True, check=True)
        else:
            shutil.rmtree(part / "bag")
        shutil.rmtree(part / "checkpoints", ignore_errors=True)
        part.rename(out)
    return _summary(out)


def find_kept_run(scene: Path, folder: Path, overrides: Sequence[str] = ()) -> Summary | None:
    """Summary of a run that kept_run has made; none where it has not."""
    out = _run_folder(scene, folder, overrides)
    return _summary(out) if (out / "summary.json").is_file() else None


def _run_folder(scene: Path, folder: Path, overrides: Sequence[str]) -> Path:
    resolved = load_scene(scene, overrides)
    return folder / f"{resolved.scene.name}-{resolved.scene_hash[:12]}"


def _summary(out: Path) -> Summary:
    summary: Summary = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    return {**summary, "folder": str(out)}


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
