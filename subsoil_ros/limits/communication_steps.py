"""Bounds on the interval between exchanges of soil and mechanism, for each tool.

A force held over an interval H acts like negative damping. On a soil spring k with damper c under a mass m,
for k H^2 / m << 1, the exchange is stable where (age of the force) k <= c <= 2 m / H. The force that acts
within a tick is H / 2 old on average; a mean over n soil steps adds (n - 1) / (2 n) H. Contacts share one
law, k and c are its K and C times their number, so this lower bound does not depend on the number.

Where the mechanism predicts the motion of a tick, the force has no age. The mean of several steps is then
stable where k^2 H^3 / (3 m) <= c <= 0.8 m / H, for k H^2 <= m, and may be up to k H^2 = 2 m; the force of one
step where c <= 2 m / H - k H.
tests/physics/test_exchange_stability.py compares the bounds with the exact one-tick map.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ..scene.mechanism import Body
from ..scene.pair_laws import layer_soils, particle_spacing_m, tool_values
from ..scene.scene import Scene
from ..scene.soil import Soil
from ..scene.tool_faces import cutting_faces
from ..scene.tool_mesh import ToolMesh
from .stable_steps import Timing, derive_timing

PRESSED_PART = 0.5
"""Part of a tool's surface that presses on particles at once: the front half."""

DAMPER_SHARE = 2.0
"""c H / m up to which the exchange is stable without a spring. With the mean of n > 1 steps it would be the
smaller of 2 n and 2 n / (n - 1), never below 2."""

PREDICTED_SHARE = 0.8
"""The same where the mean force of a tick answers to a predicted motion."""

USED_PART = 0.8
"""Part of the bounds that a derived interval takes, so that a fifth of the contact's damper is left; with a
predicted motion, for which the damper has to grow with H^3, its cube root."""

REFERENCE_OVERLAP = 0.01
"""Overlap over radius at which a Hertzian contact is taken as linear: 16 times as much halves the bounds."""


@dataclass(frozen=True)
class CouplingBound:
    """Longest intervals for one tool [s]."""

    tool: str
    undamped_s: float  # above: the contact's damper no longer outweighs what the exchange adds
    unstable_s: float  # above: the exchange is unstable
    effective_mass_kg: float
    contact_count: float


def coupling_bounds(
    scene: Scene,
    meshes: dict[str, ToolMesh],
    bed_modulus_newton_per_m3: float | None = None,
    external_masses_kg: Mapping[str, float] | None = None,
    soil_steps: int | None = None,
) -> tuple[CouplingBound, ...]:
    """Bounds of every tool that a body carries, that rolls freely, or that a machine from outside moves;
    empty without a soil of this package.

    bed_modulus_newton_per_m3: of a wedge model, from its values or its file, or of a terrain.
    external_masses_kg: effective mass of each tool, as a machine from outside gives it.
    soil_steps: in an interval; None: those of the scene.

    The effective mass is that of the free body at its farthest point, 1 / (1/m + d^2/J): joints only add
    to it, so the estimate is on the safe side. Of a tool that rolls freely it is J / r^2, r being the largest
    distance from the axis. Of several layers the worst counts.
    """
    soil, masses = scene.particle_soil, external_masses_kg or _effective_masses_kg(scene, meshes)
    if scene.wedge_soil is not None and scene.moved_by_participant:
        assert bed_modulus_newton_per_m3 is not None
        return _wedge_bounds(scene, bed_modulus_newton_per_m3, meshes, masses)
    if scene.terrain_soil is not None and masses:
        assert bed_modulus_newton_per_m3 is not None
        return _terrain_bounds(bed_modulus_newton_per_m3, meshes, masses)
    if soil is None or not masses:
        return ()
    overlap = REFERENCE_OVERLAP * soil.particles.mean_volume_radius_m
    boundaries = [tool_values(layer).linear_at(overlap) for layer in layer_soils(soil)]
    relaxation = min(boundary.damping / boundary.stiffness for boundary in boundaries)
    stiffness = max(boundary.stiffness for boundary in boundaries)
    damping = max(boundary.damping for boundary in boundaries)
    soil_steps = soil_steps or derive_timing(scene).soil_steps
    age = force_age_ticks(scene.exchanged_force, soil_steps)
    found = []
    for name, mass in masses.items():
        count = _contact_count(soil, meshes[name])
        if scene.predicts_motion:
            limits = predicted_limits(mass, count * stiffness, count * damping, relaxation, soil_steps)
        else:
            limits = relaxation / age, DAMPER_SHARE * mass / (count * damping) if damping > 0.0 else np.inf
        found.append(CouplingBound(name, *limits, effective_mass_kg=mass, contact_count=count))
    return tuple(found)


def predicted_limits(
    mass: float, stiffness: float, damping: float, relaxation: float, soil_steps: int
) -> tuple[float, float]:
    """Longest intervals [s] with a predicted motion on a soil of this stiffness [N/m] and damping [N s/m]:
    that up to which a damper of stiffness times `relaxation` [s] is enough, and that of a stable exchange."""
    square, part = mass / stiffness, damping / stiffness
    if soil_steps == 1:
        return np.inf, float(0.5 * (np.sqrt(part**2 + 8.0 * square) - part))
    largest = PREDICTED_SHARE * mass / damping if damping > 0.0 else np.inf
    return float(np.cbrt(3.0 * relaxation * square)), min(largest, float(np.sqrt(2.0 * square)))


def longest_exchange_ns(scene: Scene, meshes: dict[str, ToolMesh], every_step: Timing) -> int:
    """The longest interval [ns] of whole soil steps, one at least, within USED_PART of every tool's bounds.

    every_step: of the scene with an exchange every soil step.
    """
    several = 2 if scene.predicts_motion else None
    bounds, step_ns = coupling_bounds(scene, meshes, soil_steps=several), every_step.communication_step_ns
    if not bounds:
        return step_ns
    undamped = min(bound.undamped_s for bound in bounds) * 1e9 / step_ns
    undamped *= np.cbrt(USED_PART) if scene.predicts_motion else USED_PART
    if scene.exchanged_force == "tick_mean":
        undamped = 0.5 * undamped + 0.5  # the force of n steps is (1 - 1 / (2 n)) H old, that of one H / 2
    unstable = USED_PART * min(bound.unstable_s for bound in bounds) * 1e9 / step_ns
    return max(1, int(min(undamped, unstable))) * step_ns


def force_age_ticks(force: str, soil_steps: int) -> float:
    """Mean age of the soil's force when it acts on the mechanism [ticks], for `Scene.exchanged_force`."""
    if force == "predicted":
        return 0.0
    return 0.5 + (0.5 * (soil_steps - 1) / soil_steps if force == "tick_mean" else 0.0)


def _effective_mass_kg(body: Body, mesh: ToolMesh) -> float:
    arm = float(np.linalg.norm(mesh.vertices_m[:, [0, 2]], axis=1).max())
    return 1.0 / (1.0 / body.mass_kg + arm**2 / body.inertia_kg_m2)


def _effective_masses_kg(scene: Scene, meshes: dict[str, ToolMesh]) -> dict[str, float]:
    """Those of every tool that the soil moves: on a body, or rolling freely about the axis of its path."""
    found = {}
    for name, tool in scene.tools.items():
        if tool.body is not None and scene.mechanism is not None:
            found[name] = _effective_mass_kg(scene.mechanism.bodies[tool.body], meshes[name])
        elif tool.inertia_kg_m2 is not None and tool.path is not None and tool.path.turn is not None:
            axis = np.array(tool.path.turn.axis)
            arms = np.cross(meshes[name].about_body().vertices_m, axis / np.linalg.norm(axis))
            found[name] = tool.inertia_kg_m2 / float(np.linalg.norm(arms, axis=1).max()) ** 2
    return found


def _wedge_bounds(
    scene: Scene, modulus: float, meshes: dict[str, ToolMesh], masses: Mapping[str, float]
) -> tuple[CouplingBound, ...]:
    """Bounds from the springs before shares and shanks: their damper is k H, so it outweighs the exchange at
    any H, up to that of a damper alone, k H = 2 m / H."""
    found, share = [], PREDICTED_SHARE if scene.predicts_motion else DAMPER_SHARE
    for name, mass in masses.items():
        if not scene.tools[name].is_tillage:
            continue
        faces = cutting_faces(meshes[name], f"tools.{name}")
        longest = float(np.sqrt(share * mass / (modulus * sum(face.area_m2 for face in faces))))
        found.append(CouplingBound(name, longest, longest, mass, float(len(faces))))
    return tuple(found)


def _terrain_bounds(
    modulus: float, meshes: dict[str, ToolMesh], masses: Mapping[str, float]
) -> tuple[CouplingBound, ...]:
    """Bounds from the springs before a tool's plates, as of a wedge model."""
    found = []
    for name, mass in masses.items():
        longest = float(np.sqrt(DAMPER_SHARE * mass / (modulus * _pressed_m2(meshes[name]))))
        found.append(CouplingBound(name, longest, longest, mass, 1.0))
    return tuple(found)


def _pressed_m2(mesh: ToolMesh) -> float:
    """Area of a tool's surface that is pressed at once."""
    corners = mesh.vertices_m[mesh.facets]
    sides = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    return PRESSED_PART * 0.5 * float(np.linalg.norm(np.cross(*sides), axis=1).sum())


def _contact_count(soil: Soil, mesh: ToolMesh) -> float:
    """Particles that press on a tool at once, one per spacing squared of its pressed surface."""
    return max(1.0, _pressed_m2(mesh) / particle_spacing_m(soil) ** 2)
