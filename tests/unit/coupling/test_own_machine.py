"""Machines and soils of other makers in this process: their physics, their state, and what is refused."""

import json
import math
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import subsoil_ros as subsoil
from subsoil_ros import SpatialMotion, ToolMotion, ToolWrench
from subsoil_ros.cli.main import main
from subsoil_ros.errors import InputError, InterruptedRunError, PhysicsError, RunError
from subsoil_ros.yaml_document import dump_yaml
from tests.outside import DAMPING, GRAVITY, MASS_KG, STIFFNESS, Block, SpringField, depth_m, document


def largest_error_m(interval_ns: int) -> float:
    """Of a whole run against the closed form."""
    scene = document(coupling={"communication_step_ns": interval_ns})
    run = subsoil.run(scene, machine=Block(1e-9 * interval_ns), soil=SpringField())
    depth = -run.series["tool.foot.z_m"]
    return float(np.abs(depth - depth_m(run.series["time_s"])).max())


def test_a_block_falls_on_springs_by_the_closed_form() -> None:
    """Both from outside: the error is that of the force held over a tick, of first order in its length."""
    coarse, fine = largest_error_m(200_000), largest_error_m(100_000)
    assert fine < 0.01 * MASS_KG * GRAVITY / STIFFNESS
    assert coarse / fine == pytest.approx(2.0, rel=0.1)


def test_a_resumed_run_has_the_same_bits(tmp_path: Path) -> None:
    """Interrupted at two thirds, resumed from its checkpoint by new objects."""

    def stop(done: int, count: int) -> None:
        if done == 2 * count // 3:
            raise KeyboardInterrupt

    with pytest.raises(InterruptedRunError):
        subsoil.run(document(), tmp_path / "half", machine=Block(), soil=SpringField(), progress=stop)
    subsoil.run(document(), tmp_path / "rest", machine=Block(), soil=SpringField(), resume=tmp_path / "half")
    subsoil.run(document(), tmp_path / "whole", machine=Block(), soil=SpringField())
    rest, whole = (json.loads((tmp_path / name / "summary.json").read_text()) for name in ("rest", "whole"))
    assert rest["run"]["state_sha256"] == whole["run"]["state_sha256"]
    assert set(whole["run"]["state_sha256"]) == {"coupling", "mechanism", "soil"}
    series = [(tmp_path / name / "series.csv").read_bytes() for name in ("rest", "whole")]
    assert series[0] == series[1]


def test_check_gives_a_bound_with_an_effective_mass() -> None:
    """On a wedge model sqrt(2 m / (modulus area)); without an effective mass there is none."""
    wedge = {
        "model": "wedge",
        "bin": document()["soil"]["bin"],
        "values": {
            "density_kg_per_m3": 1500.0, "cohesion_pa": 8e3, "friction_angle_rad": 0.5, "adhesion_pa": 0.0,
            "tool_friction_angle_rad": 0.3, "bed_modulus_newton_per_m3": 2e7,
        },
    }  # fmt: skip
    (bound,) = subsoil.check(document(soil=wedge), machine=Block()).coupling
    assert bound.effective_mass_kg == MASS_KG
    area = 0.06 * 0.3 / math.sin(math.radians(60.0))
    assert bound.unstable_s == pytest.approx(math.sqrt(2.0 * MASS_KG / (2e7 * area)))
    without = subsoil.check(document(soil=wedge))
    assert without.coupling == ()
    assert "no bound on the communication step" in str(without)
    assert "stiffness of the soil is not known" in str(subsoil.check(document(), machine=Block()))


def changed(method: str, change: Callable[[Any], Any], tick: int = 0) -> Block:
    """A block whose answer is changed: of initial_motions, or of advance from a tick on."""
    block, given = Block(), getattr(Block, method)

    def answer(*arguments: Any) -> Any:
        found = given(block, *arguments)
        return change(found) if method == "initial_motions" or arguments[0] >= tick else found

    setattr(block, method, answer)
    return block


def spatial(motions: list[ToolMotion]) -> list[ToolMotion]:
    """The same in space."""
    return [
        SpatialMotion.of(m.tool, m.position_m, m.quaternion, m.velocity_m_per_s, (0, 0, 0)) for m in motions
    ]


def raises(motions: Any) -> Any:
    """An error of the machine's own."""
    raise ZeroDivisionError("by hand")


BAD: dict[str, tuple[Callable[[Any], Any], str]] = {
    "two motions": (lambda m: [*m, *m], "gave 2 records; it must give one for each tool: foot"),
    "no sequence": (lambda m: None, "gave a NoneType; it must give one for each tool"),
    "another name": (lambda m: [replace(m[0], tool="arm")], "gave tool 'arm' where 'foot' is due"),
    "not finite": (
        lambda m: [replace(m[0], z_m=math.nan)],
        "gave z_m nan for tool 'foot'; numbers must be finite",
    ),
    "text": (lambda m: [replace(m[0], x_m="0")], "gave x_m '0' for tool 'foot'"),
    "in space": (spatial, "gave a SpatialMotion for tool 'foot'; give a ToolMotion"),
    "aside": (lambda m: [replace(m[0], y_m=0.1)], "gave y_m 0.1, but it moves in the plane y = 0 m"),
    "an error": (raises, "raised ZeroDivisionError: by hand ("),
    "an exit": (lambda m: sys.exit("by hand"), "raised SystemExit: by hand ("),
}


@pytest.mark.parametrize("case", BAD)
def test_a_bad_answer_ends_the_run(case: str, tmp_path: Path) -> None:
    """At the start bad input and nothing written; later a fault with a readable record up to that tick."""
    change, words = BAD[case]
    with pytest.raises(InputError) as refused:
        subsoil.run(
            document(), tmp_path / "a", machine=changed("initial_motions", change), soil=SpringField()
        )
    assert f"machine: initial_motions {words}" in str(refused.value)
    assert not (tmp_path / "a").exists()
    machine = changed("advance", change, 1500)
    with pytest.raises(RunError) as failed:
        subsoil.run(document(), tmp_path / "b", machine=machine, soil=SpringField())
    assert f"machine: advance of tick 1500 {words}" in str(failed.value)
    assert failed.value.exit_status == 3
    assert "\n" not in str(failed.value)
    run = subsoil.read_run(tmp_path / "b")
    assert run.series["time_s"].iloc[-1] == pytest.approx(0.15)
    assert "machine: advance of tick 1500" in str(run.failure)


def test_the_interface_energy_is_watched() -> None:
    """A soil that books half of its work: the run ends by the residual, as with a mechanism."""

    class Half(SpringField):
        def advance(self, tick: int, motions: Any) -> Any:
            return [
                replace(wrench, work_joule=0.5 * wrench.work_joule)
                for wrench in super().advance(tick, motions)
            ]

    with pytest.raises(PhysicsError, match="interface energy residual"):
        subsoil.run(document(), machine=Block(), soil=Half())


class Spinner:
    """Turns at a constant speed; its angle is told as it is, or between -pi and pi."""

    def __init__(self, wrapped: bool) -> None:
        self._wrapped, self._turned_rad = wrapped, 0.0

    def initial_motions(self) -> list[ToolMotion]:
        angle = math.remainder(self._turned_rad, math.tau) if self._wrapped else self._turned_rad
        return [ToolMotion("foot", 0.0, 0.0, 0.0, angle, 0.0, 0.0, 30.0)]

    def advance(self, tick: int, wrenches: Any) -> list[ToolMotion]:
        self._turned_rad += 30.0 * 1e-4
        return self.initial_motions()

    def state_arrays(self) -> dict[str, Any]:
        return {"turned": np.array(self._turned_rad)}

    def restore(self, arrays: Any) -> None:
        self._turned_rad = float(arrays["turned"])


class Brake:
    """A torque against the turn, and its work."""

    def start(self, motions: tuple[ToolMotion, ...]) -> list[ToolWrench]:
        self._angle = motions[0].angle_rad
        return [ToolWrench("foot", 0.0, 0.0, 0.0, 0.0, 5.0, 0.0, 0.0, 1)]

    def advance(self, tick: int, motions: tuple[ToolMotion, ...]) -> list[ToolWrench]:
        turned, self._angle = motions[0].angle_rad - self._angle, motions[0].angle_rad
        return [ToolWrench("foot", 0.0, 0.0, 0.0, 0.0, 5.0, 0.0, -5.0 * turned, 1)]

    def state_arrays(self) -> dict[str, Any]:
        return {"angle": np.array(self._angle)}

    def restore(self, arrays: Any) -> None:
        self._angle = float(arrays["angle"])


def test_an_angle_may_be_told_between_minus_pi_and_pi(tmp_path: Path) -> None:
    """One and a half turns: the same series as of the whole angle, also when resumed past half a turn."""

    def stop(done: int, count: int) -> None:
        if done == 2 * count // 3:
            raise KeyboardInterrupt

    whole = subsoil.run(document(), machine=Spinner(False), soil=Brake()).series
    assert whole["tool.foot.angle_rad"].iloc[-1] == pytest.approx(9.0)
    with pytest.raises(InterruptedRunError):
        subsoil.run(document(), tmp_path / "half", machine=Spinner(True), soil=Brake(), progress=stop)
    rest = subsoil.run(
        document(), tmp_path / "rest", machine=Spinner(True), soil=Brake(), resume=tmp_path / "half"
    ).series
    np.testing.assert_allclose(rest.to_numpy(), whole.to_numpy(), rtol=1e-9, atol=1e-9)


class Silent:
    """A machine without state_arrays and restore."""

    def __init__(self) -> None:
        block = Block()
        self.initial_motions, self.advance = block.initial_motions, block.advance


def test_a_machine_without_state_runs_without_checkpoints(tmp_path: Path) -> None:
    """Refused where the scene writes checkpoints; without them it runs, and cannot be resumed."""
    field = SpringField()
    with pytest.raises(InputError, match=r"machine: Silent has no state_arrays and restore.*checkpoint_s: 0"):
        subsoil.run(document(), machine=Silent(), soil=field)
    scene = document(record={"checkpoint_s": 0.0})
    run = subsoil.run(scene, tmp_path / "run", machine=Silent(), soil=field)
    assert not (tmp_path / "run" / "checkpoints").exists()
    assert run.series["tool.foot.z_m"].min() < -0.5 * MASS_KG * GRAVITY / STIFFNESS


def moved(**path: Any) -> dict[str, Any]:
    """The scene with another start pose."""
    return document(tools={"foot": {**document()["tools"]["foot"], "path": {"external": True, **path}}})


def both() -> dict[str, Any]:
    """The block and its field."""
    return {"machine": Block(), "soil": SpringField()}


SPEED = {"speed_x_m_per_s": {"kind": "constant", "value": 1.0}}


@pytest.mark.parametrize(
    ("scene", "participants", "words"),
    [
        (moved(start_x_m=0.01), both(), "puts tool 'foot' 0.01 m and 0 rad from its start"),
        (moved(start_angle_rad=0.2), both(), "puts tool 'foot' 0 m and 0.2 rad from its start"),
        (document(), {"soil": SpringField()}, "the machine comes from outside; give run(scene, machine=...)"),
        (document(), {"machine": Block()}, "the soil comes from outside"),
        (document(), {**both(), "machine": object()}, "object has no method initial_motions, advance"),
        (document(), {**both(), "soil": Block()}, "soil: Block has no method start"),
        ("mechanism_only", {"machine": Block()}, "mechanism_only.yaml has its own; write tools"),
        (moved(**SPEED), {}, "external: given with speed_x_m_per_s"),
    ],
)
def test_what_does_not_fit_the_scene_is_refused(
    scene: Any, participants: dict[str, Any], words: str, tmp_path: Path
) -> None:
    """One message, and nothing written."""
    with pytest.raises(InputError) as refused:
        subsoil.run(scene, tmp_path / "run", **participants)
    assert words in str(refused.value)
    assert not (tmp_path / "run").exists()


def test_an_effective_mass_must_fit() -> None:
    """One positive number for each tool."""
    block = Block()
    block.effective_mass_kg = {"arm": 1.0}
    with pytest.raises(
        InputError, match=r"effective_mass_kg is .*one positive number .kg. for each tool: foot"
    ):
        subsoil.check(document(), machine=block)


def test_the_command_line_names_the_way(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A direct run has no place for a machine from outside: status 2, nothing written."""
    (tmp_path / "scene.yaml").write_text(dump_yaml(document()), encoding="utf-8")
    words = ["run", str(tmp_path / "scene.yaml"), "--mode", "direct", "--out", str(tmp_path / "run")]
    assert main(words) == 2
    assert "the machine comes from outside" in capsys.readouterr().err
    assert not (tmp_path / "run").exists()


def test_all_tools_or_none() -> None:
    """One machine moves all tools."""
    scene = document()
    scene["tools"]["other"] = {"path": {}, "groups": scene["tools"]["foot"]["groups"]}
    with pytest.raises(InputError, match=r"tools: other without path\.external: true"):
        subsoil.load_scene(scene)


def test_damping_is_booked() -> None:
    """Weight times depth is in the springs, in motion, or in the damper by the closed form."""
    run = subsoil.run(document(), machine=Block(), soil=SpringField())
    depth, speed = -run.series["tool.foot.z_m"].iloc[-1], run.series["tool.foot.velocity_z_m_per_s"].iloc[-1]
    time = np.linspace(0.0, 0.3, 30001)
    rate = np.gradient(depth_m(time), time)
    lost = DAMPING * float(np.trapezoid(rate**2, time))
    given = MASS_KG * GRAVITY * depth - 0.5 * MASS_KG * speed**2
    assert given == pytest.approx(0.5 * STIFFNESS * depth**2 + lost, rel=0.01)
