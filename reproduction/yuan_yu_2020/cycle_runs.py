"""Runs that test whether the swing of the machine in a field is an artefact, and what it depends on.

    python -m reproduction.yuan_yu_2020.cycle_runs [--out DIR] [--case NAME ...] [--workers N] [--list]

Every case is config/scenes/field_swing.yaml, the 1S-300 in loam, with one thing changed; finished runs are
kept with their bags. `python -m reproduction.yuan_yu_2020.cycle` makes the tables of cycle.md from them.
"""

import argparse
import copy
import math
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

from benchmarks.run_cache import FailedRun, Summary, find_kept_run, kept_run, write_scene
from subsoil_ros.analysis.summary import MEAN_DRAFT
from subsoil_ros.loading.loader import load_scene
from subsoil_ros.yaml_document import Document

from . import SCENES
from .draft_saving import mean_angle_rad
from .machine_variants import locked_shank

SCENE = SCENES / "field_swing.yaml"

STEP_S = 8.1e-5
"""What `time_step_s: auto` takes in the scene."""

LONG_S, MIDDLE_S, SHORT_S = 41.0, 21.0, 15.0
"""Durations: 20, 10 and 7 m of the trolley's travel at 0.5 m/s, and the entry."""

SINKAGE_M, SPRING_NEWTON = 0.0267, 4650.0
"""Means of the run in loam, which other grounds and springs must meet: how far the wheels sink into their
ground, and the force of the spring."""

TREAD = str(SCENE.parents[1] / "meshes" / "wheel.stl")


class Case(NamedTuple):
    """One run."""

    name: str
    changes: Document
    seed: int = 1
    sprung: str = ""  # the shank is locked, at the mean angle of the case of this name and seed
    duration_s: float = SHORT_S

    @property
    def locked(self) -> bool:
        """Whether the shank is held."""
        return bool(self.sprung)

    @property
    def key(self) -> str:
        """For --case and file names."""
        return f"{self.name.replace(' ', '_').replace('/', '_')}-{self.seed}"


def _radius(radius_m: float) -> Document:
    return {"soil": {"particles": {"radius_m": radius_m}, "skin_m": 0.3 * radius_m}}


def _law(stiffness: float = 1.0, damping: float = 1.0) -> Document:
    """Other contacts of the same strength: friction and attraction, k times overlap at rest, as they are."""
    factors = {
        "stiffness_newton_per_m": stiffness,
        "tangential_stiffness_newton_per_m": stiffness,
        "equilibrium_overlap_m": 1.0 / stiffness,
        "damping_newton_s_per_m": damping,
        "tangential_damping_newton_s_per_m": damping,
    }
    soil = copy.deepcopy(load_scene(SCENE).document["soil"])
    law = soil["law"]
    for row in ("particle", "boundary"):
        law[row] |= {key: law[row][key] * factor for key, factor in factors.items()}
    particles = {"radius_m": None} | soil["particles"]
    return {"soil": {"material": None, "law": law, "particles": particles, "window": soil["window"]}}


def _step(part: int) -> Document:
    """A part of the step, and so of the exchange, rows as far apart as before."""
    return {"soil": {"time_step_s": round(STEP_S / part, 9)}, "record": {"series_ticks": 20 * part}}


def _exchange(steps: int) -> Document:
    """The machine and the soil exchange once in so many steps, rows as far apart as before."""
    return {
        "coupling": {"communication_step_ns": steps * round(STEP_S * 1e9)},
        "record": {"series_ticks": 20 // steps},
        "soil": {"time_step_s": STEP_S},
    }


def _declared(force: str) -> Document:
    """A force of the scene."""
    found: Document = load_scene(SCENE).document["mechanism"]["forces"][force]
    return found


def _ground(factor: float) -> Document:
    """A stiffer ground for the wheels, as much lower as they sink less, so that the tip works as deep."""
    wheel = {
        "stiffness_newton_per_m": factor * _declared("ground_left")["stiffness_newton_per_m"],
        "ground_z_m": -SINKAGE_M * (1.0 - 1.0 / factor),
    }
    return {"mechanism": {"forces": {"ground_left": wheel, "ground_right": wheel}}}


def _spring(factor: float) -> Document:
    """Another stiffness, as long as before under the mean force; the damping ratio is kept."""
    declared = _declared("H9_spring")
    stiffness = declared["stiffness_newton_per_m"]
    spring = {
        "stiffness_newton_per_m": factor * stiffness,
        "damping_newton_s_per_m": math.sqrt(factor) * declared["damping_newton_s_per_m"],
        "free_length_m": declared["free_length_m"] - SPRING_NEWTON / stiffness * (1.0 - 1.0 / factor),
    }
    return {"mechanism": {"forces": {"H9_spring": spring}}}


def _speed(speed_m_per_s: float) -> Document:
    """Every body at that speed from the start."""
    names = ("shank", "wheel_left", "wheel_right", "lower_link", "trolley", "upper_link", "frame")
    bodies: dict[str, Document] = {name: {"velocity_m_per_s": [speed_m_per_s, 0.0]} for name in names}
    for wheel in ("wheel_left", "wheel_right"):
        bodies[wheel]["angular_velocity_rad_per_s"] = -5.0 * speed_m_per_s
    drive = {"H10_drive": {"speed": {"value": speed_m_per_s}}}
    return {"mechanism": {"bodies": bodies, "joints": drive}}


def _solid_fraction(fraction: float) -> Document:
    """Sandy loam in a bed of that density."""
    return {"soil": {"material": "sandy_loam", "bed": {"solid_fraction": fraction}}}


def _wheels_on_the_bed() -> Document:
    """As the start `end_wall` of the paper's scene; axles 18 mm higher, since this bed carries the wheels."""
    height, still = 0.19, {"velocity_m_per_s": [0.0, 0.0]}
    wheel = {**still, "angular_velocity_rad_per_s": 0.0, "position_m": [0.55, height]}
    axle = {"point_m": [0.55, height]}
    tool = {"role": "wheel", "groups": {"tread": {"mesh": TREAD, "position_m": [0.55, 0.0, height]}}}
    others = ("shank", "lower_link", "trolley", "upper_link", "frame")
    speed = {"kind": "table", "times_s": [0.0, 0.4, 0.5], "values": [0.0, 0.0, 0.5]}
    chain = {
        "kind": "coordinate_spring", "body": "frame", "coordinate": "z", "acts_in": "pull_up",
        "target": {"kind": "table", "times_s": [0.0, 0.3, 0.31], "values": [0.6713, 0.6453, 0.0]},
        "stiffness_newton_per_m": 1.0e5, "damping_newton_s_per_m": 2500.0,
    }  # fmt: skip
    return {
        "soil": {"bin": {"width_m": 1.1}},
        "mechanism": {
            "bodies": {**dict.fromkeys(others, still), "wheel_left": wheel, "wheel_right": wheel},
            "joints": {"H6_axle_right": axle, "H7_axle_left": axle, "H10_drive": {"speed": speed}},
            "forces": {"ground_left": None, "ground_right": None, "chain": chain},
            "initial": {
                "static_equilibrium": False,
                "coordinates": {"wheel_left.z_m": 0.20, "shank.angle_rad": -0.05084},
            },
        },
        "tools": {
            "wheel_left": {"body": "wheel_left", "lateral_m": 0.35, **tool},
            "wheel_right": {"body": "wheel_right", "lateral_m": -0.35, **tool},
        },
    }


def cases() -> Iterator[Case]:
    """Every run of the table, the most telling first."""
    loose, dense = _solid_fraction(0.57), _solid_fraction(0.62)
    yield Case("loam", {}, 1, duration_s=LONG_S)
    yield Case("loose sandy loam", loose, 1, duration_s=LONG_S)
    yield Case("dense sandy loam", dense, 1, duration_s=LONG_S)
    for seed in (2, 3):
        yield Case("loam", {}, seed, duration_s=MIDDLE_S)
    for seed in (1, 2, 3):
        yield Case("locked", {}, seed, "loam", MIDDLE_S)
    yield Case("dry sand", {"soil": {"material": "dry_sand"}}, duration_s=MIDDLE_S)
    yield Case("half the step", _step(2))
    yield Case("r = 12 mm", _radius(0.012))
    yield Case("r = 20 mm", _radius(0.020))
    yield Case("stiffness times 4", _law(4.0, 2.0))
    yield Case("dampers over 3", _law(damping=1.0 / 3.0))
    yield Case("exchange of two steps", _exchange(2))
    for seed in (2, 3):
        yield Case("exchange of two steps", _exchange(2), seed, duration_s=MIDDLE_S)
    for seed, duration_s in ((1, LONG_S), (2, MIDDLE_S), (3, MIDDLE_S)):
        yield Case("exchange of four steps", _exchange(4), seed, duration_s=duration_s)
    for factor in (0.3, 3.0, 10.0, 30.0):
        yield Case(f"spring times {factor:g}", _spring(factor))
    for speed in (0.25, 1.0, 2.0):
        yield Case(f"{speed:g} m/s", _speed(speed), duration_s=SHORT_S * 0.5 / speed)
    yield Case("field 1.0 m wide", {"soil": {"bin": {"width_m": 1.0}}})
    yield Case("wheel ground times 4", _ground(4.0))
    for millimetres in (10, 7.5):
        yield Case(f"r = {millimetres} mm", _radius(1e-3 * millimetres), duration_s=0.7 * SHORT_S)
    yield Case("wheels on the bed", _wheels_on_the_bed(), duration_s=0.7 * SHORT_S)
    for name, changes in (("loose sandy loam", loose), ("dense sandy loam", dense)):
        for seed in (2, 3):
            yield Case(name, changes, seed, duration_s=MIDDLE_S)
        for seed in (1, 2, 3):
            yield Case(f"{name} locked", changes, seed, name, MIDDLE_S)
    yield Case("plastic loam", {"soil": {"material": "loam_plastic"}})
    yield from _brittle_cases()


def _brittle_cases() -> Iterator[Case]:
    """Loam whose cohesion is bonds that break for good."""
    soil: Document = {"soil": {"material": "loam_bonded"}}
    yield Case("brittle loam", soil, 1, duration_s=LONG_S)
    for seed in (2, 3):
        yield Case("brittle loam", soil, seed, duration_s=MIDDLE_S)
    for seed in (1, 2, 3):
        yield Case("brittle locked", soil, seed, "brittle loam", MIDDLE_S)
    for name, changes in (
        ("half the step", _step(2)),
        ("r = 12 mm", _radius(0.012)),
        ("r = 20 mm", _radius(0.020)),
        ("field 1.0 m wide", {"soil": {"bin": {"width_m": 1.0}}}),
    ):
        yield Case(f"brittle {name}", {**changes, "soil": {**changes.get("soil", {}), **soil["soil"]}})
    for millimetres, part in ((10, 0.7), (7.5, 0.31)):
        radius = _radius(1e-3 * millimetres)["soil"]
        changes = {"soil": radius | soil["soil"]}
        yield Case(f"brittle r = {millimetres} mm", changes, duration_s=part * SHORT_S)


def scene_of(case: Case, out: Path) -> Path:
    """Scene file of a case; of a locked one that of the same bed with the shank on the spring."""
    whose = case.sprung or case.name
    free = next(one for one in cases() if (one.name, one.seed) == (whose, case.seed))
    name = free.key.rpartition("-")[0]
    every_step: Document = {
        "coupling": {"communication_step_ns": "soil_step", "force": "tick_end"},
        "record": {"series_ticks": 20},
    }
    changes: Document = {"base": str(SCENE), "name": name, **every_step, **case.changes}
    changes["duration_s"] = free.duration_s
    soil: dict[str, Any] = changes.get("soil", {})
    changes["soil"] = {**soil, "bed": {**soil.get("bed", {}), "seed": case.seed}}
    return write_scene(changes, out / "scenes" / f"{name}-{case.seed}.yaml")


def run_case(case: Case, out: Path) -> Summary:
    """Summary of a case, its bag kept; what it needs runs first.

    Raises:
        FailedRun: the run failed.
    """
    path = scene_of(case, out)
    if case.locked:
        sprung = kept_run(path, out / "runs", keep_bag=True)
        path = _locked_scene(case, path, sprung, out)
    return kept_run(path, out / "runs", keep_bag=True)


def find_case(case: Case, out: Path) -> Summary | None:
    """Summary of a case that has been run; none of one that has not."""
    path = scene_of(case, out)
    found = find_kept_run(path, out / "runs")
    if found is None or not case.locked:
        return found
    return find_kept_run(_locked_scene(case, path, found, out), out / "runs")


def _locked_scene(case: Case, path: Path, sprung: Summary, out: Path) -> Path:
    """Scene file of the shank locked at the mean angle of a sprung run of `path`."""
    resolved = load_scene(path)
    document = locked_shank(resolved, mean_angle_rad(sprung, resolved))
    document["duration_s"] = case.duration_s
    return write_scene(document, out / "scenes" / f"locked-{case.key}.yaml")


def main() -> None:
    """Run the cases that are asked for, one thread each."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, default=Path("runs/cycle"))
    parser.add_argument("--case", nargs="+", default=[], metavar="NAME")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--list", action="store_true", help="print the cases and end")
    args = parser.parse_args()
    chosen = [case for case in cases() if not args.case or case.key in args.case]
    if args.list:
        print("\n".join(case.key for case in chosen))
        return

    def one(case: Case) -> bool:
        try:
            found = run_case(case, args.out)
        except FailedRun as error:
            print(f"{case.key}: {error}", file=sys.stderr, flush=True)
            return False
        print(
            f"{case.key}: {found[MEAN_DRAFT]:.0f} N, {found['run.wall_s']:.0f} s, {found['folder']}",
            flush=True,
        )
        return True

    with ThreadPoolExecutor(args.workers) as pool:
        done = list(pool.map(one, chosen))
    if not all(done):
        raise SystemExit(1)


if __name__ == "__main__":
    main()
