"""The part of `subsoil check` that says what an accuracy preset costs and how far it is off."""

from collections.abc import Iterator, Mapping, Sequence

from rich.console import RenderableType
from rich.table import Table

from ..scene.loader import ResolvedScene
from ..scene.presets import ErrorInterval, Expected


def accuracy_lines(resolved: ResolvedScene, overrides: Sequence[str]) -> Iterator[RenderableType]:
    """What a study measured of the chosen preset, or that there is nothing measured."""
    name = resolved.accuracy
    if name is None:
        if resolved.presets:
            names = ", ".join(resolved.presets)
            yield f"accuracy: as written; presets of this scene: {names} (--accuracy NAME)"
        return
    expected = resolved.presets[name].expected
    if expected is None:
        yield (
            f"accuracy: {name}: its error and its time are not known: the study of this scene has not been "
            "run (`subsoil study` measures them)"
        )
        return
    yield _table(f"accuracy: {name}, expected error against {expected.against}", expected.errors, expected)
    for other, errors in expected.errors_against.items():
        yield _table(f"against {other}", errors, expected)
    duration = resolved.scene.duration_s
    yield (
        f"expected wall time: {expected.wall_s_per_simulated_s * duration:.3g} s for {duration:g} s, on "
        f"{expected.machine}; source: {expected.source}"
    )
    changed = [text for text in overrides if text.partition("=")[0].strip() not in ("accuracy", "start")]
    if changed:
        yield f"note: measured without {', '.join(f'--set {text}' for text in changed)}"


def _table(title: str, errors: Mapping[str, ErrorInterval], expected: Expected) -> Table:
    table = Table(title=title, title_justify="left", title_style="bold", box=None)
    table.add_column("metric")
    table.add_column("error", justify="right")
    table.add_column(f"{100.0 * expected.confidence:g} % interval", justify="right")
    for metric, error in errors.items():
        interval = f"{100.0 * error.low:+.2g} to {100.0 * error.high:+.2g} %"
        table.add_row(metric, f"{100.0 * error.mean:+.2g} %", interval)
    return table
