"""Test of the wheels in a fresh environment, away from the sources: the first run of a new user.

`python dev/fresh_install.py FOLDER`. FOLDER, which must not exist, gets the wheels of subsoil_ros and
subsoil_msgs, a virtual environment with them and everything else from the package registry at the versions
of requirements/lock.txt, and an empty folder to work in. There a new scene is run as four processes over DDS
and reported, and a shipped scene is checked by its name; HOME is empty. Minutes: the kernels are compiled
anew. Exit 0 if all of it works.
"""

import argparse
import json
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).parents[1]


def main() -> int:
    """Builds, installs, runs."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("folder", type=Path)
    folder = parser.parse_args().folder.resolve()
    wheels, prefix, work, home = (folder / name for name in ("wheels", "env", "work", "home"))
    for path in (wheels, work, home):
        path.mkdir(parents=True)
    build_wheels(wheels)
    environment = {
        **{key: os.environ[key] for key in ("LANG", "PIP_CACHE_DIR", "PIP_INDEX_URL") if key in os.environ},
        "PATH": f"{prefix}/bin:/usr/local/bin:/usr/bin:/bin",
        "HOME": str(home),
    }
    install(prefix, wheels, environment)

    def subsoil(*words: str) -> str:
        print("subsoil", *words, flush=True)
        start = time.monotonic()
        done = subprocess.run(
            [prefix / "bin/subsoil", *words],
            cwd=work,
            env=environment,
            check=True,
            stdout=subprocess.PIPE,
            text=True,
        )
        print(f"  {time.monotonic() - start:.1f} s", flush=True)
        return done.stdout

    subsoil("--version")
    assert str(prefix / "share/subsoil_ros/config/scenes/tine.yaml") in subsoil("check", "tine").replace(
        "\n", ""
    )
    check_shipped_files(prefix / "share/subsoil_ros/config")
    subsoil("new", "first")
    subsoil("run", "first/scene.yaml", "--out", "runs/first", "--set", "duration_s=0.02")
    subsoil("report", "runs/first", "--html")
    summary = json.loads((work / "runs/first/summary.json").read_text())
    assert summary["run"]["complete"]
    assert summary["run"]["mode"] == "nodes"
    assert (work / "runs/first/report.html").is_file()
    print("works")
    return 0


def check_shipped_files(share: Path) -> None:
    """Every file of config/, but programs, came with the wheel."""
    config = ROOT / "config"
    wanted = {path.relative_to(config) for path in config.rglob("*.*") if path.suffix not in (".py", ".pyc")}
    missing = sorted(str(path) for path in wanted if not (share / path).is_file())
    assert not missing, f"not in the wheel: {missing}"
    print(f"{len(wanted)} files of config/ are there", flush=True)


def build_wheels(folder: Path) -> None:
    """Both wheels, by the environment that runs this."""
    for left in (ROOT / "build").glob("lib*"):  # setuptools would pack what an older build left there
        shutil.rmtree(left)
    environment = {**os.environ, "AMENT_PREFIX_PATH": sys.prefix, "CMAKE_PREFIX_PATH": sys.prefix}
    pip = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-build-isolation", "--no-deps"]
    subprocess.run([*pip, "--wheel-dir", folder, ROOT, ROOT / "msg_defs"], check=True, env=environment)


def install(prefix: Path, wheels: Path, environment: dict[str, str]) -> None:
    """A virtual environment with the wheels and what they need."""
    base = Path(sys.base_prefix) / "bin" / f"python{sys.version_info.major}.{sys.version_info.minor}"
    subprocess.run([base, "-m", "venv", prefix], check=True)
    pip = [prefix / "bin/python", "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    lists = ["-r", ROOT / "requirements/run.txt", "-c", ROOT / "requirements/lock.txt"]
    subprocess.run([*pip, *lists, *sorted(wheels.glob("*.whl"))], check=True, env=environment)


if __name__ == "__main__":
    raise SystemExit(main())
