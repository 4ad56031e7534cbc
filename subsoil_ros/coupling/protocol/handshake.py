"""Nodes of a run, and their handshake by NodeStatus: properties of all, capabilities that the scene needs."""

from collections.abc import Iterable, Mapping

from ...contact_laws.registry import contact_laws
from ...errors import ProtocolError
from ...messages import NodeStatus
from ...scene.controller import External
from ...scene.scene import Scene
from ...source_digest import law_digests

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


def external_nodes(scene: Scene) -> dict[str, str]:
    """Nodes of a run that other programs provide, with the scene key that makes them external."""
    found = {}
    if scene.external_machine:
        found[MECHANISM] = "tools.*.path.external: true"
    if scene.external_soil:
        found[SOIL] = "soil.model: external"
    if scene.controller is not None and isinstance(scene.controller.law, External):
        found[CONTROLLER] = "controller.law: external"
    return found


TICK_MEAN = "tick_mean"
"""Capability: a force that is the mean of a tick, as coupling.force has it but for tick_end."""

PREDICTED = "predicted"
"""Capability: predicts the motions of a tick, and moves by its wrenches."""

DRIVER_COMMAND = "driver_command"
"""Capability: accepts the commands of a controller."""

EARLY_END = "early_end"
"""Capability: accepts END before the last tick of the scene."""

BATCHES = "batches"
"""Capability: passes on, and takes, messages of several ticks together, where no engine waits for them."""

CONTACT_LAW = "contact_law"
"""Capability: a contact law of another package, "contact_law KIND DIGEST" with the digest of its sources."""


def _installed_law(kind: str) -> str | None:
    """The capability of a law's kind as installed here; None if it is a law of this package."""
    digest = law_digests().get(kind)
    return None if digest is None else f"{CONTACT_LAW} {kind} {digest[:16]}"


_LAWS = tuple(filter(None, map(_installed_law, contact_laws())))

CAPABILITIES: Mapping[str, tuple[str, ...]] = {
    MECHANISM: (PREDICTED, DRIVER_COMMAND, EARLY_END, BATCHES),
    SOIL: (TICK_MEAN, EARLY_END, BATCHES, *_LAWS),
    RECORDER: (DRIVER_COMMAND, EARLY_END, BATCHES),
    CONTROLLER: (BATCHES,),
    COUPLER: (BATCHES,),
}
"""Capabilities of the nodes of this package."""


def needed_capabilities(scene: Scene) -> dict[str, dict[str, str]]:
    """For each node: the capabilities that the scene needs, with the scene key that needs them."""
    needed: dict[str, dict[str, str]] = {}

    def add(capability: str, key: str, *nodes: str) -> None:
        for node in nodes:
            needed.setdefault(node, {})[capability] = key

    if scene.soil is not None and scene.exchanged_force != "tick_end":
        add(TICK_MEAN, f"coupling.force: {scene.exchanged_force}", SOIL)
    if scene.predicts_motion:
        add(PREDICTED, "coupling.force: predicted", MECHANISM)
    if scene.particle_soil is not None and (law := _installed_law(scene.particle_soil.law.kind)):
        add(law, f"soil.law.kind: {scene.particle_soil.law.kind}", SOIL)
    if scene.controller is not None:
        add(DRIVER_COMMAND, "controller", MECHANISM, RECORDER)
    if scene.stop_when is not None:
        add(EARLY_END, "stop_when", MECHANISM, SOIL, RECORDER)
    return needed


def check_node_status(own: NodeStatus, other: NodeStatus, needed: Mapping[str, str]) -> None:
    """Compare a node's status with the coupler's own.

    Args:
        needed: capability of this node -> scene key that needs it.

    Raises:
        ProtocolError: another scene, version or message definition, or a capability that is missing.
    """
    node = other.node
    if other.package_version != own.package_version:
        raise ProtocolError(
            f"node_status: {node} is subsoil_ros {other.package_version}, the coupler {own.package_version}; "
            "install the same version for all nodes"
        )
    if other.message_hashes != own.message_hashes:
        unlike = ", ".join(_unlike(own.message_hashes, other.message_hashes))
        raise ProtocolError(
            f"node_status: {node} has other definitions of subsoil_msgs than the coupler ({unlike}); build "
            "subsoil_msgs anew for all nodes"
        )
    if other.scene_hash != own.scene_hash:
        raise ProtocolError(
            f"node_status: {node} runs scene {other.scene_hash[:16]}, the coupler {own.scene_hash[:16]} "
            "(hash of the resolved scene with its meshes); start all nodes with the same scene"
        )
    for capability, key in needed.items():
        if capability not in other.capabilities and capability.startswith(f"{CONTACT_LAW} "):
            kind = capability.split()[1]
            there = any(text.startswith(f"{CONTACT_LAW} {kind} ") for text in other.capabilities)
            found = "has other sources of" if there else "does not have"
            raise ProtocolError(
                f"node_status: {node} {found} contact law '{kind}', which the scene needs ({key}); "
                "install the package that the law comes in, in the same version, for all nodes"
            )
        if capability not in other.capabilities:
            raise ProtocolError(
                f"node_status: {node} cannot do '{capability}', which the scene needs ({key}); use a node "
                "that can, or change the scene"
            )


def _unlike(own: Iterable[str], other: Iterable[str]) -> list[str]:
    """Names of the messages whose hashes differ."""
    return sorted({text.partition(" ")[0] for text in set(own) ^ set(other)})
