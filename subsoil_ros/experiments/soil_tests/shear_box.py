"""A split box around a specimen of soil, as a scene: its meshes, its machine, its loading.

The box is a lower and an upper frame of four walls, with a plate below and one above. For direct shear the
upper frame with its lid is loaded and driven along x; for tension it is lifted. Its surfaces grip the soil.
Over a plate of metal there is no lower frame, and nothing grips.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import NDArray

from ...contact_laws.base import PairValues
from ...scene.pairs import pair_values, size_ratio
from ...scene.soil import Soil
from ...yaml_document import Document

GLUE = 10.0
"""Largest attraction of the box over that of a pair of particles: the soil breaks, not the grip."""


FOLLOWER = 4.0
"""Mass of the follower at the other end of the lid's damper over that of the lid: it stays behind the quick
motion of a lid on its contacts, and catches up with a slow one within some milliseconds."""


@dataclass(frozen=True)
class ShearBox:
    """Faces of the specimen and of the box around it, world axes [m]."""

    lower_m: tuple[float, float, float]  # inner faces: rear wall, right wall, floor
    upper_m: tuple[float, float, float]  # inner faces: front wall, left wall, underside of the lid
    wall_m: float  # thickness of walls and plates
    gap_m: float  # between the two frames, about half height

    @property
    def length_m(self) -> float:
        """Along x, the direction of shear."""
        return self.upper_m[0] - self.lower_m[0]

    @property
    def width_m(self) -> float:
        """Along y."""
        return self.upper_m[1] - self.lower_m[1]

    @property
    def height_m(self) -> float:
        """Along z, from floor to lid."""
        return self.upper_m[2] - self.lower_m[2]

    @property
    def middle_m(self) -> float:
        """Height of the plane of shear."""
        return 0.5 * (self.lower_m[2] + self.upper_m[2])

    @property
    def area_m2(self) -> float:
        """Area of the specimen's section."""
        return self.length_m * self.width_m

    @property
    def over_plate(self) -> bool:
        """Whether the upper frame reaches past the floor: it holds all the soil, and the floor is a plate."""
        return self.gap_m < -self.height_m

    @property
    def part_above(self) -> float:
        """Part of the soil above the plane of shear."""
        return 1.0 if self.over_plate else 0.5

    def section_m2(self, displacement_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Area of the plane of shear after a shear displacement; over a plate, which is longer, all of it."""
        lost = 0.0 if self.over_plate else 1.0
        return (self.length_m - lost * displacement_m) * self.width_m

    @property
    def frame_height_m(self) -> float:
        """Height of each frame: the lower one reaches down past the floor, the upper one up past the lid."""
        return 0.5 * (self.height_m - self.gap_m) + self.wall_m

    @property
    def centre_m(self) -> tuple[float, float]:
        """Centre of the specimen, x and y."""
        return 0.5 * (self.lower_m[0] + self.upper_m[0]), 0.5 * (self.lower_m[1] + self.upper_m[1])


def frame_mesh(box: ShearBox, height_m: float) -> trimesh.Trimesh:
    """Four walls, closed; centred in x and y, z from 0 to `height_m`."""
    half = np.array([0.5 * box.length_m, 0.5 * box.width_m])
    corners = np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])
    inner, outer = corners * half, corners * (half + box.wall_m)
    rings = [
        np.column_stack([ring, np.full(4, z)]) for z in (0.0, height_m) for ring in (outer, inner)
    ]  # outer and inner below, outer and inner above: corners 0, 4, 8, 12 on
    facets = []
    for i in range(4):
        j = (i + 1) % 4
        for a, b, c, d in (
            (i, j, 8 + j, 8 + i),  # outside
            (4 + j, 4 + i, 12 + i, 12 + j),  # inside
            (8 + i, 8 + j, 12 + j, 12 + i),  # top
            (4 + i, 4 + j, j, i),  # bottom
        ):
            facets += [(a, b, c), (a, c, d)]
    return trimesh.Trimesh(np.concatenate(rings), np.array(facets), process=False)


def plate_mesh(box: ShearBox) -> trimesh.Trimesh:
    """Floor or lid: reaches half way into the walls; centred in x and y, z from 0 to `wall_m`."""
    mesh = trimesh.creation.box((box.length_m + box.wall_m, box.width_m + box.wall_m, box.wall_m))
    mesh.apply_translation((0.0, 0.0, 0.5 * box.wall_m))
    return mesh


def write_meshes(box: ShearBox, folder: Path) -> None:
    """Write frame.stl and plate.stl."""
    frame_mesh(box, box.frame_height_m).export(folder / "frame.stl")
    plate_mesh(box).export(folder / "plate.stl")


def _places(box: ShearBox) -> dict[str, list[float]]:
    """Positions of the copies of the two meshes: x, y, z [m], y relative to the body."""
    x = box.centre_m[0]  # y: of the body, which stands in the middle
    heights = {
        "floor": box.lower_m[2] - box.wall_m,
        "lower": box.middle_m - 0.5 * box.gap_m - box.frame_height_m,
        "upper": box.middle_m + 0.5 * box.gap_m,
        "lid": box.upper_m[2],
    }
    return {name: [x, 0.0, z] for name, z in heights.items()}


def _tool(box: ShearBox, body: str, frame: str | None, plate: str | None) -> Document:
    places = _places(box)
    groups = {}
    if frame is not None:
        groups["walls"] = {"mesh": "frame.stl", "position_m": places[frame]}
    if plate is not None:
        groups["plate"] = {"mesh": "plate.stl", "position_m": places[plate]}
    return {"body": body, "lateral_m": box.centre_m[1], "groups": groups}


def _body(box: ShearBox, mass_kg: float, z_m: float) -> Document:
    """A body at rest that never turns: its inertia has no effect."""
    return {
        "mass_kg": mass_kg,
        "inertia_kg_m2": mass_kg * box.length_m**2,
        "position_m": [box.centre_m[0], z_m],
        "velocity_m_per_s": [0.0, 0.0],
    }


@dataclass(frozen=True)
class ShearLoading:
    """Loading of the specimen in direct shear."""

    normal_pa: float  # held on the section that is left
    load_newton: float  # on the lid before it moves, its weight included
    lid_mass_kg: float
    lid_damping_newton_s_per_m: float  # of its motion along z
    load_s: float  # duration of the rise of the load, and again of its rest
    speed_m_per_s: float
    travel_m: float

    @property
    def start_s(self) -> float:
        """Time at which the upper frame begins to move."""
        return 2.0 * self.load_s

    @property
    def duration_s(self) -> float:
        """Of the whole test; the speed grows over a twentieth of the travel."""
        return self.start_s + 1.025 * self.travel_m / self.speed_m_per_s


def shear_machine(box: ShearBox, loading: ShearLoading, gravity_m_per_s2: float) -> Document:
    """`mechanism` and `tools` of a direct shear test, or of one over a plate.

    The lid is one body with the upper frame, which is free to rise and sink: so what the walls put on the
    soil along z does not change the load on the plane of shear (R. A. Jewell, Geotechnique 39 (1989)
    309-322, has the load pad fixed to the upper half for this). The load falls with the section, so that the
    normal stress stays. The lid's damper ends at a weightless follower that is free along z: it damps quick
    motion of the lid, and bears nothing while the lid rises steadily.
    """
    start, x = loading.start_s, box.centre_m[0]
    rise = 0.05 * loading.travel_m / loading.speed_m_per_s
    reached = 0.5 * loading.speed_m_per_s * rise  # displacement when the speed is reached

    lost_m2 = box.area_m2 - box.section_m2(np.array([0.0, 0.0, reached, loading.travel_m]))
    push = loading.lid_mass_kg * gravity_m_per_s2 - loading.load_newton + loading.normal_pa * lost_m2
    load = {
        "kind": "table",
        "times_s": [0.0, loading.load_s, start, start + rise, loading.duration_s],
        "values": [0.0, *push.tolist()],
    }
    point, above = [x, box.middle_m], [x, box.middle_m + box.height_m]
    follower_kg = FOLLOWER * loading.lid_mass_kg
    return {
        "mechanism": {
            "bodies": {
                "lower": _body(box, 1.0, box.middle_m),
                "carriage": _body(box, 1.0, box.middle_m),
                "upper": _body(box, loading.lid_mass_kg, box.middle_m),
                "follower": _body(box, follower_kg, above[1]),
            },
            "joints": {
                "base": {"kind": "fixed", "body_a": "ground", "body_b": "lower", "point_m": point},
                "rail": {
                    "kind": "prismatic", "body_a": "ground", "body_b": "carriage", "point_m": point,
                    "axis": [1.0, 0.0],
                },
                "mast": {
                    "kind": "prismatic", "body_a": "carriage", "body_b": "follower", "point_m": above,
                    "axis": [0.0, 1.0],
                },
                "guide": {
                    "kind": "prismatic", "body_a": "carriage", "body_b": "upper", "point_m": point,
                    "axis": [0.0, 1.0],
                },
                "drive": {
                    "kind": "driver", "body": "carriage", "coordinate": "x",
                    "speed": {
                        "kind": "table", "times_s": [start, start + rise],
                        "values": [0.0, loading.speed_m_per_s],
                    },
                },
            },
            "forces": {
                "load": {
                    "kind": "point_load", "body": "upper", "point_m": point,
                    "force_z_newton": load,
                },
                "damper": {
                    "kind": "spring_damper", "body_a": "upper", "point_a_m": point,
                    "body_b": "follower", "point_b_m": above, "free_length_m": box.height_m,
                    "stiffness_newton_per_m": 0.0,
                    "damping_newton_s_per_m": loading.lid_damping_newton_s_per_m,
                },
                "lift": {
                    "kind": "point_load", "body": "follower", "point_m": above,
                    "force_z_newton": {"kind": "constant", "value": follower_kg * gravity_m_per_s2},
                },
            },
            "draft_driver": "drive",
        },
        "tools": {
            "lower": _tool(box, "lower", None if box.over_plate else "lower", "floor"),
            "upper": _tool(box, "upper", "upper", "lid"),
        },
    }  # fmt: skip


@dataclass(frozen=True)
class TensionLoading:
    """Loading of the specimen in tension."""

    rest_s: float  # rest before the pull, in which the glue attaches
    speed_m_per_s: float
    travel_m: float

    @property
    def duration_s(self) -> float:
        """Of the whole test; the speed grows over a twentieth of the travel."""
        return self.rest_s + 1.025 * self.travel_m / self.speed_m_per_s


def tension_machine(box: ShearBox, loading: TensionLoading) -> Document:
    """`mechanism` and `tools` of a tension test: the upper frame and its lid are lifted."""
    point = [box.centre_m[0], box.middle_m]
    rise = 0.05 * loading.travel_m / loading.speed_m_per_s
    return {
        "mechanism": {
            "bodies": {
                "lower": _body(box, 1.0, box.middle_m),
                "upper": _body(box, 1.0, box.middle_m),
            },
            "joints": {
                "base": {"kind": "fixed", "body_a": "ground", "body_b": "lower", "point_m": point},
                "rail": {
                    "kind": "prismatic", "body_a": "ground", "body_b": "upper", "point_m": point,
                    "axis": [0.0, 1.0],
                },
                "drive": {
                    "kind": "driver", "body": "upper", "coordinate": "z",
                    "speed": {
                        "kind": "table", "times_s": [loading.rest_s, loading.rest_s + rise],
                        "values": [0.0, loading.speed_m_per_s],
                    },
                },
            },
        },
        "tools": {
            "lower": _tool(box, "lower", "lower", "floor"),
            "upper": _tool(box, "upper", "upper", "lid"),
        },
    }  # fmt: skip


def gripping_law(soil: Soil) -> Document:
    """The soil's law with a boundary that is glued to the soil, if it is wet and has adhesion; else as it is.

    Under plain walls a strong soil slides out of the box as a block instead of shearing. A glued law comes
    as pair values of the law's own radius: `particles.reference_radius_m` scales them as it does the others.
    """
    law = soil.law.model_dump(mode="json")
    pair, boundary = (values.scaled(1.0 / size_ratio(soil)) for values in pair_values(soil))
    if pair.adhesion == 0.0:
        return law
    glued = replace(boundary, adhesion=GLUE * pair.peak_attraction / boundary.reach)
    return law | {"combining_rule": "none", "particle": _row(pair), "boundary": _row(glued)}


def cemented_layers(soil: Soil, floor_m: float, cap_m: float) -> list[Document]:
    """`layers` of a scene under the gripping law: one at the lid, one at the floor, the soil between them.

    The bed assigns the particles to layers; thicknesses are only checked.
    """
    pair = pair_values(soil)[0].scaled(1.0 / size_ratio(soil))
    row = {"cohesive_stiffness_newton_per_m": GLUE * pair.adhesion}
    law: Document = {"kind": soil.law.kind, "particle": row}
    return [
        {"name": "lid", "thickness_m": cap_m, "law": law},
        {"name": "soil", "thickness_m": -floor_m - 2.0 * cap_m},
        {"name": "floor", "law": law},
    ]


def _row(values: PairValues) -> Document:
    return {
        "stiffness_newton_per_m": values.stiffness,
        "tangential_stiffness_newton_per_m": values.tangential_stiffness,
        "damping_newton_s_per_m": values.damping,
        "tangential_damping_newton_s_per_m": values.tangential_damping,
        "cohesive_stiffness_newton_per_m": values.adhesion,
        "static_friction": values.static_friction,
        "sliding_friction": values.sliding_friction,
        "rolling_friction": values.rolling_friction,
        "twisting_friction": values.twisting_friction,
        "equilibrium_overlap_m": values.rest_overlap,
        "cohesion_range_m": values.reach,
    }
