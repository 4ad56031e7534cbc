"""Reproduction of one paper: Yuan & Yu (2020), a self-excited vibrating subsoiler."""

from pathlib import Path

HERE = Path(__file__).resolve().parent
CONFIG = HERE.parents[1] / "config"
SCENES = CONFIG / "scenes"
RESULTS = HERE / "results"
