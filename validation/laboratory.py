"""Small soils, tools and machines for the cases."""

import copy
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import trimesh
import yaml

from subsoil_ros.dem.build import build_engine
from subsoil_ros.dem.engine import SoilEngine
from subsoil_ros.loading.loader import ResolvedScene, load_scene
from subsoil_ros.mbd.mechanism_engine import MechanismEngine
from subsoil_ros.messages import ToolMotion

RADIUS, DENSITY, GRAVITY = 0.01, 1800.0, 9.81
MASS = DENSITY * 4.0 / 3.0 * math.pi * RADIUS**3

NEGLIGIBLE = 1e-20
"""A stiffness [N/m] or friction whose code is compiled and that has no effect: far below round-off of others.
In place of 0, so that cases share compiled kernels."""

Document = dict[str, Any]

WET_PARTICLE = {
    "stiffness_newton_per_m": 10_000.0,
    "tangential_stiffness_newton_per_m": 8_000.0,
    "damping_newton_s_per_m": 20.0,
    "tangential_damping_newton_s_per_m": 20.0,
    "cohesive_stiffness_newton_per_m": 7_000.0,
    "static_friction": 0.5,
    "sliding_friction": 0.5,
    "rolling_friction": 0.3,
    "equilibrium_overlap_m": 0.002,
    "cohesion_range_m": 0.002,
}
WET_BOUNDARY = WET_PARTICLE | {
    "stiffness_newton_per_m": 16_000.0,
    "tangential_stiffness_newton_per_m": 12_000.0,
    "cohesive_stiffness_newton_per_m": 3_000.0,
}
"""Table 3 of the paper, with all parts of the law `cohesive_linear`."""


def wet(**values: float) -> Document:
    """The paper's law; `values` change both of its rows."""
    return {"kind": "cohesive_linear", "particle": WET_PARTICLE | values, "boundary": WET_BOUNDARY | values}


def linear(stiffness: float, **values: float) -> Document:
    """Springs and dashpots, the same at boundaries: smooth and undamped but for `values`."""
    row = {
        "stiffness_newton_per_m": stiffness, "tangential_stiffness_newton_per_m": NEGLIGIBLE,
        "damping_newton_s_per_m": 0.0, "tangential_damping_newton_s_per_m": 0.0,
        "static_friction": 0.0, "sliding_friction": 0.0, "rolling_friction": NEGLIGIBLE, **values,
    }  # fmt: skip
    return {"kind": "linear", "particle": row, "boundary": row}


def box_mesh(folder: Path, x_m: float, y_m: float, z_m: float, subdivide: int = 0) -> str:
    """STL in `folder` of a box about its centre; every facet cut in four, so many times."""
    mesh = trimesh.creation.box((x_m, y_m, z_m))
    for _ in range(subdivide):
        mesh = mesh.subdivide()
    path = folder / f"box_{x_m}_{y_m}_{z_m}_{subdivide}.stl"
    mesh.export(path)
    return str(path)


@dataclass
class Laboratory:
    """Writes scenes into a folder and loads them as a user's."""

    folder: Path

    def resolve(self, document: Document) -> ResolvedScene:
        """A whole scene."""
        path = self.folder / f"scene_{len(list(self.folder.iterdir()))}.yaml"
        path.write_text(yaml.safe_dump(copy.deepcopy(document), sort_keys=False))
        return load_scene(path)

    def soil(
        self,
        law: Document | None = None,
        size_m: tuple[float, float, float] = (0.12, 0.1, 0.1),
        gravity: float = GRAVITY,
        tool: str | None = None,
        allow: Sequence[str] = (),
        **soil: Any,
    ) -> ResolvedScene:
        """A bin of this size with a grid at rest under the paper's law; `soil` has further keys of it.

        tool: mesh of a tool named `tool`. allow: key of the scene.
        """
        length, width, depth = size_m
        document: Document = {
            "name": "extreme",
            "duration_s": 1000.0,
            "gravity_m_per_s2": gravity,
            "allow": list(allow),
            "soil": {
                "bin": {"length_m": length, "width_m": width, "depth_m": depth},
                "particles": {"radius_m": RADIUS, "density_kg_per_m3": DENSITY},
                "bed": {"kind": "grid", "spacing_m": "rest"},
                "law": law or wet(),
                **soil,
            },
        }
        if tool is not None:
            document["tools"] = {"tool": {"path": {}, "groups": {"all": {"mesh": tool}}}}
        return self.resolve(document)

    def box(self, x_m: float, y_m: float, z_m: float, subdivide: int = 0) -> str:
        """As box_mesh, in the laboratory's folder."""
        return box_mesh(self.folder, x_m, y_m, z_m, subdivide)

    def machine(
        self, mechanism: Document, communication_step_ns: int, gravity: float = GRAVITY, **more: Any
    ) -> MechanismEngine:
        """The engine of a machine without soil; `more` are further keys of the scene."""
        coupling = {"communication_step_ns": communication_step_ns, **more.pop("coupling", {})}
        resolved = self.resolve(
            {"name": "extreme", "duration_s": 1e4, "gravity_m_per_s2": gravity, "mechanism": mechanism,
             "coupling": coupling, **more}
        )  # fmt: skip
        return MechanismEngine(resolved.scene, resolved.timing)


def tool_at(x_m: float, z_m: float, speed_m_per_s: float = 0.0) -> tuple[ToolMotion, ...]:
    """The tool of a scene of `Laboratory.soil`."""
    return (ToolMotion("tool", x_m, 0.0, z_m, 0.0, speed_m_per_s, 0.0, 0.0),)


def advance(engine: SoilEngine, steps: int, motions: tuple[ToolMotion, ...] = ()) -> None:
    """`steps` ticks with the tools standing still."""
    for tick in range(steps):
        engine.advance(tick, motions)


def placed(
    resolved: ResolvedScene,
    position_m: Sequence[Sequence[float]],
    velocity_m_per_s: Sequence[Sequence[float]],
) -> SoilEngine:
    """An engine with these particles in the place of the bed, and an energy book, started."""
    engine = build_engine(resolved, book=True)
    engine.place(position_m, velocity_m_per_s)  # type: ignore[arg-type]
    engine.start(())
    return engine


@dataclass
class Drag:
    """What a tool met on its way."""

    engine: SoilEngine
    forces_newton: list[float]  # along x, on the tool, step by step
    defect: float  # of the energy book, over the energy exchanged; 0 without a book

    @property
    def mean_newton(self) -> float:
        """Of the second half of the way."""
        half = self.forces_newton[len(self.forces_newton) // 2 :]
        return sum(half) / len(half)


def drag(
    engine: SoilEngine,
    step_s: float,
    duration_s: float,
    speed: Callable[[float], float],
    start_m: tuple[float, float] = (0.06, -0.03),
    book: bool = True,
) -> Drag:
    """Moves the tool from `start_m` along x at `speed` (time [s]) [m/s], by the trapezoid rule."""
    (x, z), last = start_m, speed(0.0)
    engine.start(tool_at(x, z))
    begin = engine.energy() if book else None
    largest, forces = 0.0, []
    for tick in range(round(duration_s / step_s)):
        now = speed((tick + 1) * step_s)
        x += 0.5 * step_s * (last + now)
        last = now
        forces.append(engine.advance(tick, tool_at(x, z, now))[0].force_x_newton)
        if book and tick % 200 == 0:
            largest = max(largest, engine.energy().kinetic_joule)
    if begin is None:
        return Drag(engine, forces, 0.0)
    end = engine.energy()
    exchanged = end.turned_over_joule + max(largest, end.kinetic_joule)
    defect = abs(end.total_joule - begin.total_joule) / exchanged if exchanged > 0.0 else 0.0
    return Drag(engine, forces, defect)
