"""The rows of `subsoil check` about the soil. Code of particles is imported only for a soil that has them."""

import math
from collections.abc import Iterable

from ...loading.loader import ResolvedScene
from ...loading.soil_file import soil_of
from ...scene.bed_kinds import GridBed, SavedBed, TiledBed
from ...scene.material import Material
from ...scene.pair_laws import layer_soils, particle_spacing_m
from ...scene.sizes import mean_power
from ...scene.soil import Soil, SoilWindow, rupture_distance_m
from ...scene.tool_faces import cutting_faces, wheel_face
from ...scene.tool_mesh import load_tool_mesh
from ...scene.wedge_soil import WedgeSoil


def material_rows(material: Material) -> Iterable[tuple[str, str]]:
    """Rows of the laboratory's values and those of the particles, with 95 % intervals."""
    asked = material.soil.model_dump()
    yield "soil", material.soil.name
    for key, found in material.measured.items():
        wanted = f"{asked[key]:g}, found " if asked.get(key) is not None else ""
        half = 0.5 * (found.high - found.low)
        yield key, f"{wanted}{found.value:.4g} +- {half:.2g}"


def wedge_rows(resolved: ResolvedScene, soil: WedgeSoil) -> Iterable[tuple[str, str]]:
    """Rows of the values of a wedge model, and of each tool's face or wheel."""
    found = soil_of(soil)
    values = found.values
    phi, delta = math.degrees(values.friction_angle_rad), math.degrees(values.tool_friction_angle_rad)
    yield "from", "the scene" if soil.file is None else soil.file
    if found.fitted_range is not None:
        fitted = found.fitted_range
        low, high = (math.degrees(rake) for rake in fitted.rake_rad)
        yield (
            "fitted for",
            f"depth {fitted.depth_m[0]:g} to {fitted.depth_m[1]:g} m, rake {low:.0f} to {high:.0f} deg, "
            f"speed {fitted.speed_m_per_s[0]:g} to {fitted.speed_m_per_s[1]:g} m/s",
        )
    yield (
        "strength",
        f"c = {values.cohesion_pa:.4g} Pa, phi = {phi:.3g} deg; tools: c_a = {values.adhesion_pa:.4g} Pa,"
        f" delta = {delta:.3g} deg",
    )
    period = f"{values.period_factor:.3g} wedge lengths"
    if values.period_m is not None:
        period = f"{1e3 * values.period_m:.3g} mm"
    yield "density", f"{values.density_kg_per_m3:.4g} kg/m3"
    yield (
        "failure",
        (f"drop {values.drop:.3g}, period {period}, variation {values.variation:.3g}, seed {soil.seed}"),
    )
    for name, tool in resolved.scene.tools.items():
        mesh = load_tool_mesh(resolved.directory, resolved.scene, name)
        if not tool.is_tillage:
            wheel = wheel_face(mesh, f"tools.{name}")
            yield f"wheel {name}", f"radius {wheel.radius_m:.4g} m, width {wheel.width_m:.4g} m"
            continue
        for face in cutting_faces(mesh, f"tools.{name}"):
            what = "share" if face.is_share else "shank"
            yield (
                f"{what} {name}.{mesh.groups[face.group]}",
                f"width {face.width_m:.4g} m, rake {math.degrees(face.rake_rad):.1f} degrees",
            )


def particle_rows(resolved: ResolvedScene, soil: Soil, count: int) -> Iterable[tuple[str, str]]:
    """Particles, layers, bed and bin of a soil of particles."""
    from ...dem.packing.bed_file import bed_path
    from ...dem.packing.grid import grid_shape, prepare_grid

    spheres = _spheres(soil)
    if not isinstance(soil.bed, GridBed):
        about = "" if isinstance(soil.bed, SavedBed) else "about "
        yield "particles", f"{about}{count:,} {spheres}, less those that tools overlap"
        yield from _layer_rows(soil)
        if isinstance(soil.bed, SavedBed):
            yield "bed", f"from {soil.bed.file}"
        else:
            kept = bed_path(resolved)
            when = f"kept in {kept}" if kept.is_file() else "prepared when it is first used"
            yield "bed", f"{_random_bed(soil)}, seed {soil.bed.seed}; {when}"
        size = soil.bin
        fitted = "walls" if size.sides == "walls" else "ends and period in y"
        if isinstance(soil.bed, TiledBed):
            kind = "walls" if size.sides == "walls" else f"{size.sides} sides"
            fitted = f"{kind}, {soil.bed.floor} floor"
        else:
            fitted += " fitted to the bed"
        box = "bin" if soil.window is None else "field"
        yield box, f"{size.length_m:g} x {size.width_m:g} x {size.depth_m:g} m, {fitted}"
        if soil.window is not None:
            yield "window", _window(resolved, soil, soil.window)
        return
    nx, ny, nz = grid_shape(soil)
    bed = prepare_grid(soil, resolved.scene.gravity_m_per_s2)
    yield "particles", f"{count:,} {spheres}, less those that tools overlap"
    yield from _layer_rows(soil)
    spacing_mm = particle_spacing_m(soil) * 1e3
    yield "bed", f"{nz} layers of {nx} x {ny}, spacing {spacing_mm:g} mm, top at z = 0"
    length, width = bed.upper_m[0] - bed.lower_m[0], bed.upper_m[1] - bed.lower_m[1]
    yield (
        "bin",
        (
            f"{soil.bin.length_m:g} x {soil.bin.width_m:g} x {soil.bin.depth_m:g} m; fitted to the bed: "
            f"{length:.4g} x {width:.4g} m, floor at z = {bed.lower_m[2]:.4f} m"
            + ("" if bed.period_m is None else f", y periodic with {width:.4g} m")
        ),
    )


def _window(resolved: ResolvedScene, soil: Soil, window: SoilWindow) -> str:
    text = f"soil exists from {window.behind_m:g} m behind the tools to {window.ahead_m:g} m ahead of them"
    if resolved.material is None:
        return text
    angle = resolved.material.soil.friction_angle_deg
    rupture = rupture_distance_m(soil.bin.depth_m, angle)
    return f"{text}; a cut as deep as the bed fails {rupture:.3g} m ahead at {angle:g} degrees"


def _random_bed(soil: Soil) -> str:
    heights = () if soil.surface is None else sorted({min(soil.surface.z_m), max(soil.surface.z_m)})
    surface = "" if not heights else f", surface at z = {' to '.join(f'{z:g}' for z in heights)} m"
    if not isinstance(soil.bed, TiledBed):
        return f"dense random{surface}"
    from ...dem.packing.bed_geometry import sample_edge_m

    density = soil.bed.solid_fraction * soil.particles.density_kg_per_m3
    return (
        f"tiled, solid fraction {soil.bed.solid_fraction:g} ({density:.0f} kg/m3), "
        f"tiles of {sample_edge_m(soil):.3g} m{surface}"
    )


def _spheres(soil: Soil) -> str:
    sizes, (smallest, largest) = soil.particles.sizes, soil.particles.bounds_m
    if sizes is None:
        return f"of radius {largest * 1e3:g} mm"
    mean_mm = mean_power(sizes, 1) * 1e3
    return f"of radius {smallest * 1e3:g} to {largest * 1e3:g} mm ({sizes.kind}, mean {mean_mm:.3g} mm)"


def _layer_rows(soil: Soil) -> Iterable[tuple[str, str]]:
    above = 0.0
    for layer, whole in zip(soil.layers or (), layer_soils(soil), strict=False):
        bottom = "the floor" if layer.thickness_m is None else f"{above + layer.thickness_m:g} m"
        density = whole.particles.density_kg_per_m3
        own = "" if layer.law is None else ", with a law of its own"
        yield f"layer {layer.name}", f"{above:g} m down to {bottom}, particles of {density:g} kg/m3{own}"
        above += layer.thickness_m or 0.0
