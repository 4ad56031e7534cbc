"""Measured plates beside the predicted ones: rules of PREDICTIONS.md, from the kept runs of plates.py."""

import csv
import math
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .bearing import FORMS, sand
from .plates import SANDS, SETS, SPEED_M_PER_S, Plate, pressed_pa, record, submerged

HERE = Path(__file__).parent

RADIUS_M = {"pavlov": 0.004, "kruger": 0.005, "li": 0.0035, "wong": 0.010}
"""Of all rows of a set."""

GRAIN_RADII_M = {"pavlov": (0.0025, 0.004, 0.006), "li": (0.0025, 0.0035, 0.005)}

SINKAGES_M = (0.010, 0.020)
PUSHED_M, LIFTED_M, DRAGGED_M = (0.02, 0.05), (0.02, 0.045), 0.015
"""Depths of the slopes, and way from which on a drag counts."""


class Point(NamedTuple):
    """One measured number and those that were predicted for it."""

    set: str
    what: str
    measured: float
    predicted: float  # NaN: was not run
    forms: Mapping[str, float]  # of closed forms
    agrees: bool | None = None  # None: reported only


def table(name: str) -> list[dict[str, str]]:
    """Rows of a measured set."""
    with (HERE / f"{name}.csv").open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def grain(plate: Plate, radii_m: Iterable[float], stress: Callable[[Plate, float], float]) -> float:
    """b of p = p0 (1 + b r / length), least squares; NaN while a run is missing."""
    radii = np.fromiter(radii_m, float)
    values = np.array([stress(plate, radius) for radius in radii])
    if not np.isfinite(values).all():
        return math.nan
    slope, at_zero = np.polyfit(radii / plate.length_m, values, 1)
    return float(slope / at_zero)


def _pressure(plate: Plate, radius_m: float) -> float:
    return float(pressed_pa(record(plate.name(radius_m)), plate, SINKAGES_M[-1:])[0])


def grain_of_discs() -> float:
    """b of the plate of 80 mm in `repose_29`, at the larger sinkage."""
    return grain(SETS["pavlov_grain"][0], GRAIN_RADII_M["pavlov"], _pressure)


def effective_depth_m(sinkage_m: float) -> float:
    """By how much the curve of the largest particles must be deeper to lie on that of the smallest at a
    sinkage [m]; NaN while a run is missing."""
    (plate,) = SETS["pavlov_grain"]
    small, large = (record(plate.name(GRAIN_RADII_M["pavlov"][at])) for at in (0, -1))
    if small is None or large is None:
        return math.nan
    wanted = pressed_pa(small, plate, (sinkage_m,))[0]
    depths = np.arange(0.001, sinkage_m, 0.0002)
    reached = np.maximum.accumulate(pressed_pa(large, plate, depths))
    return sinkage_m - float(np.interp(wanted, reached, depths))


def _sinkage_points(name: str, what: str, measured: Any, predicted: Any, forms: Any) -> Iterator[Point]:
    """Pressures at both sinkages, and the growth between them."""
    limits = (None, 0.30)
    for at, sinkage in enumerate(SINKAGES_M):
        limit = limits[at]
        off = abs(predicted[at] / measured[at] - 1.0)
        yield Point(
            name, f"{what}, kPa at {1e3 * sinkage:g} mm", 1e-3 * measured[at], 1e-3 * predicted[at],
            {form: 1e-3 * values[at] for form, values in forms.items()},
            None if limit is None or math.isnan(off) else bool(off <= limit),
        )  # fmt: skip
    ratio, found = measured[1] / measured[0], predicted[1] / predicted[0]
    yield Point(
        name, f"{what}, growth", ratio, found, {form: v[1] / v[0] for form, v in forms.items()},
        None if math.isnan(found) else bool(abs(found / ratio - 1.0) <= 0.25),
    )  # fmt: skip


def _forms(friction_deg: float, density: float, width_m: float) -> dict[str, list[float]]:
    """Of a round plate at both sinkages."""
    return {
        name: [form(sand(friction_deg, density), depth, width_m, 1.0) for depth in SINKAGES_M]
        for name, form in FORMS.items()
    }


def pavlov(soil: str = "repose_29") -> Iterator[Point]:
    """Round plates in loose sand."""
    found: dict[tuple[float, float], list[float]] = defaultdict(list)
    for row in table("pavlov_johnson"):
        place = 1e-3 * float(row["plate_diameter_mm"]), 1e-3 * float(row["sinkage_mm"])
        found[place].append(1e3 * float(row["pressure_kpa"]))
    radius, b = RADIUS_M["pavlov"], grain_of_discs()
    for plate in SETS["pavlov"]:
        if plate.soil != soil:
            continue
        d = plate.length_m
        measured = [float(np.mean(found[round(d, 3), depth])) for depth in SINKAGES_M]
        predicted = pressed_pa(record(plate.name(radius)), plate, SINKAGES_M) / (1.0 + b * radius / d)
        forms = _forms(29.0, SANDS[soil][3], d)
        yield from _sinkage_points("Pavlov and Johnson", f"{1e3 * d:g} mm", measured, predicted, forms)


def one_at_a_time() -> Iterator[tuple[str, float, NDArray[np.float64]]]:
    """What was changed of the round plates in `repose_29`, the plate's diameter [m], and the pressure at both
    sinkages over that without the change; of runs that are kept."""
    radius = RADIUS_M["pavlov"]
    (plate,) = SETS["pavlov_grain"]
    runs = [("another seed", plate, plate.name(radius, seed=2))]
    runs += [("half the speed", plate, plate.name(radius, speed_m_per_s=0.5 * SPEED_M_PER_S))]
    for other in SETS["pavlov_why"]:
        changed = {
            "repose_29_denser": "solid fraction 0.60 for 0.56",
            "repose_29_stronger": "friction 0.5 for 0.34: 38 degrees at the peak, a heap of 35",
        }.get(other.soil, f"floor at {1e3 * other.floor_m:g} mm")
        runs.append((changed, other, other.name(radius)))
    for changed, other, name in runs:
        base = other._replace(soil="repose_29", floor_m=0.0)
        before = pressed_pa(record(base.name(radius)), base, SINKAGES_M)
        yield changed, other.length_m, pressed_pa(record(name), other, SINKAGES_M) / before


def kruger() -> Iterator[Point]:
    """A round plate in the loosest sand."""
    measured = [
        1e3
        * np.mean(
            [
                float(row["pressure_kpa"])
                for row in table("kruger2023")
                if row["compaction_method"] == "1" and float(row["sinkage_mm"]) == 1e3 * depth
            ]
        )
        for depth in SINKAGES_M
    ]
    (plate,), radius = SETS["kruger"], RADIUS_M["kruger"]
    factor = 1.0 + grain_of_discs() * radius / plate.length_m
    predicted = pressed_pa(record(plate.name(radius)), plate, SINKAGES_M) / factor
    forms = _forms(33.0, SANDS[plate.soil][3], plate.length_m)
    yield from _sinkage_points("Kruger et al.", "151 mm", measured, predicted, forms)


def _slope(run: NDArray[Any], area_m2: float, depths_m: tuple[float, float], lifted: bool) -> float:
    """Of upward stress over depth through zero [Pa/m]."""
    turn = int(np.argmax(run["depth_m"]))
    way = run[turn + 1 :] if lifted else run[: turn + 1]
    kept = way[(way["depth_m"] >= depths_m[0]) & (way["depth_m"] <= depths_m[1])]
    return float(kept["depth_m"] @ kept["force_z_newton"] / (kept["depth_m"] @ kept["depth_m"]) / area_m2)


def level_slope(plate: Plate, radius_m: float) -> float:
    """Of a plate pushed in [Pa/m]; NaN: was not run."""
    run = record(plate.name(radius_m))
    return math.nan if run is None else _slope(run, plate.area_m2, PUSHED_M, lifted=False)


def components(soil: str) -> dict[tuple[int, int], tuple[float, float]]:
    """Stress over depth along the motion (resisting) and upward, over that of the level plate pushed in, by
    attack and direction [deg] as in li2013.csv; those that were run."""
    radius = RADIUS_M["li"]
    plates = {(plate.attack_deg, plate.then): plate for plate in SETS["li"] if plate.soil == soil}
    level = level_slope(plates[0.0, "lift"], radius)
    found = {}
    for (attack, then), plate in plates.items():
        run = record(plate.name(radius))
        if run is None:
            continue
        scale = plate.area_m2 * level
        if then == "lift":
            found[0, -90] = 0.0, _slope(run, plate.area_m2, LIFTED_M, lifted=True) / level
            continue
        way = run[run["travel_m"] >= DRAGGED_M]
        depth = float(way["depth_m"].mean())
        x, z = -way["force_x_newton"].mean(), way["force_z_newton"].mean()
        found[round(attack), 0] = float(x / scale / depth), float(z / scale / depth)
        if attack == 90.0:
            found[90, 90] = 0.0, _slope(run, plate.area_m2, PUSHED_M, lifted=False) / level
    return found


def li() -> Iterator[Point]:
    """The submerged plate: ratios, and the slope of Quikrete sand."""
    both = [components(soil) for soil in ("peak_34", "peak_38")]
    generic = {
        (int(row["beta_deg"]), int(row["gamma_deg"])): row
        for row in table("li2013")
        if row["medium"] == "generic"
    }
    for place in ((0, 0), (0, -90), (90, 0), (90, 90), (45, 0), (-45, 0)):
        row = generic[place]
        for axis, key in enumerate(("alpha_x_newton_per_cm3", "alpha_z_newton_per_cm3")):
            if axis == 0 and place[1] != 0:
                continue
            measured = float(row[key])
            known = [one[place][axis] for one in both if place in one]
            predicted = float(np.mean(known)) if known else math.nan
            within = max(0.25 * abs(measured), 0.05)
            yield Point(
                "Li et al.", f"{row['motion']}, {'along' if axis == 0 else 'up'}", measured, predicted, {},
                bool(abs(predicted - measured) <= within) if known else None,
            )  # fmt: skip
    yield quikrete()


def quikrete() -> Point:
    """Slope of the level plate [kPa/cm], geometric mean of both readings, without the grain."""
    (row,) = (row for row in table("agarwal2019") if row["medium"].startswith("Quikrete"))
    measured, radius = 10.0 * float(row["alpha_z_newton_per_cm3"]), RADIUS_M["li"]
    plates = [submerged(soil)[-1] for soil in ("peak_34", "peak_38")]
    b = grain(SETS["li_grain"][0], GRAIN_RADII_M["li"], level_slope)
    pushed = [level_slope(plate, radius) for plate in plates]
    predicted = 1e-5 * math.sqrt(math.prod(pushed)) / (1.0 + b * radius / plates[0].length_m)
    depths = np.linspace(*PUSHED_M, 31)
    forms = {}
    for name, form in FORMS.items():
        slopes = []
        for angle in (34.0, 38.0):
            stress = [form(sand(angle, 1560.0), z, 0.025, 25.0 / 38.0) for z in depths]
            slopes.append(float(depths @ stress / (depths @ depths)))
        forms[name] = 1e-5 * math.sqrt(math.prod(slopes))
    off = abs(predicted / measured - 1.0)
    return Point(
        "Agarwal et al.", "slope of the level plate, kPa/cm", measured, predicted, forms,
        None if math.isnan(off) else bool(off <= 0.30),
    )  # fmt: skip


def wong() -> Iterator[tuple[str, float, float, float]]:
    """Soil, predicted pressure at 50 mm [kPa], and the range of soils with half to twice its cohesion."""
    for plate in SETS["wong"]:
        cohesion = {"dry_sand": 0.0, "sandy_loam": 5e3, "loam": 10e3, "clay_loam": 20e3}[plate.soil]
        low, high = (0.0, 2e3) if cohesion == 0.0 else (0.5 * cohesion, 2.0 * cohesion)
        depth, near = 0.05, []
        for row in table("wong_bekker"):
            if low <= float(row["cohesion_pa"]) <= high:
                k = float(row["kc_kn_per_m_n_plus_1"]) / (0.5 * plate.length_m)
                near.append((k + float(row["kphi_kn_per_m_n_plus_2"])) * depth ** float(row["n"]))
        found = pressed_pa(record(plate.name(RADIUS_M["wong"])), plate, (depth,))[0]
        yield plate.soil, 1e-3 * float(found), min(near), max(near)
