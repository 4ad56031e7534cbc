"""A tool that leaps enters the soil anew: as one that begins there, and without effect on anything else."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from subsoil_ros.errors import PhysicsError
from subsoil_ros.messages import SpatialMotion, ToolMotion
from subsoil_ros.wedge.wedge_engine import WedgeEngine
from tests.soils import NEGLIGIBLE

STEP_S = 5e-5
BIN = ("soil.bin.length_m=0.3",)
ALONE = ("gravity_m_per_s2=0", "soil.bin.length_m=0.4", "soil.bin.width_m=0.4", "soil.bin.depth_m=0.4")
UPRIGHT, NONE = (0.0, 0.0, 0.0, 1.0), (0.0, 0.0, 0.0)
IN_SOIL, IN_AIR = (0.1, 0.0, -0.03), (0.1, 0.0, 0.2)


def external(mesh: str, *names: str) -> dict:
    """Tools of a scene that may leap."""
    path = {"external": True, "start_z_m": 0.2, "may_leap": True, "turn": {}}
    return {name: {"path": path, "groups": {"body": {"mesh": mesh}}} for name in names}


def still(place, tool: str = "tool") -> ToolMotion:
    """At rest."""
    return SpatialMotion.of(tool, place, UPRIGHT, NONE, NONE)


def dragged(t: float, start_m: float = 0.08, tool: str = "tool") -> SpatialMotion:
    """Through the bed at 1 m/s."""
    place = (start_m + t, 0.0, -0.03)
    return SpatialMotion.of(tool, place, UPRIGHT, (1.0, 0.0, 0.0), NONE)


def test_it_is_where_a_tool_that_begins_there_would_be(soil):
    """The same particles are removed, and forces from then on agree to round-off; energy has no gap."""
    tools = external(soil.box(0.04, 0.04, 0.06), "tool")
    leapt, began = (soil.engine(*BIN, tools=tools, book=True) for _ in range(2))
    count = leapt.particle_count
    leapt.start((still(IN_AIR),))
    began.start((dragged(0.0),))
    before = leapt.energy().total_joule
    ways = [(dragged(STEP_S * (k + 1)),) for k in range(300)]
    found = [[engine.advance(k, way)[0] for k, way in enumerate(ways)] for engine in (leapt, began)]
    removed = count - began.particle_count
    assert leapt.leaps == (1, removed)
    assert removed >= 8
    forces = np.array([[(w.force_x_newton, w.force_z_newton) for w in wrenches] for wrenches in found])
    assert np.abs(forces[1]).max() > 1.0
    assert_allclose(forces[0], forces[1], rtol=0.0, atol=1e-7 * np.abs(forces[1]).max())
    assert_allclose(leapt.positions_m(), began.positions_m(), rtol=0.0, atol=1e-9)
    book = leapt.energy()
    assert abs(book.carried_joule) > 0.1
    assert book.total_joule == pytest.approx(before, abs=0.02 * abs(book.tool_work_joule))


def test_another_tool_and_its_soil_feel_nothing_of_a_leap(soil):
    """One is dragged through the bed, and keeps force and springs, while the other leaps from air to air."""
    tools = external(soil.box(0.03, 0.04, 0.06), "tool", "other")

    def motions(t, leaps):
        return dragged(t), still((0.2, 0.0, 0.5) if leaps and t > 0.0101 else IN_AIR, "other")

    found = []
    for leaps in (False, True):
        engine = soil.engine(*BIN, tools=tools, book=True)
        engine.start(motions(0.0, leaps))
        wrenches = [engine.advance(k, motions(STEP_S * (k + 1), leaps))[0] for k in range(260)]
        assert engine.leaps == (int(leaps), 0)
        found.append([(w.force_x_newton, w.force_z_newton) for w in wrenches])
    without, with_leap = np.array(found)
    assert np.abs(without[200:]).max() > 1.0
    assert_allclose(with_leap, without, rtol=0.0, atol=1e-9 * np.abs(without).max())


def test_what_was_pressed_goes_on_freely(soil):
    """A sphere that a tool presses, and one that presses another, which it removes: no force after it."""
    tools = external(soil.box(0.04, 0.04, 0.06), "tool")
    no_adhesion = {"cohesive_stiffness_newton_per_m": NEGLIGIBLE, "equilibrium_overlap_m": NEGLIGIBLE}
    engine = soil.engine(*ALONE, "soil.time_step_s=2e-5", tools=tools, law=no_adhesion, book=True)
    engine.place(np.array(((0.1, 0.0, -0.1401), (0.3, 0.0, -0.2), (0.3, 0.0, -0.2185))))
    engine.start((still((0.1, 0.0, -0.1)),))
    for k in range(15):
        down = (0.1, 0.0, -0.1 - 2e-5 * (k + 1))
        engine.advance(k, (SpatialMotion.of("tool", down, UPRIGHT, (0.0, 0.0, -1.0), NONE),))
    before = engine.velocities_m_per_s()
    assert (before[[0, 2], 2] < -0.01).all()
    engine.advance(15, (still((0.3, 0.0, -0.175)),))  # the lower sphere is 3.5 mm clear of it
    assert engine.leaps == (1, 1)
    assert_allclose(engine.velocities_m_per_s(), before[[0, 2]], rtol=0.0, atol=1e-12)


def test_a_state_keeps_what_was_counted(soil):
    tools = external(soil.box(0.04, 0.04, 0.06), "tool")
    engine, again = (soil.engine(*BIN, tools=tools, book=True) for _ in range(2))
    engine.start((still(IN_AIR),))
    engine.advance(0, (still(IN_SOIL),))
    again.restore({name: array.copy() for name, array in engine.state_arrays().items()})
    assert again.leaps == engine.leaps
    there = (still(IN_SOIL),)
    assert engine.advance(1, there) == again.advance(1, there)
    assert (engine.cloud(1, 1).identities == again.cloud(1, 1).identities).all()


def test_a_tool_that_swallows_the_bed_is_told(soil):
    tools = external(soil.box(0.6, 0.6, 0.6), "tool")
    engine = soil.engine(*BIN, tools=tools, book=True)
    engine.start((still((0.1, 0.0, 1.0)),))
    with pytest.raises(PhysicsError, match="tick 0: after a leap the tools overlap every particle"):
        engine.advance(0, (still((0.1, 0.0, -0.05)),))


def test_wedges_begin_anew_after_a_leap(soil):
    """Forces of a plate that leapt 0.3 m ahead are those of one that began there."""
    scene = {
        "soil": {
            "model": "wedge",
            "bin": {"length_m": 2.0, "width_m": 0.5, "depth_m": 0.3},
            "values": {
                "density_kg_per_m3": 1500.0, "cohesion_pa": 8e3, "friction_angle_rad": 0.5,
                "adhesion_pa": 0.0, "tool_friction_angle_rad": 0.3,
            },
        },
        "tools": {
            "tool": {
                "path": {"external": True, "may_leap": True},
                "groups": {"body": {"mesh": soil.box(0.02, 0.1, 0.2)}},
            }
        },
        "coupling": {"communication_step_ns": 1_000_000},
    }  # fmt: skip
    resolved = soil.resolve({"name": "wedge", "duration_s": 1.0, **scene})

    def at(x_m):
        return (ToolMotion("tool", x_m, 0.0, 0.0, 0.0, 0.5, 0.0, 0.0),)

    leapt, began = WedgeEngine(resolved), WedgeEngine(resolved)
    leapt.start(at(0.2))
    for k in range(50):
        first = leapt.advance(k, at(0.2 + 5e-4 * (k + 1)))
    began.start(at(0.5))
    ways = [0.5 + 5e-4 * (k + 1) for k in range(20)]
    found = [[engine.advance(50 + k, at(x)) for k, x in enumerate(ways)] for engine in (leapt, began)]
    assert abs(first[0].force_x_newton - found[1][0][0].force_x_newton) > 10.0
    forces = np.array([[w[0].force_x_newton for w in wrenches] for wrenches in found])
    assert_allclose(forces[0], forces[1], rtol=1e-9)
