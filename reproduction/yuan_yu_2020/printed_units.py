"""Table 3 in N/mm and in N/m: the same share and blade, the same bed, 20 mm of travel.

    python -m reproduction.yuan_yu_2020.printed_units [--out DIR] [--threads N]

Runs subsoiler_1s300_printed_units.yaml (twelve minutes of a free core) and the same scene with the values
read in N/m and N s/m (a second), and prints draft, stable step, attraction of a pair, Rumpf's bound of the
tensile strength and the steps that the full scene would take.
"""

import argparse
import json
from pathlib import Path

from benchmarks.run_cache import Summary, kept_run
from subsoil_ros.analysis.columns import DRAFT
from subsoil_ros.analysis.summary import path_of
from subsoil_ros.loading.loader import ResolvedScene, load_scene
from subsoil_ros.scene.pair_laws import pair_values, rest_spacing_m

from . import SCENES

SCENE = SCENES / "subsoiler_1s300_printed_units.yaml"
TINE = SCENE.with_name("tine.yaml")
FULL_S = 4.0
"""Of the paper's run."""


def in_newton_per_metre() -> list[str]:
    """Overrides that give the scene the law of tine.yaml."""
    law = load_scene(TINE).document["soil"]["law"]
    return [
        f"soil.law.{row}.{key}={value!r}"
        for row in ("particle", "boundary")
        for key, value in law[row].items()
        if isinstance(value, float)
    ] + ["name=newton_per_metre"]


def figures(resolved: ResolvedScene, summary: Summary) -> dict[str, float]:
    """What is compared."""
    soil = resolved.scene.particle_soil
    assert soil is not None
    pair, _ = pair_values(soil)
    spacing = rest_spacing_m(soil)
    return {
        "draft mean [N]": summary[path_of(DRAFT, "run", "mean")],
        "draft largest [N]": summary[path_of(DRAFT, "run", "max")],
        "soil step [s]": resolved.timing.soil_step_s,
        "steps of the full scene": FULL_S / resolved.timing.soil_step_s,
        "pull of a pair [N]": pair.peak_attraction,
        "pull over spacing squared [Pa]": pair.peak_attraction / spacing**2,
        "particles": summary["particles.count"],
        "steps": summary["run.steps"],
        "wall [s]": summary["run.wall_s"],
    }


def main() -> None:
    """Runs both."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, default=Path("runs/printed_units"))
    parser.add_argument("--threads", type=int, default=1)
    args = parser.parse_args()
    found = {}
    for name, overrides in (("N/m", in_newton_per_metre()), ("N/mm, as printed", [])):
        resolved = load_scene(SCENE, overrides)
        found[name] = figures(resolved, kept_run(SCENE, args.out / "runs", overrides, args.threads))
        print(json.dumps({name: found[name]}), flush=True)
    (args.out / "printed_units.json").write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
