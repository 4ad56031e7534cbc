"""Names of the nodes of a run, and how far the recorder may be behind."""

from ...scene.model import Scene

COUPLER = "coupler"
MECHANISM = "mechanism"
SOIL = "soil"
RECORDER = "recorder"
CONTROLLER = "controller"

ACK_LAG_TICKS = 256
"""Ticks that the recorder may be behind the grants."""

ACK_EVERY_TICKS = 16
"""The recorder acknowledges at least so often; below ACK_LAG_TICKS, or the run would stand still."""


def participants(scene: Scene) -> tuple[str, ...]:
    """Nodes a run of the scene needs beside the coupler."""
    names = [name for name, part in ((MECHANISM, scene.mechanism), (SOIL, scene.soil)) if part is not None]
    if scene.controller is not None:
        names.append(CONTROLLER)
    if scene.record.bag:
        names.append(RECORDER)
    return tuple(names)
