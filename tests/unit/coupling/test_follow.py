"""Poses as they come: between them, out of order, through a tree of frames; and the time that they take."""

import math
import threading

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from subsoil_ros.coupling.follow.follower import Follower
from subsoil_ros.coupling.follow.poses import FrameTree, Pose, PoseTrack
from subsoil_ros.errors import InterruptedRunError, RunError
from subsoil_ros.leaps import entry
from subsoil_ros.loading.loader import load_scene
from subsoil_ros.messages import SpatialMotion, ToolMotion
from subsoil_ros.rotations import planar_quaternion
from tests.outside import MESH

MS = 1_000_000
UPRIGHT = (0.0, 0.0, 0.0, 1.0)
TICK = 10 * MS


def about(axis: str, angle_rad: float) -> tuple[float, float, float, float]:
    """A turn as a quaternion."""
    x, y, z, w = Rotation.from_euler(axis, angle_rad).as_quat().tolist()
    return x, y, z, w


def test_poses_are_joined_by_lines_and_turns():
    track = PoseTrack(10.0)
    track.add(Pose(0, (0.0, 0.0, 0.0), about("z", 0.0)))
    track.add(Pose(100 * MS, (0.1, 0.2, -0.1), about("z", 0.4)))
    found = track.at(25 * MS)
    assert_allclose(found.pose.position_m, (0.025, 0.05, -0.025))
    assert_allclose(found.pose.quaternion, about("z", 0.1))
    assert_allclose(found.velocity_m_per_s, (1.0, 2.0, -1.0))
    assert_allclose(found.spin_rad_per_s, (0.0, 0.0, 4.0), atol=1e-12)


@pytest.mark.parametrize(
    ("pose", "cause"),
    [
        (Pose(100, (0.0, 0.0, 0.0), UPRIGHT), "repeated"),
        (Pose(99, (0.0, 0.0, 0.0), UPRIGHT), "late"),
        (Pose(101, (math.nan, 0.0, 0.0), UPRIGHT), "not a pose"),
        (Pose(101, (0.0, 0.0, math.inf), UPRIGHT), "not a pose"),
        (Pose(101, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0)), "not a pose"),
        (Pose(101, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, math.nan)), "not a pose"),
    ],
)
def test_poses_that_cannot_be_used_change_nothing(pose, cause):
    track = PoseTrack(10.0)
    track.add(Pose(100, (1.0, 0.0, 0.0), UPRIGHT))
    assert track.add(pose) == cause
    assert track.newest_ns == 100
    assert track.at(100).pose.position_m == (1.0, 0.0, 0.0)


@pytest.mark.parametrize(
    "far", [Pose(20 * MS, (0.5, 0.0, 0.0), UPRIGHT), Pose(20 * MS, (0.0, 0.0, 0.0), about("x", 1.5))]
)
def test_between_poses_too_far_apart_the_tool_stays(far):
    """0.5 m in 20 ms, or 1.5 rad: at the last moment it is there, at rest in either place."""
    track = PoseTrack(10.0)
    track.add(Pose(0, (0.0, 0.0, 0.0), UPRIGHT))
    track.add(far)
    before, after = track.at(20 * MS - 1), track.at(20 * MS)
    assert before.pose.position_m == (0.0, 0.0, 0.0)
    assert before.pose.quaternion == UPRIGHT
    assert after.pose == far
    assert before.velocity_m_per_s == after.velocity_m_per_s == (0.0, 0.0, 0.0)


def test_a_frame_is_carried_by_its_parents():
    """A column that turns at 10 Hz, an arm at 25 Hz, a fixed mount: against rotation matrices."""
    tree = FrameTree("map", ["bucket"], 10.0)
    tree.add("arm", "bucket", Pose(0, (0.2, 0.0, 0.1), about("y", 0.3)), fixed=True)
    found = []
    for k in range(26):
        now = 20 * MS * k
        if k % 5 == 0:
            turn = about("z", 1e-9 * now)
            assert tree.add("map", "column", Pose(now, (1.0, 2.0, 0.0), turn), fixed=False) == ""
            assert (
                tree.add("elsewhere", "column", Pose(now, (0.0, 0.0, 0.0), turn), fixed=False) == "repeated"
            )
            found += list(tree.poses())
        if k % 2 == 0:
            tree.add("column", "arm", Pose(now, (0.5, 0.0, 1e-9 * now), UPRIGHT), fixed=False)
            found += list(tree.poses())
    assert [name for name, _ in found] == ["bucket"] * len(found)
    times = [pose.time_ns for _, pose in found]
    assert times == [20 * MS * k for k in range(25) if k % 5 == 0 or k % 2 == 0]
    assert times[-1] == 480 * MS  # to where both are known
    for _, pose in found:
        time_s = 1e-9 * pose.time_ns
        turn = Rotation.from_euler("z", time_s)
        place = np.array((1.0, 2.0, 0.0)) + turn.apply((0.7, 0.0, 0.1 + time_s))
        assert_allclose(pose.position_m, place, atol=1e-12)
        whole = turn * Rotation.from_euler("y", 0.3)
        assert (Rotation.from_quat(pose.quaternion) * whole.inv()).magnitude() < 1e-12


def test_frames_in_a_loop_or_without_a_world_give_nothing():
    tree = FrameTree("map", ["a"], 10.0)
    for parent, child in (("b", "a"), ("a", "b")):
        tree.add(parent, child, Pose(0, (0.0, 0.0, 0.0), UPRIGHT), fixed=False)
    assert list(tree.poses()) == []


def follower(stopped=lambda: 0, spatial=True, tools=("foot",), **keys) -> Follower:
    """Of tools in ticks of 10 ms."""
    path = {"external": True, "start_z_m": 0.5, "may_leap": True, **({"turn": {}} if spatial else {})}
    scene = {
        "name": "followed",
        "duration_s": 1.0,
        "soil": {"model": "external", "bin": {"length_m": 1.0, "width_m": 1.0, "depth_m": 0.5}},
        "tools": {tool: {"path": path, "groups": {"foot": {"mesh": str(MESH)}}} for tool in tools},
        "coupling": {"communication_step_ns": TICK},
        "record": {"checkpoint_s": 0.0},
    }
    return Follower(load_scene(scene), stopped, **keys)


def at(x_m: float, time_ns: int) -> Pose:
    """A pose on the x axis."""
    return Pose(time_ns, (x_m, 0.0, 0.3), UPRIGHT)


def test_time_goes_on_from_the_first_pose_up_to_the_newest():
    """The machine's clock has an origin of its own."""
    found, origin = follower(), 1_700_000_000_000 * MS
    assert found.initial_motions()[0].position_m == (0.0, 0.0, 0.5)
    found.receive("foot", at(0.10, origin))
    assert found.advance(0, ())[0].position_m == (0.10, 0.0, 0.3)
    found.receive("foot", at(0.13, origin + 30 * MS))
    assert [found.advance(k, ())[0].x_m for k in (1, 2, 3)] == pytest.approx([0.11, 0.12, 0.13])
    assert found.stamp_ns == origin + 30 * MS
    assert (found.skips, found.behind_s) == (0, 0.0)


def test_soil_that_is_too_far_behind_skips_to_the_newest():
    found = follower(behind_s=0.1)
    found.receive("foot", at(0.0, 0))
    found.advance(0, ())
    for k in range(1, 31):
        found.receive("foot", at(0.01 * k, 10 * MS * k))
    assert found.behind_s == pytest.approx(0.3)
    (motion,) = found.advance(1, ())
    assert motion.x_m == pytest.approx(0.30)
    assert motion.velocity_m_per_s == pytest.approx((1.0, 0.0, 0.0))
    assert found.facts() == {
        "start_ns": 0, "end_ns": 300 * MS, "skipped_s": pytest.approx(0.29), "skips": 1, "refused": {},
    }  # fmt: skip


def test_poses_that_are_rare_make_it_skip_nothing():
    """Two a second, each a way of 50 ticks that it has yet to go."""
    found = follower()
    found.receive("foot", at(0.0, 0))
    ways = [found.advance(0, ())[0].x_m]
    for k in range(1, 4):
        found.receive("foot", at(0.1 * k, 500 * MS * k))
        ways += [found.advance(tick, ())[0].x_m for tick in range(50 * k - 49, 50 * k + 1)]
    assert found.skips == 0
    assert np.diff(ways) == pytest.approx(0.002)


def test_poses_within_a_tick_are_no_leap():
    """A joint whose encoder gives an angle for a while, then the next one."""
    track = PoseTrack(10.0)
    for k in range(200):
        track.add(Pose(MS * k, (0.0, 0.0, 0.0), about("z", 0.0015 * (k // 3))))
    for k in range(20, 190):
        before, after = track.over(MS * (k - 10), TICK), track.over(MS * k, TICK)
        motions = [
            SpatialMotion.of("foot", m.pose.position_m, m.pose.quaternion, *m[1:]) for m in (before, after)
        ]
        assert entry(motions[0], motions[1], 0.01) is None
    assert track.over(100 * MS, TICK).spin_rad_per_s[2] == pytest.approx(0.5, rel=0.2)


def test_a_leap_within_a_tick_stays_one():
    track = PoseTrack(10.0)
    for k in range(30):
        track.add(Pose(MS * k, (0.001 * k + (0.3 if k > 20 else 0.0), 0.0, 0.0), UPRIGHT))
    before, after = track.over(15 * MS, TICK), track.over(25 * MS, TICK)
    motions = [
        SpatialMotion.of("foot", m.pose.position_m, m.pose.quaternion, *m[1:]) for m in (before, after)
    ]
    assert after.velocity_m_per_s == pytest.approx((1.0, 0.0, 0.0))
    start = entry(motions[0], motions[1], 0.01)
    assert start is not None
    assert start.position_m == pytest.approx((0.315, 0.0, 0.0))


def test_what_is_forgotten_is_not_needed():
    track = PoseTrack(10.0)
    for k in range(10):
        track.add(at(0.01 * k, 10 * MS * k))
    wanted = [track.over(time, TICK) for time in (45 * MS, 90 * MS)]
    track.forget(35 * MS)
    assert track.oldest_ns == 30 * MS
    assert [track.over(time, TICK) for time in (45 * MS, 90 * MS)] == wanted


def test_a_written_quaternion_is_taken():
    track = PoseTrack(10.0)
    assert track.add(Pose(0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.7071, 0.7071))) == ""
    assert math.hypot(*track.at(0).pose.quaternion) == pytest.approx(1.0, abs=1e-15)


def test_a_run_ends_where_no_pose_can_come():
    found = follower()
    found.receive("foot", at(0.0, 0))
    found.advance(0, ())
    threading.Timer(0.2, found.fail, (KeyError("joint"),)).start()
    with pytest.raises(RunError, match="poses: KeyError: 'joint'"):
        found.advance(1, ())


def test_clocks_that_differ_are_told():
    found = follower(tools=("foot", "hand"))
    found.receive("foot", at(0.0, 1_700_000_000_000 * MS))
    found.receive("hand", at(0.0, 5_000 * MS))
    with pytest.raises(RunError, match=r"foot 1700000000\.000 s, hand 5\.000 s; stamp all by one clock"):
        found.advance(0, ())


def test_it_waits_for_a_pose_and_can_be_stopped():
    stop: list[int] = []
    found = follower(lambda: stop[0] if stop else 0)
    found.receive("foot", at(0.0, 0))
    found.advance(0, ())
    threading.Timer(0.2, stop.append, (2,)).start()
    with pytest.raises(InterruptedRunError):
        found.advance(1, ())
    stop.clear()
    threading.Timer(0.2, found.receive, ("foot", at(0.02, 20 * MS))).start()
    assert found.advance(1, ())[0].x_m == pytest.approx(0.01)


def test_a_planar_tool_keeps_its_plane_and_counts_its_turns():
    found = follower(spatial=False)
    found.receive("foot", Pose(0, (0.1, 0.0005, 0.2), planar_quaternion(0.0)))
    found.advance(0, ())
    for k in range(1, 5):
        found.receive("foot", Pose(10 * MS * k, (0.1, 0.0, 0.2), planar_quaternion(0.9 * k)))
        (motion,) = found.advance(k, ())
        assert type(motion) is ToolMotion
        assert motion.y_m == 0.0
        assert motion.angle_rad == pytest.approx(0.9 * k)
        assert motion.angular_velocity_rad_per_s == pytest.approx(90.0)
    for k, (y_m, turn) in enumerate([(0.01, UPRIGHT), (0.0, about("x", 0.1)), (0.0, about("z", 0.1))]):
        found.receive("foot", Pose((60 + k) * MS, (0.1, y_m, 0.2), turn))
    assert found.refused == {"out of the plane of travel": 3}


def spatial(x_m: float, speed: float, turn: tuple[float, float, float, float] = UPRIGHT, spin: float = 0.0):
    """A motion along x."""
    return SpatialMotion.of("foot", (x_m, 0.0, 0.0), turn, (speed, 0.0, 0.0), (0.0, 0.0, spin))


def planar(x_m: float, speed: float, angle_rad: float = 0.0, rate: float = 0.0) -> ToolMotion:
    """The same in the plane."""
    return ToolMotion("foot", x_m, 0.0, 0.0, angle_rad, speed, 0.0, rate)


@pytest.mark.parametrize("motion", [spatial, planar])
def test_a_leap_is_a_way_that_no_velocity_explains(motion):
    """Also where a tool stops or starts in the tick, and where it is placed to a tenth of a millimetre."""
    for before, after in ((1.0, 1.0), (1.0, 0.0), (0.0, 1.0)):
        assert entry(motion(0.0, before), motion(0.001, after), 1e-3) is None
    assert entry(motion(0.0, 0.0), motion(0.0001, 0.0), 1e-3) is None
    start = entry(motion(0.0, 1.0), motion(0.003, 1.0), 1e-3)
    assert start is not None
    assert start.position_m == pytest.approx((0.002, 0.0, 0.0))
    assert start.velocity_m_per_s == (1.0, 0.0, 0.0)


def test_a_turn_that_no_spin_explains_is_a_leap_too():
    assert entry(planar(0.0, 0.0, 0.0, 10.0), planar(0.0, 0.0, 0.01, 10.0), 1e-3) is None
    start = entry(planar(0.0, 0.0), planar(0.0, 0.0, 0.1, 10.0), 1e-3)
    assert start is not None
    assert start.angle_rad == pytest.approx(0.09)
    assert entry(spatial(0.0, 0.0), spatial(0.0, 0.0, about("z", 0.01), 10.0), 1e-3) is None
    start = entry(spatial(0.0, 0.0), spatial(0.0, 0.0, about("z", 0.1), 10.0), 1e-3)
    assert start is not None
    assert start.quaternion == about("z", 0.1)
