"""The fit of a law of particles to soil tests."""

import hashlib
import json
import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from ...errors import InputError
from ...loading.loader import ResolvedScene, load_scene
from ...yaml_document import dump_yaml
from .design import DraftTarget, LawDesign, StrengthTarget, Target
from .runs import RunProgress
from .soil_results import draft_results, repose_results, strength_results


@dataclass(frozen=True)
class LawFit:
    """Fitted numbers of a law, and the tests at them."""

    scene: ResolvedScene  # the start
    keys: tuple[str, ...]
    values: NDArray[np.float64]
    errors: NDArray[np.float64]  # standard errors; nan where they are not known
    names: tuple[str, ...]  # of the results
    wanted: NDArray[np.float64]
    found: NDArray[np.float64]
    tolerance: NDArray[np.float64]  # relative
    run_count: int
    finished: bool  # False: ended by max_runs


class _Enough(Exception):
    """Raised when max_runs evaluations have been made."""


def fit_law(
    scene: ResolvedScene,
    design: LawDesign,
    folder: Path,
    threads: int,
    progress: RunProgress,
    say: Callable[[str], None],
) -> LawFit:
    """Least squares of (found - wanted) / (tolerance wanted), differences taken over `design.difference`.

    Every set of parameters is tested once and kept in `folder`; a fit that was stopped goes through the
    same sets again, from there. Standard errors are from the Jacobian, tolerances being standard deviations.

    Raises:
        InputError: a parameter is no number of the scene or starts outside its bounds.
        RunError: a test failed.
    """
    names, wanted, tolerance = _wanted(design.targets)
    low = np.array([item.lowest for item in design.parameters])
    high = np.array([item.largest for item in design.parameters])
    start = np.array([_number(scene, item.key) for item in design.parameters])
    for item, value in zip(design.parameters, start, strict=True):
        if not item.lowest <= value <= item.largest:
            raise InputError(
                f"parameters: {item.key} starts at {value:g} in {scene.path}, outside {item.lowest:g} "
                f"to {item.largest:g}; widen them, or start elsewhere with 'overrides'"
            )
    keys = tuple(item.key for item in design.parameters)
    best: list[Any] = [np.inf, start, wanted]
    tested: set[bytes] = set()

    def evaluate(values: NDArray[np.float64]) -> NDArray[np.float64]:
        if values.tobytes() not in tested and len(tested) >= design.max_runs:
            raise _Enough
        tested.add(values.tobytes())
        found = _results(scene, design, keys, values, folder, threads, progress)
        cost = float((((found - wanted) / (tolerance * wanted)) ** 2).sum())
        shown = ", ".join(
            f"{key.split('.')[-1]} {value:.4g}" for key, value in zip(keys, values, strict=True)
        )
        got = ", ".join(f"{name} {value:.4g}" for name, value in zip(names, found, strict=True))
        say(f"set {len(tested)} of at most {design.max_runs}: {shown}: {got}; cost {cost:.3g}")
        if cost < best[0]:
            best[:] = [cost, values.copy(), found]
        return found

    errors = np.full(len(keys), np.nan)
    finished = True
    try:
        width = high - low
        # from 1 to 2, so that a step relative to a parameter is one relative to its bounds
        end = least_squares(
            lambda x: (evaluate(low + (x - 1.0) * width) - wanted) / (tolerance * wanted),
            1.0 + (start - low) / width,
            bounds=(1.0, 2.0),
            diff_step=design.difference,
            xtol=1e-3,
            ftol=1e-3,
        )
        covariance = np.linalg.pinv(end.jac.T @ end.jac)
        errors = np.sqrt(np.diag(covariance)) * width
    except _Enough:
        finished = False
    return LawFit(scene, keys, best[1], errors, names, wanted, best[2], tolerance, len(tested), finished)


def _wanted(targets: tuple[Target, ...]) -> tuple[tuple[str, ...], NDArray[np.float64], NDArray[np.float64]]:
    names, wanted, tolerance = [], [], []
    for target in targets:
        given = target.model_dump(exclude_none=True)
        for key in ("cohesion_pa", "friction_angle_rad", "tensile_strength_pa", "draft_newton", "angle_rad"):
            if given.get(key):
                names.append(key)
                wanted.append(given[key])
                tolerance.append(target.tolerance)
    if not names:
        raise InputError("targets: give at least one number that a test is to meet, above 0")
    return tuple(names), np.array(wanted), np.array(tolerance)


def _number(scene: ResolvedScene, key: str) -> float:
    """The scene's own value or default. Raises InputError for a key that is no number."""
    value: Any = scene.scene.model_dump()
    for part in key.split("."):
        value = value.get(part) if isinstance(value, dict) else None
    if not isinstance(value, int | float) or isinstance(value, bool):
        raise InputError(f"parameters: {key} is no number of {scene.path}; give the dotted path of one")
    return float(value)


def _results(
    scene: ResolvedScene,
    design: LawDesign,
    keys: tuple[str, ...],
    values: NDArray[np.float64],
    folder: Path,
    threads: int,
    progress: RunProgress,
) -> NDArray[np.float64]:
    changes = [f"{key}={float(value)!r}" for key, value in zip(keys, values, strict=True)]
    resolved = load_scene(scene.path, (*design.overrides, *changes))
    found: list[float] = []
    for target in design.targets:
        content = json.dumps([resolved.scene_hash, target.model_dump(mode="json")], sort_keys=True)
        path = folder / f"{hashlib.sha256(content.encode()).hexdigest()[:32]}.json"
        if not path.is_file():
            path.parent.mkdir(parents=True, exist_ok=True)
            results = _run(resolved, target, folder, threads, progress)
            part = path.with_suffix(".part")
            part.write_text(json.dumps(results))
            os.replace(part, path)
        found += json.loads(path.read_text()).values()
    return np.array(found)


def _run(
    scene: ResolvedScene, target: Target, folder: Path, threads: int, progress: RunProgress
) -> dict[str, float]:
    if isinstance(target, StrengthTarget):
        return strength_results(scene, target, threads, progress)
    if isinstance(target, DraftTarget):
        return draft_results(scene, target, folder, threads, progress)
    return repose_results(scene, target, threads, progress)


def write_law(path: Path, fit: LawFit) -> None:
    """Write a scene with the start as its base and the fitted numbers, and a report beside it as .json."""
    document: dict[str, Any] = {
        "base": str(fit.scene.path.resolve()),
        "name": f"{fit.scene.scene.name}_calibrated",
    }
    for key, value in zip(fit.keys, fit.values.tolist(), strict=True):
        place = document
        *parts, last = key.split(".")
        for part in parts:
            place = place.setdefault(part, {})
        if parts[-2:-1] == ["law"] or parts[-1:] == ["law"]:
            kind = fit.scene.scene.particle_soil.law.kind  # type: ignore[union-attr]
            document["soil"].setdefault("law", {})["kind"] = kind
        place[last] = value
    path.write_text(dump_yaml(document), encoding="utf-8")
    report = {
        "finished": fit.finished,
        "sets_tested": fit.run_count,
        "parameters": {
            key: {"value": value, "standard_error": None if np.isnan(error) else error}
            for key, value, error in zip(fit.keys, fit.values.tolist(), fit.errors.tolist(), strict=True)
        },
        "results": {
            name: {"wanted": wanted, "found": found}
            for name, wanted, found in zip(fit.names, fit.wanted.tolist(), fit.found.tolist(), strict=True)
        },
    }
    path.with_suffix(".json").write_text(json.dumps(report, indent=1) + "\n", encoding="utf-8")
