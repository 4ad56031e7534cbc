"""Check a scene: size, limits and cost of a run, without running it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ..coupling.external import Machine, effective_masses_kg
from ..errors import SceneError
from ..limits.communication_steps import CouplingBound, coupling_bounds
from ..limits.soil_at_work import Finding, soil_at_work
from ..limits.stable_steps import StepLimit, step_limits, step_notes
from ..loading.loader import ResolvedScene
from ..loading.soil_file import soil_of
from ..scene.scene import Scene
from ..scene.tool_mesh import ToolMesh, load_tool_mesh
from .load import SceneLike, resolved_scene
from .plausible import implausible

if TYPE_CHECKING:
    from ..mbd.statics import Survey

BYTES_PER_PARTICLE = 600
"""State, neighbour list and contact history of one particle."""

BYTES_OF_PROCESS = 250e6
"""A Python process with the compiled kernels (measured)."""

PARTICLE_STEPS_PER_S = 6.0e6
"""One core, float64, all features of the law `cohesive_linear` (measured: 7.2e6 on a free core)."""

LOCKSTEP_S_PER_TICK, WITH_PARTICLES_S_PER_TICK = 4.0e-4, 2.5e-3
"""Exchange of one tick between processes, wall time (rough), without and with particles, which evict the
nodes from the caches (measured on two cores: 1.7 and 3.1 ms, benchmarks/README.md)."""


@dataclass(frozen=True)
class Cost:
    """Rough estimate of memory and wall time of a run."""

    memory_bytes: float  # of the process with the soil, or of the direct run
    process_bytes: float  # of every further process, where nodes are processes
    soil_wall_s: float  # of the soil on one core; 0 without particles
    exchange_wall_s: float  # of the exchange between processes; a direct run has none


@dataclass(frozen=True)
class CheckResult:
    """Size, limits and cost of a run of a scene.

    Attributes:
        scene: the scene as it would run.
        particles: number of particles before tools remove any; about so many for a dense random bed.
        limits: every stable soil step [s] with its cause, the smallest first; empty without particles.
        at_work: overlap, damping and inertial number of particles while a tool works; empty without.
        coupling: longest communication interval [s] of every tool that a body carries.
        mechanism: topology, static equilibrium and modes; None without a mechanism.
        cost: memory and wall time.
        notes: messages that a run prints before it begins.
        warnings: conditions that may make the result wrong.
    """

    scene: ResolvedScene
    particles: int
    limits: tuple[StepLimit, ...]
    at_work: tuple[Finding, ...]
    coupling: tuple[CouplingBound, ...]
    mechanism: Survey | None
    cost: Cost
    notes: tuple[str, ...]
    warnings: tuple[str, ...]

    def __str__(self) -> str:
        return "\n".join(self._lines())

    def _lines(self) -> Iterator[str]:
        timing, scene = self.scene.timing, self.scene.scene
        ticks = f"{timing.tick_count:,} ticks of {timing.communication_step_ns:,} ns"
        yield f"{scene.name}: {scene.duration_s:g} s, {ticks}"
        yield f"particles: {self.particles:,}"
        for limit in self.limits[:1]:
            yield (
                f"soil step: {timing.soil_step_s * 1e6:.4g} us, {timing.soil_steps} per tick; stable up to "
                f"{limit.limit_s * 1e6:.4g} us ({limit.cause})"
            )
        yield from (f"{found.name}: {found.text}" for found in self.at_work)
        for bound in self.coupling:
            yield (
                f"coupling of tool '{bound.tool}': stable up to {bound.unstable_s * 1e6:.4g} us, "
                f"undamped up to {bound.undamped_s * 1e6:.4g} us"
            )
        cost = self.cost
        yield (
            f"cost: {cost.memory_bytes / 1e9:.2f} GB; wall time about {cost.soil_wall_s:.3g} s for the soil "
            f"on one core, and {cost.exchange_wall_s:.3g} s of exchange where the nodes are processes"
        )
        yield from self.notes
        yield from (f"warning: {warning}" for warning in self.warnings)


def check(
    scene: SceneLike | ResolvedScene,
    overrides: Mapping[str, object] | None = None,
    *,
    machine: Machine | None = None,
) -> CheckResult:
    """Validate a scene and estimate what a run of it costs, without running it.

    Args:
        scene: as load_scene takes it, or gives it.
        overrides: as in load_scene.
        machine: an external one; its effective_mass_kg gives the bounds on the communication step.

    Returns:
        Particles, limits, cost and warnings; `print` shows them.

    Raises:
        SceneError: whatever would stop a run before its first tick.
    """
    resolved = resolved_scene(scene, overrides)
    model, survey = resolved.scene, None
    masses = effective_masses_kg(resolved, machine)
    try:
        if model.mechanism is not None:
            from ..mbd.statics import survey as survey_of

            survey = survey_of(model.mechanism, model.gravity_m_per_s2)
        bounds = _bounds(resolved, masses)
        particles = start_count(resolved)
        doubts = implausible(resolved)
    except SceneError as error:
        raise SceneError(f"{resolved.path}: {error}") from error
    soil, timing = model.particle_soil, resolved.timing
    exchange_s = LOCKSTEP_S_PER_TICK if soil is None else WITH_PARTICLES_S_PER_TICK
    return CheckResult(
        scene=resolved,
        particles=particles,
        limits=step_limits(soil) if soil is not None else (),
        at_work=soil_at_work(model, _meshes(resolved)),
        coupling=bounds,
        mechanism=survey,
        cost=Cost(
            memory_bytes=BYTES_OF_PROCESS + particles * BYTES_PER_PARTICLE,
            process_bytes=BYTES_OF_PROCESS,
            soil_wall_s=particles * timing.soil_steps * timing.tick_count / PARTICLE_STEPS_PER_S,
            exchange_wall_s=timing.tick_count * exchange_s,
        ),
        notes=(*run_notes(resolved), *_unbounded(model, masses)),
        warnings=(*_warnings(resolved, bounds), *doubts),
    )


def start_count(resolved: ResolvedScene) -> int:
    """Particles before tools remove any; 0 in other soils. Raises SceneError as check_start does."""
    if resolved.scene.particle_soil is None:
        return 0
    from ..dem.packing.start import check_start

    return check_start(resolved)


def run_notes(resolved: ResolvedScene) -> tuple[str, ...]:
    """Notes on a scene that are printed before it runs."""
    if resolved.scene.particle_soil is None:
        return resolved.notes
    found = soil_at_work(resolved.scene, _meshes(resolved))
    warnings = (f"warning: {number.warning}" for number in found if number.warning is not None)
    return (*resolved.notes, *step_notes(resolved.scene, resolved.timing.soil_step_s), *warnings)


def _meshes(resolved: ResolvedScene) -> dict[str, ToolMesh]:
    return {name: load_tool_mesh(resolved.directory, resolved.scene, name) for name in resolved.scene.tools}


def _unbounded(scene: Scene, masses: Mapping[str, float] | None) -> Iterator[str]:
    """Why there is no bound on the communication step."""
    if scene.external_soil:
        yield "coupling: no bound on the communication step: the stiffness of the soil is not known"
    elif scene.external_machine and masses is None:
        yield (
            "coupling: no bound on the communication step, which takes check(scene, machine=...) with a "
            "machine that has effective_mass_kg"
        )


def _bounds(resolved: ResolvedScene, masses: Mapping[str, float] | None) -> tuple[CouplingBound, ...]:
    scene = resolved.scene
    modulus = None
    if scene.wedge_soil is not None:
        modulus = soil_of(scene.wedge_soil).values.bed_modulus_newton_per_m3
    elif scene.terrain_soil is not None:
        modulus = scene.terrain_soil.values.bed_modulus_newton_per_m3
    bounds = coupling_bounds(scene, _meshes(resolved), modulus, masses)
    for bound in bounds:
        if resolved.timing.communication_step_s > bound.unstable_s:
            raise SceneError(
                f"coupling.communication_step_ns: {resolved.timing.communication_step_ns} is above the "
                f"stable limit {bound.unstable_s * 1e9:.0f} ns of tool '{bound.tool}' (effective mass "
                f"{bound.effective_mass_kg:.3g} kg under {bound.contact_count:.0f} contacts). "
                "Use 'auto', or less."
            )
    return bounds


def _warnings(resolved: ResolvedScene, bounds: tuple[CouplingBound, ...]) -> Iterator[str]:
    for bound in bounds:
        if resolved.timing.communication_step_s > bound.undamped_s:
            yield (
                f"coupling.communication_step_ns: {resolved.timing.communication_step_ns} is above "
                f"{bound.undamped_s * 1e9:.0f} ns for tool '{bound.tool}': the exchange outweighs the "
                "contact's damper and can fake vibration"
            )
