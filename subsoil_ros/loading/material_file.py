"""Material files: `soil.material` in a scene stands for particles calibrated to a soil of a laboratory."""

import math
import os.path
from collections.abc import Sequence
from pathlib import Path

from ..errors import SceneError
from ..scene.material import VERSION, LaboratorySoil, Material
from ..scene.soil import Soil, rupture_distance_m
from ..strict_model import LARGEST
from ..yaml_document import Document, dump_yaml, merge, read_document
from .files import shipped_names
from .overrides import Override
from .validation import suggestion, validated, value_at

_BROUGHT = ("law", "bonds", "particles.sizes", "particles.density_kg_per_m3", "particles.reference_radius_m")
"""Keys of `soil` that the material gives; a scene with a material must not have them."""


def read_laboratory_soil(path: Path) -> LaboratorySoil:
    """Read a laboratory's soil. Raises SceneError for a file that is missing or describes no soil."""
    return validated(LaboratorySoil, read_document(path, str(path)), str(path))


def read_material(path: Path, place: str) -> Material:
    """Read a material. Raises SceneError for a file that is missing, no material, or of another version."""
    if not os.path.isfile(path) and not path.suffix:
        near = suggestion(path.name, shipped_names("materials"))
        raise SceneError(f"{place}: given '{path.name[:80]}'; there is no such file or shipped soil: {near}")
    shown = f"{place}: {path}"
    document = read_document(path, shown)
    if document.get("version") != VERSION:
        raise SceneError(
            f"{shown}: version {document.get('version')!r}, this program reads {VERSION}; calibrate "
            "the soil again (subsoil calibrate)"
        )
    return validated(Material, document, shown)


def write_material(path: Path, material: Material) -> None:
    """Write a file from which read_material returns an equal material."""
    path.write_text(dump_yaml(material.model_dump(mode="json", exclude_none=True)), encoding="utf-8")


def material_first(
    document: Document, changes: Sequence[Override]
) -> tuple[Sequence[Override], Sequence[Override]]:
    """Split overrides: those that choose a material and its radius come first, before it is read; the others
    change what it gave. Without a material, all are in the second part."""
    choose = ("soil", "soil.material", "soil.particles", "soil.particles.radius_m")
    soils = [document.get("soil"), *(change.value for change in changes if change.path == "soil")]
    named = any(isinstance(soil, dict) and "material" in soil for soil in soils)
    if not named and not any(change.path == "soil.material" for change in changes):
        return (), changes
    first = [change for change in changes if change.path in choose]
    return first, [change for change in changes if change.path not in choose]


def with_material(document: Document, shown: str) -> tuple[Document, Material | None]:
    """Return a scene's document with the particles of its material in place of `soil.material`.

    Raises:
        SceneError: no such file, no radius or one that it does not cover, or keys that the material gives.
    """
    soil = document.get("soil")
    if not isinstance(soil, dict) or "material" not in soil:
        return document, None
    name = soil["material"]
    if name is None:
        return {**document, "soil": {key: soil[key] for key in soil if key != "material"}}, None
    if not isinstance(name, str):
        raise SceneError(
            f"{shown}: soil.material: given {name!r}; it must be a material file or a soil's name"
        )
    material = read_material(Path(name), f"{shown}: soil.material")
    if soil.get("model") == "terrain":
        own = {key: value for key, value in soil.items() if key != "material"}
        given = own.get("values") or {}
        if not isinstance(given, dict):
            raise SceneError(f"{shown}: soil.values: given {given!r}; it must be a mapping of values")
        return {**document, "soil": {**own, "values": {**_terrain_values(material), **given}}}, None
    for key in _BROUGHT:
        if value_at(soil, key.split(".")) is not None:
            raise SceneError(f"{shown}: soil.{key}: given beside soil.material, which brings it; remove one")
    radius = value_at(soil, ("particles", "radius_m"))
    low, high = material.radii_m
    if radius is None:
        raise SceneError(
            f"{shown}: soil.particles.radius_m: is missing; give a mean radius from {low:g} to {high:g} m, "
            "or a tool with depth_m and speed_m_per_s, from which it is derived"
        )
    if not isinstance(radius, int | float) or isinstance(radius, bool) or not low <= radius <= high:
        raise SceneError(
            f"{shown}: soil.particles.radius_m: given {radius!r}; it must be a mean radius from {low:g} to "
            f"{high:g} m, which {name} covers; for others calibrate it (subsoil calibrate --radius)"
        )
    own = {key: value for key, value in soil.items() if key not in ("material", "law", "bonds")}
    own["particles"] = {key: value for key, value in own["particles"].items() if value is not None}
    del own["particles"]["radius_m"]
    below = material.section(float(radius))
    if (value_at(soil, ("bed", "kind")) or "tiled") != "tiled":
        del below["bed"]
    return {**document, "soil": merge(below, own, shown)}, material


def _terrain_values(material: Material) -> Document:
    """Strength of a terrain of this soil: the laboratory's, and what was measured at the critical state."""
    soil, measured = material.soil, material.measured
    friction, cohesion = soil.friction_angle_deg, soil.cohesion_pa
    loose = {
        key: min(max(measured[key].value, 0.0), peak) if key in measured else peak
        for key, peak in (("critical_friction_angle_deg", friction), ("critical_cohesion_pa", cohesion))
    }
    return {
        "density_kg_per_m3": soil.bulk_density_kg_per_m3,
        "cohesion_pa": cohesion,
        "friction_angle_rad": math.radians(friction),
        "loose_cohesion_pa": loose["critical_cohesion_pa"],
        "loose_friction_angle_rad": math.radians(loose["critical_friction_angle_deg"]),
        "adhesion_pa": 0.0,
        "tool_friction_angle_rad": math.radians(min(soil.metal_friction_angle_deg, friction)),
    }


def with_window(document: Document, material: Material | None, shown: str) -> Document:
    """Return a scene's document with the lengths of `soil.window` from its material, where it gives none.

    Raises:
        SceneError: it is given shorter than the rupture distance.
    """
    window = value_at(document, ("soil", "window"))
    depth = value_at(document, ("soil", "bin", "depth_m"))
    if material is None or not isinstance(window, dict) or not isinstance(depth, int | float):
        return document
    if not 0.0 < depth <= LARGEST:
        return document  # the scene's own checks refuse it
    angle = material.soil.friction_angle_deg
    needed = math.ceil(1e3 * rupture_distance_m(depth, angle)) / 1e3
    for key in ("ahead_m", "behind_m"):
        given = window.get(key)
        if isinstance(given, int | float) and given < needed:
            raise SceneError(
                f"{shown}: soil.window.{key}: {given:g} m is less than the rupture distance of soil "
                f"'{material.soil.name}', {needed:g} m over {depth:g} m of depth at {angle:g} degrees; make "
                "it longer, or leave it out"
            )
    filled = {"ahead_m": needed, "behind_m": needed} | window
    return {**document, "soil": {**document["soil"], "window": filled}}


def is_of(soil: Soil, material: Material) -> bool:
    """Whether a validated soil is still that of its material: the scene has changed no part of it."""
    low, high = soil.particles.bounds_m
    section = material.section(0.5 * (low + high)) | {"bin": soil.bin.model_dump(exclude={"sides"})}
    return _fixed_part(soil) == _fixed_part(Soil.model_validate(section))


def _fixed_part(soil: Soil) -> Document:
    """The part of a material's soil that a scene may not change; radii rounded to a nanometre."""
    content = soil.model_dump(
        include={"law", "bonds", "particles", "bed", "layers"},
        exclude={"bed": {"seed", "tile_m", "floor"}, "particles": {"sizes": {"seed"}}},
    )
    sizes = content["particles"]["sizes"] or {}
    sizes |= {key: round(value, 9) for key, value in sizes.items() if isinstance(value, float)}
    return content
