"""Energy account of the interface, and the schedule of records."""

import math

import numpy as np
import pytest

from subsoil_ros.coupling.energy_account import InterfaceAccount, held_work_joule
from subsoil_ros.errors import PhysicsError
from subsoil_ros.messages import ToolMotion, ToolWrench
from subsoil_ros.schedule import Schedule


def motion(x: float, z: float = 0.0, phi: float = 0.0) -> ToolMotion:
    return ToolMotion("share", x, 0.0, z, phi, 0.0, 0.0, 0.0)


def wrench(x: float, z: float = 0.0, torque_y: float = 0.0, work: float = 0.0) -> ToolWrench:
    return ToolWrench("share", x, 9.0, z, 9.0, torque_y, 9.0, work, 0)


def test_held_work_counts_the_plane_alone() -> None:
    """Force times way in x and z, and -torque_y times phi; the other parts do no work."""
    work = held_work_joule(wrench(2.0, 3.0, torque_y=5.0), motion(1.0, 1.0, 1.0), motion(1.5, 1.25, 1.125))
    assert work == 2.0 * 0.5 + 3.0 * 0.25 - 5.0 * 0.125


def test_residual_of_a_spring_is_half_k_h_v_squared_per_tick() -> None:
    """On a spring k at speed v the held force lags one tick: the residual is t k v^2 H / 2, exactly."""
    k, v, h, ticks = 1000.0, 0.5, 1e-3, 200
    account = InterfaceAccount((motion(0.0),), (wrench(0.0),), None, 0.0)
    for tick in range(ticks):
        before, after = v * tick * h, v * (tick + 1) * h
        work = -0.5 * k * (after**2 - before**2)
        account.add((motion(after),), (wrench(-k * after, work=work),))
    expected = 0.5 * k * v**2 * h * (ticks * h)
    # round-off: `ticks` additions of numbers as large as the whole work
    bound = ticks * np.finfo(float).eps * account.work.absolute_work_joule
    assert abs(account.work.residual_joule - expected) <= bound
    assert account.work.residual_ratio == pytest.approx(expected / account.work.absolute_work_joule, rel=1e-9)


def test_bound_is_applied_beyond_the_grace_only() -> None:
    """A residual above its bound ends the run with advice, but not before enough work was done."""
    account = InterfaceAccount((motion(0.0),), (wrench(1.0),), 0.02, 1.0)
    account.add((motion(0.5),), (wrench(1.0, work=0.9),))
    account.check(0)
    account.add((motion(1.0),), (wrench(1.0, work=0.2),))
    with pytest.raises(
        PhysicsError, match=r"tick 1: .* -0.1 J is 9.09 % .*lower coupling.communication_step_ns"
    ):
        account.check(1)


def test_numbers_that_are_none_end_the_run() -> None:
    """NaN in a wrench is found at once, whatever the bound."""
    account = InterfaceAccount((motion(0.0),), (wrench(math.nan),), None, 1.0)
    account.add((motion(0.5),), (wrench(1.0),))
    with pytest.raises(PhysicsError, match="not finite"):
        account.check(0)


def test_schedule_ends_with_the_last_tick() -> None:
    """Series and clouds come at their multiples and with the last tick; no clouds if none are asked for."""
    schedule = Schedule(tick_count=25, series_ticks=10, cloud_ticks=20)
    assert [k for k in range(25) if schedule.series_due(k)] == [9, 19, 24]
    assert [k for k in range(25) if schedule.cloud_due(k)] == [19, 24]
    assert not any(Schedule(25, 10, 0).cloud_due(k) for k in range(25))
