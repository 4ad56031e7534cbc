"""Draft saved by a sprung shank: the control that the paper lacks.

    python -m reproduction.yuan_yu_2020.draft_saving \
        [SCENE] [--out DIR] [--most-seeds N] [--threads N] [--set key=value ...]

On each bed (seeds 0, 1, ... of the grid's jitter, or of a random bed) three machines run: sprung; locked at
the nominal angle, that of the reference pose; and locked at the mean angle that the sprung one had on this
bed. Only the last isolates vibration: its share has the mean angle of the sprung one. Start, slot and bed are
the same. Drafts are means over the metrics window; differences are taken bed by bed, with Student's
interval, until its half-width is below 2 % of the control's mean draft, or the seeds are used up: then the
difference is not resolved.

Published beside: 7 to 12 points of mean draft for self-excitation (Zhou et al. 2019, Trans. CSAM 50(5)
71-78).
"""

import argparse
import json
import math
import sys
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from benchmarks.run_cache import Summary, kept_run, write_scene
from subsoil_ros.analysis.columns import DRAFT, Body
from subsoil_ros.analysis.summary import MEAN_DRAFT, path_of
from subsoil_ros.loading.loader import ResolvedScene, load_scene

from . import SCENES
from .machine_variants import locked_shank, shank_and_frame
from .paired import PairedDifference, paired_difference

BOUND = 0.02
"""Half-width that counts as resolved, part of the control's mean draft."""

JITTER_M = 0.0005
"""Of each centre of a grid along each axis (chosen: half of it moves a bond by a quarter of its rest
overlap)."""

LEAST_SEEDS = 3
"""An interval of two pairs is 13 standard errors wide."""

COMPARED = {
    MEAN_DRAFT: "mean draft [N]",
    path_of(DRAFT, "moving_10ms", "min"): "least draft, 10 ms mean [N]",
    path_of(DRAFT, "moving_10ms", "max"): "largest draft, 10 ms mean [N]",
    "loads.specific.energy_joule_per_m": "energy [J/m]",
    "loads.specific.energy_joule_per_m3": "energy per loosened volume [J/m3]",
    "loads.tip_depth_m.mean": "mean depth of the tip [m]",
}


def bed_overrides(resolved: ResolvedScene, seed: int) -> list[str]:
    """Changes that make the bed of a seed."""
    soil = resolved.scene.particle_soil
    if soil is None:
        raise SystemExit(f"{resolved.path}: needs a soil of particles: only its beds have seeds")
    found = [f"soil.bed.seed={seed}"]
    if soil.bed.kind == "grid" and soil.bed.jitter_m == 0.0:
        ratio = soil.particles.mean_volume_radius_m / 0.010
        found.append(f"soil.bed.jitter_m={JITTER_M * ratio!r}")
    return found


def mean_angle_rad(summary: Mapping[str, Any], resolved: ResolvedScene) -> float:
    """Mean angle of the shank against the frame over the window, zero in the reference pose.

    Of a flattened summary, or of a row of a sweep's table, whose numbers are text.
    """
    shank, frame = shank_and_frame(resolved.scene)
    assert resolved.scene.mechanism is not None
    bodies = resolved.scene.mechanism.bodies
    means = {name: float(summary[path_of(Body(name).angle_rad, "mean")]) for name in (shank, frame)}
    return (means[shank] - bodies[shank].angle_rad) - (means[frame] - bodies[frame].angle_rad)


def run_seed(scene: Path, overrides: list[str], seed: int, out: Path, threads: int) -> dict[str, Summary]:
    """The three machines on one bed; overrides must not change what `scene` was resolved for."""
    plain = load_scene(scene, overrides)
    bed = bed_overrides(plain, seed)
    resolved = load_scene(scene, [*overrides, *bed])
    runs = out / "runs"
    sprung = kept_run(scene, runs, [*overrides, *bed], threads)
    if sprung["window.whole_run"]:
        raise SystemExit(f"{scene}: ends before its metrics window begins, so its mean draft is of the entry")
    found = {"sprung": sprung}
    for name, angle in (
        ("locked, nominal angle", 0.0),
        ("locked, mean angle", mean_angle_rad(sprung, resolved)),
    ):
        path = write_scene(locked_shank(resolved, angle), out / "scenes" / f"{name.split()[-2]}-{seed}.yaml")
        found[name] = {**kept_run(path, runs, (), threads), "angle_rad": angle}
    return found


def compare(seeds: list[dict[str, Summary]]) -> dict[str, dict[str, PairedDifference]]:
    """Differences control less sprung, by control and quantity; what a run lacks is left out."""
    table: dict[str, dict[str, PairedDifference]] = {}
    for control in seeds[0]:
        if control == "sprung":
            continue
        table[control] = {
            key: paired_difference(
                [one["sprung"][key] for one in seeds], [one[control][key] for one in seeds]
            )
            for key in COMPARED
            if all(key in one[name] for one in seeds for name in ("sprung", control))
        }
    return table


def markdown(scene: str, scene_hash: str, table: dict[str, dict[str, PairedDifference]], command: str) -> str:
    """The table, with intervals."""
    lines = [f"# Draft saving: {scene}", "", f"`{command}`, scene hash `{scene_hash[:16]}`", ""]
    for control, rows in table.items():
        lines += [f"## Against {control}", "", "| quantity | sprung | locked | difference (95 %) | pairs |",
                  "|---|---|---|---|---|"]  # fmt: skip
        for key, found in rows.items():
            half = f"{found.half_width:.4g}" if math.isfinite(found.half_width) else "unknown"
            lines.append(
                f"| {COMPARED[key]} | {found.case_mean:.4g} | {found.control_mean:.4g} "
                f"| {found.difference:+.4g} "
                f"+- {half} | {found.pair_count} |"
            )
        draft = rows[MEAN_DRAFT]
        resolved = "resolved" if draft.resolved(BOUND) else f"not resolved to {100.0 * BOUND:g} %"
        lines += ["", f"Saving of mean draft {100.0 * draft.saving:+.1f} "
                  f"+- {100.0 * draft.saving_half_width:.1f} %: "
                  f"{draft.verdict}; {resolved}. Published: 7 to 12 points.", ""]  # fmt: skip
    return "\n".join(lines)


def main() -> None:
    """Runs pairs until the difference is resolved or the seeds are used up."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("scene", nargs="?", type=Path, default=SCENES / "subsoiler_1s300.yaml")
    parser.add_argument("--out", type=Path, default=Path("runs/draft_saving"))
    parser.add_argument("--most-seeds", type=int, default=12)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--set", dest="overrides", action="append", default=[], metavar="KEY=VALUE")
    args = parser.parse_args()
    seeds: list[dict[str, Summary]] = []
    table: dict[str, dict[str, PairedDifference]] = {}
    for seed in range(args.most_seeds):
        seeds.append(run_seed(args.scene, args.overrides, seed, args.out, args.threads))
        table = compare(seeds)
        drafts = [rows[MEAN_DRAFT] for rows in table.values()]
        shown = ", ".join(f"{100.0 * d.saving:+.1f} +- {100.0 * d.saving_half_width:.1f} %" for d in drafts)
        print(f"seed {seed}: saving {shown}", flush=True)
        if len(seeds) >= LEAST_SEEDS and all(found.resolved(BOUND) for found in drafts):
            break
    resolved = load_scene(args.scene, args.overrides)
    document: dict[str, Any] = {
        "scene": resolved.scene.name,
        "scene_hash": resolved.scene_hash,
        "seeds": [
            {name: {key: run.get(key) for key in (*COMPARED, "angle_rad")} for name, run in one.items()}
            for one in seeds
        ],
        "differences": {name: {key: asdict(d) for key, d in rows.items()} for name, rows in table.items()},
    }
    text = json.dumps(document, indent=1).replace("Infinity", "null")
    (args.out / "draft_saving.json").write_text(text + "\n", encoding="utf-8")
    command = " ".join(["python -m reproduction.yuan_yu_2020.draft_saving", *sys.argv[1:]])
    shown = markdown(resolved.scene.name, resolved.scene_hash, table, command)
    (args.out / "draft_saving.md").write_text(shown, encoding="utf-8")
    print(shown)


if __name__ == "__main__":
    main()
