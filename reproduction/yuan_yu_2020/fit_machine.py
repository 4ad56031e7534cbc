"""Fits the free parameters of the 1S-300 to the paper's printed results, stage by stage.

    python -m reproduction.yuan_yu_2020.fit_machine [--stage NAME ...] [--only NAME=VALUE ...] [--out DIR]

statics   spring and its lever in closed form, held against their ranges; no run
wedge     depth, damping and start on the wedge model; seconds a run
coarse    depth, friction limit and start with larger particles and wheels on plain ground; minutes a run
full      the best of the coarse stage in the paper's bin, bag, tables and figures kept; half an hour on
          two cores: only if named by --stage

Ranges and reasons: fit_ranges.yaml. A run scores how many of the printed values it holds
within 25 %, and the root mean square of ln(ours / printed), sign changes counted as a factor of ten. Whole
run and metrics window have equal weight: the paper does not state to which of them its ranges refer. Finished
runs are kept.
"""

import argparse
import copy
import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from benchmarks.run_cache import FailedRun, Summary, kept_run, write_rows, write_scene
from subsoil_ros.errors import SubsoilError
from subsoil_ros.loading.loader import load_scene
from subsoil_ros.yaml_document import Document

from . import HERE, SCENES, printed
from .levers import SHARE_DEPTH_PART
from .machine_variants import at_depth, at_rest, coarse_soil, on_plain_ground

Parameters = dict[str, Any]

FIT = HERE / "fit_ranges.yaml"
WEDGE = SCENES / "subsoiler_1s300_wedge.yaml"

DEPTHS_M = (0.18, 0.22, 0.26, 0.30)
"""Looked at (chosen: the range of the parameter up to the scene's first depth)."""

COARSE_BIN_M = (2.0, 0.72, 0.4)
"""The paper's length; twelve shares wide (chosen: 20 % of draft came with bins half as wide)."""

TARGET = 0.25
SIGN_FACTOR = 10.0
"""What a wrong sign counts (chosen: worse than any factor seen)."""

TIP_LEVER_M = 0.70
"""From the hinge down to the tip."""

SPRING_LENGTH_M = 0.40
"""Of the spring in the reference pose."""

DAMPINGS = (200.0, 1000.0, 3000.0)
"""Looked at [N s/m]: the range's ends, and the damping ratio 0.13."""


def targets() -> dict[str, float]:
    """Printed values by the quantity of a summary that they are compared with; the period is not fitted."""
    return {
        quantity: printed.value(quantity)
        for quantity in printed.REFERENCE.values
        if quantity != "failure_cycles.time_s.mean"
    }


def score(summary: Summary) -> dict[str, Any]:
    """Ours beside the printed values, how many are held, and the root mean square of the logarithms."""
    ours: dict[str, float] = {}
    misses, held = [], 0
    for quantity, given in targets().items():
        value = ours[quantity] = summary[quantity]
        held += abs(value - given) <= TARGET * abs(given)
        same_sign = value * given > 0.0
        misses.append(math.log(abs(value / given)) if same_sign else math.log(SIGN_FACTOR))
    rms = float(np.sqrt(np.mean(np.square(misses))))
    return {"held": int(held), "rms_log": rms, **ours}


def statics(ranges: dict[str, Any], depth_m: float) -> dict[str, float]:
    """Spring and its lever from the printed ranges, at a working depth; the hinge stays where it is.

    Stiffness x lever = range of the spring force / range of the angle; draft's lever / spring's lever =
    range of the spring force / range of the draft; and the spring rests (no force) where tension and
    compression divide the angle.

    Raises:
        SystemExit: a value falls out of its range.
    """
    tension, compression = printed.SPRING_NEWTON
    swing = printed.ANGLE_RANGE_RAD
    per_radian = (compression - tension) / swing
    ratio = (compression - tension) / (printed.DRAFT_NEWTON[1] - printed.DRAFT_NEWTON[0])
    lever = (TIP_LEVER_M - (1.0 - SHARE_DEPTH_PART) * depth_m) / ratio
    no_force_rad = -swing * -tension / (compression - tension)
    found = {
        "spring_stiffness_newton_per_m": per_radian / lever,
        "spring_lever_m": lever,
        "free_length_m": SPRING_LENGTH_M + lever * no_force_rad,
    }
    for name, value in found.items():
        low, high = map(float, ranges[name]["range"])
        if not low <= value <= high:
            raise SystemExit(
                f"{FIT}: parameters.{name}: the printed ranges give {value:.6g}, outside {low:g} to {high:g}"
            )
    return found


def with_spring(document: Document, spring: dict[str, float]) -> Document:
    """The machine with another spring, level in the reference pose, and its lug at another height."""
    found = copy.deepcopy(document)
    mechanism = found["mechanism"]
    force = mechanism["forces"]["H9_spring"]
    height = mechanism["joints"]["H8_shank_hinge"]["point_m"][1] + spring["spring_lever_m"]
    force["point_a_m"][1] = force["point_b_m"][1] = height
    force["stiffness_newton_per_m"] = spring["spring_stiffness_newton_per_m"]
    force["free_length_m"] = spring["free_length_m"]
    force["damping_newton_s_per_m"] = spring["spring_damping_newton_s_per_m"]
    return found


def variant(
    scene: Path, parameters: Parameters, ranges: dict[str, Any], out: Path, coarse_radius_m: float | None
) -> Path:
    """Scene file of one set of parameters; `scene` is on the wedge model or on particles."""
    start, friction = parameters["start"], parameters["friction_normal"]
    first = load_scene(scene, [f"initial_condition={start}"])
    document = at_depth(first, parameters["depth_m"], from_above=start == "lowered")
    spring = statics(ranges, parameters["depth_m"])
    document = with_spring(document, {**spring, "spring_damping_newton_s_per_m": parameters["damping"]})
    if first.scene.particle_soil is not None:
        document["soil"]["law"]["friction_normal"] = friction
    if coarse_radius_m is not None:
        document = coarse_soil(on_plain_ground(document), coarse_radius_m, COARSE_BIN_M)
    document["name"] += f"_{start}_{friction}_{parameters['damping']:.0f}"
    path = write_scene(document, out / "scenes" / f"{document['name']}.yaml")
    write_scene(at_rest(document, load_scene(path)), path)
    return path


def run_all(
    cases: Sequence[tuple[Parameters, Path]], out: Path, threads: int, *, keep_bag: bool
) -> list[Parameters]:
    """Scores of all cases, the best first; a failed one is reported and does not stop the others."""
    rows = []
    for parameters, path in cases:
        try:
            summary = kept_run(path, out / "runs", (), threads, keep_bag=keep_bag)
            rows.append({**parameters, **score(summary), "scene_hash": summary["scene.hash"]})
        except (FailedRun, SubsoilError) as error:
            print(f"{path.stem}: {error}", flush=True)
            continue
        print(
            json.dumps({k: f"{v:.4g}" if isinstance(v, float) else v for k, v in rows[-1].items()}),
            flush=True,
        )
    return sorted(rows, key=lambda row: (-row["held"], row["rms_log"]))


def parameter_sets(name: str, ranges: dict[str, Any], out: Path) -> list[Parameters]:
    """What a stage varies: the damping on the wedge model, then its best; the best of all in the full bin."""
    if name == "full":
        return [json.loads((out / "coarse.json").read_text(encoding="utf-8"))[0]]
    dampings: Sequence[float] = DAMPINGS
    frictions = ranges["parameters"]["friction_normal"]["choices"]
    if name == "wedge":
        frictions = ["total"]  # the limit that the wedge model was fitted to
    else:
        wedge = out / "wedge.json"
        dampings = (
            [json.loads(wedge.read_text(encoding="utf-8"))[0]["damping"]] if wedge.is_file() else [1000.0]
        )
    return [
        {"depth_m": depth, "friction_normal": friction, "start": start, "damping": damping}
        for start in ranges["parameters"]["start"]["choices"]
        for friction in frictions
        for depth in DEPTHS_M
        for damping in dampings
    ]


def chosen(sets: list[Parameters], only: Sequence[str]) -> list[Parameters]:
    """Those sets that every "name=value,value" of `only` allows."""
    allowed = {text.partition("=")[0]: text.partition("=")[2].split(",") for text in only}
    return [one for one in sets if all(f"{one[key]}" in values for key, values in allowed.items())]


def stage(name: str, ranges: dict[str, Any], out: Path, args: argparse.Namespace) -> list[Parameters]:
    """One stage with runs."""
    radius_m = args.radius if name == "coarse" else None
    scene = WEDGE if name == "wedge" else (FIT.parent / str(ranges["scene"])).resolve()
    cases = [
        (
            parameters,
            variant(scene, parameters, ranges["parameters"], out / name, radius_m),
        )
        for parameters in chosen(parameter_sets(name, ranges, out), args.only)
    ]
    return run_all(cases, out / name, args.threads, keep_bag=name == "full")


def main() -> None:
    """Runs the stages that are asked for."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--stage",
        nargs="+",
        choices=("statics", "wedge", "coarse", "full"),
        default=["statics", "wedge", "coarse"],
    )
    parser.add_argument("--out", type=Path, default=Path("runs/fit_machine"))
    parser.add_argument(
        "--only",
        nargs="+",
        default=[],
        metavar="NAME=VALUE,VALUE",
        help="run these parameters only: depth_m, friction_normal, start, damping",
    )
    parser.add_argument("--radius", type=float, default=0.025, metavar="M", help="of the coarse particles")
    parser.add_argument("--threads", type=int, default=1)
    args = parser.parse_args()
    ranges = yaml.safe_load(FIT.read_text(encoding="utf-8"))
    args.out.mkdir(parents=True, exist_ok=True)
    for name in args.stage:
        if name == "statics":
            rows = [{"depth_m": depth, **statics(ranges["parameters"], depth)} for depth in DEPTHS_M]
        else:
            rows = stage(name, ranges, args.out, args)
        if rows:
            write_rows(args.out / f"{name}.csv", rows)
            print(f"{name}: first {rows[0]}")


if __name__ == "__main__":
    main()
