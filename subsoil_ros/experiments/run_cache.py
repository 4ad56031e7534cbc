"""Finished runs, kept by the hash of their scene: calibrations, sweeps, studies and benchmarks share them.

A cached run is a folder with scene.yaml, series.csv and summary.json as `subsoil run` leaves them, and
run.json, which has its outcome and its times. A bag is kept only on request: a run of scene.yaml gives it
again, bit for bit.
"""

import json
import logging
import os
import shutil
import tempfile
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from pydantic import ValidationError

from ..analysis.series import Series, read_series_csv
from ..analysis.summary import Summary
from ..api.execution import RunResult, code_digest
from ..errors import InputError, RunError, SubsoilError
from ..loading.loader import ResolvedScene
from ..yaml_document import Document, read_document

_logger = logging.getLogger(__name__)

NAME_DIGITS = 32
"""Digits of the hash in the name of a folder."""


@dataclass(frozen=True)
class CachedRun:
    """A run in its folder; failed runs are kept too, with their message."""

    folder: Path

    @cached_property
    def facts(self) -> Document:
        """Content of run.json, see RunResult; empty for a folder of `subsoil run`."""
        path = self.folder / "run.json"
        return _read_json(path) if path.is_file() else {}

    @cached_property
    def scene(self) -> Document:
        """Content of scene.yaml."""
        path = self.folder / "scene.yaml"
        return read_document(path, str(path))

    @cached_property
    def summary(self) -> Document:
        """summary.json; empty if a run failed before its first series tick."""
        path = self.folder / "summary.json"
        return _read_json(path) if path.is_file() else {}

    @cached_property
    def metrics(self) -> Summary:
        """summary.json of a recorded run. Raises InputError for one that another version has written."""
        try:
            return Summary.model_validate(self.summary)
        except ValidationError as error:
            raise InputError(
                f"{self.folder / 'summary.json'}: is no summary of a run with this version; remove the "
                "folder, and the run is repeated"
            ) from error

    @property
    def failure(self) -> str | None:
        """Message of the failure; None if the run did not fail."""
        message = self.facts["failure"]
        return None if message is None else str(message)

    def error(self, name: str) -> SubsoilError:
        """The failure as the exception that was raised: InputError or RunError."""
        kind = InputError if self.facts["exit_status"] == InputError.exit_status else RunError
        return kind(f"{name}: {self.failure}")

    def series(self) -> Series:
        """Its series, to the last bit."""
        return read_series_csv(self.folder / "series.csv")


def lack_of(run: CachedRun) -> str:
    """Why a run has no means of a working tool: its failure, or no row in its metrics window; or ""."""
    if run.failure is None and run.metrics.window.whole_run:
        return "no row lies in its metrics window, so its means would be of the whole run; make it longer"
    return run.failure or ""


def warn_of_other_code(runs: Iterable[CachedRun]) -> None:
    """Warn of kept runs that other engines have made than those of this process: their numbers may differ."""
    other = [run for run in runs if run.facts.get("code") != code_digest()]
    if other:
        _logger.warning(
            "warning: kept runs of another version of the engines, whose numbers may differ: %d; remove %s "
            "to run all again",
            len(other),
            other[0].folder.parent,
        )


def _read_json(path: Path) -> Document:
    return dict(json.loads(path.read_text(encoding="utf-8")))


def run_folder(cache: Path, scene_hash: str) -> Path:
    """Folder in which the run of a scene is kept."""
    return cache / scene_hash[:NAME_DIGITS]


def find_run(cache: Path, scene_hash: str) -> CachedRun | None:
    """The cached run of a scene; None if there is none."""
    folder = run_folder(cache, scene_hash)
    return CachedRun(folder) if (folder / "run.json").is_file() else None


def keep_run(cache: Path, scene: ResolvedScene, executed: RunResult) -> CachedRun:
    """Keep a run in place of an earlier one of the same scene; its folder appears in one piece."""
    cache.mkdir(parents=True, exist_ok=True)
    part = Path(tempfile.mkdtemp(prefix=".part-", dir=cache))
    try:
        scene.write(part / "scene.yaml")
        for name, content in executed.files.items():
            (part / name).write_bytes(content)
        part.chmod(0o755)  # mkdtemp's folders are readable by the user alone
        soil = None if scene.material is None else scene.material.soil.name  # which scene.yaml has not
        return keep_folder(cache, scene.scene_hash, part, executed.facts | {"soil": soil})
    finally:
        shutil.rmtree(part, ignore_errors=True)


def keep_folder(cache: Path, scene_hash: str, made: Path, facts: Document) -> CachedRun:
    """Keep a folder that `subsoil run` made on the disk of the cache, as keep_run does; it is moved.

    facts: as RunResult has them.
    """
    folder = run_folder(cache, scene_hash)
    (made / "run.json").write_text(json.dumps(facts, indent=1) + "\n", encoding="utf-8")
    shutil.rmtree(folder, ignore_errors=True)
    try:
        os.rename(made, folder)
    except OSError:
        if not folder.is_dir():  # else another process has just kept the same run, with the same numbers
            raise
    return CachedRun(folder)
