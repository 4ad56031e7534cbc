"""Scene files: reading, merging, initial conditions, overrides, and the way back through a written scene."""

import textwrap
from pathlib import Path

import pytest

from subsoil_ros.errors import SceneError
from subsoil_ros.loading.loader import load_scene
from subsoil_ros.scene.bed_kinds import TiledBed

SCENE = """
name: pendulum
duration_s: 1e-1
initial_condition: low
mechanism:
  bodies:
    bob: {mass_kg: 2, inertia_kg_m2: 0.5, position_m: [0.0, -1.0]}
  joints:
    pivot: {kind: revolute, body_a: ground, body_b: bob, point_m: [0.0, 0.0]}
  forces:
    push: {kind: point_load, body: bob, point_m: [0.0, -1.0], force_x_newton: {kind: constant, value: 3.0}}
initial_conditions:
  low: {}
  high:
    mechanism:
      forces: {push: null}
      initial: {coordinates: {bob.angle_rad: 1.5}}
"""


@pytest.fixture
def scene_file(tmp_path: Path) -> Path:
    path = tmp_path / "pendulum.yaml"
    path.write_text(SCENE)
    return path


def complaint(path: Path, *overrides: str) -> str:
    with pytest.raises(SceneError) as caught:
        load_scene(path, overrides)
    return str(caught.value)


def test_exponent_without_point_is_a_number(scene_file: Path) -> None:
    """1e-1 is read as 0.1."""
    assert load_scene(scene_file).scene.duration_s == 0.1


def test_leading_zeros_are_decimal(scene_file: Path) -> None:
    """YAML 1.2: 010 is ten; YAML 1.1 took it for the octal eight."""
    assert load_scene(scene_file, ["duration_s=010"]).scene.duration_s == 10.0


def test_initial_condition_is_laid_over_the_rest(scene_file: Path) -> None:
    """The chosen initial condition changes and removes keys; the other one leaves no trace."""
    low, high = load_scene(scene_file).scene, load_scene(scene_file, ["initial_condition=high"]).scene
    assert low.mechanism is not None
    assert high.mechanism is not None
    assert list(low.mechanism.forces) == ["push"]
    assert list(high.mechanism.forces) == []
    assert high.mechanism.initial.coordinates == {"bob.angle_rad": 1.5}


def test_a_whole_part_may_be_added(scene_file: Path) -> None:
    """A force under a new name; a value below a name that is not there is a slip of the pen (below)."""
    force = "{kind: point_load, body: bob, point_m: [0.0, -1.0], force_x_newton: {kind: constant, value: 2}}"
    found = load_scene(scene_file, [f"mechanism.forces.pull={force}"]).scene.mechanism
    assert found is not None
    assert list(found.forces) == ["push", "pull"]


@pytest.mark.parametrize(
    "overrides", [(), ("initial_condition=high",), ("duration_s=0.3", "mechanism.bodies.bob.mass_kg=3")]
)
def test_written_scene_is_the_same_scene(
    scene_file: Path, tmp_path: Path, overrides: tuple[str, ...]
) -> None:
    """What write() leaves loads to an equal scene and hash, start and overrides included."""
    first = load_scene(scene_file, overrides)
    copy = tmp_path / "elsewhere" / "scene.yaml"
    copy.parent.mkdir()
    first.write(copy)
    second = load_scene(copy)
    assert second.scene == first.scene
    assert second.scene_hash == first.scene_hash
    assert second.document == first.document


def test_hash_sees_numbers_and_not_their_spelling(scene_file: Path, tmp_path: Path) -> None:
    """Comments, 2 for 2.0 and written-out defaults keep the hash; another number changes it."""
    spelled = tmp_path / "spelled.yaml"
    spelled.write_text("# same\n" + SCENE.replace("mass_kg: 2,", "mass_kg: 2.0, angle_rad: 0.0,"))
    reference = load_scene(scene_file).scene_hash
    assert load_scene(spelled).scene_hash == reference
    assert load_scene(scene_file, ["mechanism.bodies.bob.mass_kg=2.1"]).scene_hash != reference


def test_base_is_laid_under(scene_file: Path) -> None:
    """A scene with a base keeps what it does not name, and null removes."""
    child = scene_file.with_name("child.yaml")
    child.write_text(
        textwrap.dedent("""
        base: pendulum.yaml
        name: child
        initial_condition: null
        initial_conditions: null
        mechanism: {bodies: {bob: {mass_kg: 5.0}}, forces: null}
        """)
    )
    mechanism = load_scene(child).scene.mechanism
    assert mechanism is not None
    assert mechanism.bodies["bob"].mass_kg == 5.0
    assert mechanism.bodies["bob"].inertia_kg_m2 == 0.5
    assert mechanism.forces == {}
    assert "no initial condition 'high'" in complaint(child, "initial_condition=high")


def test_initial_condition_of_the_base_may_remove(scene_file: Path) -> None:
    """A start inherited from the base still removes by null."""
    child = scene_file.with_name("child.yaml")
    child.write_text("base: pendulum.yaml\nname: child\ninitial_condition: high\n")
    mechanism = load_scene(child).scene.mechanism
    assert mechanism is not None
    assert mechanism.forces == {}


def test_circle_of_bases(tmp_path: Path) -> None:
    """Two files that name each other as base are refused."""
    (tmp_path / "a.yaml").write_text("base: b.yaml\n")
    (tmp_path / "b.yaml").write_text("base: a.yaml\n")
    assert "name each other as base" in complaint(tmp_path / "a.yaml")


def test_override_replaces_a_law_of_another_kind(scene_file: Path) -> None:
    """A mapping of another kind replaces; keys of the old kind are not left in it."""
    law = "{kind: ramp, end_value: 4.0, end_s: 0.5}"
    scene = load_scene(scene_file, [f"mechanism.forces.push.force_x_newton={law}"]).scene
    assert scene.mechanism is not None
    push = scene.mechanism.forces["push"]
    assert push.model_dump()["force_x_newton"] == {
        "kind": "ramp", "start_value": 0.0, "end_value": 4.0, "start_s": 0.0, "end_s": 0.5,
    }  # fmt: skip


def test_a_kind_over_a_base_that_leaves_it_out_keeps_the_base(tmp_path: Path) -> None:
    """The kind of a material's bed comes after the base; the seed that stands there still counts."""
    base = Path(__file__).parents[3] / "config/scenes/field_tine.yaml"
    (tmp_path / "base.yaml").write_text(f"base: {base}\nsoil: {{bed: {{seed: 5}}}}\n")
    child = tmp_path / "child.yaml"
    child.write_text("base: base.yaml\nsoil: {bed: {kind: tiled, tile_m: 0.5}}\n")
    soil = load_scene(child).scene.particle_soil
    assert soil is not None
    assert isinstance(soil.bed, TiledBed)
    assert (soil.bed.seed, soil.bed.tile_m) == (5, 0.5)


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("duration=3", ["no key 'duration'", "did you mean 'duration_s'"]),
        ("mechanism.bodies.bobb.mass_kg=1", ["no key 'bobb' in mechanism.bodies", "did you mean 'bob'"]),
        ("mechanism.bodies.bob.mass_gk=1", ["no key 'mass_gk'", "did you mean 'mass_kg'"]),
        ("mechanism.bodies.bob.position_m.0=1", ["is a list", "position_m=[...]"]),
        ("mechanism.bodies.bob.mass_kg.x=1", ["'mechanism.bodies.bob.mass_kg' has no keys below it"]),
        ("mechanism.bodies.bob.mass_kg=-1", ["bob.mass_kg: given -1", "greater than 0", "by --set"]),
        ("initial_condition=hihg", ["no initial condition 'hihg'", "did you mean 'high'"]),
        ("initial_conditions.low.name=x", ["'initial_conditions' cannot be set"]),
        ("coupling=null", ["none to remove"]),
        ("duration_s", ["KEY.KEY=VALUE"]),
        ("duration_s=", ["KEY.KEY=VALUE"]),
        ("duration_s=.inf", ["given inf", "finite"]),
        ("duration_s=[1", ["not valid YAML"]),
    ],
)
def test_bad_override(scene_file: Path, override: str, words: list[str]) -> None:
    """A wrong override says which, and what is known there."""
    text = complaint(scene_file, override)
    assert "\n" not in text
    for word in words:
        assert word in text


def test_override_of_a_default(scene_file: Path) -> None:
    """Keys that the file leaves out, and names with dots, can be set."""
    scene = load_scene(
        scene_file, ["coupling.mechanism_steps=3", "mechanism.initial.coordinates.bob.angle_rad=0.2"]
    ).scene
    assert scene.coupling.mechanism_steps == 3
    assert scene.mechanism is not None
    assert scene.mechanism.initial.coordinates == {"bob.angle_rad": 0.2}


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("duration_s: 1e-1", "duration_s: true", ["duration_s: given true; it must be a number"]),
        ("duration_s: 1e-1", "duration_s: yes", ["duration_s: given the text 'yes'; it must be a number"]),
        ("duration_s: 1e-1", "duration_s: 1:30", ["duration_s: given the text '1:30'; it must be a number"]),
        ("name: pendulum", "name: 2020-01-02\nduration: 1", ["duration: unknown key"]),
        ("duration_s: 1e-1", "duration_s: 10 s", ["duration_s: given the text '10 s'; it must be a number"]),
        ("duration_s: 1e-1", "duration_s: .nan", ["duration_s: given nan", "finite"]),
        ("duration_s: 1e-1", "duration_s: 1\nduration_s: 2", ["4:1", "'duration_s' is given twice", "3"]),
        (
            "  high:\n",
            "  high:\n    <<: {}\n    name: a\n    name: b\n",
            ["'name' is given twice", "first in line"],
        ),
        ("duration_s: 1e-1", "2: 3", ["key 2 is not text"]),
        ("duration_s: 1e-1", "[a, b]: 3", ["key of several values is not text"]),
        ("kind: revolute", "kind: revolut", ["joints.pivot.kind", "did you mean 'revolute'"]),
        (
            "kind: revolute, ",
            "",
            ["joints.pivot: 'kind' is missing", "revolute, prismatic, point_on_line, fixed, driver"],
        ),
        ("point_m: [0.0, 0.0]", "point_m: [0.0]", ["joints.pivot.point_m.1: is missing"]),
        ("point_m: [0.0, 0.0]", "pointm: [0.0, 0.0]", ["joints.pivot.pointm: unknown key", "'point_m'"]),
        ("kind: constant, value: 3.0", "kind: constant, valeu: 3", ["newton.valeu: unknown", "'value'"]),
        ("body_a: ground", "body_a: grond", ["mechanism.joints.pivot.body_a: no body 'grond'"]),
        (
            "name: pendulum",
            "nmae: pendulum",
            ["nmae: unknown key", "did you mean 'name'", "name: is missing"],
        ),
        ("initial_condition: low", "", ["initial_condition: is missing; choose one of low, high"]),
        ("  low: {}", "  low: 3", ["initial_conditions: must be a mapping"]),
    ],
)
def test_bad_file(scene_file: Path, old: str, new: str, words: list[str]) -> None:
    """A wrong file is answered with its name, the place, what was given and what is allowed."""
    assert old in SCENE
    scene_file.write_text(SCENE.replace(old, new))
    text = complaint(scene_file)
    assert str(scene_file) in text
    for word in words:
        assert word in text


def test_many_errors_are_counted(scene_file: Path) -> None:
    """Eight errors are shown, one per line, and the rest is counted."""
    scene_file.write_text(SCENE + "".join(f"wrong{k}: 1\n" for k in range(12)))
    lines = complaint(scene_file).splitlines()
    assert len(lines) == 9
    assert "4 more errors" in lines[-1]


def test_alias_that_contains_itself(scene_file: Path) -> None:
    """A YAML alias inside its own anchor ends in a message, not in a recursion."""
    scene_file.write_text(SCENE + "loop: &loop {again: *loop}\n")
    assert "nested without end" in complaint(scene_file)


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        (["tools.tine.setback_m=0.012"], "given 0.012; it must be at most 0.00956"),
        (["tools.tine.setback_m=0.005", "preset=real_time"], "given without particles"),
    ],
)
def test_setbacks_that_are_refused(overrides: list[str], words: str) -> None:
    assert words in complaint(Path(__file__).parents[3] / "config/scenes/field_tine.yaml", *overrides)
