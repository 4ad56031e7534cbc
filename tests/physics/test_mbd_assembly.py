"""Starts of machines: what is made consistent, what is held, and what is refused with which words."""

import copy
import math
import warnings

import pytest

from subsoil_ros.errors import PhysicsError, ProtocolError, SceneError, SingularMechanismError
from subsoil_ros.mbd.assembly import MovedBodiesWarning, RedundantConstraintsWarning, Topology, assemble
from subsoil_ros.mbd.equilibrium import UnstableEquilibriumWarning
from subsoil_ros.messages import ToolWrench
from subsoil_ros.scene.mechanism import Mechanism


def _body(x, z, **rest):
    return {"mass_kg": 1.0, "inertia_kg_m2": 0.1, "position_m": (x, z), **rest}


def _pin(body_a, body_b, x, z, **rest):
    return {"kind": "revolute", "body_a": body_a, "body_b": body_b, "point_m": (x, z), **rest}


def _drive(body, coordinate, **law):
    return {"kind": "driver", "body": body, "coordinate": coordinate, "speed": law}


def _rail(body, x=0.0, z=0.0):
    return {"kind": "prismatic", "body_a": "ground", "body_b": body, "point_m": (x, z), "axis": (1.0, 0.0)}


def _four_bar(**initial):
    """A parallelogram of two upright links and a bar."""
    return {
        "bodies": {"left": _body(0.1, 0.5), "right": _body(1.1, 0.5), "bar": _body(0.7, 1.0)},
        "joints": {
            "left_foot": _pin("ground", "left", 0.0, 0.0),
            "right_foot": _pin("ground", "right", 1.0, 0.0),
            "left_head": _pin("left", "bar", 0.2, 1.0),
            "right_head": _pin("right", "bar", 1.2, 1.0),
        },
        "initial": initial,
    }


def _with_third_link():
    machine = _four_bar()
    machine["bodies"]["middle"] = _body(0.6, 0.5)
    machine["joints"]["middle_foot"] = _pin("ground", "middle", 0.5, 0.0)
    machine["joints"]["middle_head"] = _pin("middle", "bar", 0.7, 1.0)
    return machine


# --- consistent starts ------------------------------------------------------------------------------


def test_bodies_given_a_little_wrong_are_moved_onto_their_joints(mechanism_engine):
    """A pose rounded by a centimetre is closed to 1e-12 m, moving each body by no more than about that."""
    machine = _four_bar()
    machine["joints"]["left_head"]["point_b_m"] = (0.21, 1.005)
    with pytest.warns(MovedBodiesWarning, match=r"left_head are 11\.2 mm apart.*bar by \d"):
        state = mechanism_engine(machine).state("run", -1, 0)
    assert state.position_residual_m < 1e-12
    for body, name in zip(state.bodies, machine["bodies"], strict=True):
        x, z = machine["bodies"][name]["position_m"]
        assert math.hypot(body.x_m - x, body.z_m - z) < 0.02


def test_a_velocity_that_joints_forbid_is_named():
    """The two links of a parallelogram turn alike: given 1 and 0.5 m/s, they start in between."""
    machine = _four_bar()
    for name, speed in (("left", 1.0), ("right", 0.5)):
        machine["bodies"][name]["velocity_m_per_s"] = (speed, 0.0)
    with pytest.warns(MovedBodiesWarning, match=r"velocity_m_per_s \(x\): given .*starts with 0\.7"):
        assemble(Mechanism.model_validate(machine), 9.81, 1e-3)


def test_the_velocity_of_a_welded_body_moves_no_other(mechanism_engine):
    """What the weld forbids is round-off, not a direction in which the slider would start at 1e14 m/s."""
    machine = {
        "bodies": {"slider": _body(0.8, -0.1), "anvil": _body(0.3, 0.4, velocity_m_per_s=(-0.2, -0.5))},
        "joints": {"rail": _rail("slider") | {"axis": (0.0, 1.0)},
                   "weld": {"kind": "fixed", "body_a": "ground", "body_b": "anvil", "point_m": (-0.7, -0.1)}},
    }  # fmt: skip
    with pytest.warns(MovedBodiesWarning, match="anvil"):
        engine = mechanism_engine(machine)
    assert (engine.arrays.v == 0.0).all()


def test_named_coordinates_are_held(mechanism_engine):
    """A coordinate of `initial.coordinates` has its value exactly; the others follow."""
    state = mechanism_engine(_four_bar(coordinates={"left.angle_rad": 0.4})).state("run", -1, 0)
    assert state.bodies[0].angle_rad == pytest.approx(0.4, abs=1e-13)
    assert state.bodies[1].angle_rad == pytest.approx(0.4, abs=1e-12)
    assert state.bodies[2].angle_rad == pytest.approx(0.0, abs=1e-12)


def test_named_coordinates_are_held_at_rest_too(mechanism_engine, subsoiler):
    """The wheels held at a height, shank and hitch go to rest around them."""
    machine = copy.deepcopy(subsoiler)
    del machine["forces"]["left"], machine["forces"]["right"]
    machine["initial"]["coordinates"] = {"wheel_left.z_m": 0.21}
    state = mechanism_engine(machine).state("run", -1, 0)
    assert state.bodies[1].z_m == pytest.approx(0.21, abs=1e-12)
    # no moment about the shank's hinge: spring force x lever balances the weight x offset
    assert state.forces[0].load * 0.25 == pytest.approx(35.2 * 9.81 * 0.0075, rel=0.1)
    assert state.bodies[0].angle_rad == pytest.approx(-0.05, abs=0.01)


def test_machine_is_moved_along_the_travel(mechanism_engine, subsoiler):
    """translate_x_m moves every body by that, and nothing else."""
    here = mechanism_engine(subsoiler).state("run", -1, 0)
    moved = copy.deepcopy(subsoiler)
    moved["initial"]["translate_x_m"] = -0.31
    there = mechanism_engine(moved).state("run", -1, 0)
    for a, b in zip(here.bodies, there.bodies, strict=True):
        assert b.x_m - a.x_m == pytest.approx(-0.31, abs=1e-9)
        assert b.z_m == pytest.approx(a.z_m, abs=1e-9)
        assert b.angle_rad == pytest.approx(a.angle_rad, abs=1e-9)


def test_ground_joints_move_with_the_machine(mechanism_engine):
    """A linkage on the ground keeps its shape when it is moved."""
    state = mechanism_engine(_four_bar(translate_x_m=2.0)).state("run", -1, 0)
    assert [b.x_m for b in state.bodies] == pytest.approx([2.1, 3.1, 2.7], abs=1e-12)
    assert state.position_residual_m < 1e-12


def test_given_velocities_rule_and_the_others_follow(mechanism_engine):
    """A crank given a turning speed keeps it; bodies without velocities follow the linkage."""
    machine = _four_bar()
    machine["bodies"]["left"]["angular_velocity_rad_per_s"] = 3.0
    state = mechanism_engine(machine).state("run", -1, 0)
    assert [b.angular_velocity_rad_per_s for b in state.bodies] == pytest.approx([3.0, 3.0, 0.0], abs=1e-12)
    assert state.bodies[2].velocity_x_m_per_s == pytest.approx(-3.0 * 1.0, abs=1e-12)
    assert state.bodies[2].velocity_z_m_per_s == pytest.approx(3.0 * 0.2, abs=1e-12)


def test_wheel_above_the_ground_settles_onto_it(mechanism_engine):
    """Static equilibrium finds the ground from above it, and does not turn the wheel."""
    contact = {
        "kind": "wheel_contact",
        "body": "wheel",
        "radius_m": 0.2,
        "stiffness_newton_per_m": 1e4,
        "damping_newton_s_per_m": 10.0,
        "friction": 0.3,
    }
    machine = {
        "bodies": {"wheel": _body(0.0, 1.5)},
        "forces": {"tread": contact},
        "initial": {"static_equilibrium": True},
    }
    body = mechanism_engine(machine).state("run", -1, 0).bodies[0]
    assert body.z_m == pytest.approx(0.2 - 9.81 / 1e4, abs=1e-12)
    assert (body.x_m, body.angle_rad) == (0.0, 0.0)


def test_rest_is_a_pose_that_is_stable(mechanism_engine):
    """A rod that leans a little from upright comes to rest hanging, not standing."""
    machine = {
        "bodies": {"rod": _body(0.05, 0.5)},
        "joints": {"pin": _pin("ground", "rod", 0.0, 0.0)},
        "initial": {"static_equilibrium": True},
    }
    body = mechanism_engine(machine).state("run", -1, 0).bodies[0]
    assert body.x_m == pytest.approx(0.0, abs=1e-9)
    assert body.z_m == pytest.approx(-math.hypot(0.05, 0.5), abs=1e-12)


def _run(engine, ticks):
    for tick in range(ticks):
        engine.advance(tick, ())


# --- refused ----------------------------------------------------------------------------------------


def test_links_too_short_cannot_be_assembled(mechanism_engine):
    """Two links of 1 m cannot span 2.3 m; the error names the open joints and the gap."""
    machine = {
        "bodies": {"first": _body(0.5, 0.0), "second": _body(1.5, 0.0)},
        "joints": {
            "start": _pin("ground", "first", 0.0, 0.0),
            "knee": _pin("first", "second", 1.0, 0.0),
            "end": _pin("second", "ground", 2.0, 0.0, point_b_m=(2.3, 0.0)),
        },
    }
    # the least-squares gap of 0.3 m is shared by three equal joints
    with pytest.raises(SceneError, match=r"cannot be assembled.*start by 0\.1 m.*end by 0\.1 m"):
        mechanism_engine(machine)


def test_points_far_apart_are_wrong_data(mechanism_engine):
    """Beyond a tenth of the machine's size; a machine whose points meet is not spoken of."""
    machine = _four_bar()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        mechanism_engine(machine)
    machine["joints"]["left_head"]["point_b_m"] = (0.6, 1.0)
    with pytest.raises(SceneError, match=r"joints\.left_head: its two points are 0\.4 m apart.*10%"):
        mechanism_engine(machine)


@pytest.mark.parametrize("height", [0.5, -0.5])
def test_an_unstable_equilibrium_is_named(height):
    """A pendulum that stands, and none that hangs."""
    machine = {
        "bodies": {"bob": _body(0.0, height)},
        "joints": {"pin": _pin("ground", "bob", 0.0, 0.0)},
        "initial": {"static_equilibrium": True},
    }
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        assemble(Mechanism.model_validate(machine), 9.81, 1e-3)
    assert [found.category for found in caught] == ([UnstableEquilibriumWarning] if height > 0.0 else [])
    assert all("body 'bob'" in str(found.message) for found in caught)


def test_held_coordinate_off_its_rail_cannot_be_assembled(mechanism_engine):
    """A held coordinate that a joint forbids is named with the joint."""
    machine = {
        "bodies": {"slider": _body(0.0, 0.0)},
        "joints": {"rail": _rail("slider")},
        "initial": {"coordinates": {"slider.z_m": 0.2}},
    }
    with pytest.raises(SceneError, match=r"rail by 0\.1 m, initial\.coordinates\.slider\.z_m by 0\.1 m"):
        mechanism_engine(machine)


def test_drivers_that_disagree_contradict_each_other(mechanism_engine):
    """Two drivers of one coordinate with two speeds, or one across its rail: both joints are named."""
    machine = {
        "bodies": {"slider": _body(0.0, 0.0)},
        "joints": {
            "rail": _rail("slider"),
            "slow": _drive("slider", "x", kind="constant", value=0.5),
            "fast": _drive("slider", "x", kind="constant", value=0.6),
        },
    }
    with pytest.raises(SceneError, match="slow, fast contradict each other: no velocity"):
        mechanism_engine(machine)
    machine["joints"] = {"rail": _rail("slider"), "up": _drive("slider", "z", kind="constant", value=0.1)}
    with pytest.raises(SceneError, match="rail, up contradict each other"):
        mechanism_engine(machine)


def test_drivers_that_part_later_end_the_run_by_name(mechanism_engine):
    """Two drivers that agree at the start and part later are found when they part."""
    machine = {
        "bodies": {"slider": _body(0.0, 0.0)},
        "joints": {
            "rail": _rail("slider"),
            "steady": _drive("slider", "x", kind="constant", value=0.5),
            "rising": _drive(
                "slider", "x", kind="ramp", start_value=0.5, end_value=1.0, start_s=0.02, end_s=0.5
            ),
        },
    }
    with pytest.warns(RedundantConstraintsWarning, match="steady, rising"):
        engine = mechanism_engine(machine)
    with pytest.raises(PhysicsError, match=r"constraints contradict each other: joints\.(steady|rising)"):
        _run(engine, 100)


def test_third_parallel_link_is_redundant_but_moves(mechanism_engine):
    """The repeated link is a warning; motion is that of two links of the same mass, reactions are marked."""
    machine = _with_third_link()
    with pytest.warns(RedundantConstraintsWarning, match=r"left_foot.*middle_head: 1 of the constraints"):
        engine = mechanism_engine(machine)
    assert engine.topology.freedom_count == 1
    assert engine.topology.redundant_count == 1
    for tick in range(600):
        engine.advance(tick, ())
    state = engine.state("run", 599, 600_000_000)
    assert state.position_residual_m < 1e-10
    assert not any(joint.unique for joint in state.joints)
    # the smallest reactions carry the bar: their sum is what accelerates it
    heads = [j for j in state.joints if j.name.endswith("head")]
    bar = state.bodies[2]
    assert sum(j.force_x_newton for j in heads) == pytest.approx(bar.acceleration_x_m_per_s2, abs=1e-9)
    assert sum(j.force_z_newton for j in heads) == pytest.approx(bar.acceleration_z_m_per_s2 + 9.81, abs=1e-9)
    # one equation for the angle of links (three masses at half height, the bar at full height)
    angle, rate = math.atan2(-0.2, 1.0), 0.0
    length = math.hypot(0.2, 1.0)
    inertia = 3.0 * (0.1 + (0.5 * length) ** 2) + length**2
    moment = 9.81 * length * (3.0 * 0.5 + 1.0)
    for _ in range(60_000):  # leap-frog, 1e-5 s: errors below 1e-9 rad
        rate += 0.5e-5 * moment * math.sin(angle) / inertia
        angle += 1e-5 * rate
        rate += 0.5e-5 * moment * math.sin(angle) / inertia
    turned = angle - math.atan2(-0.2, 1.0)
    assert state.bodies[0].angle_rad == pytest.approx(turned, abs=1e-8)


def test_topology_counts_freedoms_and_redundant_joints():
    """Of a parallelogram with a third link."""
    with pytest.warns(RedundantConstraintsWarning):
        start = assemble(Mechanism.model_validate(_with_third_link()), 9.81, step_s=1.0)
    topology = Topology.of(start)
    assert (topology.coordinate_count, topology.constraint_count, topology.freedom_count) == (12, 12, 1)
    assert set(topology.redundant_joints) == set(_with_third_link()["joints"])


def test_flat_parallelogram_is_a_singular_start(mechanism_engine):
    """A parallelogram lying flat may go on in two ways: its joints are named."""
    machine = {
        "bodies": {"left": _body(0.5, 0.0), "right": _body(1.5, 0.0), "bar": _body(1.5, 0.0)},
        "joints": {
            "a": _pin("ground", "left", 0.0, 0.0),
            "b": _pin("ground", "right", 1.0, 0.0),
            "c": _pin("left", "bar", 1.0, 0.0),
            "d": _pin("right", "bar", 2.0, 0.0),
        },
    }
    with pytest.raises(SceneError, match=r"initial pose is singular.*a, b, c, d"):
        mechanism_engine(machine)


def test_slider_driven_past_its_dead_centre_is_named(mechanism_engine):
    """A slider pulled to the end of its stroke ends the run by name, never with NaN."""
    angle = 0.6
    pin = (0.5 * math.cos(angle), 0.5 * math.sin(angle))
    end = pin[0] + math.sqrt(1.0 - pin[1] ** 2)
    machine = {
        "bodies": {
            "crank": _body(0.5 * pin[0], 0.5 * pin[1]),
            "rod": _body(0.5 * (pin[0] + end), 0.5 * pin[1]),
            "slider": _body(end, 0.0),
        },
        "joints": {
            "main": _pin("ground", "crank", 0.0, 0.0),
            "big_end": _pin("crank", "rod", *pin),
            "small_end": _pin("rod", "slider", end, 0.0),
            "rail": _rail("slider"),
            "pull": _drive("slider", "x", kind="constant", value=0.4),
        },
    }
    engine = mechanism_engine(machine)
    with pytest.raises(SingularMechanismError, match="main, big_end, small_end, pull"):
        _run(engine, 1000)
    body = engine.state("run", 0, 0).bodies[2]
    assert 0.0 <= 1.5 - body.x_m < 0.8e-3  # within two steps of the dead centre, and finite


def test_machine_that_nothing_holds_has_no_rest(mechanism_engine):
    """Static equilibrium of a falling body is refused, naming the body and the force."""
    machine = {"bodies": {"stone": _body(0.0, 0.0)}, "initial": {"static_equilibrium": True}}
    with pytest.raises(SceneError, match=r"static_equilibrium.*'stone' is still pulled by 9\.81 N"):
        mechanism_engine(machine)


def test_ticks_and_wrenches_out_of_order_are_refused(mechanism_engine):
    """A tick that is not the next, a foreign tool, and a wrench that is not finite are named."""
    engine = mechanism_engine({"bodies": {"block": _body(0.0, 0.0)}}, tools=["block"])
    with pytest.raises(ProtocolError, match="asked to advance tick 1, but the next one is 0"):
        engine.advance(1, ())
    with pytest.raises(ProtocolError, match="wrenches of plough, but the tools are block_tool"):
        engine.advance(0, (ToolWrench("plough", *[0.0] * 7, contact_count=0),))
    with pytest.raises(PhysicsError, match="tick 0: the wrench on tool 'block_tool' is not finite"):
        engine.advance(0, (ToolWrench("block_tool", math.nan, *[0.0] * 6, contact_count=0),))
