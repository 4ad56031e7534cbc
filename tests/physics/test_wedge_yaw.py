"""The wedge model with yaw: a plate whose edge is at an angle to its travel, against closed forms."""

import math

import numpy as np
import pytest
import trimesh
import yaml
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

import subsoil_ros as subsoil
from subsoil_ros.errors import PhysicsError, SceneError
from subsoil_ros.loading.loader import load_scene
from subsoil_ros.messages import SpatialMotion, ToolMotion, ToolWrench
from subsoil_ros.wedge.failure_wedge import Plate, Strength, failure
from subsoil_ros.wedge.wedge_engine import WedgeEngine

WIDTH, TALL, DEPTH, SPEED, TICK_S = 0.2, 0.3, 0.15, 0.5, 1e-3
DELTA, ADHESION = 0.35, 1e3
VALUES = {
    "density_kg_per_m3": 1300.0, "cohesion_pa": 5e3, "friction_angle_rad": 0.55, "adhesion_pa": ADHESION,
    "tool_friction_angle_rad": DELTA, "variation": 0.0, "drop": 0.0,
}  # fmt: skip


def sharp(rake_rad: float, back_m: float = 0.01) -> trimesh.Trimesh:
    """A plate from the origin up whose flanks slant back by 45 degrees, so that it has no sides."""
    lean = TALL / math.tan(rake_rad)
    half = 0.5 * WIDTH
    section = ((0.0, -half), (0.0, half), (-back_m, half - back_m), (-back_m, back_m - half))
    corners = [(x - part * lean, y, part * TALL) for part in (0.0, 1.0) for x, y in section]
    return trimesh.Trimesh(vertices=corners).convex_hull


@pytest.fixture
def engine(tmp_path):
    """Makes an engine of one tool in space, or in the plane; `path` and values may change."""

    def scene(mesh, path=None, values=None, **tool):
        mesh.export(tmp_path / "plate.stl")
        document = {
            "name": "yaw",
            "duration_s": 0.2,
            "soil": {
                "model": "wedge",
                "bin": {"length_m": 2.0, "width_m": 1.0, "depth_m": 0.5},
                "values": VALUES | (values or {}),
            },
            "tools": {
                "plate": {"path": path or {"turn": {}}, "groups": {"plate": {"mesh": "plate.stl"}}, **tool}
            },
        }
        (tmp_path / "scene.yaml").write_text(yaml.safe_dump(document, sort_keys=False))
        return load_scene(tmp_path / "scene.yaml")

    return lambda *args, **kw: WedgeEngine(scene(*args, **kw))


def at(position, rotation: Rotation) -> tuple[SpatialMotion, ...]:
    """Motion of the plate; the wedge model reads its pose only."""
    quaternion = tuple(rotation.as_quat().tolist())
    return (SpatialMotion.of("plate", tuple(position), quaternion, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),)


def pulled(soil: WedgeEngine, rotation: Rotation, travel=(1.0, 0.0, 0.0), count: int = 200) -> ToolWrench:
    """The wrench after a straight pull at SPEED, DEPTH below the surface."""
    step = SPEED * TICK_S * np.array(travel)
    places = np.array((0.5, 0.1, -DEPTH)) + np.arange(count + 1)[:, None] * step
    soil.start(at(places[0], rotation))
    return [soil.advance(k, at(place, rotation))[0] for k, place in enumerate(places[1:])][-1]


def force(wrench: ToolWrench) -> np.ndarray:
    """Force, (3,)."""
    return np.array((wrench.force_x_newton, wrench.force_y_newton, wrench.force_z_newton))


def torque(wrench: ToolWrench) -> np.ndarray:
    """Torque, (3,)."""
    return np.array((wrench.torque_x_newton_m, wrench.torque_y_newton_m, wrench.torque_z_newton_m))


def about(axis: int, degrees: float) -> Rotation:
    """A rotation about x, y or z."""
    return Rotation.from_rotvec(math.radians(degrees) * np.eye(3)[axis])


@pytest.mark.parametrize("theory", ["mckyes_ali", "perumpral"])
def test_without_yaw_it_is_the_plate_in_the_plane(engine, theory):
    """The same bits in every field of the wrench, sides and blunt tip included."""
    box = trimesh.creation.box((0.06, WIDTH, TALL)).apply_translation((0.0, 0.0, 0.5 * TALL))
    values = {"theory": theory, "tip_m": 0.02, "drop": 0.3, "variation": 0.2, "period_m": 0.01}
    spatial, planar = engine(box, values=values), engine(box, {}, values)
    random = np.random.default_rng(3)
    steps = np.abs(random.normal(size=(400, 2))) * (5e-4, 5e-5)
    places = np.array((0.5, -DEPTH)) + np.cumsum(steps, axis=0)
    for k, (x, z) in enumerate(places.tolist()):
        motions = at((x, 0.0, z), Rotation.identity()), (ToolMotion("plate", x, 0.0, z, 0.0, 0.0, 0.0, 0.0),)
        if k == 0:
            spatial.start(motions[0])
            planar.start(motions[1])
        else:
            assert spatial.advance(k, motions[0]) == planar.advance(k, motions[1])
    assert planar.memory.tools[0].failed_count[0] > 5


@pytest.mark.parametrize("rake", [40.0, 90.0])
@pytest.mark.parametrize("yaw", [-45.0, 10.0, 30.0])
def test_a_yawed_plate_has_the_force_of_the_equations(engine, rake, yaw):
    """F = -N n - (N tan delta + c_a A) u: n the plate's normal, u the sliding of plate on wedge, which leaves
    across the edge along beta; N = P cos(delta_e), tan delta_e = tan delta cos(iota) of that sliding."""
    alpha, psi = math.radians(rake), math.radians(yaw)
    wrench = pulled(engine(sharp(alpha)), about(2, yaw))
    across = np.array((math.cos(psi), math.sin(psi), 0.0))
    up = np.eye(3)[2]
    normal = math.sin(alpha) * across + math.cos(alpha) * up
    plate = Plate(WIDTH, alpha, DEPTH, DEPTH)
    part = 1.0
    for _ in range(30):
        strength = Strength(
            1300.0 * 9.81, 1300.0, 5e3, 0.55, part * ADHESION, math.atan(part * math.tan(DELTA)), 0.0, 1.0
        )
        beta, pressed, _, rising, _ = failure(plate, strength, SPEED * math.cos(psi))
        soil = math.cos(psi) * math.sin(alpha) / math.sin(alpha + beta)
        slide = np.eye(3)[0] - soil * (math.cos(beta) * across + math.sin(beta) * up)
        assert abs(slide @ normal) < 1e-12
        slide /= np.linalg.norm(slide)
        part = math.hypot(slide @ across, slide @ up)
    bears = pressed * math.cos(strength.tool_friction)
    held = bears * math.tan(DELTA) + ADHESION * WIDTH * DEPTH / math.sin(alpha)
    expected = -bears * normal - held * slide
    # friction fades below 1 mm/s: 0.5 % of what slides at 0.2 m/s
    assert_allclose(force(wrench), expected, atol=6e-3 * np.linalg.norm(expected))
    assert math.copysign(1.0, wrench.force_y_newton) == -math.copysign(1.0, yaw)
    high = (rising / 3.0 + 0.5 * (1.0 - rising)) * DEPTH
    place = high * up - high / math.tan(alpha) * across
    assert_allclose(
        torque(wrench), np.cross(place, force(wrench)), atol=2e-3 * DEPTH * np.abs(expected).max()
    )
    assert wrench.work_joule == pytest.approx(wrench.force_x_newton * SPEED * TICK_S, rel=1e-9)


def test_a_smooth_plate_is_pushed_along_its_normal(engine):
    """Without friction and adhesion on metal: side force over draft is tan(yaw), lift over them cot(rake)."""
    smooth = {"adhesion_pa": 0.0, "tool_friction_angle_rad": 0.0}
    wrench = pulled(engine(sharp(math.radians(60.0)), values=smooth), about(2, 25.0))
    normal = about(2, 25.0).apply((math.sin(math.radians(60.0)), 0.0, math.cos(math.radians(60.0))))
    assert_allclose(force(wrench) / -np.linalg.norm(force(wrench)), normal, atol=1e-6)


def test_yaw_either_way_mirrors_the_wrench(engine):
    """Draft, lift and pitching moment are even in the yaw; side force, rolling and yawing moment odd."""
    soil = engine(sharp(math.radians(50.0)))
    one, other = (pulled(soil, about(2, yaw)) for yaw in (20.0, -20.0))
    assert_allclose(force(other), force(one) * (1, -1, 1), rtol=1e-12)
    assert_allclose(torque(other), torque(one) * (-1, 1, -1), rtol=1e-12, atol=1e-12)
    assert one.force_y_newton < -50.0


def test_a_world_turned_about_the_vertical_has_turned_forces(engine):
    """Yaw is of the plate against its travel, wherever both point."""
    turn = about(2, 70.0)
    soil = engine(sharp(math.radians(50.0)))
    one = pulled(soil, about(2, 20.0) * about(1, -5.0))
    other = pulled(soil, turn * about(2, 20.0) * about(1, -5.0), turn.apply((1.0, 0.0, 0.0)))
    assert_allclose(force(other), turn.apply(force(one)), rtol=1e-9)
    assert_allclose(torque(other), turn.apply(torque(one)), rtol=1e-9)


@pytest.mark.parametrize("seed", range(3))
def test_it_stays_in_the_friction_cone_and_gives_no_energy(engine, seed):
    """On closed paths in space: friction within N tan delta, against the sliding; work below the spring's."""
    random = np.random.default_rng(seed)
    mesh = sharp(math.radians(55.0)).apply_translation((0.05, 0.1 * seed, 0.0))  # beside its body
    soil = engine(mesh, values={"adhesion_pa": 0.0, "drop": 0.4, "variation": 0.2})
    time = np.linspace(0.0, 2.0 * np.pi, 3000)
    shape = sum(
        random.normal(size=(6, 1)) * np.sin(k * time + random.uniform(0.0, 6.28, (6, 1))) for k in (1, 3, 7)
    )
    poses = shape * np.array((0.03, 0.005, 0.01, 0.01, 0.02, 0.05))[:, None]
    poses += np.array((0.8, 0.0, -DEPTH, 0.0, 0.0, 0.3))[:, None]
    poses[:, -1] = poses[:, 0]
    rotations = Rotation.from_rotvec(poses[3:].T)
    soil.start(at(poses[:3, 0].tolist(), rotations[0]))
    work, held, pushed = [0.0], 0.0, 0
    area = WIDTH * TALL / math.sin(math.radians(55.0))
    for tick, place in enumerate(poses[:3].T.tolist()):
        try:
            wrench = soil.advance(tick, at(place, rotations[tick]))[0]
        except PhysicsError:  # where it turns round it moves along its edge, which is refused
            continue
        work.append(work[-1] + wrench.work_joule)
        spring = soil.memory.tools[0].normal_newton[0]
        held = max(held, spring**2 / (2.0 * 2e7 * area))
        looks = rotations[tick].apply((math.sin(math.radians(55.0)), 0.0, math.cos(math.radians(55.0))))
        bears = -force(wrench) @ looks
        assert np.linalg.norm(force(wrench) + bears * looks) <= bears * math.tan(DELTA) * (1.0 + 1e-9) + 1e-9
        pushed += bears > 10.0
    assert pushed > 300
    assert work[-1] < 0.0
    assert np.max(np.array(work) - np.minimum.accumulate(work)) <= held


def test_its_state_is_all_there_is(engine):
    """An engine that is put into the state of another goes on alike, bit for bit."""
    one, two = (
        engine(sharp(1.0), values={"drop": 0.3, "variation": 0.2, "period_m": 0.02}) for _ in range(2)
    )
    places = [(0.5 + 5e-4 * k, 1e-4 * k, -DEPTH) for k in range(400)]
    turns = [about(2, 10.0 + 0.02 * k) * about(1, 0.01 * k) for k in range(400)]
    one.start(at(places[0], turns[0]))
    for k in range(1, 200):
        one.advance(k, at(places[k], turns[k]))
    two.restore({name: np.array(array) for name, array in one.state_arrays().items()})
    for k in range(200, 400):
        motions = at(places[k], turns[k])
        assert one.advance(k, motions) == two.advance(k, motions)


@pytest.mark.parametrize(
    ("rotation", "message"),
    [
        (about(2, 46.0), r"tools.plate: travels at 46.0 degrees of yaw; .* up to 45"),
        (about(2, -60.0), r"tools.plate: travels at 60.0 degrees of yaw"),
        (about(0, 6.0), r"tools.plate: has an edge 6.0 degrees out of the level; .* up to 5"),
        (about(1, 70.0), r"tools.plate: its share has a rake of"),
    ],
)
def test_what_theory_does_not_cover_is_refused(engine, rotation, message):
    """Before the run where the path says so, and in the run by its tick."""
    mesh = sharp(math.radians(80.0))
    with pytest.raises(PhysicsError, match="(start|tick 0): " + message):
        pulled(engine(mesh), rotation)
    path = {
        "speed_x_m_per_s": {"kind": "constant", "value": SPEED},
        "turn": {"start_rotation_rad": rotation.as_rotvec().tolist()},
    }
    with pytest.raises(SceneError, match=message):
        engine(mesh, path)


def test_tools_that_are_no_such_plates_are_refused(engine):
    """Sides that sweep soil, a mesh that looks aside, a tool that is turned about an axis, a wheel."""
    box = trimesh.creation.box((0.06, WIDTH, TALL)).apply_translation((0.0, 0.0, 0.5 * TALL))
    with pytest.raises(
        PhysicsError, match=r"20.0 degrees of yaw, at which its side sweeps 0.11 of its width"
    ):
        pulled(engine(box), about(2, 20.0))
    turned = sharp(1.2)
    turned.apply_transform(trimesh.transformations.rotation_matrix(0.2, (0, 0, 1)))
    with pytest.raises(SceneError, match=r"tools.plate: the front of its mesh looks 1\d.\d degrees aside"):
        engine(turned)
    rolls = {"turn": {"axis": [0.0, 1.0, 0.0], "free": {"inertia_kg_m2": 1.0}}}
    with pytest.raises(SceneError, match=r"tools.plate.path: turn.axis: turns the tool"):
        engine(box, rolls)
    with pytest.raises(SceneError, match=r"tools.plate.path: role 'wheel' with a path in space"):
        engine(box, role="wheel")


def test_a_run_with_a_yawed_plate_records_its_side_force(engine, tmp_path):
    """From a scene file to series.csv and an energy account that closes."""
    path = {
        "start_x_m": 0.3, "start_z_m": -0.1, "speed_x_m_per_s": {"kind": "constant", "value": SPEED},
        "turn": {"start_rotation_rad": [0.0, 0.0, 0.5]},
    }  # fmt: skip
    engine(sharp(1.2), path)
    run = subsoil.run(subsoil.load_scene(tmp_path / "scene.yaml"))
    assert run.failure is None
    last = run.series.iloc[-1]
    assert last["tool.plate.force_y_newton"] < -0.2 * last["draft_newton"] < 0.0
    assert run.summary["energy"]["residual_ratio"] < 0.02
