"""Bad scenes on the command line: exit status 2, one clear message on stderr, no traceback."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import pytest
import trimesh

from subsoil_ros.cli.main import main

ROOT = Path(__file__).parents[3]
SCENES = ROOT / "config" / "scenes"

FOUR_BAR = """
name: four_bar
duration_s: 0.1
mechanism:
  bodies:
    crank: {mass_kg: 1.0, inertia_kg_m2: 0.1, position_m: [0.0, 0.5]}
    coupler: {mass_kg: 1.0, inertia_kg_m2: 0.1, position_m: [0.5, 1.0]}
    rocker: {mass_kg: 1.0, inertia_kg_m2: 0.1, position_m: [1.0, 0.5]}
  joints:
    A: {kind: revolute, body_a: ground, body_b: crank, point_m: [0.0, 0.0]}
    B: {kind: revolute, body_a: crank, body_b: coupler, point_m: [0.0, 1.0]}
    C: {kind: revolute, body_a: coupler, body_b: rocker, point_m: [1.0, 1.0]}
    D: {kind: revolute, body_a: ground, body_b: rocker, point_m: [FAR, 0.0], point_b_m: [1.0, 0.0]}
"""


class Done(NamedTuple):
    """How a command ended."""

    returncode: int
    stdout: str
    stderr: str


Check = Callable[..., Done]


@pytest.fixture
def check(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Check:
    """Runs `subsoil check` from the root of the repository."""
    monkeypatch.chdir(ROOT)

    def run(*arguments: object) -> Done:
        return Done(main(["check", *map(str, arguments)]), *capsys.readouterr())

    return run


@pytest.fixture
def refused(check: Check) -> Callable[..., str]:
    """Runs `subsoil check` on bad input and gives its one message."""

    def run(*arguments: object) -> str:
        done = check(*arguments)
        assert done.returncode == 2, done.stderr
        assert done.stdout == ""
        lines = done.stderr.strip().splitlines()
        assert len(lines) == 1, done.stderr
        assert "Traceback" not in done.stderr
        return lines[0]

    return run


@pytest.mark.parametrize(
    "name", ["mechanism_only", "subsoiler_1s300", "subsoiler_1s300_quick", "tine", "tine_hardpan"]
)
def test_good_scene(check: Check, name: str) -> None:
    """The shipped scenes pass: status 0, tables on stdout, nothing on stderr."""
    done = check(SCENES / f"{name}.yaml")
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    assert "wall time" in done.stdout
    assert ("degrees of freedom  4" in done.stdout) == (not name.startswith("tine"))


def test_full_scene_is_described(check: Check) -> None:
    """The paper's scene shows particles, each step limit with its cause, steps, memory and wall time."""
    text = check(SCENES / "subsoiler_1s300.yaml", "--verbose").stdout
    for words in ("188,034", "on rotation", "on translation", "stiffness", "binds", "soil steps", "memory"):
        assert words in text
    limits = [float(found) for found in re.findall(r"^ ([\d.]+) us", text, re.MULTILINE)]
    assert limits == sorted(limits)
    assert len(limits) >= 3


def test_exchange_that_is_doubtful_is_said(check: Check) -> None:
    """An interval at which the exchange wins is warned of."""
    done = check(SCENES / "subsoiler_1s300_quick.yaml", "--set", "coupling.communication_step_ns=2000000")
    assert done.returncode == 0, done.stderr
    assert "the exchange outweighs the contact's damper" in " ".join(done.stdout.split())


def test_missing_file(refused: Callable[..., str]) -> None:
    """A scene file that is not there is named, with those beside it."""
    text = refused(SCENES / "tyne.yaml")
    assert "tyne.yaml: no such file" in text
    assert "tine.yaml" in text


def test_a_file_name_that_is_too_long(
    refused: Callable[..., str], capsys: pytest.CaptureFixture[str]
) -> None:
    """Of the scene, of files in it, and of a run."""
    long = "a" * 300
    assert long in refused(long)
    assert "no such file" in refused(SCENES / "field_tine.yaml", "--set", f"soil.material={long}")
    assert main(["report", long]) == 2
    assert "is longer than a file name can be" in capsys.readouterr().err


def test_folder_for_a_file(refused: Callable[..., str]) -> None:
    """A folder in place of the scene is refused."""
    assert "is a folder" in refused(SCENES)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("name: x\nsoil: [1, 2\nduration_s: 3\n", ":3:"),
        ("name: x\n\tduration_s: 3\n", ":2:1: not valid YAML"),
        ("", "is empty"),
        ("- 1\n- 2\n", "holds a list"),
        ("name: \xff\n", "byte 0xff is not UTF-8 text"),
    ],
)
def test_syntax_error(refused: Callable[..., str], tmp_path: Path, content: str, words: str) -> None:
    """What is no YAML mapping is refused by line and column."""
    path = tmp_path / "bad.yaml"
    path.write_bytes(content.encode("latin-1"))
    text = refused(path)
    assert str(path) in text
    assert words in text


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        (["soil.bin.lenght_m=1"], ["no key 'lenght_m' in soil.bin", "did you mean 'length_m'"]),
        (["soil.bin.length_m=long"], ["soil.bin.length_m: given the text 'long'; it must be a number"]),
        (["soil.particles.radius_m=-0.01"], ["soil.particles.radius_m: given -0.01", "greater than 0"]),
        (["mechanism.joints.H8_shank_hinge.body_b=shnak"], ["joints.H8_shank_hinge.body_b: no body 'shnak'"]),
        (["tools.shank.body=shnak"], ["tools.shank.body: no body 'shnak'"]),
        (
            ["tools.shank.body=wheel_left"],
            ["mechanism.forces.ground_left", "touches the soil twice", "wheel_contact"],
        ),
        (
            ["soil.time_step_s=1e-3"],
            ["soil.time_step_s: 0.001 s is above the stable limit", "damping", "auto"],
        ),
        (
            ["coupling.communication_step_ns=20000000"],
            ["communication_step_ns: 20000000 is above the stable limit", "shank"],
        ),
        (["tools.shank.groups.share.mesh=none.stl"], ["tools.shank.groups.share.mesh", "No such file"]),
    ],
)
def test_bad_value(refused: Callable[..., str], overrides: list[str], words: list[str]) -> None:
    """A key, a value or a name that cannot be: where, what was given, what is allowed."""
    arguments = [part for text in overrides for part in ("--set", text)]
    message = refused(SCENES / "subsoiler_1s300_quick.yaml", *arguments)
    for word in words:
        assert word in message


def test_unknown_key_in_the_file(check: Check, tmp_path: Path) -> None:
    """A misspelt key of a file is answered with the right one."""
    path = tmp_path / "bad.yaml"
    document = (SCENES / "tine.yaml").read_text()
    path.write_text(document.replace("cohesion_range_m:", "cohesoin_range_m:", 1))
    message = (
        "soil.law.particle.cohesoin_range_m: unknown key 'cohesoin_range_m'; did you mean 'cohesion_range_m'?"
    )
    text = check(path).stderr
    assert message in text


def test_open_mesh(refused: Callable[..., str], tmp_path: Path) -> None:
    """A mesh that is not watertight is refused by file and tool."""
    box = trimesh.creation.box((0.1, 0.1, 0.1))
    box.update_faces([face != 0 for face in range(12)])
    path = tmp_path / "open.stl"
    path.write_bytes(box.export(file_type="stl"))
    text = refused(SCENES / "tine.yaml", "--set", f"tools.tine.groups.share.mesh={path}")
    assert "tools.tine.groups.share.mesh" in text
    assert "open.stl: is not watertight" in text


def test_bodies_that_cannot_be_assembled(refused: Callable[..., str], tmp_path: Path) -> None:
    """Three links of 1 m cannot bridge 5 m."""
    path = tmp_path / "bad.yaml"
    path.write_text(FOUR_BAR.replace("FAR", "5.0"))
    text = refused(path)
    assert str(path) in text
    assert "assembled" in text


def test_four_bar_closes(check: Check, tmp_path: Path) -> None:
    """The scene of the test before is good but for its length."""
    path = tmp_path / "good.yaml"
    path.write_text(FOUR_BAR.replace("FAR", "1.1"))
    done = check(path)
    assert done.returncode == 0, done.stderr
    assert "degrees of freedom  1" in done.stdout


def test_contradictory_constraints(refused: Callable[..., str], tmp_path: Path) -> None:
    """Two drivers that want different speeds of one coordinate are refused by name."""
    path = tmp_path / "bad.yaml"
    law = "{{kind: constant, value: {0}}}"
    driver = f"    speed{{0}}: {{{{kind: driver, body: crank, coordinate: angle, speed: {law}}}}}\n"
    drivers = driver.format(1) + driver.format(2)
    path.write_text(FOUR_BAR.replace("FAR", "1.0") + drivers)
    text = refused(path)
    assert str(path) in text
    assert "contradict" in text
    assert "speed1" in text
    assert "speed2" in text
