"""Design of a calibration, read from a file: scenes to run and numbers to find."""

import math
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from ..errors import InputError
from ..loading.loader import ResolvedScene, load_scene
from ..loading.validation import validated
from ..scene.bed_kinds import is_random
from ..scene.pair_laws import particle_spacing_m
from ..scene.wedge_soil import WheelSoil
from ..strict_model import Finite, Positive, StrictModel
from ..yaml_document import read_document

GOLDEN = ((math.sqrt(5.0) - 1.0) / 2.0, 0.7548776662466927)
"""Factors of the shifts of the tool against a regular bed: their multiples modulo 1 fill a square evenly."""


class Point(StrictModel):
    """One kind of run: the tip's depth, the speed, and how far the tool is turned (phi, nose down < 0)."""

    depth_m: Positive
    speed_m_per_s: Positive
    tilt_rad: Finite = 0.0
    replicates: Annotated[int, Field(ge=1)] = 1

    @property
    def name(self) -> str:
        """Name for tables and progress."""
        tilt = f", turned {math.degrees(self.tilt_rad):.0f} deg" if self.tilt_rad else ""
        return f"{self.depth_m:g} m deep, {self.speed_m_per_s:g} m/s{tilt}"


class WedgeDesign(StrictModel):
    """Runs of a tool on a path that a wedge model is fitted to, and others that it is checked on."""

    model: Literal["wedge"]
    scene: str  # with one tool on a path; relative to the design file
    overrides: tuple[str, ...] = ()  # KEY=VALUE over the scene, in every run
    start_tip_x_m: Finite = -0.05
    window_m: tuple[Positive, Positive]  # tip positions over which means are taken
    theory: Literal["mckyes_ali", "perumpral"] = "mckyes_ali"
    fit: Annotated[tuple[Point, ...], Field(min_length=3)]
    check: tuple[Point, ...] = ()
    wheels: WheelSoil | None = None  # copied into the soil file


def read_design(path: Path) -> WedgeDesign:
    """Read a design file. Raises InputError for a file that is missing or is no design."""
    return validated(WedgeDesign, read_document(path, str(path)), str(path))


def tip_of(scene: ResolvedScene) -> tuple[str, tuple[float, float]]:
    """Name of the scene's one tool on a path, and its tip. Raises InputError where there are others."""
    tools = [name for name, tool in scene.scene.tools.items() if tool.path is not None]
    tip = scene.scene.report.tip_m
    if len(tools) != 1 or tip is None:
        raise InputError(
            f"{scene.path}: has {len(tools)} tools on paths and {'no ' if tip is None else ''}report.tip_m; "
            "a calibration draws one tool, whose tip report.tip_m names"
        )
    return tools[0], tip


def turned_tip_m(scene: ResolvedScene, point: Point) -> tuple[float, float]:
    """The tip (x, z) from the tool's origin, the tool turned as at a point."""
    _, (x, z) = tip_of(scene)
    cosine, sine = math.cos(point.tilt_rad), math.sin(point.tilt_rad)
    return cosine * x - sine * z, sine * x + cosine * z


def point_overrides(
    scene: ResolvedScene, design: WedgeDesign, point: Point, replicate: int
) -> tuple[str, ...]:
    """Overrides that make a scene of a point.

    Replicates have the next seed of a random bed; in a regular one, another position of the tool.
    """
    (name, _), (tip_x, tip_z) = tip_of(scene), turned_tip_m(scene, point)
    soil = scene.scene.particle_soil
    assert soil is not None
    shift = [0.0, 0.0]
    changes = []
    bed = soil.bed
    if replicate and is_random(bed):
        changes.append(f"soil.bed.seed={bed.seed + replicate}")
    elif replicate:
        spacing = particle_spacing_m(soil)
        shift = [round((part * replicate) % 1.0 * spacing, 6) for part in GOLDEN]
        for group, part in scene.scene.tools[name].groups.items():
            px, py, pz = part.position_m
            changes.append(f"tools.{name}.groups.{group}.position_m=[{px!r}, {py + shift[1]!r}, {pz!r}]")
    if scene.scene.stop_when is not None:
        changes.append("stop_when=null")
    travel = design.window_m[1] - design.start_tip_x_m + 0.05
    path = f"tools.{name}.path"
    return (
        *design.overrides,
        *changes,
        f"duration_s={round(travel / point.speed_m_per_s, 3)!r}",
        f"{path}.start_x_m={design.start_tip_x_m - tip_x + shift[0]!r}",
        f"{path}.start_z_m={-point.depth_m - tip_z!r}",
        f"{path}.start_angle_rad={point.tilt_rad!r}",
        f"{path}.speed_x_m_per_s={{kind: constant, value: {point.speed_m_per_s!r}}}",
        "record.series_ticks=1",
        "record.cloud_hz=0.0",
    )


def base_scene(design_path: Path, design: WedgeDesign) -> ResolvedScene:
    """The design's scene with its common overrides. Raises InputError for one without particles."""
    scene = load_scene(design_path.parent / design.scene, design.overrides)
    if scene.scene.particle_soil is None:
        raise InputError(f"{scene.path}: has no soil of particles, so there is nothing to calibrate to")
    return scene
