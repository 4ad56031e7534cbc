"""Tools in six degrees of freedom: planar ones where they move in a plane, exact in what is conserved."""

import math

import numpy as np
import pytest
import trimesh
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation, RotationSpline

from subsoil_ros.dem.build import build_engine
from subsoil_ros.dem.tools.motion import motion_within
from subsoil_ros.errors import PhysicsError, ProtocolError
from subsoil_ros.mbd.tool_paths import PathEngine
from subsoil_ros.messages import SpatialMotion, ToolMotion, ToolWrench
from subsoil_ros.rotations import Vector
from tests.soils import NEGLIGIBLE

STEP_S = 5e-5
MASS = 1800.0 * 4.0 / 3.0 * math.pi * 0.01**3
INERTIA = 0.4 * MASS * 0.01**2
NO_ADHESION = {"cohesive_stiffness_newton_per_m": NEGLIGIBLE}
WIDE = ("gravity_m_per_s2=0", "soil.bin.length_m=0.4", "soil.bin.width_m=0.4", "soil.bin.depth_m=0.4")
CENTRE = np.array((0.2, 0.0, -0.2))


def in_space(position: np.ndarray, rotation: Rotation, velocity: Vector, spin: Vector) -> SpatialMotion:
    """A motion of the tool named 'tool'."""
    parts = (position, rotation.as_quat(), velocity, spin)
    return SpatialMotion.of("tool", *(tuple(np.asarray(part).tolist()) for part in parts))  # type: ignore[arg-type]


def as_spatial(motion: ToolMotion) -> SpatialMotion:
    """The same motion without its planar angle."""
    return SpatialMotion.of(
        motion.tool, motion.position_m, motion.quaternion, motion.velocity_m_per_s, motion.spin_rad_per_s
    )


def loads(wrench: ToolWrench) -> np.ndarray:
    """Force and torque, (6,)."""
    return np.array(
        [
            wrench.force_x_newton, wrench.force_y_newton, wrench.force_z_newton,
            wrench.torque_x_newton_m, wrench.torque_y_newton_m, wrench.torque_z_newton_m,
        ]
    )  # fmt: skip


def sphere(soil, radius_m: float) -> str:
    """STL of an icosphere about its centre."""
    path = soil.folder / "sphere.stl"
    trimesh.creation.icosphere(subdivisions=2, radius=radius_m).export(path)
    return str(path)


def test_a_planar_path_given_in_space_has_the_planar_forces(soil, at, one):
    """A box swept and turned through a bed, four soil steps an exchange: all six loads, work and motion."""
    found = []
    for spatial in (False, True):
        engine = soil.engine(
            "coupling.communication_step_ns=200000", "soil.bin.length_m=0.3",
            tools=one(soil.box(0.03, 0.04, 0.08, subdivide=1)),
        )  # fmt: skip

        def motions(t, spatial=spatial):
            planar = at(
                0.1 + 0.6 * t + 3.0 * t * t, -0.04, 3.0 * t + 9.0 * t * t,
                vx=0.6 + 6.0 * t, rate=3.0 + 18.0 * t,
            )  # fmt: skip
            return tuple(map(as_spatial, planar)) if spatial else planar

        engine.start(motions(0.0))
        answers = [engine.advance(k, motions(2e-4 * (k + 1)))[0] for k in range(200)]
        work = sum(answer.work_joule for answer in answers)
        found.append((np.array([loads(answer) for answer in answers]), work, engine.positions_m()))
    planar, spatial = found
    assert np.abs(planar[0][:, 0]).max() > 5.0
    # round-off, which contacts of the bed multiply in 40 ms
    assert_allclose(spatial[0], planar[0], rtol=0.0, atol=1e-7 * np.abs(planar[0]).max())
    assert_allclose(spatial[1], planar[1], rtol=1e-9)
    assert_allclose(spatial[2], planar[2], atol=1e-11)


def test_a_turned_world_has_turned_forces(soil, at, one):
    """A sphere that spins and moves in the plane among particles, and the same turned as a whole: a spinning
    intruder feels the same whatever the axis, whichever kind of motion moves it."""
    rng = np.random.default_rng(4)
    direction = rng.normal(size=(6, 3))
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    offset, velocity, spin = direction * 0.0482, rng.normal(size=(6, 3)) * 0.05, rng.normal(size=(6, 3)) * 5.0
    mesh, found = sphere(soil, 0.04), []
    for turn in (None, Rotation.from_rotvec((0.0, 0.0, 0.0)), Rotation.from_rotvec((1.1, -0.7, 0.4))):
        by = turn or Rotation.identity()
        engine = soil.engine(*WIDE, tools=one(mesh))
        engine.place(CENTRE + by.apply(offset), by.apply(velocity), by.apply(spin))

        def motions(t, turn=turn):
            planar = at(0.2 + 0.1 * t, -0.2, 8.0 * t, vx=0.1, rate=8.0)
            if turn is None:
                return planar
            position = CENTRE + turn.apply(np.array(planar[0].position_m) - CENTRE)
            rotation = turn * Rotation.from_quat(planar[0].quaternion)
            return (in_space(position, rotation, turn.apply((0.1, 0, 0)), turn.apply((0, -8.0, 0))),)

        engine.start(motions(0.0))
        answers = np.array([loads(engine.advance(k, motions(STEP_S * (k + 1)))[0]) for k in range(200)])
        found.append(by.inv().apply(answers.reshape(-1, 3)).reshape(-1, 6))
    assert np.abs(found[0][:, 3:]).max() > 1e-3
    scale = np.abs(found[0]).max()
    for other in found[1:]:
        assert_allclose(other, found[0], rtol=0.0, atol=1e-9 * scale)


def test_plates_yawed_either_way_in_mirrored_beds_have_mirrored_forces(soil, one):
    """A tilted plate at yaw +a and -a, drawn through a bed and its mirror image: draft, lift, pitching moment
    are the same, side force and the other torques change sign."""
    engine = soil.engine("soil.bin.length_m=0.3", "soil.bed.jitter_m=0.0004")
    bed, found = engine.positions_m(), []
    for side in (1.0, -1.0):
        engine = soil.engine("soil.bin.length_m=0.3", tools=one(soil.box(0.012, 0.06, 0.08)))
        rotation = Rotation.from_rotvec((0.0, 0.0, side * 0.6)) * Rotation.from_rotvec((0.0, 0.3, 0.0))
        position = np.array((-0.05, 0.0, -0.03))
        engine.place(bed * (1.0, side, 1.0))
        engine.start((in_space(position, rotation, (0.5, 0, 0), (0, 0, 0)),))
        answers = []
        for k in range(5000):
            now = position + 0.5 * STEP_S * (k + 1) * np.eye(3)[0]
            answers.append(loads(engine.advance(k, (in_space(now, rotation, (0.5, 0, 0), (0, 0, 0)),))[0]))
        found.append(np.array(answers))
    mirror = np.array((1, -1, 1, -1, 1, -1))
    hit = int(np.argmax(np.abs(found[0][:, 0]) > 1.0))
    assert 0 < hit < 2000
    assert np.abs(found[0][hit : hit + 200, 1]).max() > 0.05 * np.abs(found[0][hit : hit + 200, 0]).max()
    # exact but for the order of sums, as long as contacts have not multiplied that
    assert_allclose(found[1][: hit + 200] * mirror, found[0][: hit + 200], atol=1e-8 * np.abs(found[0]).max())
    means = [rows[-2000:].mean(axis=0) for rows in found]
    assert_allclose(means[1] * mirror, means[0], atol=0.1 * np.abs(means[0]).max())
    assert means[0][0] < -1.0


def hit(soil, one, step_s):
    """A box that moves and turns in space strikes a particle; engine and the loads of each step."""
    engine = soil.engine(
        *WIDE, f"soil.time_step_s={step_s}", law=NO_ADHESION,
        tools=one(soil.box(0.08, 0.05, 0.06)), book=True,
    )  # fmt: skip
    velocity, spin = np.array((0.4, -0.3, 0.5)), np.array((4.0, 7.0, -5.0))
    start = Rotation.from_rotvec((0.4, -0.2, 0.3))
    place = CENTRE + start.apply((0.021, 0.013, 0.042))
    engine.place([place], [(0.1, 0.2, -0.6)], [(9.0, -14.0, 6.0)])

    def motion(t):
        return in_space(CENTRE + velocity * t, Rotation.from_rotvec(spin * t) * start, velocity, spin)

    engine.start((motion(0.0),))
    before = engine.energy()
    steps = []
    for k in range(round(0.03 / step_s)):
        now = motion(step_s * (k + 1))
        steps.append((np.array(now.position_m), engine.advance(k, (now,))[0]))
    assert np.abs(loads(steps[-1][1])).max() < 1e-15  # apart again
    return engine, before, steps


def test_what_a_tool_in_space_gives_a_particle_is_what_it_loses(soil, one):
    """Impulse and angular impulse about the world's origin of all six loads, to round-off."""
    engine, _, steps = hit(soil, one, STEP_S)
    impulse, turning = np.zeros(3), np.zeros(3)
    for position, wrench in steps:
        load = STEP_S * loads(wrench)
        impulse += load[:3]
        turning += load[3:] + np.cross(position, load[:3])
    x, v, w = (
        read()[0]
        for read in (engine.positions_m, engine.velocities_m_per_s, engine.angular_velocities_rad_per_s)
    )
    start = CENTRE + Rotation.from_rotvec((0.4, -0.2, 0.3)).apply((0.021, 0.013, 0.042))
    gained = MASS * (v - (0.1, 0.2, -0.6))
    spun = MASS * (np.cross(x, v) - np.cross(start, (0.1, 0.2, -0.6))) + INERTIA * (w - (9.0, -14.0, 6.0))
    assert np.abs(gained).min() > 1e-4
    assert_allclose(gained, -impulse, rtol=1e-9, atol=1e-13)
    assert_allclose(spun, -turning, rtol=1e-9, atol=1e-13)


def test_the_work_of_a_wrench_in_space_is_gained_or_dissipated(soil, one):
    """Kinetic energy gained + sinks = minus the work done on the tool, to first order in the step."""

    def defect(step_s):
        engine, before, steps = hit(soil, one, step_s)
        book, work = engine.energy(), -sum(wrench.work_joule for _, wrench in steps)
        assert_allclose(book.tool_work_joule, work, rtol=1e-12)
        assert min(book.sinks_joule.values()) >= 0.0
        return abs(book.total_joule - before.total_joule) / abs(work)

    coarse, fine = defect(STEP_S), defect(0.25 * STEP_S)
    assert coarse < 0.05
    assert fine < 0.5 * coarse


def test_an_exchange_with_a_large_turn_is_as_many_small_ones(soil, one):
    """A box that turns by a radian while it strikes: 2000 soil steps of one exchange, and 2000 exchanges."""
    velocity, spin, ends = np.array((0.4, -0.3, 0.5)), np.array((4.0, 7.0, -5.0)), []
    start = Rotation.from_rotvec((0.4, -0.2, 0.3))
    for exchanges in (2000, 1):
        engine = soil.engine(
            *WIDE, f"coupling.communication_step_ns={100_000_000 // exchanges}", "coupling.force=tick_mean",
            law=NO_ADHESION, tools=one(soil.box(0.08, 0.05, 0.06)),
        )  # fmt: skip
        engine.place([CENTRE + start.apply((0.021, 0.013, 0.042))], [(0.1, 0.2, -0.6)])

        def motions(t):
            return (in_space(CENTRE + velocity * t, Rotation.from_rotvec(spin * t) * start, velocity, spin),)

        engine.start(motions(0.0))
        answers = [engine.advance(k, motions(0.1 * (k + 1) / exchanges))[0] for k in range(exchanges)]
        mean = np.mean([loads(answer) for answer in answers], axis=0)
        work = sum(answer.work_joule for answer in answers)
        ends.append(np.concatenate((engine.positions_m()[0], engine.velocities_m_per_s()[0], mean, [work])))
    assert np.abs(ends[0][6:9]).min() > 1e-3
    assert_allclose(ends[1], ends[0], rtol=1e-7)


def free_disc(soil, one, axis: Vector, start: Vector, inertia: float):
    """A disc of radius 0.06 m that rolls freely about `axis`, alone in a wide bin, and its engines."""
    path = soil.folder / "disc.stl"
    trimesh.creation.cylinder(radius=0.06, height=0.03, sections=24).export(path)
    tools = one(str(path))
    tools["tool"]["path"] = {
        "start_x_m": float(CENTRE[0]), "start_z_m": float(CENTRE[2]),
        "turn": {
            "start_rotation_rad": list(start), "axis": list(axis),
            "free": {"inertia_kg_m2": inertia, "start_speed_rad_per_s": 2.0},
        },
    }  # fmt: skip
    scene = soil.scene(*WIDE, law=NO_ADHESION, tools=tools)
    return build_engine(scene), PathEngine(scene.scene, scene.timing)


def test_a_free_disc_struck_by_a_particle_closes_angular_momentum(soil, one):
    """About the axis: what the particle loses the disc has, exactly once its last force has acted."""
    start, inertia = (0.5, -0.3, 0.2), 2e-4
    soil_engine, paths = free_disc(soil, one, (0.0, 0.0, 1.0), start, inertia)
    turn = Rotation.from_rotvec(start)
    axis = turn.apply((0.0, 0.0, 1.0))
    velocity = turn.apply((-0.5, 0.6, 0.1))
    place = CENTRE + turn.apply((0.0705, -0.005, 0.003))
    soil_engine.place([place], [velocity])
    motions = paths.initial_motions()
    wrenches = soil_engine.start(motions)

    def of_both():
        x, v = soil_engine.positions_m()[0] - CENTRE, soil_engine.velocities_m_per_s()[0]
        own = INERTIA * soil_engine.angular_velocities_rad_per_s()[0]
        return axis @ (MASS * np.cross(x, v) + own), inertia * (axis @ np.array(motions[0].spin_rad_per_s))

    before = of_both()
    for tick in range(1500):
        motions = paths.advance(tick, wrenches)
        wrenches = soil_engine.advance(tick, motions)
    assert np.abs(loads(wrenches[0])).max() < 1e-15  # apart again
    after = of_both()
    assert abs(after[1] - before[1]) > 0.05 * abs(before[0])
    assert_allclose(sum(after), sum(before), rtol=1e-9)
    # the disc turned about its axis alone
    assert_allclose(np.cross(motions[0].spin_rad_per_s, axis), 0.0, atol=1e-12)
    assert_allclose(
        turn.apply((0, 0, 1)), Rotation.from_quat(motions[0].quaternion).apply((0, 0, 1)), atol=1e-9
    )


def test_a_free_disc_goes_on_from_a_state(soil, one):
    """Soil and paths put into the state of a checkpoint give the same bits as those that went on."""
    engines = [free_disc(soil, one, (0.0, 0.0, 1.0), (0.5, -0.3, 0.2), 2e-4) for _ in range(2)]
    turn = Rotation.from_rotvec((0.5, -0.3, 0.2))
    ends, state = [], None
    for soil_engine, paths in engines:
        soil_engine.place([CENTRE + turn.apply((0.0705, -0.005, 0.003))], [turn.apply((-0.5, 0.6, 0.1))])
        motions, first = paths.initial_motions(), 0
        wrenches = soil_engine.start(motions)
        if state is not None:
            first, wrenches = 150, state[2]
            soil_engine.restore(state[0])
            paths.restore(state[1])
        for tick in range(first, 300):
            if tick == 150 and state is None:
                copies = ({name: np.array(array) for name, array in engine.state_arrays().items()}
                          for engine in (soil_engine, paths))  # fmt: skip
                state = (*copies, wrenches)
            motions = paths.advance(tick, wrenches)
            wrenches = soil_engine.advance(tick, motions)
        ends.append(repr((motions, wrenches)))
    assert wrenches[0].work_joule != 0.0 or state[2][0].contact_count > 0
    assert ends[0] == ends[1]


def test_tools_in_space_turn_about_an_axis_within_an_exchange():
    """About a fixed axis, a cubic of the angle is met exactly; else the error falls with the interval."""
    axis = np.array((0.6, -0.48, 0.64))
    angle = np.polynomial.Polynomial((0.3, 90.0, -800.0, 4e4))

    def motion(t):
        return in_space(
            (t, t * t, -t), Rotation.from_rotvec(axis * angle(t)), (1.0, 2 * t, -1.0), axis * angle.deriv()(t)
        )

    for part in (0.1, 0.5, 0.9):
        between, exact = motion_within(motion(0.02), motion(0.03), 0.01, part), motion(0.02 + 0.01 * part)
        left = Rotation.from_quat(exact.quaternion).inv() * Rotation.from_quat(between.quaternion)
        assert left.magnitude() < 1e-12
        assert_allclose(between.spin_rad_per_s, exact.spin_rad_per_s, rtol=1e-9)
        assert_allclose(between.position_m, exact.position_m, atol=1e-15)
        assert_allclose(between.velocity_m_per_s, exact.velocity_m_per_s, atol=1e-12)

    spline = RotationSpline(
        (0.0, 0.1, 0.2, 0.3), Rotation.from_rotvec(np.random.default_rng(2).normal(size=(4, 3)))
    )
    gaps = []
    for interval in (0.02, 0.01):
        ends = [
            in_space((0, 0, 0), spline(t), (0, 0, 0), spline(t).apply(spline(t, 1)))
            for t in (0.11, 0.11 + interval)
        ]
        between = Rotation.from_quat(motion_within(*ends, interval, 0.5).quaternion)
        gaps.append((spline(0.11 + 0.5 * interval).inv() * between).magnitude())
    assert gaps[1] < 0.3 * gaps[0]


@pytest.mark.parametrize("sides", ["walls", "periodic"])
def test_what_a_tool_in_space_may_not_do(soil, at, one, sides):
    """Leap, turn by half a turn in an exchange, change its kind, or come to a seam: one message each."""
    still = Rotation.identity()

    def engine(*more):
        made = soil.engine(
            f"soil.bin.sides={sides}", "soil.bin.width_m=0.2", *more, tools=one(soil.box(0.04, 0.03, 0.04))
        )
        made.start((in_space((0.06, 0.0, 0.2), still, (0, 0, 0), (0, 0, 0)),))
        return made

    with pytest.raises(PhysicsError, match=r"tick 0: tool tool moves at up to 300 m/s"):
        engine().advance(0, (in_space((0.06, 0.0, 0.2), still, (0, 300.0, 0), (0, 0, 0)),))
    with pytest.raises(
        PhysicsError, match=r"tool tool turns by 3.5 rad in one exchange.*communication_step_ns"
    ):
        engine().advance(0, (in_space((0.06, 0.0, 0.2), still, (0, 0, 0), (0, 0, 7e4)),))
    with pytest.raises(ProtocolError, match=r"tool tool: a planar motion came after a spatial"):
        engine().advance(0, at(0.06, 0.2))
    with pytest.raises(ProtocolError, match=r"no unit quaternion"):
        SpatialMotion.of("tool", (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.9), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    aside = (in_space((0.06, 0.09, 0.2), still, (0, 0, 0), (0, 0, 0)),)
    if sides == "periodic":
        with pytest.raises(PhysicsError, match=r"tick 0: tools.tool: is from y = 0.075 to 0.105 m"):
            engine().advance(0, aside)
    else:
        engine().advance(0, aside)
