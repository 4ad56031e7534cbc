"""MuJoCo as the machine of a scene: closed forms, balances, its state, and what is refused."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import subsoil_ros as subsoil
from subsoil_ros import ToolMotion, ToolWrench
from subsoil_ros.errors import InputError, RunError
from subsoil_ros.messages import work_joule
from tests.outside import GRAVITY, MASS_KG, STIFFNESS, SpringField, depth_m, document

pytest.importorskip("mujoco", reason="needs the extra mujoco")

HITCH = Path(__file__).parents[3] / "examples" / "three_point_hitch"
BLOCK = f"""
<mujoco>
  <option timestep="0.0001" integrator="Euler"/>
  <worldbody>
    <body name="block">
      <joint type="slide" axis="0 0 1"/>
      <inertial pos="0 0 0" mass="{MASS_KG}" diaginertia="1 1 1"/>
      <site name="foot"/>
    </body>
  </worldbody>
</mujoco>"""


def test_a_block_falls_on_springs_by_the_closed_form() -> None:
    """MuJoCo's body on a spring field: swings about m g / k as the oscillator does."""
    scene = subsoil.load_scene(document())
    run = subsoil.run(scene, machine=subsoil.MujocoMachine(scene, BLOCK), soil=SpringField())
    error = np.abs(-run.series["tool.foot.z_m"] - depth_m(run.series["time_s"]))
    assert error.max() < 0.01 * MASS_KG * GRAVITY / STIFFNESS


class Nothing:
    """No force at all."""

    def start(self, motions: tuple[ToolMotion, ...]) -> list[ToolWrench]:
        """Zero."""
        return [ToolWrench("foot", 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0)]

    def advance(self, tick: int, motions: tuple[ToolMotion, ...]) -> list[ToolWrench]:
        """Zero."""
        return self.start(motions)


@pytest.mark.parametrize("every_tick", [True, False])
def test_a_force_that_the_control_applies_stays_beside_that_of_the_soil(every_tick: bool) -> None:
    """data.xfrc_applied, set at every exchange or once, lifts the block by (F / m - g) t^2 / 2."""
    scene, force = subsoil.load_scene(document(record={"checkpoint_s": 0.0})), 2.0 * MASS_KG * GRAVITY

    def control(model: Any, data: Any, time_s: float) -> None:
        if every_tick or time_s == 0.0:
            data.body("block").xfrc_applied[2] = force

    machine = subsoil.MujocoMachine(scene, BLOCK, control)
    run = subsoil.run(scene, machine=machine, soil=Nothing())
    time_s, z_m = (run.series[name].to_numpy() for name in ("time_s", "tool.foot.z_m"))
    assert z_m[-1] == pytest.approx(0.5 * GRAVITY * time_s[-1] ** 2, rel=1e-3)


ARM_M, BOB_KG, DRAG_NEWTON, YAW_RAD, START_RAD = 2.0, 50.0, 50.0, 0.5, 1.0


class Drag:
    """A force of constant size against the motion, where the tool is below `level_m`."""

    level_m = -0.8 * ARM_M

    def start(self, motions: tuple[ToolMotion, ...]) -> list[ToolWrench]:
        """None at rest."""
        self._motion, self.way_m = motions[0], 0.0
        return [ToolWrench("foot", 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0)]

    def advance(self, tick: int, motions: tuple[ToolMotion, ...]) -> list[ToolWrench]:
        """Against the velocity at the tick's end."""
        motion, speed = motions[0], math.hypot(*motions[0].velocity_m_per_s)
        inside = motion.z_m < self.level_m
        size = DRAG_NEWTON / speed if inside else 0.0
        force = tuple(-size * part for part in motion.velocity_m_per_s)
        work = work_joule(force, (0.0, 0.0, 0.0), self._motion, motion)
        self.way_m += math.dist(motion.position_m, self._motion.position_m) if inside else 0.0
        self._motion = motion
        return [ToolWrench("foot", *force, 0.0, 0.0, 0.0, work, int(inside))]


@pytest.mark.full
def test_a_pendulum_plough_does_known_work() -> None:
    """Yawed, its weight halfway up, through soil of constant drag: it loses drag times arc."""
    sine, cosine = math.sin(START_RAD), math.cos(START_RAD)
    half, half_m = 0.5 * YAW_RAD, 0.5 * ARM_M
    model = f"""
    <mujoco>
      <option timestep="0.0001" integrator="Euler"/>
      <worldbody>
        <body quat="{math.cos(half)} 0 0 {math.sin(half)}">
          <joint type="hinge" axis="0 1 0"/>
          <inertial pos="{-half_m * sine} 0 {-half_m * cosine}" mass="{2 * BOB_KG}"
                    diaginertia="1e-6 1e-6 1e-6"/>
          <site name="foot" pos="{-sine * ARM_M} 0 {-cosine * ARM_M}"/>
        </body>
      </worldbody>
    </mujoco>"""
    place = (-sine * ARM_M * math.cos(YAW_RAD), -sine * ARM_M * math.sin(YAW_RAD), -cosine * ARM_M)
    path = {
        "external": True, "start_x_m": place[0], "start_z_m": place[2],
        "turn": {"start_rotation_rad": [0.0, 0.0, YAW_RAD]},
    }  # fmt: skip
    foot = {**document()["tools"]["foot"], "path": path, "lateral_m": place[1]}
    scene = subsoil.load_scene(
        document(
            duration_s=1.15,
            tools={"foot": foot},
            coupling={
                "communication_step_ns": 100_000,
                "residual_grace_joule": 10.0,
            },  # the drag begins at once
            record={"checkpoint_s": 0.0, "series_ticks": 10},
        )
    )
    soil = Drag()
    run = subsoil.run(scene, machine=subsoil.MujocoMachine(scene, model), soil=soil)
    series = run.series
    arc = 2.0 * math.acos(-Drag.level_m / ARM_M) * ARM_M
    assert soil.way_m == pytest.approx(arc, rel=2e-3)
    up = series["tool.foot.x_m"] * math.cos(YAW_RAD) + series["tool.foot.y_m"] * math.sin(YAW_RAD) > 0.0
    top = float(series["tool.foot.z_m"][up].max())
    lost = BOB_KG * GRAVITY * (place[2] - top)
    assert lost == pytest.approx(DRAG_NEWTON * arc, rel=5e-3)
    off = series["tool.foot.y_m"] * math.cos(YAW_RAD) - series["tool.foot.x_m"] * math.sin(YAW_RAD)
    assert off.abs().max() < 1e-9  # it stays in its plane
    assert abs(run.summary["energy"]["residual_ratio"]) < 0.02


def test_the_cart_starts_where_its_scene_does() -> None:
    """The smallest example: its tine at the start of the path, at the speed of the cart."""
    folder = HITCH.parent / "mujoco_cart"
    scene = subsoil.load_scene(folder / "cart.yaml")
    (motion,) = subsoil.MujocoMachine(scene, folder / "cart.xml").initial_motions()
    path = scene.scene.tools["tine"].path
    assert path is not None
    assert (motion.x_m, motion.z_m) == pytest.approx((path.start_x_m, path.start_z_m))
    assert motion.velocity_x_m_per_s == pytest.approx(0.5)


def hitch(duration_s: float, **machine: Any) -> tuple[Any, subsoil.MujocoMachine]:
    """The scene of the three-point hitch, and its machine."""
    scene = subsoil.load_scene(HITCH / "hitch.yaml", {"duration_s": duration_s, "record.checkpoint_s": 0.1})
    return scene, subsoil.MujocoMachine(scene, HITCH / "hitch.xml", **machine)


def test_the_tractor_pulls_what_the_soil_resists() -> None:
    """In steady work the governor's mean force is the mean draft; lift rods and links close the rest."""
    governor: list[float] = []
    scene, machine = hitch(2.0, control=lambda model, data, time: governor.append(data.actuator_force[0]))
    run = subsoil.run(scene, machine=machine)
    steady = run.series["time_s"] > 1.0
    draft = run.series["draft_newton"][steady].mean()
    assert draft > 1000.0
    assert np.mean(governor[1000:]) == pytest.approx(draft, rel=0.01)
    assert run.series["tool.tine_middle.velocity_x_m_per_s"][steady].mean() == pytest.approx(0.5, rel=0.02)
    assert 0.1 < -(run.series["tool.tine_middle.z_m"][steady].mean() - 0.3) < 0.2  # depth of the tips
    assert run.summary["energy"]["residual_ratio"] < 0.02


def test_two_runs_have_the_same_bits_and_so_has_a_resumed_one(tmp_path: Path) -> None:
    """MuJoCo's state goes on from a checkpoint bit for bit."""

    def stop(done: int, count: int) -> None:
        if done == 240:
            raise KeyboardInterrupt

    scene, machine = hitch(0.3)
    subsoil.run(scene, tmp_path / "whole", machine=machine)
    scene, machine = hitch(0.3)
    with pytest.raises(RunError):
        subsoil.run(scene, tmp_path / "half", machine=machine, progress=stop)
    scene, machine = hitch(0.3)
    subsoil.run(scene, tmp_path / "rest", machine=machine, resume=tmp_path / "half")
    whole, rest = (subsoil.read_run(tmp_path / name) for name in ("whole", "rest"))
    assert whole.series["draft_newton"].max() > 100.0
    assert whole.summary["run"]["state_sha256"] == rest.summary["run"]["state_sha256"]
    assert (tmp_path / "whole/series.csv").read_bytes() == (tmp_path / "rest/series.csv").read_bytes()


@pytest.mark.parametrize(
    ("model", "words"),
    [
        (
            BLOCK.replace('name="foot"', 'name="toe"'),
            "no site 'foot' for the tool of that name; sites are toe",
        ),
        (BLOCK.replace("0.0001", "0.00003"), "option.timestep: given 3e-05 s; it must be a whole part of"),
        (BLOCK.replace("Euler", "RK4"), "option.integrator: given RK4"),
        (BLOCK.replace("<body", "<boddy"), "MuJoCo cannot read the model"),
    ],
)
def test_a_model_that_does_not_fit_is_refused(model: str, words: str) -> None:
    """One message."""
    with pytest.raises(InputError) as refused:
        subsoil.MujocoMachine(subsoil.load_scene(document()), model)
    assert words in str(refused.value)
    assert "\n" not in str(refused.value)


def test_a_state_that_is_not_finite_ends_the_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """MuJoCo would begin again at its start pose."""
    monkeypatch.chdir(tmp_path)  # MuJoCo writes a log there

    def control(model: Any, data: Any, time: float) -> None:
        if time > 0.05:
            data.qvel[0] = math.inf

    scene = subsoil.load_scene(document())
    machine = subsoil.MujocoMachine(scene, BLOCK, control)
    with pytest.raises(RunError, match=r"machine: advance of tick 501 raised PhysicsError: MuJoCo: "):
        subsoil.run(scene, machine=machine, soil=SpringField())
