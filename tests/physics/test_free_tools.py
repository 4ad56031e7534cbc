"""Tools that something else moves in six degrees of freedom: the same motion feels the same whoever makes it,
and a body that flies freely keeps momentum and energy together with the soil it strikes."""

import copy
import math

import numpy as np
import pytest
import trimesh
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

import subsoil_ros as subsoil
from subsoil_ros.messages import SpatialMotion, ToolWrench
from tests.soils import NEGLIGIBLE

CENTRE = np.array((0.2, 0.0, -0.2))
PARTICLE_KG = 1800.0 * 4.0 / 3.0 * math.pi * 0.01**3
PARTICLE_KG_M2 = 0.4 * PARTICLE_KG * 0.01**2
NO_ADHESION = {"cohesive_stiffness_newton_per_m": NEGLIGIBLE}
WIDE = ("gravity_m_per_s2=0", "soil.bin.length_m=0.4", "soil.bin.width_m=0.4", "soil.bin.depth_m=0.4")


def loads(wrench: ToolWrench) -> tuple[np.ndarray, np.ndarray]:
    """Force and torque."""
    return (
        np.array((wrench.force_x_newton, wrench.force_y_newton, wrench.force_z_newton)),
        np.array((wrench.torque_x_newton_m, wrench.torque_y_newton_m, wrench.torque_z_newton_m)),
    )


START_M, ACROSS_M_PER_S, TURN_RAD_PER_S = (0.03, 0.02), 0.3, 12.0
"""Of the centre of a ball half in the bed: place (x, z); it is drawn along x while it spins."""


class Spinner:
    """A machine that moves the ball as the paths do."""

    def __init__(self, tick_s: float) -> None:
        self._tick_s = tick_s

    def initial_motions(self) -> list[SpatialMotion]:
        """At time 0."""
        return self.advance(-1, ())

    def advance(self, tick: int, wrenches: tuple[ToolWrench, ...]) -> list[SpatialMotion]:
        """At the end of `tick`."""
        time = self._tick_s * (tick + 1)
        turn = Rotation.from_rotvec((0.0, -TURN_RAD_PER_S * time, 0.0)).as_quat().tolist()
        place = (START_M[0] + ACROSS_M_PER_S * time, 0.0, START_M[1])
        spin = (0.0, -TURN_RAD_PER_S, 0.0)
        return [SpatialMotion.of("ball", place, tuple(turn), (ACROSS_M_PER_S, 0.0, 0.0), spin)]


def constant(value: float) -> dict[str, object]:
    """A time function."""
    return {"kind": "constant", "value": value}


def test_a_spinning_ball_feels_the_same_whoever_turns_it(soil):
    """A path in the plane, a path in space, a mechanism with two drivers, and a machine from outside."""
    mesh = soil.folder / "ball.stl"
    trimesh.creation.icosphere(subdivisions=2, radius=0.03).export(mesh)
    start = {"start_x_m": START_M[0], "start_z_m": START_M[1]}
    moves = {**start, "speed_x_m_per_s": constant(ACROSS_M_PER_S)}
    turned = {"axis": [0.0, -1.0, 0.0], "speed_rad_per_s": constant(TURN_RAD_PER_S)}
    body = {"mass_kg": 2.0, "inertia_kg_m2": 0.01, "position_m": list(START_M)}
    slides = {"kind": "prismatic", "body_a": "ground", "body_b": "sledge", "point_m": list(START_M)}
    mechanism = {
        "bodies": {
            "sledge": {**body, "velocity_m_per_s": [ACROSS_M_PER_S, 0.0]},
            "ball": {
                **body, "velocity_m_per_s": [ACROSS_M_PER_S, 0.0],
                "angular_velocity_rad_per_s": TURN_RAD_PER_S,
            },
        },
        "joints": {
            "rail": {**slides, "axis": [1.0, 0.0]},
            "axle": {"kind": "revolute", "body_a": "sledge", "body_b": "ball", "point_m": list(START_M)},
            "drive": {
                "kind": "driver", "body": "sledge", "coordinate": "x", "speed": constant(ACROSS_M_PER_S),
            },
            "spindle": {
                "kind": "driver", "body": "ball", "coordinate": "angle", "speed": constant(TURN_RAD_PER_S),
            },
        },
    }  # fmt: skip
    ways = {
        "plane": ({"path": {**moves, "angular_speed_rad_per_s": constant(TURN_RAD_PER_S)}}, {}),
        "space": ({"path": {**moves, "turn": turned}}, {}),
        "machine": ({"path": {**start, "external": True, "turn": {}}}, {}),
        "mechanism": ({"body": "ball"}, {"mechanism": mechanism}),
    }
    found = {}
    for name, (moved, more) in ways.items():
        part = {"mesh": str(mesh)}
        if "body" in moved:
            part["position_m"] = [START_M[0], 0.0, START_M[1]]
        scene = soil.scene(
            "duration_s=0.05", "record.series_ticks=1", "record.checkpoint_s=0",
            "coupling.communication_step_ns=50000",
            tools={"ball": {**moved, "groups": {"ball": part}}}, **copy.deepcopy(more),
        )  # fmt: skip
        run = subsoil.run(scene, machine=Spinner(5e-5) if name == "machine" else None)
        assert run.failure is None
        columns = [f"tool.ball.{kind}_{axis}_newton{'_m' if kind == 'torque' else ''}"
                   for kind in ("force", "torque") for axis in "xyz"]  # fmt: skip
        found[name] = run.series[columns].to_numpy()
    scale = np.abs(found["space"]).max(axis=0)
    assert scale[0] > 1.0
    assert scale[4] > 0.01
    for rows in found.values():
        assert_allclose(rows, found["space"], rtol=0.0, atol=1e-6 * scale.max())


class Thrown:
    """A machine: one rigid body that nothing holds, moved by the wrench held through a tick.

    Momentum and angular momentum are advanced exactly, orientation by the midpoint rule.
    """

    def __init__(self, tick_s: float, mass: float, moments: np.ndarray, spin: np.ndarray) -> None:
        self.mass, self._moments, self._tick_s = mass, moments, tick_s
        self.position, self.velocity = CENTRE.copy(), np.array((0.3, -0.2, 0.4))
        self.rotation = Rotation.from_rotvec((0.4, -0.2, 0.3))
        self.turning = self._inertia(self.rotation) @ spin  # angular momentum about its centre

    def _inertia(self, rotation: Rotation) -> np.ndarray:
        axes = rotation.as_matrix()
        return axes @ np.diag(self._moments) @ axes.T

    def spin(self) -> np.ndarray:
        """Angular velocity."""
        return np.linalg.solve(self._inertia(self.rotation), self.turning)

    def initial_motions(self) -> list[SpatialMotion]:
        """As it is now."""
        parts = (self.position, self.rotation.as_quat(), self.velocity, self.spin())
        return [SpatialMotion.of("tool", *(tuple(part.tolist()) for part in parts))]

    def advance(self, tick: int, wrenches: tuple[ToolWrench, ...]) -> list[SpatialMotion]:
        """A tick further."""
        force, torque = loads(wrenches[0])
        self.velocity = self.velocity + self._tick_s / self.mass * force
        self.position = self.position + self._tick_s * self.velocity
        self.turning = self.turning + self._tick_s * torque
        half = Rotation.from_rotvec(0.5 * self._tick_s * self.spin()) * self.rotation
        between = np.linalg.solve(self._inertia(half), self.turning)
        self.rotation = Rotation.from_rotvec(self._tick_s * between) * self.rotation
        return self.initial_motions()

    def kinetic_joule(self) -> float:
        """Of translation and rotation."""
        return 0.5 * self.mass * float(self.velocity @ self.velocity) + 0.5 * float(
            self.turning @ self.spin()
        )


SIDES_M, TOOL_KG = (0.08, 0.05, 0.06), 0.05
MOMENTS = TOOL_KG / 12.0 * np.array([b * b + c * c for b, c in ((0.05, 0.06), (0.08, 0.06), (0.08, 0.05))])


def thrown(soil, one, step_s: float, count: int):
    """A box of the mass of seven particles tumbles and strikes `count` particles; what is conserved
    before and after, and the energy that changed hands."""
    engine = soil.engine(
        *WIDE, f"soil.time_step_s={step_s}", law=NO_ADHESION, tools=one(soil.box(*SIDES_M)), book=True
    )
    body = Thrown(step_s, TOOL_KG, MOMENTS, np.array((4.0, 7.0, -5.0)))
    grid = 0.021 * np.stack(np.meshgrid(*3 * [np.arange(-1.0, 2.0)]), axis=-1).reshape(-1, 3)[:count]
    places = CENTRE + body.rotation.apply(np.array((0.021, 0.013, 0.042)) + grid - grid[0])
    engine.place(places, [(0.1, 0.2, -0.6)] * count, [(9.0, -14.0, 6.0)] * count)
    motions = tuple(body.initial_motions())
    wrenches = engine.start(motions)

    def of_both():
        x, v, w = (
            read()
            for read in (engine.positions_m, engine.velocities_m_per_s, engine.angular_velocities_rad_per_s)
        )
        momentum = PARTICLE_KG * v.sum(axis=0) + body.mass * body.velocity
        turning = PARTICLE_KG * np.cross(x, v).sum(axis=0) + PARTICLE_KG_M2 * w.sum(axis=0)
        turning += body.mass * np.cross(body.position, body.velocity) + body.turning
        book = engine.energy()
        return momentum, turning, book.total_joule + book.tool_work_joule + body.kinetic_joule()

    before, start = of_both(), body.kinetic_joule()
    touched = 0
    for tick in range(round(0.04 / step_s)):
        motions = tuple(body.advance(tick, wrenches))
        wrenches = engine.advance(tick, motions)
        touched += wrenches[0].contact_count > 0
    assert touched > 20
    assert min(engine.energy().sinks_joule.values()) >= 0.0
    # half the last force's impulse has acted on the particles (velocity Verlet), none of it on the box
    force, torque = (0.5 * step_s * load for load in loads(wrenches[0]))
    momentum, turning, energy = of_both()
    after = momentum + force, turning + torque + np.cross(body.position, force), energy
    return before, after, engine.energy().turned_over_joule + start


@pytest.mark.parametrize("count", [1, 27])
def test_an_impact_in_six_degrees_of_freedom_keeps_momentum_and_energy(soil, one, count):
    """Linear and angular momentum of box and particles to round-off; energy, with what the book lost, within
    the tolerance of the book and to first order in the exchange."""
    defects = []
    for step_s in (5e-5, 1.25e-5):
        before, after, exchanged = thrown(soil, one, step_s, count)
        for old, new in zip(before[:2], after[:2], strict=True):
            assert_allclose(new, old, rtol=0.0, atol=1e-11 * np.linalg.norm(before[0]))
        defects.append(abs(after[2] - before[2]) / exchanged)
    assert defects[0] < 0.05
    assert defects[1] < 0.35 * defects[0]
