"""Soil and mechanism together: the whole energy book and the momentum of the interface."""

import pytest
from numpy.testing import assert_allclose
from scipy.integrate import trapezoid

from subsoil_ros.coupling.energy_account import account_of
from subsoil_ros.dem.build import build_engine
from subsoil_ros.mbd.mechanism_engine import MechanismEngine
from validation.coupling import block_machine

DURATION_S = 0.06


def coupled(soil, step):
    """The scheme of a run, without a bag. Yields engines, last wrenches and new ones, account, motions."""
    resolved = soil.scene(
        f"soil.time_step_s={step}", "soil.bin.length_m=0.3", "soil.bed.jitter_m=0.0003",
        **block_machine(soil.box(0.03, 0.05, 0.06)),
    )  # fmt: skip
    mechanism = MechanismEngine(resolved.scene, resolved.timing)
    bed = build_engine(resolved, 1, book=True)
    motions = mechanism.initial_motions()
    wrenches = bed.start(motions)
    account = account_of(resolved.scene, motions, wrenches, step)
    for tick in range(round(DURATION_S / step)):
        held = wrenches
        motions = mechanism.advance(tick, held)
        wrenches = bed.advance(tick, motions)
        yield tick, mechanism, bed, held, wrenches, account.add(motions, wrenches), motions


def test_the_whole_book_closes_better_when_the_step_halves(soil):
    """Machine and soil energy + every sink - driver work is constant up to first order in the step."""

    def defect(step):
        start, work = None, None
        for tick, mechanism, bed, _, _, work, _ in coupled(soil, step):  # noqa: B007
            if start is None:
                start = whole(tick, mechanism, bed)
        end = whole(tick, mechanism, bed)
        driver = mechanism.state("r", tick, 0).driver_work_joule
        assert driver > 0.2
        assert bed.energy().tool_work_joule > 0.1
        return abs(end - start) / driver, work.report("r", tick, 1, 0.0).residual_ratio

    coarse, fine = defect(4e-5), defect(2e-5)
    assert coarse[0] < 1e-3
    assert fine[0] < 0.7 * coarse[0]
    # the machine takes the soil's impulse of the tick, along a motion a second order away from its own
    assert coarse[1] < 1e-6
    assert fine[1] < 0.3 * coarse[1]


def whole(tick, mechanism, bed):
    """Everything but what the driver put in [J]."""
    m, s = mechanism.state("r", tick, 0), bed.energy()
    inside = m.kinetic_energy_joule + m.gravity_energy_joule + m.spring_energy_joule + m.dissipated_joule
    return inside - m.driver_work_joule + s.total_joule + s.tool_work_joule


def test_the_machine_gains_the_impulses_of_driver_and_held_wrench(soil):
    """Momentum of both bodies in x = impulse of the driver + sum of held wrench times interval."""
    step = 4e-5
    impulse, driver, before = 0.0, [], None
    for tick, mechanism, _, held, _, _, _ in coupled(soil, step):
        now = sum(m * v for m, v in zip((20.0, 6.0), mechanism.arrays.v[[0, 3]], strict=True))
        if before is None:
            before = now
        else:
            impulse += held[0].force_x_newton * step
        driver.append(mechanism.state("r", tick, 0).draft_newton)
    # the driver's force varies within a tick: its impulse by the trapezoid rule is good to second order
    pull = trapezoid(driver, dx=step)
    assert_allclose(now - before, impulse + pull, atol=2e-3 * abs(pull) + 1e-6)
    assert abs(impulse) > 0.05


@pytest.mark.parametrize("step", [4e-5])
def test_soil_work_reported_is_force_times_displacement(soil, step):
    """The work a wrench reports is the work its force does on the tool's displacement of that tick."""
    last = None
    for *_, wrenches, _, (now,) in coupled(soil, step):
        if last is not None:
            w = wrenches[0]
            work = (
                w.force_x_newton * (now.x_m - last.x_m)
                + w.force_z_newton * (now.z_m - last.z_m)
                - w.torque_y_newton_m * (now.angle_rad - last.angle_rad)
            )
            assert_allclose(w.work_joule, work, rtol=1e-12, atol=1e-15)
        last = now
