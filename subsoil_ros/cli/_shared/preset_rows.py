"""The part of `subsoil check` that prints the cost and the error of accuracy presets."""

from collections.abc import Iterator, Mapping, Sequence

from rich.console import RenderableType
from rich.table import Table

from ...loading.loader import ResolvedScene
from ...loading.presets import ErrorInterval, Expected
from .tables import table


def accuracy_lines(resolved: ResolvedScene, overrides: Sequence[str]) -> Iterator[RenderableType]:
    """Lines of what a study measured of the chosen preset, or of all; a line if nothing was measured."""
    name, duration = resolved.preset, resolved.scene.duration_s
    if name is None:
        if resolved.presets:
            names = ", ".join(resolved.presets)
            yield f"preset: none, as written; presets of this scene: {names} (--preset NAME)"
        known = {key: item.expected for key, item in resolved.presets.items() if item.expected is not None}
        if known:
            yield from _all_presets(known, duration)
            for note in dict.fromkeys(note for item in known.values() for note in item.notes):
                yield f"{', '.join(key for key, item in known.items() if note in item.notes)}: {note}"
            yield from _changed(overrides)
        return
    expected = resolved.presets[name].expected
    if expected is None:
        yield (
            f"preset {name}: its error and its time are not known: the study of this scene has not been "
            "run (`subsoil study` measures them)"
        )
        return
    yield _one_preset(f"preset {name}: expected error against {expected.against}", expected.errors, expected)
    for other, errors in expected.errors_against.items():
        yield _one_preset(f"against {other}", errors, expected)
    yield from expected.notes
    if expected.wall_s_per_simulated_s is not None:
        yield (
            f"expected wall time: {expected.wall_s_per_simulated_s * duration:.3g} s for {duration:g} s, "
            f"without start-up, on {expected.machine}"
        )
    yield f"source: {expected.source}"
    yield from _changed(overrides)


def _changed(overrides: Sequence[str]) -> Iterator[str]:
    """Note that overrides change the scene that was measured."""
    changed = [text for text in overrides if text.partition("=")[0].strip() != "preset"]
    if changed:
        yield f"note: measured without {', '.join(f'--set {text}' for text in changed)}"


def _all_presets(known: Mapping[str, Expected], duration_s: float) -> Iterator[Table]:
    """Yield a table with a row for each preset and its wall time, then one for each further reference."""
    walls = {
        name: "" if (wall_s := item.wall_s_per_simulated_s) is None else f"{wall_s * duration_s:.3g} s"
        for name, item in known.items()
    }
    times = {f"wall time for {duration_s:g} s": walls} if any(walls.values()) else {}
    errors = {name: item.errors for name, item in known.items()}
    yield _one_row_each("expected error in %, with its interval", errors, times)
    for other in dict.fromkeys(other for item in known.values() for other in item.errors_against):
        against = {name: item.errors_against.get(other, {}) for name, item in known.items()}
        yield _one_row_each(f"against {other}, in %", against, {})


def _one_row_each(
    title: str, errors: Mapping[str, Mapping[str, ErrorInterval]], further: Mapping[str, Mapping[str, str]]
) -> Table:
    metrics = list(dict.fromkeys(metric for found in errors.values() for metric in found))
    presets = table(title, ("preset", *metrics, *further))
    for name, found in errors.items():
        cells = [_mean_and_interval(found[metric]) if metric in found else "" for metric in metrics]
        presets.add_row(name, *cells, *(column[name] for column in further.values()))
    return presets


def _one_preset(title: str, errors: Mapping[str, ErrorInterval], expected: Expected) -> Table:
    metrics = table(title, ("metric", "error", f"{100.0 * expected.confidence:g} % interval"))
    for metric, error in errors.items():
        metrics.add_row(metric, f"{100.0 * error.mean:+.3g} %", _interval(error))
    return metrics


def _mean_and_interval(error: ErrorInterval) -> str:
    mean, low, high = (
        f"{100.0 * value:+.{1 if abs(value) < 0.1 else 0}f}" for value in (error.mean, error.low, error.high)
    )
    return f"{mean} ({low} to {high})"


def _interval(error: ErrorInterval) -> str:
    return f"{100.0 * error.low:+.3g} to {100.0 * error.high:+.3g} %"
