"""Soil files: values of a wedge model, the soil they were fitted to, and the range of the fit."""

import hashlib
import math
from pathlib import Path
from typing import Literal

from pydantic import Field, ValidationError

from ..contact_laws.registry import contact_laws
from ..errors import SceneError, SubsoilError
from ..rotations import Vector, level_axes
from ..scene.scene import Scene
from ..scene.soil import Soil
from ..scene.tool_faces import CuttingFace, cutting_faces, wheel_face
from ..scene.tool_mesh import load_tool_mesh
from ..scene.tools import Path as ToolPath
from ..scene.wedge_soil import LARGEST_SUM_RAD, SoilRange, WedgeSoil, WedgeValues
from ..strict_model import StrictModel
from ..yaml_document import Document, dump_yaml, read_document
from .validation import validated

RANGE_UNITS = {
    "depth_m": ("m", 1.0),
    "speed_m_per_s": ("m/s", 1.0),
    "rake_rad": ("deg", 180.0 / math.pi),
}
"""Unit in messages and its factor, by the key of SoilRange."""

RANGE_MARGIN = 1.2
"""Factor beyond its range up to which a soil file is accepted, with a warning: forces change slowly there."""

RAKES_RAD = (math.radians(15.0), 0.5 * math.pi)
"""Rakes that the wedge theory covers: the charts of McKyes (1985) begin near 15 degrees; on a face that leans
forward beyond the vertical, soil stays on the tool and acts as a part of it."""

LARGEST_YAW_RAD = math.radians(45.0)
"""Largest angle between a plate's normal and its travel, seen from above: beyond it a plate moves more along
its edge than across it, and the theory has no motion of the soil along the edge."""

LARGEST_ROLL_RAD = math.radians(5.0)
"""Largest tilt of the edge out of the level. The depth is taken at the middle of the edge: for a plate as
wide as deep, it differs by 9 % between the ends, and a force that grows as the depth squared by 0.1 %."""

LARGEST_SIDE = 0.1
"""Largest width that a side sweeps over that of its plate: the soil that a side pushes is neglected, so it
must be little against the plate's."""

FACING_RAD = math.radians(1.0)
"""Largest angle by which a mesh's front faces sideways: round-off of a mesh; yaw comes from the motion."""


class SoilFile(StrictModel):
    """Content of a soil file: `subsoil calibrate` writes it and `soil.file` names it."""

    model: Literal["wedge"]
    fitted_law: Document  # particles, bed and law that the runs had, as law_of gives it
    fitted_range: SoilRange
    values: WedgeValues
    errors: dict[str, float] = {}  # standard error of each fitted value
    report: Document = Field(default={})  # residuals, runs; printed, not used


class FoundSoil(StrictModel):
    """Values of a scene's soil, from the scene or from its file."""

    values: WedgeValues
    fitted_range: SoilRange | None  # None: the values are the scene's own


def read_soil_file(path: Path, place: str = "soil.file") -> SoilFile:
    """Read a soil file. Raises SceneError for a file that is missing, no YAML, or no soil file."""
    shown = f"{place}: {path}"
    document = read_document(path, shown)
    if document.get("model") != "wedge":
        raise SceneError(
            f"{shown}: its model is {document.get('model')!r}; give a file with model "
            "'wedge', as `subsoil calibrate` writes it"
        )
    return validated(SoilFile, document, shown)


def write_soil_file(path: Path, soil: SoilFile) -> None:
    """Write a soil file from which read_soil_file returns an equal one."""
    path.write_text(dump_yaml(soil.model_dump(mode="json")), encoding="utf-8")


def soil_of(soil: WedgeSoil) -> FoundSoil:
    """The values of a wedge model; the loader has made the file's path absolute."""
    if soil.values is not None:
        return FoundSoil(values=soil.values, fitted_range=None)
    assert soil.file is not None
    found = read_soil_file(Path(soil.file))
    return FoundSoil(values=found.values, fitted_range=found.fitted_range)


def law_of(soil: Soil) -> Document:
    """The properties that identify a particle soil: spheres, packing and law; not bin, steps or seed."""
    content = soil.model_dump(mode="json", include={"particles", "bed", "law", "layers"}, exclude_none=True)
    content["bed"].pop("seed", None)
    if "file" in content["bed"]:
        content["bed"]["file"] = hashlib.sha256(Path(content["bed"]["file"]).read_bytes()).hexdigest()
    return dict(content)


def _with_defaults(fitted: Document) -> Document:
    """`fitted_law` with defaults for keys added to its law since; unchanged if the law refuses it."""
    try:
        law = contact_laws()[fitted["law"]["kind"]].model_validate(fitted["law"])
    except (KeyError, ValidationError):
        return fitted
    return {**fitted, "law": law.model_dump(mode="json", exclude_none=True)}


def _differences(one: object, two: object, path: str = "") -> list[str]:
    """Paths at which two plain documents differ."""
    if isinstance(one, dict) and isinstance(two, dict):
        return [
            place
            for key in sorted({*one, *two})
            for place in _differences(one.get(key), two.get(key), f"{path}.{key}" if path else key)
        ]
    return [] if one == two else [path]


def check_wedge_soil(scene: Scene, directory: Path, fitted_to: Scene | None) -> tuple[str, ...]:
    """Check a scene on a wedge model; return the notes that a run prints.

    fitted_to: the scene that `soil.fitted_to` names.

    Raises:
        SceneError: a soil file of another law or out of its range, a rake that the theory does not cover, a
            wheel that is not round, wheels without values for them.
    """
    soil = scene.wedge_soil
    assert soil is not None
    found = soil_of(soil)
    beyond = "beyond_fitted_range" in scene.allow
    if fitted_to is not None and "other_contact_law" not in scene.allow:
        _refuse_other_law(soil, fitted_to)
    notes: list[str] = []
    for name, tool in scene.tools.items():
        place, mesh = f"tools.{name}", load_tool_mesh(directory, scene, name)
        if not tool.is_tillage:
            wheel_face(mesh, place)
            if found.values.wheels is None:
                raise SceneError(
                    f"soil: has no 'wheels' to carry {place} (role: wheel); give soil.values.wheels, or "
                    "leave the wheel to mechanism.forces (wheel_contact)"
                )
            continue
        share = cutting_faces(mesh, place)[0]
        if tool.path is not None and tool.path.is_spatial:
            _check_in_space(tool.path, cutting_faces(mesh.about_body(), place), place)
        turn = _start_pitch(tool.path) if tool.path is not None else 0.0
        rake = share.rake_rad - turn
        refuse_rake(
            rake, found.values.friction_angle_rad, found.values.tool_friction_angle_rad, place, SceneError
        )
        if found.fitted_range is not None:
            for what, key, value in _work(scene, name, share, rake):
                notes += _in_range(place, what, key, value, found.fitted_range, beyond)
    return tuple(notes)


def refuse_rake(
    rake_rad: float, friction_rad: float, tool_friction_rad: float, place: str, kind: type[SubsoilError]
) -> None:
    """Raise `kind` where the wedge theory does not cover a rake."""
    low, high = RAKES_RAD
    high = min(high, LARGEST_SUM_RAD - friction_rad - tool_friction_rad)
    if not low - 1e-9 <= rake_rad <= high + 1e-9:
        raise kind(
            f"{place}: its share has a rake of {math.degrees(rake_rad):.1f} degrees; the wedge theory covers "
            f"{math.degrees(low):.0f} to {math.degrees(high):.1f} degrees in this soil: turn the tool, or "
            "use soil.model: dem"
        )


def refuse_yaw(
    yaw_rad: float, roll_rad: float, face: CuttingFace, place: str, kind: type[SubsoilError]
) -> None:
    """Raise `kind` where the theory does not cover yaw, tilt or sides of a plate."""
    yaw, roll, swept = abs(yaw_rad), abs(roll_rad), face.side_part * math.tan(abs(yaw_rad))
    if yaw > LARGEST_YAW_RAD + 1e-9:
        found = f"travels at {math.degrees(yaw):.1f} degrees of yaw; the wedge theory covers up to "
        found += f"{math.degrees(LARGEST_YAW_RAD):.0f}"
    elif roll > LARGEST_ROLL_RAD:
        found = (
            f"has an edge {math.degrees(roll):.1f} degrees out of the level; the wedge theory covers up to "
        )
        found += f"{math.degrees(LARGEST_ROLL_RAD):.0f}"
    elif swept > LARGEST_SIDE:
        found = (
            f"travels at {math.degrees(yaw):.1f} degrees of yaw, at which its side sweeps {swept:.2g} of its "
        )
        found += f"width; the wedge theory has plates without sides, up to {LARGEST_SIDE:g}"
    else:
        return
    raise kind(f"{place}: {found}: turn the tool, make its sides shorter, or use soil.model: dem")


def _start_pitch(path: ToolPath) -> float:
    """Planar angle of a tool at the start of its path, in the plane across its edge."""
    return level_axes(path.start_quaternion).pitch_rad if path.is_spatial else path.start_angle_rad


def _check_in_space(path: ToolPath, faces: tuple[CuttingFace, ...], place: str) -> None:
    """Raise SceneError for a tool whose start is beyond the theory of yaw, as far as the scene shows it."""
    for face in faces:
        if abs(face.aside_rad) > FACING_RAD:
            raise SceneError(
                f"{place}: the front of its mesh looks {math.degrees(face.aside_rad):.1f} degrees aside; "
                "give a mesh that faces +x, and its yaw by path.turn.start_rotation_rad"
            )
        axes = level_axes(path.start_quaternion)
        ahead, aside, _ = axes.of(_start_way(path))
        refuse_yaw(math.atan2(aside, abs(ahead)), axes.roll_rad, face, place, SceneError)


def _start_way(path: ToolPath) -> Vector:
    """Horizontal velocity if the speed is constant; 0 where only the run gives it."""
    x, y = (
        law.value if law is not None and law.kind == "constant" else 0.0
        for law in (path.speed_x_m_per_s, path.speed_y_m_per_s)
    )
    return x, y, 0.0


def _refuse_other_law(soil: WedgeSoil, fitted_to: Scene) -> None:
    particles = fitted_to.particle_soil
    if particles is None:
        raise SceneError(f"soil.fitted_to: {soil.fitted_to}: has no soil of particles; name a scene that has")
    assert soil.file is not None
    differ = _differences(_with_defaults(read_soil_file(Path(soil.file)).fitted_law), law_of(particles))
    if differ:
        raise SceneError(
            f"soil.file: {soil.file}: was fitted to another soil than that of soil.fitted_to "
            f"{soil.fitted_to}; they differ in {', '.join(differ[:5])}. Calibrate to that scene's soil, or "
            "add allow: [other_contact_law]"
        )


def _work(scene: Scene, name: str, share: CuttingFace, rake: float) -> list[tuple[str, str, float]]:
    """(name, key of SoilRange, value) of what a tool is to do: on a path, or in the reference pose."""
    tool = scene.tools[name]
    work = [("mean rake of its lowest group", "rake_rad", rake)]
    if tool.path is not None:
        path = tool.path
        turn = _start_pitch(path)
        tip = math.sin(turn) * share.tip_m[0] + math.cos(turn) * share.tip_m[1]
        if path.speed_z_m_per_s is None:
            work.append(("depth", "depth_m", -(path.start_m(0.0)[2] + tip)))
        law = path.speed_x_m_per_s
        if law is not None and law.kind == "constant":
            work.append(("speed", "speed_m_per_s", law.value))
    elif scene.mechanism is not None and tool.body is not None:
        body = scene.mechanism.bodies[tool.body]
        work.append(("depth", "depth_m", -(body.position_m[1] + share.tip_m[1])))
        work.append(("speed", "speed_m_per_s", (body.velocity_m_per_s or (0.0, 0.0))[0]))
    return [item for item in work if item[2] > 0.0]


def _in_range(place: str, what: str, key: str, value: float, fitted: SoilRange, beyond: bool) -> list[str]:
    low, high = getattr(fitted, key)
    unit, factor = RANGE_UNITS[key]
    if low <= value <= high:
        return []
    text = (
        f"{place}: {what} {factor * value:.4g} {unit} is outside the range {factor * low:.4g} to "
        f"{factor * high:.4g} {unit} that"
    )
    if not beyond and not low / RANGE_MARGIN <= value <= high * RANGE_MARGIN:
        parts = "" if key != "rake_rad" else "if it is of point and shank in one mesh, give two groups; else "
        raise SceneError(
            f"{text} soil.file was fitted in, by more than {RANGE_MARGIN:g} times; {parts}fit it further, or "
            "add allow: [beyond_fitted_range]"
        )
    return [f"warning: {text} the soil was fitted in; the force there is extrapolated"]
