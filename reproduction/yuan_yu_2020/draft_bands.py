"""Draft against depth and speed of share and blade in particles, beside ASABE D497.7 and McKyes and Ali.

    python -m reproduction.yuan_yu_2020.draft_bands \
        [--out DIR] [--radius M] [--threads N] [--set key=value ...]

Runs share and blade of the 1S-300 on a path through a bed of the paper's soil (radius 20 mm with the law
scaled by default), draws the curves beside the formulas, and writes CSV, JSON and Markdown. The formulas
are not fitted; their strength is that of the bed's own shear tests (soil_tests.md).
"""

import argparse
import json
import sys
from pathlib import Path
from typing import Any

from benchmarks.run_cache import kept_run, write_rows
from subsoil_ros.analysis.columns import DRAFT
from subsoil_ros.analysis.summary import MEAN_DRAFT, path_of
from subsoil_ros.figures.plotting import COLOURS, new_figure, save_figure
from subsoil_ros.loading.loader import load_scene
from subsoil_ros.scene.tool_faces import cutting_faces
from subsoil_ros.scene.tool_mesh import load_tool_mesh
from validation.blades import ASABE_RANGE, TEXTURES, asabe_newton

from . import SCENES
from .draft_formulas import PAPER_GRID, mckyes_newton

TINE = SCENES / "tine.yaml"
DEPTHS_M = (0.12, 0.18, 0.24, 0.30)
SPEEDS_M_PER_S = (0.5, 1.0, 1.5)
MIDDLE_DEPTH_M, MIDDLE_SPEED = 0.18, 0.5
BIN_M = (1.6, 0.72, 0.4)
"""Twelve shares wide, as COARSE_BIN_M of fit_machine.py: bins half as wide add 20 % to the draft."""

TIP_M = (0.12, -0.30)
"""Of the meshes."""

MARGIN_M = 0.4
"""Tip this far inside both ends while the mean is taken (chosen: ten particles of 20 mm)."""


def case(depth_m: float, speed: float, radius_m: float) -> list[str]:
    """Overrides of tine.yaml."""
    length, width, depth = BIN_M
    way = length - 0.1 + 0.05
    return [
        f"soil.bin={{length_m: {length}, width_m: {width}, depth_m: {depth}}}",
        f"soil.particles={{radius_m: {radius_m!r}, reference_radius_m: 0.01, density_kg_per_m3: 1800.0}}",
        "soil.bed={kind: grid, spacing_m: rest}",
        f"soil.skin_m={0.3 * radius_m!r}",
        "soil.tool_stiffness_factor=10.0",
        "coupling.communication_step_ns=1000000",
        "coupling.force=tick_mean",
        "record.series_ticks=2",
        f"report.window_inside_m={MARGIN_M}",
        f"tools.tine.path.start_z_m={-TIP_M[1] - depth_m!r}",
        f"tools.tine.path.speed_x_m_per_s={{kind: constant, value: {speed!r}}}",
        f"duration_s={way / speed!r}",
        f"name=tine_{1e3 * depth_m:.0f}mm_{10.0 * speed:.0f}dm_per_s",
    ]


def run_cases(out: Path, radius_m: float, overrides: list[str], threads: int) -> list[dict[str, Any]]:
    """Depths at one speed, speeds at one depth."""
    points = [(depth, MIDDLE_SPEED) for depth in DEPTHS_M]
    points += [(MIDDLE_DEPTH_M, speed) for speed in SPEEDS_M_PER_S if speed != MIDDLE_SPEED]
    rows = []
    for depth, speed in points:
        found = kept_run(TINE, out / "runs", [*case(depth, speed, radius_m), *overrides], threads)
        rows.append(
            {
                "depth_m": depth,
                "speed_m_per_s": speed,
                "draft_newton": found[MEAN_DRAFT],
                "half_width_newton": found.get(path_of(DRAFT, "stationarity", "mean_half_width")),
                "drift": found.get(path_of(DRAFT, "stationarity", "verdict")),
                **formulas(depth, speed),
                "scene_hash": found["scene.hash"],
            }
        )
        print(json.dumps(rows[-1]), flush=True)
    return rows


def formulas(depth_m: float, speed: float) -> dict[str, float]:
    """Drafts of every formula [N]."""
    resolved = load_scene(TINE)
    faces = cutting_faces(load_tool_mesh(resolved.directory, resolved.scene, "tine"), "tools.tine")
    share = next(face for face in faces if face.is_share)
    found = {f"asabe_{texture}_newton": asabe_newton(depth_m, speed, texture) for texture in TEXTURES}
    for strength in PAPER_GRID:
        name = strength.source.split()[-1]
        found[f"mckyes_{name}_newton"] = mckyes_newton(
            depth_m, speed, strength, share.width_m, share.rake_rad
        )
    return found


def draw(rows: list[dict[str, Any]], path: Path) -> Path:
    """Curves over depth and over speed."""
    figure = new_figure(11.0, 4.6)
    panels = figure.subplots(1, 2, sharey=True)
    for axes, key, label, fixed in (
        (panels[0], "depth_m", "depth [m]", ("speed_m_per_s", MIDDLE_SPEED)),
        (panels[1], "speed_m_per_s", "speed [m/s]", ("depth_m", MIDDLE_DEPTH_M)),
    ):
        shown = sorted((row for row in rows if row[fixed[0]] == fixed[1]), key=lambda row: row[key])
        x = [row[key] for row in shown]
        low = [(1.0 - ASABE_RANGE) * row["asabe_coarse_newton"] for row in shown]
        high = [(1.0 + ASABE_RANGE) * row["asabe_fine_newton"] for row in shown]
        axes.fill_between(x, low, high, color="#f2e6c9", label="ASABE D497.7, coarse -50 % to fine +50 %")
        for texture in TEXTURES:
            axes.plot(
                x, [row[f"asabe_{texture}_newton"] for row in shown], color=COLOURS["reference"], lw=0.8
            )
        for name, style in (("peak", "-"), ("residual", "--")):
            axes.plot(
                x, [row[f"mckyes_{name}_newton"] for row in shown], color=COLOURS["share"], ls=style,
                label=f"McKyes and Ali, {name} strength",
            )  # fmt: skip
        error = [row["half_width_newton"] or 0.0 for row in shown]
        axes.errorbar(
            x, [row["draft_newton"] for row in shown], yerr=error, fmt="o-", color=COLOURS["main"],
            label="particles, mean with 95 %",
        )  # fmt: skip
        axes.set_xlabel(label)
        axes.grid(alpha=0.3)
    panels[0].set_ylabel("draft [N]")
    panels[0].set_ylim(bottom=0.0)
    panels[0].legend(fontsize=8)
    figure.suptitle("Draft of share and blade beside formulas that know nothing of it", fontsize=11)
    return save_figure(figure, path)


def markdown(rows: list[dict[str, Any]], command: str) -> str:
    """The table."""
    lines = ["# Draft beside independent formulas", "", f"`{command}`", "",
             "| depth, speed | particles | McKyes and Ali: peak, residual | ASABE coarse, medium, fine |",
             "|---|---|---|---|"]  # fmt: skip
    for row in rows:
        half = row["half_width_newton"]
        lines.append(
            f"| {row['depth_m']:.2f} m, {row['speed_m_per_s']:g} m/s | {row['draft_newton']:.0f}"
            f"{f' +- {half:.0f}' if half else ''} N ({row['drift']}) | {row['mckyes_peak_newton']:.0f}, "
            f"{row['mckyes_residual_newton']:.0f} N | {row['asabe_coarse_newton']:.0f}, "
            f"{row['asabe_medium_newton']:.0f}, {row['asabe_fine_newton']:.0f} N |"
        )
    return "\n".join(lines) + "\n"


def main() -> None:
    """Runs and compares."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, default=Path("runs/draft_bands"))
    parser.add_argument("--radius", type=float, default=0.020, metavar="M")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--set", dest="overrides", action="append", default=[], metavar="KEY=VALUE")
    args = parser.parse_args()
    rows = run_cases(args.out, args.radius, args.overrides, args.threads)
    write_rows(args.out / "draft_bands.csv", rows)
    command = " ".join(["python -m reproduction.yuan_yu_2020.draft_bands", *sys.argv[1:]])
    (args.out / "draft_bands.md").write_text(markdown(rows, command), encoding="utf-8")
    print(draw(rows, args.out / "draft_bands.png"))


if __name__ == "__main__":
    main()
