"""Runs a toolbar scene with controller.py, and draws what came of it.

python examples/draft_control/run.py --out runs/draft_control [--real-time]
python examples/draft_control/run.py --scene toolbar_particles.yaml --step-at 1.6 --out runs/particles
"""

import argparse
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np

from subsoil_ros.analysis.columns import DRAFT, TIME, Body
from subsoil_ros.analysis.series import read_series
from subsoil_ros.figures.plotting import COLOURS, new_figure, save_figure
from subsoil_ros.loading.loader import load_scene
from subsoil_ros.messages import DriverCommand
from subsoil_ros.recording.bag_reader import BagReader

FOLDER = Path(__file__).parent
WAITING = re.compile(r"waiting for a node 'controller' of run '(\w+)' in ROS_DOMAIN_ID=(\d+)")


def main() -> int:
    """Starts the run and, when it waits for it, the controller. Returns the exit status of the run."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--scene", default="toolbar.yaml", help="of this folder")
    parser.add_argument("--out", type=Path, required=True, help="folder for the results; must not exist")
    parser.add_argument("--target", type=float, default=1300.0, help="draft to hold [N]")
    parser.add_argument("--later-target", type=float, default=1700.0, help="the same after the step [N]")
    parser.add_argument("--step-at", type=float, default=5.0, help="simulated time of the step [s]")
    parser.add_argument("--real-time", action="store_true", help="hold the run to the wall clock")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="as of subsoil run")
    args = parser.parse_args()
    command = [sys.executable, "-m", "subsoil_ros.cli.main", "run", str(FOLDER / args.scene)]
    command += ["--out", str(args.out), *(word for change in args.set for word in ("--set", change))]
    controller: subprocess.Popen[bytes] | None = None
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as run:
        for line in run.stdout or ():
            print(line, end="", flush=True)
            waiting = WAITING.match(line)
            if waiting:
                controller = start_controller(args, run_id=waiting[1], domain=waiting[2])
    status = run.returncode
    if controller is not None:
        status = status or controller.wait()
    if status == 0:
        targets = (args.target, args.later_target, args.step_at)
        print(f"figure: {draw(args.out, targets)}")
    return status


def start_controller(args: argparse.Namespace, run_id: str, domain: str) -> subprocess.Popen[bytes]:
    """Starts controller.py for a run that waits in a ROS domain."""
    parameters = {
        "scene": args.out.resolve() / "scene.yaml",
        "run_id": f"'{run_id}'",
        "target_newton": args.target,
        "later_target_newton": args.later_target,
        "step_at_s": args.step_at,
        "real_time": str(args.real_time).lower(),
    }
    command = [sys.executable, str(FOLDER / "controller.py"), "--ros-args"]
    for name, value in parameters.items():
        command += ["-p", f"{name}:={value}"]
    return subprocess.Popen(command, env={**os.environ, "ROS_DOMAIN_ID": domain}, stdin=subprocess.DEVNULL)


def draw(out: Path, targets: tuple[float, float, float]) -> Path:
    """Draft, depth of the tip and commanded speed over time, from the bag."""
    resolved = load_scene(out / "scene.yaml")
    series = read_series(out / "bag", resolved.scene)
    mechanism = resolved.scene.mechanism
    tip = resolved.scene.report.tip_m
    assert mechanism is not None
    assert tip is not None
    times = series[TIME]
    turn, centre = series[Body("shank").angle_rad], mechanism.bodies["shank"].position_m
    tip_z = (
        series[Body("shank").z_m] + np.sin(turn) * (tip[0] - centre[0]) + np.cos(turn) * (tip[1] - centre[1])
    )
    commands = list(BagReader(out / "bag").records(DriverCommand))
    commanded_s = [command.tick * resolved.timing.communication_step_s for command in commands]
    target, later, step_s = targets
    figure = new_figure(9.0, 7.5)
    top, middle, bottom = figure.subplots(3, 1, sharex=True)
    top.plot(times, series[DRAFT], color=COLOURS["main"], lw=0.8, label="draft")
    top.plot(times, np.where(times < step_s, target, later), color="black", ls="--", lw=1.0, label="target")
    top.set_ylabel("draft [N]")
    top.legend(loc="lower right", frameon=False)
    top.set_title(f"Draft control of a hitch: {resolved.scene.description}", fontsize=11)
    middle.plot(times, -tip_z, color=COLOURS["main"], lw=1.2)
    middle.invert_yaxis()
    middle.set_ylabel("depth of the tip [m]")
    bottom.step(commanded_s, [1e3 * command.speed for command in commands], where="post", lw=1.0)
    bottom.set_ylabel("hitch, up [mm/s]")
    bottom.set_xlabel("simulated time [s]")
    for axes in (top, middle, bottom):
        axes.grid(alpha=0.3)
    return save_figure(figure, out / "draft_control.png")


if __name__ == "__main__":
    raise SystemExit(main())
