"""Columns of series.csv: their names, which end in the unit, and how a row follows from a tick's records.

`Body("shank").angle_rad` is the name of a column. Each class lists the columns of one kind of part in their
order, and a column is the field of its name in the part's record (messages.py): a new column is a new line.
"""

from collections.abc import Iterable, Iterator
from inspect import get_annotations
from typing import Any, ClassVar, NamedTuple

from ..messages import (
    CouplingReport,
    MechanismState,
    SoilState,
    SpatialMotion,
    ToolMotions,
    ToolWrench,
    ToolWrenches,
)
from ..scene.mechanism import CoordinateSpring, Mechanism, Revolute, SpringDamper, TorsionSpring
from ..scene.scene import Scene

Cells = Iterator[tuple[str, int | float]]
"""Columns and their values in one row."""

TIME = "time_s"
"""End of the tick."""

DRAFT = "draft_newton"
"""Pull along travel: of mechanism.draft_driver, without one of all tools."""

DRAFT_OF_SHARES = "draft.share_newton"
"""Pull of the tillage tools alone."""

DRAFT_OF_WHEELS = "draft.wheels_newton"


def draft_of_tool(name: str) -> str:
    """Pull of one of several tillage tools."""
    return f"draft.tool.{name}_newton"


def draft_parts(scene: Scene) -> dict[str, str]:
    """Columns of the parts of the draft that a run may have, in words, without any that is all of it."""
    driven = scene.mechanism is not None and scene.mechanism.draft_driver is not None
    rolls = any(not tool.is_tillage for tool in scene.tools.values())
    shares = {DRAFT_OF_SHARES: "of it tillage tools"} if driven or rolls else {}
    single = {draft_of_tool(tool): f"  of it {tool}" for tool in scene.tools}
    return {**shares, **single, DRAFT_OF_WHEELS: "of it wheels"}


class _Part:
    """Names of the columns KIND.NAME.FIELD, a field for each that a subclass and its bases declare."""

    _kind: ClassVar[str]
    _fields: ClassVar[tuple[str, ...]] = ()

    def __init_subclass__(cls, kind: str = "") -> None:
        cls._kind = kind
        cls._fields += tuple(get_annotations(cls))

    def __init__(self, *names: str | None) -> None:
        for field in self._fields:
            setattr(self, field, ".".join(map(str, (self._kind, *names, field))))

    def cells(self, record: object) -> Cells:
        """Columns with their values in a record."""
        return ((column, getattr(record, field)) for field, column in vars(self).items())


class _PlanarMotion(_Part):
    """Centre of mass in the plane of travel; angle about -y."""

    x_m: str
    z_m: str
    angle_rad: str
    velocity_x_m_per_s: str
    velocity_z_m_per_s: str
    angular_velocity_rad_per_s: str


class Body(_PlanarMotion, kind="body"):
    """A body of the mechanism."""

    acceleration_x_m_per_s2: str
    acceleration_z_m_per_s2: str
    angular_acceleration_rad_per_s2: str


class PlanarTool(_PlanarMotion, kind="tool"):
    """Motion of a tool in the plane."""


class SpatialTool(_Part, kind="tool"):
    """Motion of a tool in six degrees of freedom."""

    x_m: str
    y_m: str
    z_m: str
    velocity_x_m_per_s: str
    velocity_z_m_per_s: str
    velocity_y_m_per_s: str
    quaternion_x: str
    quaternion_y: str
    quaternion_z: str
    quaternion_w: str
    angular_velocity_x_rad_per_s: str
    angular_velocity_z_rad_per_s: str
    angular_velocity_y_rad_per_s: str


class FacetGroup(_Part, kind="tool"):
    """Force of the soil on one facet group of a tool: FacetGroup(TOOL, GROUP)."""

    force_x_newton: str
    force_y_newton: str
    force_z_newton: str


class Wrench(FacetGroup, kind="tool"):
    """Soil on a tool, about its centre of mass."""

    torque_x_newton_m: str
    torque_y_newton_m: str
    torque_z_newton_m: str
    contact_count: str


class Joint(_Part, kind="joint"):
    """Reaction of a joint on its second body; of a driver, on the driven body."""

    force_x_newton: str
    force_z_newton: str
    moment_newton_m: str


class _Mechanism(_Part, kind="mechanism"):
    """The whole mechanism; work and dissipation since the start."""

    kinetic_energy_joule: str
    gravity_energy_joule: str
    spring_energy_joule: str
    dissipated_joule: str
    driver_work_joule: str
    external_work_joule: str
    position_residual_m: str
    velocity_residual_m_per_s: str
    energy_residual_joule: str
    part_count: str


class _Soil(_Part, kind="soil"):
    """Soil of particles; lost, broken and rebuild counts since the start."""

    particle_count: str
    contact_count: str
    lost_particle_count: str
    broken_bond_count: str
    rebuild_count: str
    kinetic_energy_joule: str
    rms_speed_m_per_s: str
    rms_angular_velocity_rad_per_s: str
    max_overlap_m: str
    max_tool_overlap_m: str


class _Coupling(_Part, kind="coupling"):
    """Interface account since the start. Wall time is no column: it differs between equal runs."""

    residual_joule: str
    absolute_work_joule: str
    residual_ratio: str


MECHANISM, SOIL, COUPLING = _Mechanism(), _Soil(), _Coupling()


class ForceElement(NamedTuple):
    """Columns of a force element, as ForceState has their values."""

    load: str
    coordinate: str
    rate: str


def spring_element(name: str | None) -> ForceElement:
    """A spring between two points: axial force, compression positive, length and its rate."""
    return _along("spring", name, "length_m")


def force_element(mechanism: Mechanism, name: str) -> ForceElement:
    """A force element of any kind; also JOINT.friction and JOINT.stops."""
    force = mechanism.forces.get(name)
    match force:
        case None:
            if isinstance(mechanism.joints[name.rpartition(".")[0]], Revolute):
                return _about("joint", name)
            return _along("joint", name, "distance_m")
        case SpringDamper():
            return spring_element(name)
        case TorsionSpring() | CoordinateSpring(coordinate="angle"):
            return _about(force.kind, name)
        case CoordinateSpring():
            return _along(force.kind, name, f"{force.coordinate}_m")
    return _along(force.kind, name, "penetration_m" if force.kind == "wheel_contact" else "distance_m")


def _along(kind: str, name: str | None, coordinate: str) -> ForceElement:
    prefix = f"{kind}.{name}"
    return ForceElement(f"{prefix}.force_newton", f"{prefix}.{coordinate}", f"{prefix}.rate_m_per_s")


def _about(kind: str, name: str) -> ForceElement:
    prefix = f"{kind}.{name}"
    return ForceElement(f"{prefix}.moment_newton_m", f"{prefix}.angle_rad", f"{prefix}.rate_rad_per_s")


def tick_cells(scene: Scene, records: dict[type, Any]) -> Cells:
    """Columns and values of a tick from its records, by type."""
    report: CouplingReport = records[CouplingReport]
    yield TIME, report.end_time_ns * 1e-9
    state: MechanismState | None = records.get(MechanismState)
    wrenches: ToolWrenches | None = records.get(ToolWrenches)
    yield from _draft(scene, state, wrenches)
    if state is not None and scene.mechanism is not None:
        yield from _mechanism(scene.mechanism, state)
    yield from _tools(records[ToolMotions], wrenches)
    soil: SoilState | None = records.get(SoilState)
    if soil is not None and scene.particle_soil is not None:  # a wedge model has no such columns
        yield from SOIL.cells(soil)
    yield from COUPLING.cells(report)


def draft_of(tools: Iterable[ToolWrench]) -> float:
    """Draft of tools [N]: the pull along +x, so minus the soil's force."""
    return -sum(tool.force_x_newton for tool in tools)


def _draft(scene: Scene, state: MechanismState | None, wrenches: ToolWrenches | None) -> Cells:
    """Draft, and its parts by kind of tool, and by shank where there are several."""
    tools = wrenches.tools if wrenches is not None else ()
    if state is not None and scene.mechanism is not None and scene.mechanism.draft_driver is not None:
        yield DRAFT, state.draft_newton
    elif tools:
        yield DRAFT, draft_of(tools)
    shares = [tool for tool in tools if scene.tools[tool.tool].is_tillage]
    wheels = [tool for tool in tools if not scene.tools[tool.tool].is_tillage]
    if shares:
        yield DRAFT_OF_SHARES, draft_of(shares)
    if len(shares) > 1:  # several shanks side by side
        yield from ((draft_of_tool(tool.tool), -tool.force_x_newton) for tool in shares)
    if wheels:
        yield DRAFT_OF_WHEELS, draft_of(wheels)


def _mechanism(mechanism: Mechanism, state: MechanismState) -> Cells:
    for force in state.forces:
        values = (force.load, force.coordinate, force.rate)
        yield from zip(force_element(mechanism, force.name), values, strict=True)
    for body in state.bodies:
        yield from Body(body.name).cells(body)
    for joint in state.joints:
        yield from Joint(joint.name).cells(joint)
    yield from MECHANISM.cells(state)


def _tools(motions: ToolMotions, wrenches: ToolWrenches | None) -> Cells:
    answers = wrenches.tools if wrenches is not None else ()
    for motion, wrench in zip(motions.tools, answers, strict=True):
        kind = SpatialTool if isinstance(motion, SpatialMotion) else PlanarTool
        yield from kind(motion.tool).cells(motion)
        yield from Wrench(motion.tool).cells(wrench)
        for group in wrench.groups:
            yield from FacetGroup(motion.tool, group.group).cells(group)
