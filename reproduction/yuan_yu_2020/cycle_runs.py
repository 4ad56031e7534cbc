"""Runs of the cycle scene that could show its swing to be an artefact.

    python -m reproduction.yuan_yu_2020.cycle_runs [--out DIR] [--case NAME ...] [--workers N] [--list]

Every case is config/scenes/subsoiler_1s300_cycle.yaml with one thing changed; finished runs are kept with
their bags. `python -m reproduction.yuan_yu_2020.cycle` makes the tables of cycle.md from them.
"""

import argparse
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

from benchmarks.run_cache import FailedRun, Summary, find_kept_run, kept_run, write_scene
from subsoil_ros.loading.loader import load_scene
from subsoil_ros.yaml_document import Document

from . import SCENES
from .draft_saving import mean_angle_rad
from .machine_variants import locked_shank

SCENE = SCENES / "subsoiler_1s300_cycle.yaml"

STEP_S = 5.3e-5
"""What `time_step_s: auto` takes in the scene."""

GROUND_STIFFNESS, SINKAGE_M = 28000.0, 0.0209
"""Of the wheel ground as declared [N/m], and how far the wheels sink into it in work, where the share is
carried by the soil in part."""

LAW = {"particle": (4.0e5, 3.2e5, 10.0, 5.0), "boundary": (8.0e5, 6.4e5, 20.0, 10.0)}
"""Stiffness, tangential stiffness [N/m], damping, tangential damping [N s/m] of the scene."""

GRACE_JOULE, FIRST_CONTACTS_JOULE = 1.0, 10.0
"""Interface work before its residual is judged: from the first joule on where a case passes that, else as in
the scene. It is first contacts, 0.02 J in the exchange, that fail; over a run it is below 0.1 % of 2 kJ."""

TREAD = str(SCENE.parents[1] / "meshes" / "wheel.stl")


class Case(NamedTuple):
    """One run."""

    name: str
    changes: Document
    seed: int = 0
    locked: bool = False  # at the mean angle of the sprung run of this seed
    grace_joule: float = GRACE_JOULE

    @property
    def key(self) -> str:
        """For --case and file names."""
        return f"{self.name.replace(' ', '_').replace('/', '_')}-{self.seed}"


def _radius(radius_m: float) -> Document:
    return {"soil": {"particles": {"radius_m": radius_m}, "skin_m": 0.3 * radius_m}}


def _law(stiffness: float = 1.0, damping: float = 1.0) -> Document:
    keys = (
        "stiffness_newton_per_m", "tangential_stiffness_newton_per_m", "damping_newton_s_per_m",
        "tangential_damping_newton_s_per_m",
    )  # fmt: skip
    factors = (stiffness, stiffness, damping, damping)
    law = {
        row: {key: value * factor for key, value, factor in zip(keys, values, factors, strict=True)}
        for row, values in LAW.items()
    }
    return {"soil": {"law": law}}


def _step(part: int) -> Document:
    """A part of the step, and so of the exchange, rows as far apart as before."""
    return {"soil": {"time_step_s": round(STEP_S / part, 9)}, "record": {"series_ticks": 20 * part}}


def _ground(factor: float) -> Document:
    """A stiffer ground for the wheels, as much lower as they sink less, so that the tip works as deep."""
    wheel = {
        "stiffness_newton_per_m": factor * GROUND_STIFFNESS,
        "ground_z_m": -SINKAGE_M * (1.0 - 1.0 / factor),
    }
    return {"mechanism": {"forces": {"ground_left": wheel, "ground_right": wheel}}}


def _half_the_speed() -> Document:
    """Over the same travel, every body at that speed from the start."""
    names = ("shank", "wheel_left", "wheel_right", "lower_link", "trolley", "upper_link", "frame")
    bodies: dict[str, Document] = {name: {"velocity_m_per_s": [0.25, 0.0]} for name in names}
    for wheel in ("wheel_left", "wheel_right"):
        bodies[wheel]["angular_velocity_rad_per_s"] = -1.25
    drive = {"H10_drive": {"speed": {"value": 0.25}}}
    return {
        "duration_s": 8.0,
        "record": {"series_ticks": 40},
        "mechanism": {"bodies": bodies, "joints": drive},
    }


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
        "duration_s": 4.4,
        "soil": {"bin": {"length_m": 2.8, "width_m": 1.1}},
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
        "report": {"settle_s": 0.5},
    }


def cases() -> Iterator[Case]:
    """Every run of the table, the most telling first."""
    for seed in (0, 1, 2):
        yield Case("as declared", {}, seed)
    for seed in (0, 1, 2):
        yield Case("locked", {}, seed, True, FIRST_CONTACTS_JOULE)
    yield Case("half the step", _step(2))
    yield Case("stiffness times 4", _law(stiffness=4.0))
    yield Case("dampers over 3", _law(damping=1.0 / 3.0))
    for seed in (0, 1, 2):
        grace_joule = FIRST_CONTACTS_JOULE if seed == 1 else GRACE_JOULE
        yield Case("r = 18 mm", _radius(0.018), seed, grace_joule=grace_joule)
    yield Case("r = 12 mm", _radius(0.012))
    exchange: Document = {
        "coupling": {"communication_step_ns": 2 * round(STEP_S * 1e9)},
        "record": {"series_ticks": 10},
    }
    exchange |= {"soil": {"time_step_s": STEP_S}}
    yield Case("exchange of two steps", exchange, grace_joule=FIRST_CONTACTS_JOULE)
    yield Case("bin 1.1 m wide", {"soil": {"bin": {"width_m": 1.1}}})
    stiff = {"stiffness_newton_per_m": 7.06e5, "free_length_m": 0.3746}  # at 3.0 kN as long as before
    yield Case("spring times 4", {"mechanism": {"forces": {"H9_spring": stiff}}})
    yield Case("wheel ground times 4", _ground(4.0))
    yield Case("wheel ground times 7", _ground(7.0))
    yield Case("0.25 m/s", _half_the_speed())
    yield Case("r = 10 mm", _radius(0.010))
    yield Case("wheels on the bed", _wheels_on_the_bed())
    yield Case("a third of the step", _step(3))


def scene_of(case: Case, out: Path) -> Path:
    """Scene file of a case; of a locked one that of the same bed with the shank on the spring."""
    name = "as_declared" if case.locked else case.key.rpartition("-")[0]
    grace_joule = GRACE_JOULE if case.locked else case.grace_joule
    changes: Document = {"base": str(SCENE), "name": name, **case.changes}
    soil: dict[str, Any] = changes.get("soil", {})
    changes["soil"] = {**soil, "bed": {"seed": case.seed}}
    changes["coupling"] = {**changes.get("coupling", {}), "residual_grace_joule": grace_joule}
    return write_scene(changes, out / "scenes" / f"{case.key}.yaml")


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
    document["coupling"] = {**document.get("coupling", {}), "residual_grace_joule": case.grace_joule}
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
            f"{case.key}: {found['series.draft_newton.mean']:.0f} N, {found['run.wall_s']:.0f} s, "
            f"{found['folder']}",
            flush=True,
        )
        return True

    with ThreadPoolExecutor(args.workers) as pool:
        done = list(pool.map(one, chosen))
    if not all(done):
        raise SystemExit(1)


if __name__ == "__main__":
    main()
