"""Machines and soils of other programs over DDS: the bits of a run in process, and faults that end it."""

import json
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import subsoil_ros as subsoil
from subsoil_ros.errors import InputError
from subsoil_ros.ros.transport.ros_domain import run_domain
from subsoil_ros.yaml_document import dump_yaml
from tests.outside import Block, SpringField, document
from tests.system.conftest import Run
from tests.system.test_modes import without_wall_time

ROOT = Path(__file__).parents[2]
HITCH = ROOT / "examples" / "three_point_hitch"
BOTH = {"machine": "machine=Block()", "soil": "soil=SpringField()"}
LIMIT_S = 600.0


def serving(scene: Path, given: str, before: str) -> subprocess.Popen[str]:
    """A program that serves a participant of tests/outside.py; ends with the status of the error it gets."""
    program = f"""
import sys
import subsoil_ros as subsoil
from subsoil_ros.errors import SubsoilError
from tests.outside import Block, SpringField
{before}
try:
    subsoil.serve({str(scene)!r}, {given})
except SubsoilError as error:
    sys.exit(f"{{error.exit_status}} {{error}}")
"""
    return subprocess.Popen(
        [sys.executable, "-c", program], cwd=ROOT, stderr=subprocess.PIPE, stdin=subprocess.DEVNULL, text=True
    )


class Served:
    """A run as nodes whose machine and soil are programs of their own."""

    def __init__(self, folder: Path, before: str = "", earlier: Path | None = None, **more: Any) -> None:
        self.scene, self.out = folder / "scene.yaml", folder / ("rest" if earlier else "out")
        self.scene.write_text(dump_yaml(document(**more)), encoding="utf-8")
        duration_s = document(**more)["duration_s"]
        words, shared = [], f", checkpoints={str(self.out / 'checkpoints')!r}"
        if earlier is not None:
            words = ["--resume", str(earlier)]
            shared += f", resume={str(max(earlier.glob('checkpoints/*/manifest.json')).parent)!r}"
        self.run = Run(self.out, "nodes", duration_s, *words, scene=self.scene)
        self.programs = {name: serving(self.scene, given + shared, before) for name, given in BOTH.items()}

    def finish(self) -> tuple[int, str, dict[str, str]]:
        """Status and error of the run, and the last words of each program."""
        status, _, error = self.run.finish()
        words = {}
        for name, program in self.programs.items():
            text = program.communicate(timeout=LIMIT_S)[1].strip()
            words[name] = text.splitlines()[-1] if text else ""
        return status, error, words

    def end(self) -> None:
        """Leaves nothing behind."""
        for program in self.programs.values():
            program.kill()
            program.wait()
        self.run.end({})


@pytest.fixture(autouse=True)
def _own_domain(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.delenv("ROS_DOMAIN_ID", raising=False)
    with run_domain() as domain:
        monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
        yield


@pytest.fixture
def started() -> Iterator[list[Served]]:
    """Ends what a test left."""
    runs: list[Served] = []
    yield runs
    for served in runs:
        served.end()


@pytest.mark.full
def test_the_bits_are_those_of_a_run_in_process(tmp_path: Path, started: list[Served]) -> None:
    """Machine and soil in three processes and in one: the same series and the same state at the end."""
    started.append(Served(tmp_path))
    status, error, words = started[0].finish()
    assert status == 0, error + str(words)
    assert {program.returncode for program in started[0].programs.values()} == {0}, words
    subsoil.run(started[0].scene, tmp_path / "direct", machine=Block(), soil=SpringField())
    there, here = (tmp_path / name for name in ("out", "direct"))
    assert (there / "series.csv").read_bytes() == (here / "series.csv").read_bytes()
    assert without_wall_time(there) == without_wall_time(here)
    ends = [json.loads((out / "summary.json").read_text())["run"]["state_sha256"] for out in (there, here)]
    assert ends[0] == ends[1]
    assert set(ends[0]) == {"coupling", "mechanism", "soil"}
    assert list((there / "checkpoints").glob("*/manifest.json"))


def test_an_interrupted_run_goes_on(tmp_path: Path, started: list[Served]) -> None:
    """Ctrl-C writes a checkpoint with both participants in it; resumed, the state at the end is the same."""
    long = {"duration_s": 0.5}
    started.append(Served(tmp_path, **long))
    started[0].run.wait_until_recording()
    started[0].run.process.send_signal(signal.SIGINT)
    status, error, words = started[0].finish()
    assert status == 130, error + str(words)
    started.append(Served(tmp_path, earlier=tmp_path / "out", **long))
    status, error, words = started[1].finish()
    assert status == 0, error + str(words)
    subsoil.run(started[0].scene, tmp_path / "direct", machine=Block(), soil=SpringField())
    ends = [
        json.loads((tmp_path / name / "summary.json").read_text())["run"]["state_sha256"]
        for name in ("rest", "direct")
    ]
    assert ends[0] == ends[1]


@pytest.mark.full
def test_a_machine_that_dies_ends_the_run(tmp_path: Path, started: list[Served]) -> None:
    """SIGKILL of the serving program: status 3, named, the bag readable, the soil's program told."""
    started.append(Served(tmp_path, duration_s=60.0))
    served = started[0]
    served.run.wait_until_recording()
    served.programs["machine"].send_signal(signal.SIGKILL)
    status, error, words = served.finish()
    assert status == 3
    assert "mechanism has not been heard of" in error
    assert words["soil"].startswith("3 run aborted at tick ")
    run = subsoil.read_run(served.out)
    assert len(run.series) > 10
    assert "mechanism has not been heard of" in str(run.failure)


@pytest.mark.full
def test_an_error_of_the_machine_ends_the_run(tmp_path: Path, started: list[Served]) -> None:
    """An exception in advance: status 3 for all, one message with the place."""
    before = """
class Tired(Block):
    def advance(self, tick, wrenches):
        if tick == 700:
            raise ValueError("tired")
        return super().advance(tick, wrenches)
Block = Tired"""
    started.append(Served(tmp_path, before))
    status, error, words = started[0].finish()
    assert status == 3
    message = "machine: advance of tick 700 raised ValueError: tired (<string>, line 10)"
    assert message in " ".join(error.split())
    assert words["machine"] == f"3 {message}"
    last = subsoil.read_run(started[0].out).series["time_s"].iloc[-1]
    assert 0.0 < last < 0.0701  # the record is cut where all have finished, some ticks before the error


@pytest.mark.full
def test_a_machine_elsewhere_is_refused_at_the_start(tmp_path: Path, started: list[Served]) -> None:
    """Not at the start pose of the scene: status 2, nothing left in the folder."""
    before = """
class Raised(Block):
    def __init__(self):
        super().__init__()
        self._state[0] = 0.1
Block = Raised"""
    started.append(Served(tmp_path, before))
    status, error, words = started[0].finish()
    assert status == 2, error
    assert "initial_motions puts tool 'foot' 0.1 m" in " ".join(error.split())
    assert words["machine"].startswith("2 machine: initial_motions puts tool")
    assert not started[0].out.exists()


@pytest.mark.full
def test_a_program_that_comes_late_hears_of_the_end(tmp_path: Path, started: list[Served]) -> None:
    """The machine has refused before the soil is there: it does not wait for a coupler that has ended."""
    before = """
import time
class Wrong(Block):
    def __init__(self):
        super().__init__()
        self._state[0] = 0.1
class Late(SpringField):
    def __init__(self):
        time.sleep(6.0)
        super().__init__()
Block, SpringField = Wrong, Late"""
    started.append(Served(tmp_path, before))
    status, error, words = started[0].finish()
    assert status == 2, error
    assert "initial_motions puts tool 'foot' 0.1 m" in words["soil"], words


def test_what_serve_needs(tmp_path: Path) -> None:
    """Refused before any node is made."""
    with pytest.raises(InputError, match=r"serve: give a machine or a soil"):
        subsoil.serve(document(), Block(), soil=SpringField())
    with pytest.raises(
        InputError, match=r"serve: the scene writes checkpoints every 0.1 s; give checkpoints"
    ):
        subsoil.serve(document(), Block())
    with pytest.raises(InputError, match=r"machine: given, but .* has its own"):
        subsoil.serve("tine", Block())


@pytest.mark.full
@pytest.mark.parametrize(
    ("name", "duration_s"),
    [("hitch.yaml", 0.3), ("hitch_particles.yaml", 0.1)],
)
def test_the_hitch_over_dds_has_the_same_bits(name: str, duration_s: float, tmp_path: Path) -> None:
    """MuJoCo's three-point hitch in the plane and in space: in process, and as a node."""
    pytest.importorskip("mujoco", reason="needs the extra mujoco")
    program = [sys.executable, str(HITCH / "hitch.py"), "--scene", str(HITCH / name)]
    program += ["--duration", str(duration_s)]
    subprocess.run([*program, "--out", str(tmp_path / "direct")], check=True, timeout=LIMIT_S)
    run = Run(tmp_path / "nodes", "nodes", duration_s, scene=HITCH / name)
    try:
        subprocess.run([*program, "--serve"], check=True, timeout=LIMIT_S)
        status, _, error = run.finish()
    finally:
        run.end({})
    assert status == 0, error
    direct, nodes = (tmp_path / name for name in ("direct", "nodes"))
    assert (nodes / "series.csv").read_bytes() == (direct / "series.csv").read_bytes()
    assert without_wall_time(nodes) == without_wall_time(direct)
    assert subsoil.read_run(tmp_path / "nodes").series["draft_newton"].max() > 10.0
