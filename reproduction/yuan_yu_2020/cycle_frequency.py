"""Test whether the swing of the sprung shank is a linear response to the failures that the locked tool meets.

The moment of the soil on the locked tool is applied to the linear shank, over time and over the travel of the
tip, and the spring force is compared with that of the sprung machine.
"""

import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.stats import f as f_distribution

from subsoil_ros.analysis.columns import TIME, Wrench
from subsoil_ros.analysis.failure_cycles import SMOOTHED_S
from subsoil_ros.analysis.series import running_mean, step_s
from subsoil_ros.loading.loader import load_scene
from subsoil_ros.scene.mechanism import SpringDamper

from .cycle_record import ANGLE, SPRING, Run, Values, quantile_range
from .cycle_runs import SCENE
from .levers import Levers, levers_of

STEP_S = 1e-4
"""Of the shank on soil that unloads (chosen: below a hundredth of the shortest period, 20 ms)."""

TRAVEL_MODELS = {"20 kN/m": 2.0e4, "200 kN/m": 2.0e5, "1000 kN/m": 1.0e6}
"""Stiffness [N/m] at the tip with which soil that has not failed unloads and is loaded again."""

OCTAVES_HZ = (0.6, 1.25, 2.5, 5.0, 10.0, 20.0)
"""Bounds of bands; the lowest bin that a window of 3 s holds twice is in the first."""

HANN_BINS = 1.5
"""Bins that one degree of Hann's window takes (equivalent noise bandwidth)."""


def soil_moment_newton_m(run: Run, levers: Levers) -> Values:
    """Moment (n,) of the soil on the shank about its hinge, positive where it presses the spring."""
    series = run.series
    shank = run.scene.scene.mechanism.bodies["shank"] if run.scene.scene.mechanism else None
    assert shank is not None
    arm = np.array(shank.position_m) - np.array(levers.hinge_m)
    turn = series[ANGLE] - shank.angle_rad
    x = np.cos(turn) * arm[0] - np.sin(turn) * arm[1]
    z = np.sin(turn) * arm[0] + np.cos(turn) * arm[1]
    # the planar moment is about -y, and the spring is pressed where the shank is turned back, clockwise
    return -np.asarray(
        x * series[Wrench("shank").force_z_newton]
        - z * series[Wrench("shank").force_x_newton]
        - series[Wrench("shank").torque_y_newton_m]
    )


def through_the_shank(locked: Run, levers: Levers, damping_newton_s_per_m: float) -> Values:
    """Spring force (n,) [N] of the linear shank under the moment that the soil puts on the locked one, over
    time.

    J a'' + C r^2 a' + k r^2 a = M(t) about the hinge, from rest under the first moment; force k r a + C r
    a'. The soil does not feel the shank give way: no feedback.
    """
    times, lever = locked.series[TIME], levers.spring_arm_m
    moment = soil_moment_newton_m(locked, levers)
    stiffness, damping = levers.stiffness_newton_m_per_rad, damping_newton_s_per_m * lever**2

    def rates(time: float, state: Values) -> list[float]:
        load = float(np.interp(time, times, moment))
        return [state[1], (load - damping * state[1] - stiffness * state[0]) / levers.inertia_kg_m2]

    start = [float(moment[0]) / stiffness, 0.0]
    found = solve_ivp(rates, (times[0], times[-1]), start, t_eval=times, max_step=2e-3, rtol=1e-6)
    return np.asarray((stiffness * found.y[0] + damping * found.y[1]) / lever)


def over_the_travel(
    locked: Run, levers: Levers, damping_newton_s_per_m: float, soil_newton_per_m: float
) -> Values:
    """Spring force (n,) [N] of the same shank, its soil as strong at each place as the locked tool found it.

    The tip is at s = v t - h a, h the lever of the tip. Where it has never been farther, the moment is that
    of the locked record at s; behind its farthest place the soil unloads, M(s_most) - h K (s_most - s) with
    K `soil_newton_per_m`, and never pulls. Semi-implicit Euler.
    """
    times, place = locked.series[TIME], np.maximum.accumulate(locked.tip_m[0])
    moment, tip = soil_moment_newton_m(locked, levers), levers.tip_lever_m
    arm, inertia = levers.spring_arm_m, levers.inertia_kg_m2
    stiffness, damping = levers.stiffness_newton_m_per_rad, damping_newton_s_per_m * arm**2
    speed = float((place[-1] - place[0]) / (times[-1] - times[0]))
    steps = np.arange(times[0], times[-1], STEP_S)
    angle, rate, most = float(moment[0]) / stiffness, 0.0, float(place[0])
    shift = float(place[0]) + tip * angle
    force = np.empty_like(steps)
    for k, time in enumerate(steps):
        at = shift + speed * (time - steps[0]) - tip * angle
        most = max(most, at)
        load = float(np.interp(most, place, moment)) - tip * soil_newton_per_m * (most - at)
        load = max(load, 0.0) if most > at else load
        rate += STEP_S * (load - damping * rate - stiffness * angle) / inertia
        angle += STEP_S * rate
        force[k] = (stiffness * angle + damping * rate) / arm
    return np.interp(times, steps, force)


def frequency_rows(sprung: Sequence[Run], locked: Sequence[Run]) -> list[dict[str, Any]]:
    """Rows of frequency.csv: the sprung shank, and the linear one on the soil that the locked tool found."""
    scene = load_scene(SCENE).scene
    levers = levers_of(scene)
    spring = scene.mechanism.forces["H9_spring"] if scene.mechanism else None
    assert levers is not None
    assert isinstance(spring, SpringDamper)
    damper = spring.damping_newton_s_per_m
    records = {
        "sprung": (sprung, [run.series[SPRING][run.rows] for run in sprung]),
        "locked record over time": (
            locked, [through_the_shank(run, levers, damper)[run.rows] for run in locked],
        ),
        **{
            f"locked record over travel, unloading {name}": (
                locked, [over_the_travel(run, levers, damper, soil)[run.rows] for run in locked],
            )
            for name, soil in TRAVEL_MODELS.items()
        },
    }  # fmt: skip
    own = _mean_density(*records["sprung"])
    rows = []
    for name, (runs, forces) in records.items():
        found = [
            run.cycles_of(running_mean(force, max(1, round(SMOOTHED_S / step_s(run.series)))))
            for run, force in zip(runs, forces, strict=True)
        ]
        cycles = [one for one in found if one is not None]
        frequency, density = _mean_density(runs, forces)
        rows.append(
            {
                "record": name,
                "spring_mean_newton": float(np.mean([force.mean() for force in forces])),
                "spring_deviation_newton": float(np.mean([force.std() for force in forces])),
                "spring_98_percent_range_newton": float(np.mean([quantile_range(f) for f in forces])),
                "time_s": float(np.mean([one.time_s.mean() for one in cycles])),
                "loading_fraction": float(np.mean([one.loading_fraction for one in cycles])),
                "strongest_hz": float(frequency[1 + np.argmax(density[1:])]),
                **_octaves(frequency, own[1] / density),
            }
        )
    rows.append({"record": "of chance, 95 %", **_ratio_of_chance(own[0], len(sprung))})
    return rows


def _mean_density(runs: Sequence[Run], records: Sequence[Values]) -> tuple[Values, Values]:
    """Mean periodogram over beds, at the frequencies of the first."""
    found = [run.periodogram(values) for run, values in zip(runs, records, strict=True)]
    frequency = found[0][0]
    return frequency, np.mean([np.interp(frequency, *one) for one in found], axis=0)


def _octaves(frequency: Values, ratio: Values) -> dict[str, float]:
    """Mean ratio (geometric) of densities by octave, sprung over this one."""
    found = {}
    for low, high in itertools.pairwise(OCTAVES_HZ):
        inside = (frequency >= low) & (frequency < high)
        found[f"sprung_over_this_{low:g}_to_{high:g}_hz"] = float(np.exp(np.log(ratio[inside]).mean()))
    return found


def _ratio_of_chance(frequency: Values, beds: int) -> dict[str, float]:
    """Ratio that two records of one process pass in an octave (or fall below its inverse) in one set of
    octaves of twenty: F quantile, two freedoms for each independent bin of each bed."""
    found, bands = {}, len(OCTAVES_HZ) - 1
    for low, high in itertools.pairwise(OCTAVES_HZ):
        bins = int(((frequency >= low) & (frequency < high)).sum())
        freedoms = 2.0 * max(1.0, bins / HANN_BINS) * beds
        level = float(f_distribution.ppf(1.0 - 0.025 / bands, freedoms, freedoms))
        found[f"sprung_over_this_{low:g}_to_{high:g}_hz"] = level
    return found
