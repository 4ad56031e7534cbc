"""Scenes in short: what is derived from a soil, a tool's file, depth, speed and travel."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from subsoil_ros.errors import SceneError
from subsoil_ros.loading.loader import ResolvedScene, load_scene
from subsoil_ros.scene.soil import rupture_distance_m
from subsoil_ros.scene.tool_mesh import load_tool_mesh
from subsoil_ros.scene.tool_shape import tool_shape
from subsoil_ros.yaml_document import dump_yaml, leaves
from tests.unit.scene.step_prism import step_prism

TINE_MM = [(0.0, 0.0), (-60.0, 34.64), (-60.0, 500.0), (-100.0, 500.0), (-100.0, 10.0)]
"""A tine in x and z: a front raked by 30 degrees up to an upright shank, an underside with 5.7 degrees."""

Load = Callable[..., ResolvedScene]


@pytest.fixture
def load(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Load:
    """Loads the scene of six lines, with changes by dotted path; meshes of the same tine lie beside it."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    (tmp_path / "my_tine.step").write_text(step_prism(TINE_MM, 40.0))
    (tmp_path / "tine.yaml").write_text(
        "soil: loam\ntools: {tine: {mesh: my_tine.step, depth_m: 0.20, speed_m_per_s: 0.5}}\ntravel_m: 3\n"
    )

    def loaded(**changes: Any) -> ResolvedScene:
        keys = {key.replace("__", "."): value for key, value in changes.items()}
        return load_scene(tmp_path / "tine.yaml", keys)

    monkeypatch.chdir(tmp_path)
    return loaded


def as_mesh(metres: float = 1.0, lying: bool = False) -> trimesh.Trimesh:
    """The tine as facets; lying: drawn with y upwards and looking backward."""
    scene = trimesh.load_scene(Path("my_tine.step"))
    mesh = scene.to_mesh()
    mesh.merge_vertices(merge_tex=True, merge_norm=True)
    vertices = np.asarray(mesh.vertices) / metres
    if lying:
        vertices = (vertices * (-1.0, -1.0, 1.0))[:, [0, 2, 1]] * (1.0, 1.0, -1.0)
    return trimesh.Trimesh(vertices, mesh.faces, process=False)


def vertices_m(scene: ResolvedScene) -> np.ndarray:
    """Vertices of the tine, sorted."""
    found = load_tool_mesh(scene.directory, scene.scene, "tine").vertices_m.round(6) + 0.0
    return np.unique(found, axis=0)


def test_what_six_lines_make(load: Load) -> None:
    """Time by the travel, a field about the tool, the foremost point just outside, means from the tip on."""
    found = load()
    scene = found.scene
    assert scene.duration_s == 6.0
    assert scene.name == "tine"
    tine, soil = scene.tools["tine"], scene.particle_soil
    assert tine.path is not None
    assert soil is not None
    assert soil.window is not None
    assert (tine.path.start_x_m, tine.path.start_z_m) == (-0.05, -0.2)
    assert scene.report.tip_m == (0.0, 0.0)
    assert soil.bin.depth_m == pytest.approx(0.3)
    assert 0.04 + 2 * 0.2 <= soil.bin.width_m <= 0.04 + 2 * 0.2 + 0.05
    ahead = rupture_distance_m(0.2, 32.0)
    assert ahead <= scene.report.window_inside_m <= ahead + 0.01
    assert soil.bin.length_m >= 3.0 + ahead + soil.window.ahead_m
    assert found.preset == "standard"
    keys = {"duration_s", "soil.bin.width_m", "soil.window", "tools.tine.path.start_x_m", "preset"}
    assert {item.key for item in found.derived} >= keys
    assert all(item.reason for item in found.derived)


def test_the_scene_in_full_is_the_same_scene(load: Load, tmp_path: Path) -> None:
    """What a run writes has no key in short, and loads to the same hash; nothing is derived again."""
    found = load()
    found.write(tmp_path / "full.yaml")
    again = load_scene(tmp_path / "full.yaml")
    assert again.scene_hash == found.scene_hash
    assert not again.derived
    assert "depth_m: 0.2" not in (tmp_path / "full.yaml").read_text()


def test_given_values_stay(load: Load) -> None:
    """By overrides before what is derived, and after it."""
    found = load(
        soil="clay_loam", travel_m=1.0, tools__tine__depth_m=0.3, soil__particles__radius_m=0.012,
        soil__bin__width_m=1.0, report__window_inside_m=0.2,
    )  # fmt: skip
    soil = found.scene.particle_soil
    assert soil is not None
    assert found.material is not None
    assert found.material.soil.name == "clay loam"
    assert load(soil="clay_loam").scene.report.window_inside_m > load().scene.report.window_inside_m
    assert found.preset is None
    assert soil.particles.mean_volume_radius_m == pytest.approx(0.012, rel=0.05)
    assert (soil.bin.width_m, soil.bin.depth_m) == (1.0, pytest.approx(0.45))
    assert found.scene.duration_s == 2.0
    assert found.scene.report.window_inside_m == 0.2


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("coupling.communication_step_ns", 250_000),
        ("coupling.residual_bound", 0.05),
        ("coupling", {"force": "tick_end"}),
        ("soil.bed.solid_fraction", 0.6),
        ("soil.bed", {"kind": "tiled", "tile_m": 0.5}),
        ("soil.bin.width_m", 1.2),
        ("soil.bin", {"length_m": 4.0, "width_m": 1.2, "depth_m": 0.3}),
    ],
)
def test_a_key_in_the_file_is_the_same_key_by_an_override(
    load: Load, tmp_path: Path, key: str, value: Any
) -> None:
    """What stands beside it is derived in both, and it is in neither list."""
    by_override = load(**{key: value})
    for name in reversed(key.split(".")):
        value = {name: value}
    (tmp_path / "own.yaml").write_text(dump_yaml({"base": "tine.yaml", "name": "tine", **value}))
    in_file = load_scene(tmp_path / "own.yaml")
    assert in_file.scene == by_override.scene
    given = {path for path, _ in leaves(value)}
    for found in (in_file, by_override):
        assert not {item.key for item in found.derived} & given
        assert any(item.key.startswith("soil.b") for item in found.derived)


def test_the_field_is_as_long_as_the_run(load: Load) -> None:
    """Whether travel or duration is given, by the file or an override, of which the last counts."""
    for changes in ({"duration_s": 20.0}, {"travel_m": 10.0}):
        scene = load(**changes).scene
        assert scene.duration_s == 20.0
        assert scene.soil is not None
        assert scene.soil.bin.length_m > 10.5
    with pytest.raises(SceneError, match="both travel_m and duration_s; give one"):
        load(duration_s=20.0, travel_m=10.0)


def test_the_field_is_about_what_is_in_the_soil(load: Load) -> None:
    """Wherever a tool lies in its file, and up to where the surface cuts its facets."""
    place = {"tools__tine__mesh": "tool.stl"}
    box = trimesh.creation.box((0.03, 0.06, 0.5))
    box.export("tool.stl")
    beside = load(tools__tine__lateral_m=-0.33, **place).scene
    box.apply_translation((0.0, -0.33, 0.0))
    box.export("tool.stl")
    assert load(**place).scene.soil == beside.soil
    assert beside.soil is not None
    assert beside.soil.bin.width_m == pytest.approx(2 * (0.36 + 0.2), abs=0.05)
    x, y, z = [-0.05, -0.05, 0.0, 0.0], [-0.02, 0.02, -0.02, 0.02], 4 * [0.0]
    lower, upper = np.array([x, y, z]).T, np.array([x, y, z]).T * (3.0, 10.0, 0.0) + (0.2, 0.0, 0.4)
    trimesh.convex.convex_hull(np.concatenate((lower, upper))).export(
        "tool.stl"
    )  # 0.22 m wide at the surface
    found = load(**place).scene
    assert found.soil is not None
    assert found.soil.bin.width_m == pytest.approx(0.65)
    assert found.tools["tine"].path is not None
    assert found.tools["tine"].path.start_x_m == pytest.approx(-0.05 - 0.1)


def test_a_wheel_is_not_what_means_are_of(load: Load) -> None:
    """The tip is that of the first tool that works the soil, which metrics follow; so is the size."""
    trimesh.creation.box((0.4, 0.02, 0.4)).export("wheel.stl")
    wheel = {"mesh": "wheel.stl", "role": "wheel", "depth_m": 0.3, "speed_m_per_s": 0.5, "lateral_m": 0.5}
    tine = {"mesh": "my_tine.step", "depth_m": 0.2, "speed_m_per_s": 0.5}
    own = {"preset": "own", "presets": {"own": {}}}
    scene = {"soil": {"material": "loam"}, "tools": {"wheel": wheel, "tine": tine}, "travel_m": 3, **own}
    found, alone = load_scene({"name": "wheeled", **scene}).scene, load().scene
    assert found.report.tip_m == alone.report.tip_m == (0.0, 0.0)
    assert found.particle_soil is not None
    assert alone.particle_soil is not None
    assert found.particle_soil.particles == alone.particle_soil.particles


def test_tools_of_one_drawing_keep_their_distances(load: Load) -> None:
    """Fore and aft as across; means begin, and the field ends, so much later that they hold for the last."""
    for name, place in (("front.stl", (1.0, 0.0, 0.0)), ("rear.stl", (0.6, 0.25, 0.1))):
        box = trimesh.creation.box((0.03, 0.06, 0.5))
        box.apply_translation(place)
        box.export(name)
    moved = {"depth_m": 0.2, "speed_m_per_s": 0.5}
    tools = {"front": {"mesh": "front.stl", **moved}, "rear": {"mesh": "rear.stl", **moved}}
    alone, found = (
        load_scene({"name": "drawn", "soil": {"material": "loam"}, "tools": given, "travel_m": 3}).scene
        for given in ({"front": tools["front"]}, tools)
    )
    paths = [tool.path for tool in found.tools.values()]
    assert [path.start_x_m for path in paths if path] == [pytest.approx(-0.05 - 1.015)] * 2
    assert [path.start_z_m for path in paths if path] == [pytest.approx(0.05), pytest.approx(-0.05)]
    assert found.report.tip_m == alone.report.tip_m
    assert found.report.window_inside_m == alone.report.window_inside_m
    assert found.soil is not None
    assert alone.soil is not None
    assert found.soil.bin.length_m == pytest.approx(alone.soil.bin.length_m + 0.4)
    assert found.soil.bin.width_m > alone.soil.bin.width_m


def test_nothing_in_short_is_left_out(tmp_path: Path) -> None:
    """A preset is laid over a scene after all is derived."""
    scenes = Path(__file__).parents[3] / "config/scenes"
    presets = "preset: longer\npresets: {longer: {changes: {travel_m: 7}}}\n"
    (tmp_path / "longer.yaml").write_text(f"base: {scenes / 'field_tine.yaml'}\n{presets}")
    with pytest.raises(SceneError, match="travel_m: given in an initial condition or preset"):
        load_scene(tmp_path / "longer.yaml")


@pytest.mark.parametrize("rake", [30.0, 60.0, 90.0])
def test_a_blade_is_a_mesh_of_its_angles(load: Load, rake: float) -> None:
    """Closed, as wide, as steep and as thick as asked, its edge at the origin; twice as high as deep."""
    found = load(tools__tine__mesh=None, tools__tine__blade={"rake_deg": rake, "width_m": 0.06})
    mesh = load_tool_mesh(found.directory, found.scene, "tine")
    shape = tool_shape(mesh.vertices_m, mesh.facets, 0.2)
    assert shape.rake_deg == pytest.approx(rake, abs=0.01)
    assert shape.clearance_deg == pytest.approx(10.0, abs=0.01)
    assert (shape.width_m, shape.height_m) == (pytest.approx(0.06), pytest.approx(0.4))
    assert shape.tip_m == pytest.approx((0.0, 0.0), abs=1e-9)
    solid = trimesh.Trimesh(mesh.vertices_m, mesh.facets)
    heel = 0.02 / np.sin(np.radians(rake - 10.0)) * np.sin(np.radians(10.0))  # height of its corner behind
    assert solid.is_watertight
    assert solid.volume == pytest.approx(0.06 * 0.02 / np.sin(np.radians(rake)) * (0.4 - 0.5 * heel))


@pytest.mark.parametrize("preset", ["fine", "coarse"])
def test_a_preset_gives_the_size(load: Load, preset: str) -> None:
    """And no row of `derived` says another one."""
    found = load(preset=preset)
    assert found.preset == preset
    assert "soil.particles.radius_m" not in {item.key for item in found.derived}


@pytest.mark.parametrize("setback_m", [0, 0.004])
def test_a_setback_that_is_given_stays(load: Load, tmp_path: Path, setback_m: float) -> None:
    """Also none, by an override and in the file."""
    tool = f"{{mesh: my_tine.step, depth_m: 0.2, speed_m_per_s: 0.5, setback_m: {setback_m}}}"
    (tmp_path / "own.yaml").write_text(f"soil: loam\ntools: {{tine: {tool}}}\ntravel_m: 3\n")
    for found in (load_scene(tmp_path / "own.yaml"), load(tools__tine__setback_m=setback_m)):
        assert found.preset == "standard"
        assert found.scene.tools["tine"].setback_m == setback_m


@pytest.mark.parametrize(("file", "unit"), [
    ("metres.stl", None), ("millimetres.stl", "mm"), ("centimetres.obj", "cm"), ("inches.stl", "inch"),
    ("metres.obj", "m"),
])  # fmt: skip
def test_units_and_formats_make_the_same_tool(load: Load, file: str, unit: str | None) -> None:
    """To the round-off of an STL file."""
    metres = {"mm": 1e-3, "cm": 1e-2, "inch": 0.0254}.get(unit or "m", 1.0)
    as_mesh(metres).export(file)
    found = load(tools__tine__mesh=file, **({"tools__tine__unit": unit} if unit else {}))
    np.testing.assert_allclose(vertices_m(found), vertices_m(load()), atol=2e-6)


def test_a_3mf_names_its_unit(load: Load) -> None:
    """It is read, not asked for."""
    scene = trimesh.Scene([as_mesh(1e-3)])
    scene.units = "millimeters"
    Path("tine.3mf").write_bytes(scene.export(file_type="3mf"))
    np.testing.assert_allclose(vertices_m(load(tools__tine__mesh="tine.3mf")), vertices_m(load()), atol=2e-6)


def test_a_lying_tool_is_turned(load: Load) -> None:
    """Drawn with y upwards, and looking backward."""
    as_mesh(lying=True).export("lying.stl")
    found = load(tools__tine__mesh="lying.stl", tools__tine__up="y", tools__tine__rotation_deg=[0, 0, 180])
    np.testing.assert_allclose(vertices_m(found), vertices_m(load()), atol=2e-6)


def test_the_shape_is_that_of_the_drawing(load: Load) -> None:
    """Width, rake and clearance of the edge, whatever the shank above it."""
    found = load()
    mesh = load_tool_mesh(found.directory, found.scene, "tine")
    shape = tool_shape(mesh.vertices_m, mesh.facets, 0.2)
    assert shape.width_m == pytest.approx(0.04)
    assert shape.height_m == pytest.approx(0.5)
    assert shape.tip_m == pytest.approx((0.0, 0.0))
    assert shape.rake_deg == pytest.approx(30.0, abs=0.1)
    assert shape.clearance_deg == pytest.approx(np.degrees(np.arctan(0.1)), abs=0.1)


BAD: list[tuple[dict[str, Any], str]] = [
    ({"tools__tine__mesh": "big.stl"}, "100 x 40 x 500 large, and the file names no.*unit: mm for 0.5 m"),
    ({"tools__tine__mesh": "big.stl", "tools__tine__unit": "m"}, "is 500 m large, and no tool is"),
    ({"tools__tine__unit": "mm"}, "the file names its unit; leave it out"),
    ({"tools__tine__mesh": "tine.dwg"}, "given a '.dwg' file, allowed are .stl, .obj, .3mf, .step, .stp"),
    ({"tools__tine__mesh": "not_there.step"}, "not_there.step: No such file"),
    ({"tools__tine__mesh": "broken.step"}, "broken.step: .*STEP"),
    ({"tools__tine__speed_m_per_s": -0.5}, "must be above 0; turn the mesh by rotation_deg"),
    ({"tools__tine__speed_m_per_s": None}, "give both depth_m and speed_m_per_s"),
    ({"tools__tine__depth_m": 0}, "depth_m: given 0; it must be a number greater than 0"),
    ({"tools__tine__up": "x"}, "up: given the text 'x'; it must be 'y' or 'z'"),
    ({"tools__tine__depht_m": 1.0}, "did you mean 'depth_m'?"),
    ({"tools__tine__groups": {"a": {"mesh": "my_tine.step"}}}, "given both 'mesh' and 'groups'"),
    ({"tools__tine__blade": {"rake_deg": 45, "width_m": 0.06}}, "both 'blade' and a mesh; give one of"),
    (
        {"tools__tine__mesh": None, "tools__tine__blade": {"rake_deg": 9, "width_m": 0.06}},
        "clearance_deg: given 10, must be below rake_deg 9",
    ),
    (
        {
            "tools__a": {"blade": {"rake_deg": 45, "width_m": 0.06}, "path": {"speed_x_m_per_s": 1.0}},
        },
        "tools.a.blade: height_m: is missing; a tool without depth_m needs it",
    ),
    ({"travel_m": "far"}, "travel_m: given 'far'; it must be a number above 0"),
    ({"soil": "loom"}, "did you mean 'loam'?"),
    ({"tools__a": {"mesh": "my_tine.step", "depth_m": 0.1, "speed_m_per_s": 1.0}}, "move at 0.5, 1 m/s"),
]  # fmt: skip


@pytest.mark.parametrize(("changes", "message"), BAD)
def test_bad_input(load: Load, changes: dict[str, Any], message: str) -> None:
    """One line that says where, what was given and what to do."""
    as_mesh(1e-3).export("big.stl")
    Path("broken.step").write_text("ISO-10303-21;\n")
    Path("tine.dwg").touch()
    with pytest.raises(SceneError, match=message) as caught:
        load(**changes)
    assert len(str(caught.value).splitlines()) == 1


def test_travel_needs_a_tool_in_short(tmp_path: Path) -> None:
    """A path has a law of its own."""
    with pytest.raises(SceneError, match=re.escape("travel_m: given without a tool in short")):
        load_scene("tine", {"travel_m": 1.0})


@pytest.mark.parametrize("value", [0.5, {"kind": "constant", "value": 0.5}])
def test_a_number_is_a_constant_law(value: object) -> None:
    """In a path, and within a sum; the same scene by hash."""
    given = load_scene("tine", {"tools.tine.path.speed_x_m_per_s": value})
    summed = load_scene("tine", {"tools.tine.path.speed_x_m_per_s": {"kind": "sum", "terms": [value]}})
    assert given.scene_hash == load_scene("tine").scene_hash
    path = summed.scene.tools["tine"].path
    assert path is not None
    assert "value=0.5" in str(path.speed_x_m_per_s)


def test_a_tool_of_another_scene_may_be_in_short(tmp_path: Path) -> None:
    """By an override that brings the whole of it; a speed alone is not enough."""
    mesh = str(Path(__file__).parents[3] / "config/meshes/share.stl")
    tool = {"mesh": mesh, "depth_m": 0.1, "speed_m_per_s": 0.5}
    found = load_scene("field_tine", {"tools.second": {**tool, "lateral_m": 0.15}})
    assert found.scene.tools["second"].path is not None
    with pytest.raises(SceneError, match="give both depth_m and speed_m_per_s"):
        load_scene("field_tine", {"tools.second": {"mesh": mesh, "speed_m_per_s": 0.5}})
