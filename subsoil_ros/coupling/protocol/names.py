"""Names of the nodes of a run, and the largest lag of the recorder."""

from ...scene.controller import External
from ...scene.scene import Scene

COUPLER = "coupler"
MECHANISM = "mechanism"
SOIL = "soil"
RECORDER = "recorder"
CONTROLLER = "controller"

ACK_LAG_TICKS = 256
"""Largest number of ticks that the recorder may be behind the grants."""

ACK_EVERY_TICKS = 16
"""Largest number of ticks between acknowledgements; below ACK_LAG_TICKS, or the run would stand still."""


def participants(scene: Scene) -> tuple[str, ...]:
    """Nodes that a run of the scene needs beside the coupler."""
    parts = ((MECHANISM, scene.moved_by_participant), (SOIL, scene.soil is not None))
    names = [name for name, there in parts if there]
    if scene.controller is not None:
        names.append(CONTROLLER)
    if scene.record.bag:
        names.append(RECORDER)
    return tuple(names)


def nodes_from_outside(scene: Scene) -> dict[str, str]:
    """Nodes of a run that other programs provide, with the scene key that makes them external."""
    found = {}
    if scene.external_machine:
        found[MECHANISM] = "tools.*.path.external: true"
    if scene.external_soil:
        found[SOIL] = "soil.model: external"
    if scene.controller is not None and isinstance(scene.controller.law, External):
        found[CONTROLLER] = "controller.law: external"
    return found
