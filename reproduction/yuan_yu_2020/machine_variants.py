"""The same machine in another form: shank locked, set to another depth, on plain ground, in coarser soil.

Each function takes a resolved scene and returns the document of another, to be written as a scene file.
Nothing is run.
"""

import copy
from typing import Any

import numpy as np

from subsoil_ros.coupling.engines import build_mechanism
from subsoil_ros.errors import SceneError
from subsoil_ros.loading.loader import ResolvedScene
from subsoil_ros.scene.mechanism import WheelContact
from subsoil_ros.scene.scene import Scene
from subsoil_ros.yaml_document import Document

from .levers import rest_angle_rad

LOCK = "shank_lock"

WHEEL_CONTACT = {
    "kind": "wheel_contact",
    "radius_m": 0.20,
    "stiffness_newton_per_m": 28000.0,
    "damping_newton_s_per_m": 150.0,
    "friction": 0.5,
}
"""Measured on the paper's bed (reproduction/yuan_yu_2020/depth_wheel.md)."""


def shank_and_frame(scene: Scene) -> tuple[str, str]:
    """Names of the shank and of the body that its spring leans on.

    Raises:
        SceneError: the scene's report names no shank with a spring.
    """
    report, mechanism = scene.report, scene.mechanism
    spring: Any = mechanism.forces.get(report.spring or "") if mechanism is not None else None
    if spring is None or report.shank is None or report.shank not in (spring.body_a, spring.body_b):
        raise SceneError(
            f"{scene.name}: report.shank, report.spring: given {report.shank}, {report.spring}; needed are a "
            "body and the spring that holds it"
        )
    return report.shank, spring.body_b if spring.body_a == report.shank else spring.body_a


def start_places(resolved: ResolvedScene) -> dict[str, tuple[float, float, float]]:
    """x, z [m] and angle [rad] of every body at the start."""
    mechanism = build_mechanism(resolved)
    if mechanism is None:
        raise SceneError(f"{resolved.path}: mechanism: is missing; a path has no variants")
    state = mechanism.state("", -1, 0)
    return {body.name: (body.x_m, body.z_m, body.angle_rad) for body in state.bodies}


def locked_shank(resolved: ResolvedScene, angle_rad: float) -> Document:
    """The shank held at an angle against the frame by a joint in the place of its spring.

    The joint is a driver that stands still: it holds whatever angle it starts from. A spring with `locked`
    holds that of the reference pose only.
    """
    shank, frame = shank_and_frame(resolved.scene)
    mechanism = resolved.scene.mechanism
    assert mechanism is not None
    places = start_places(resolved)
    tilt = places[frame][2] - mechanism.bodies[frame].angle_rad
    document = _copied(resolved)
    parts = document["mechanism"]
    del parts["forces"][resolved.scene.report.spring]
    parts.setdefault("joints", {})[LOCK] = {
        "kind": "driver", "body": shank, "relative_to": frame, "coordinate": "angle",
        "speed": {"kind": "constant", "value": 0.0},
    }  # fmt: skip
    coordinates = parts.setdefault("initial", {}).setdefault("coordinates", {})
    coordinates[f"{shank}.angle_rad"] = mechanism.bodies[shank].angle_rad + tilt + angle_rad
    document["report"].pop("spring")
    document["name"] = f"{resolved.scene.name}_locked"
    return document


def at_depth(resolved: ResolvedScene, depth_m: float, *, from_above: bool = False) -> Document:
    """The whole machine mounted higher or lower over its wheels, so that the tip works at `depth_m`.

    Every part moves by the same height but the wheels, their axles and contacts; levers and angles stay.
    `initial.coordinates` and coordinate springs on heights move along. With `from_above` the start stays
    where it was, and a chain lets the machine down as fast as before, but to its new height; the shank's
    angle at the start then is no more the one of rest (see at_rest).
    """
    scene = resolved.scene
    if scene.report.tip_m is None or scene.mechanism is None:
        raise SceneError(f"{resolved.path}: report.tip_m: is missing, so there is no depth to change")
    rise = -scene.report.tip_m[1] - depth_m
    wheels = wheel_bodies(scene)
    document = _copied(resolved)
    parts = document["mechanism"]
    for name, body in parts["bodies"].items():
        if name not in wheels:
            body["position_m"][1] += rise
    for joint in parts.get("joints", {}).values():
        carried = {joint.get("body_a"), joint.get("body_b"), joint.get("body")}
        if not carried & wheels and "point_m" in joint:
            joint["point_m"][1] += rise
    for force in parts.get("forces", {}).values():
        for key in ("point_m", "point_a_m", "point_b_m"):
            if key in force:
                force[key][1] += rise
        if (
            force["kind"] == "coordinate_spring"
            and force["coordinate"] == "z"
            and force["body"] not in wheels
        ):
            _raise_law(force["target"], rise, from_above)
    coordinates = parts.get("initial", {}).get("coordinates", {})
    for key in coordinates:
        if key.endswith(".z_m") and not from_above and key.rpartition(".")[0] not in wheels:
            coordinates[key] += rise
    for tool in document.get("tools", {}).values():
        if tool.get("body") not in wheels:
            for part in tool["groups"].values():
                x, y, z = part.get("position_m", [0.0, 0.0, 0.0])
                part["position_m"] = [x, y, z + rise]
    document["report"]["tip_m"] = [scene.report.tip_m[0], -depth_m]
    document["name"] = f"{scene.name}_{1e3 * depth_m:.0f}mm"
    return document


def on_plain_ground(document: Document) -> Document:
    """Wheels on an elastic ground instead of on particles: a bin as narrow as the share allows."""
    found = copy.deepcopy(document)
    for name, tool in list(found.get("tools", {}).items()):
        if tool.get("role", "tillage") == "tillage":
            continue
        found["mechanism"].setdefault("forces", {})[f"ground_{name}"] = {
            **WHEEL_CONTACT,
            "body": tool["body"],
        }
        del found["tools"][name]
    return found


def coarse_soil(document: Document, radius_m: float, bin_m: tuple[float, float, float]) -> Document:
    """Larger particles of the same soil (`PairValues.scaled`) in another bin: length, width, depth [m]."""
    found = copy.deepcopy(document)
    soil = found["soil"]
    particles = soil["particles"]
    particles["reference_radius_m"] = particles.get("reference_radius_m", particles["radius_m"])
    ratio = radius_m / particles["radius_m"]
    particles["radius_m"] = radius_m
    soil["bin"].update(length_m=bin_m[0], width_m=bin_m[1], depth_m=bin_m[2])
    soil["skin_m"] = ratio * soil.get("skin_m", 0.003)
    if soil["bed"]["kind"] == "grid":
        soil["bed"]["spacing_m"] = "rest"
    return found


def wheel_bodies(scene: Scene) -> set[str]:
    """Bodies that stand on the soil: of tools that are no share, and of wheel contacts."""
    found = {tool.body for tool in scene.tools.values() if not tool.is_tillage and tool.body is not None}
    forces = scene.mechanism.forces.values() if scene.mechanism is not None else ()
    return found | {force.body for force in forces if isinstance(force, WheelContact)}


def _copied(resolved: ResolvedScene) -> Document:
    document = copy.deepcopy(resolved.document)
    document.pop("initial_condition", None)
    document.pop("initial_conditions", None)
    return document


def _raise_law(law: dict[str, Any], rise: float, last_only: bool) -> None:
    """Adds a height to a time function, in place; `last_only`: to the end of a table of two, as fast as
    before."""
    if last_only:
        if law["kind"] != "table" or len(law["values"]) != 2:
            raise SceneError("mechanism.forces: a machine is let down by a table of two heights; give it one")
        (first, last), (begin, end) = law["values"], law["times_s"]
        law["values"] = [first, last + rise]
        law["times_s"] = [begin, begin + (end - begin) * (last + rise - first) / (last - first)]
        return
    for key in ("value", "start_value", "end_value", "mean"):
        if key in law:
            law[key] += rise
    if "values" in law:
        law["values"] = (np.array(law["values"]) + rise).tolist()
    if law["kind"] not in ("constant", "ramp", "sine", "table"):
        raise SceneError(
            f"mechanism.forces: a height driven by a law of kind '{law['kind']}' cannot be moved"
        )


def at_rest(document: Document, resolved: ResolvedScene) -> Document:
    """The document whose shank starts at rest on its spring; `resolved` is the document, loaded."""
    shank, frame = shank_and_frame(resolved.scene)
    mechanism = resolved.scene.mechanism
    rest = rest_angle_rad(resolved.scene)
    if mechanism is None or rest is None:
        return document
    found = copy.deepcopy(document)
    tilt = start_places(resolved)[frame][2] - mechanism.bodies[frame].angle_rad
    coordinates = found["mechanism"].setdefault("initial", {}).setdefault("coordinates", {})
    coordinates[f"{shank}.angle_rad"] = mechanism.bodies[shank].angle_rad + tilt + rest
    return found
