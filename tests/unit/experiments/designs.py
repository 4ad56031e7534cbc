"""Small designs of a calibration and of a study."""

from pathlib import Path

import yaml

SCENES = Path(__file__).parents[3] / "config" / "scenes"
POINTS = [(0.10, 1.0, 0.0), (0.20, 1.0, 0.0), (0.20, 3.0, 0.0), (0.15, 2.0, -0.2)]
TINY = {
    "overrides": [
        "soil.bin={length_m: 0.2, width_m: 0.11, depth_m: 0.11}",
        "soil.bed.jitter_m=1.0e-4",
        "tools.tine.path.start_x_m=-0.13",
        "tools.tine.path.speed_x_m_per_s={kind: constant, value: 1.0}",
        "tools.tine.path.start_z_m=0.24",
        "duration_s=0.03",
        "record.cloud_hz=0.0",
        "report.window_inside_m=0.0",
    ],
    "reference": ["soil.time_step_s=2.0e-5"],
    "seeds": [0, 1],
    "factors": {
        "soil_step": {"auto": ["soil.time_step_s=auto"], "same": ["soil.time_step_s=2.0e-5"]},
        "overlap": {"none allowed": ["soil.max_tool_overlap_m=1.0e-9"]},
        "soil": {
            "wedge": [
                "soil={model: wedge, file: ../soils/paper_grid.yaml}",
                "allow=[beyond_fitted_range]",
            ]
        },
    },
    "presets": {"coarse": {"soil_step": "auto"}},
    "metrics": ["draft_mean_newton"],
}


def small_design(folder: Path) -> Path:
    """The file of a small calibration on tine.yaml."""
    points = [{"depth_m": d, "speed_m_per_s": v, "tilt_rad": t} for d, v, t in POINTS]
    design = {
        "model": "wedge",
        "scene": str(SCENES / "tine.yaml"),
        "overrides": [
            "coupling.communication_step_ns=1000000",
            "soil.bin={length_m: 3.4, width_m: 0.25, depth_m: 0.27}",
        ],
        "window_m": [0.2, 3.2],
        "fit": points,
        "check": [{"depth_m": 0.18, "speed_m_per_s": 2.0}],
    }
    path = folder / "design.yaml"
    path.write_text(yaml.safe_dump(design, sort_keys=False))
    return path
