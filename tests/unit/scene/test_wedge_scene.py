"""Wedge model of the soil in scenes: what is refused and what is said, one message each."""

import json
import math
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest
import yaml

from subsoil_ros.analysis.summarize import summarize_unrecorded
from subsoil_ros.cli.main import main
from subsoil_ros.errors import SceneError
from subsoil_ros.loading.loader import ResolvedScene, load_scene
from subsoil_ros.loading.scene_bundle import pack, unpack
from subsoil_ros.loading.soil_file import SoilFile, law_of, read_soil_file, write_soil_file
from subsoil_ros.scene.wedge_soil import SoilRange, WedgeValues
from subsoil_ros.schedule import Schedule

SCENES = Path(__file__).parents[3] / "config" / "scenes"
VALUES = {
    "density_kg_per_m3": 1300.0,
    "cohesion_pa": 8e3,
    "friction_angle_rad": 0.5,
    "adhesion_pa": 1e3,
    "tool_friction_angle_rad": 0.3,
}


@pytest.fixture
def wedge(tmp_path: Path) -> Callable[..., ResolvedScene]:
    """Loads tine.yaml (0.20 m deep, 0.5 m/s, 25 degrees) on a wedge model of these keys."""

    def load(*overrides: str, allow: Sequence[str] = (), **soil: object) -> ResolvedScene:
        soil = {"model": "wedge", **soil}
        document = {"base": str(SCENES / "tine.yaml"), "soil": soil, "allow": list(allow)}
        path = tmp_path / "scene.yaml"
        path.write_text(yaml.safe_dump(document))
        return load_scene(path, overrides)

    return load


@pytest.fixture
def soil_file(tmp_path: Path) -> Callable[..., str]:
    """Writes a soil file fitted to the soil of tine.yaml; a range may change."""

    def write(**changes: tuple[float, float]) -> str:
        ranges = {"depth_m": (0.1, 0.3), "speed_m_per_s": (0.4, 1.5), "rake_rad": (0.4, 0.6)} | changes
        particles = load_scene(SCENES / "tine.yaml").scene.particle_soil
        assert particles is not None
        found = SoilFile(
            model="wedge",
            fitted_law=law_of(particles),
            fitted_range=SoilRange(**ranges),
            values=WedgeValues(**VALUES),
        )
        write_soil_file(tmp_path / "soil.yaml", found)
        assert read_soil_file(tmp_path / "soil.yaml") == found
        return str(tmp_path / "soil.yaml")

    return write


@pytest.mark.parametrize(
    ("soil", "words"),
    [
        ({}, "soil.values: neither is given; give 'values', or 'file'"),
        ({"values": VALUES, "file": "soil.yaml"}, "soil.values: both are given"),
        (
            {"values": VALUES | {"cohesion_pa": -1.0}},
            "soil.values.cohesion_pa: given -1.0; it must be a number at least 0",
        ),
        ({"values": VALUES | {"friction_angle_rad": 30.0}}, "soil.values.friction_angle_rad: given 30.0"),
        (
            {"values": VALUES | {"tool_friction_angle_rad": 0.6}},
            "soil.values.tool_friction_angle_rad: 0.6 is above friction_angle_rad 0.5",
        ),
        ({"values": VALUES | {"cohesion": 1.0}}, "did you mean 'cohesion_pa'?"),
        ({"values": VALUES, "particles": {}}, "soil.particles: unknown key 'particles'"),
        ({"values": VALUES, "fitted_to": "tine.yaml"}, "soil.fitted_to: only a 'file' was fitted"),
        ({"file": "none.yaml"}, "none.yaml: No such file or directory; give the path of a soil file"),
    ],
)
def test_bad_soil(wedge: Callable[..., ResolvedScene], soil: dict, words: str) -> None:
    """Where, what was given, what is allowed."""
    with pytest.raises(SceneError) as error:
        wedge(**soil)
    assert words in str(error.value)


def test_another_model_is_refused_by_name(wedge: Callable[..., ResolvedScene]) -> None:
    """A model that is not there says which are."""
    with pytest.raises(SceneError, match=r"soil\.model: given the text 'fem', allowed are dem, wedge"):
        wedge("soil.model=fem", values=VALUES)


@pytest.mark.parametrize("rake_deg", [10.0, 100.0])
def test_a_rake_beyond_the_theory(wedge: Callable[..., ResolvedScene], rake_deg: float) -> None:
    """The wedge theory covers 15 to 90 degrees."""
    turn = math.radians(25.0 - rake_deg)
    with pytest.raises(SceneError, match=rf"tools\.tine: its share has a rake of {rake_deg:.1f} degrees"):
        wedge(f"tools.tine.path.start_angle_rad={turn!r}", values=VALUES)


def test_a_wheel_needs_to_be_round_and_soil_to_carry_it(wedge: Callable[..., ResolvedScene]) -> None:
    """`role: wheel` means wheel."""
    with pytest.raises(SceneError, match=r"tools\.tine: 'role: wheel' makes it a wheel"):
        wedge("tools.tine.role=wheel", values=VALUES)


def test_a_soil_file_carries_its_law_and_range(
    wedge: Callable[..., ResolvedScene], soil_file: Callable[..., str]
) -> None:
    """In range nothing is said; the file's bytes are in the scene's hash."""
    file = soil_file()
    inside = wedge(file=file, fitted_to=str(SCENES / "tine.yaml"))
    assert inside.notes == ()
    before = inside.scene_hash
    Path(file).write_text(Path(file).read_text().replace("cohesion_pa: 8000.0", "cohesion_pa: 9000.0"))
    assert wedge(file=file, fitted_to=str(SCENES / "tine.yaml")).scene_hash != before


def test_a_soil_file_of_another_law(
    wedge: Callable[..., ResolvedScene], soil_file: Callable[..., str], tmp_path: Path
) -> None:
    """The keys that differ are named; other_contact_law takes it all the same."""
    other = tmp_path / "other.yaml"
    change = {"soil": {"law": {"particle": {"cohesive_stiffness_newton_per_m": 1.0}}}}
    other.write_text(json.dumps({"base": str(SCENES / "tine.yaml"), **change}))
    with pytest.raises(
        SceneError,
        match=r"they differ in law\.particle\.cohesive_stiffness_newton_per_m\..*other_contact_law",
    ):
        wedge(file=soil_file(), fitted_to=str(other))
    wedge(file=soil_file(), fitted_to=str(other), allow=["other_contact_law"])


@pytest.mark.parametrize(
    ("key", "low", "high"),
    [("depth_m", 0.1, 0.19), ("depth_m", 0.21, 0.3), ("speed_m_per_s", 0.55, 1.0), ("rake_rad", 0.3, 0.4)],
)
def test_a_little_out_of_range_is_a_warning(
    wedge: Callable[..., ResolvedScene], soil_file: Callable[..., str], key: str, low: float, high: float
) -> None:
    """Up to 1.2 times the range the force is extrapolated, and that is said."""
    (note,) = wedge(file=soil_file(**{key: (low, high)})).notes
    assert note.startswith("warning: tools.tine: ")
    factor = 180.0 / math.pi if key == "rake_rad" else 1.0  # an angle is told in degrees
    assert f"outside the range {factor * low:.4g} to {factor * high:.4g}" in note


@pytest.mark.parametrize(
    ("key", "low", "high"),
    [("depth_m", 0.1, 0.16), ("depth_m", 0.25, 0.3), ("speed_m_per_s", 0.7, 1.0), ("rake_rad", 0.2, 0.3)],
)
def test_far_out_of_range_is_refused(
    wedge: Callable[..., ResolvedScene], soil_file: Callable[..., str], key: str, low: float, high: float
) -> None:
    """Beyond 1.2 times the range; beyond_fitted_range takes it with the warning."""
    file = soil_file(**{key: (low, high)})
    with pytest.raises(
        SceneError, match=r"by more than 1\.2 times; .*fit it further, or add allow: \[beyond_fi"
    ):
        wedge(file=file)
    allowed = wedge(file=file, allow=["beyond_fitted_range"])
    assert len(allowed.notes) == 1
    assert wedge("allow=[beyond_fitted_range]", file=file).scene_hash == allowed.scene_hash


def test_what_a_scene_allows_travels_with_it(
    wedge: Callable[..., ResolvedScene], soil_file: Callable[..., str], tmp_path: Path
) -> None:
    """A bundle drops `fitted_to` and keeps `allow`: same hash, same summary."""
    other = tmp_path / "other.yaml"
    change = {"soil": {"law": {"particle": {"cohesive_stiffness_newton_per_m": 1.0}}}}
    other.write_text(json.dumps({"base": str(SCENES / "tine.yaml"), **change}))
    scene = wedge(file=soil_file(), fitted_to=str(other), allow=["other_contact_law"])
    folder = tmp_path / "worker"
    folder.mkdir()
    assert unpack(pack(scene), folder).scene.allow == ("other_contact_law",)
    assert summarize_unrecorded(scene, {}).scene.allow == ["other_contact_law"]


def test_a_file_of_another_model(wedge: Callable[..., ResolvedScene], tmp_path: Path) -> None:
    """What `calibrate` writes for particles is no wedge model."""
    (tmp_path / "soil.yaml").write_text("model: dem\n")
    with pytest.raises(SceneError, match="its model is 'dem'; give a file with model 'wedge'"):
        wedge(file=str(tmp_path / "soil.yaml"))


def test_a_base_of_particles_leaves_only_its_bin(wedge: Callable[..., ResolvedScene]) -> None:
    """No key of particles survives in a wedge model; the written scene loads to the same hash."""
    scene = wedge(values=VALUES)
    assert scene.scene.wedge_soil is not None
    assert scene.scene.wedge_soil.bin.length_m == 0.6
    assert scene.timing.communication_step_ns == 1_000_000
    copy = scene.path.with_name("copy.yaml")
    scene.write(copy)
    assert load_scene(copy).scene_hash == scene.scene_hash


def test_a_tick_too_long_for_the_springs_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    """k H = 2 m / H with the shank's mass at its tip: 5.5 ms for the machine; the scene's 1 ms passes."""
    scene = str(SCENES / "subsoiler_1s300_wedge.yaml")
    assert main(["check", scene]) == 0
    assert main(["check", scene, "--set", "coupling.communication_step_ns=8000000"]) == 2
    assert "above the stable limit" in capsys.readouterr().err


@pytest.mark.parametrize(("preset", "default_s"), [("fine", 0.5), ("real_time", 10.0)])
def test_checkpoints_are_rare_where_no_particles_are(preset, default_s):
    """By default; a value of the scene counts in both soils, and 0 means none."""
    for given, every_s in (([], default_s), (["2.0"], 2.0), (["0"], 0.0)):
        changes = [f"record.checkpoint_s={value}" for value in given]
        resolved = load_scene("field_tine", [f"preset={preset}", *changes])
        ticks = Schedule.of(resolved.scene, resolved.timing).checkpoint_ticks
        assert ticks * resolved.timing.communication_step_s == pytest.approx(every_s)
