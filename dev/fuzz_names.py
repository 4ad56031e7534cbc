"""Random names of tools, groups, bodies, joints, forces, scenes and mesh files, in one small scene.

Each is accepted, or refused in one message that shows the key or the name. Where all are accepted, topics and
frames must be valid in ROS and unlike, and a run must give a bag, columns and files under these names.
"""

import json
import tempfile
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from shutil import copyfile
from typing import NamedTuple

from hypothesis import strategies as st
from rclpy.validate_full_topic_name import validate_full_topic_name

from dev.fuzz import outcome
from subsoil_ros import load_scene, run
from subsoil_ros.analysis.columns import Body, FacetGroup, Joint, PlanarTool, Wrench, spring_element
from subsoil_ros.loading.files import config_folder
from subsoil_ros.recording.standard_messages import WORLD_FRAME
from subsoil_ros.recording.topics import bag_topic, recorded_topics
from subsoil_ros.yaml_document import read_document

MESH = config_folder() / "meshes" / "share.stl"
SOIL = {
    "model": "wedge", "bin": {"length_m": 2.0, "width_m": 0.5, "depth_m": 0.5},
    "values": {
        "density_kg_per_m3": 1300.0, "cohesion_pa": 8e3, "friction_angle_rad": 0.5, "adhesion_pa": 1e3,
        "tool_friction_angle_rad": 0.3,
    },
}  # fmt: skip

_hard = st.sampled_from(
    [
        "",
        " ",
        ".",
        "..",
        "a.b",
        "a/b",
        "../a",
        "on",
        "null",
        "true",
        "1e3",
        "0x1",
        "1a",
        "_a",
        "a__b",
        "a_",
        "~",
        "-",
        "a b",
        "a\n",
        "a\tb",
        "a:b",
        "a: b",
        "#a",
        "{a}",
        "'",
        '"',
        "%s",
        "blé",
        "土",
        "\u202ea",
        "\U0001f69c",
        "a" * 64,
        "a" * 65,
        "a" * 5000,
        "world",
        "ground",
        "all",
        "tool",
        "map",
        "kind",
        "time_s",
        "CON",
        "A",
        "a",
    ]
)
_names = st.one_of(st.from_regex(r"[A-Za-z][A-Za-z0-9_]{0,8}", fullmatch=True), _hard)
_texts = st.one_of(_names, st.text(max_size=12))


class Case(NamedTuple):
    """Names of two bodies and of the parts on them."""

    tools: tuple[str, str]
    groups: tuple[str, str]
    bodies: tuple[str, str]
    joint: str
    spring: str
    scene: str
    mesh: str
    escaped: bool = False
    runs: bool = False


NAMED = tuple(field for field in Case._fields if field not in ("escaped", "runs"))


def cases() -> st.SearchStrategy[Case]:
    """Mostly plain names, and one or more that are not."""
    two = st.lists(_texts, min_size=2, max_size=2, unique=True).map(tuple)
    plain = Case(("left", "right"), ("share", "shank"), ("front", "rear"), "pin", "spring", "named", "mesh")
    kinds = {field: two if isinstance(getattr(plain, field), tuple) else _texts for field in NAMED}
    fields = st.lists(st.sampled_from(sorted(kinds)), min_size=1, max_size=3, unique=True)
    given = fields.flatmap(lambda chosen: st.fixed_dictionaries({field: kinds[field] for field in chosen}))
    return st.builds(
        lambda given, k: plain._replace(**given, escaped=k > 7, runs=k == 0), given, st.integers(0, 9)
    )


def scene(case: Case, mesh: str) -> str:
    """Text of a scene with these names."""
    groups = {group: {"mesh": mesh} for group in case.groups}
    parts = {"body_a": case.bodies[0], "body_b": case.bodies[1]}
    places = {"point_a_m": (0.0, 0.3), "point_b_m": (1.0, 0.3)}
    stiffness = {"stiffness_newton_per_m": 100.0, "free_length_m": 1.0}
    body = {"mass_kg": 10.0, "inertia_kg_m2": 1.0}
    document = {
        "name": case.scene, "duration_s": 0.002, "soil": SOIL, "gravity_m_per_s2": 0.0,
        "mechanism": {
            "bodies": {name: body | {"position_m": (x, 0.0)} for x, name in enumerate(case.bodies)},
            "joints": {case.joint: {"kind": "revolute", **parts, "point_m": (0.5, 0.0)}},
            "forces": {case.spring: {"kind": "spring_damper", **parts, **places, **stiffness}},
        },
        "tools": {
            tool: {"body": name, "groups": groups} for tool, name in zip(case.tools, case.bodies, strict=True)
        },
        "report": {"spring": case.spring, "shank": case.bodies[0]},
    }  # fmt: skip
    return json.dumps(document, ensure_ascii=case.escaped)


def judge(case: Case) -> str:
    """Raise AssertionError unless the names are refused, or can be used everywhere."""
    with tempfile.TemporaryDirectory(prefix="subsoil_fuzz_") as folder:
        path = Path(folder) / "below" / "scene.yaml"
        path.parent.mkdir()
        mesh = path.parent / f"{case.mesh}.stl"
        with suppress(OSError, ValueError):  # no file can have such a name
            if not mesh.resolve().is_relative_to(folder):
                return "elsewhere"
            mesh.parent.mkdir(parents=True, exist_ok=True)
            copyfile(MESH, mesh)
        path.write_text(scene(case, f"{case.mesh}.stl"), encoding="utf-8")
        return outcome(lambda: _use(case, path), lambda message: _shows(case, message))


def _use(case: Case, path: Path) -> None:
    resolved = load_scene(path)
    topics = list(map(bag_topic, recorded_topics(resolved.scene)))
    for topic in topics:
        validate_full_topic_name(topic)
    assert len(set(topics)) == len(topics), "two topics have one name"
    columns = list(_columns(case))
    assert len(set(columns)) == len(columns), "two columns have one name"
    assert WORLD_FRAME not in case.bodies, "a body has the frame of the world"
    if not case.runs:
        return
    out = path.parent / "out"
    found = run(path, out)
    assert set(columns) <= set(found.series.columns), "a column is missing"
    again = read_document(out / "scene.yaml", "scene.yaml")
    assert again["name"] == case.scene, "the scene is kept under another name"
    assert load_scene(out / "scene.yaml").scene_hash == resolved.scene_hash, "the kept scene is another one"


def _columns(case: Case) -> Iterator[str]:
    parts = [Body(name) for name in case.bodies] + [Joint(case.joint)]
    for tool in case.tools:
        parts += [PlanarTool(tool), Wrench(tool), *(FacetGroup(tool, group) for group in case.groups)]
    for part in parts:
        yield from vars(part).values()
    yield from spring_element(case.spring)


def _shows(case: Case, message: str) -> None:
    fields = [getattr(case, field) for field in NAMED]
    named = [name for field in fields for name in ((field,) if isinstance(field, str) else field)]
    assert "scene.yaml:" in message, f"names no file: {message}"
    assert any(name in message for name in ("not valid YAML", *named, "name", *NAMED)), (
        f"shows no name: {message}"
    )
