"""Three tines on a three-point hitch: MuJoCo moves them, the soil of a scene answers.

python examples/three_point_hitch/hitch.py --out runs/hitch
python examples/three_point_hitch/hitch.py --serve   # joins a run that was started elsewhere
"""

import argparse
from pathlib import Path

import subsoil_ros as subsoil
from subsoil_ros.loading.loader import ResolvedScene

FOLDER = Path(__file__).parent


def machine_of(scene: ResolvedScene) -> subsoil.MujocoMachine:
    """Tractor, hitch and implement, at the start of the scene; two steps of MuJoCo an exchange of 1 ms."""
    text = (FOLDER / "hitch.xml").read_text(encoding="utf-8")
    timestep_s = min(0.0005, scene.timing.communication_step_s)
    return subsoil.MujocoMachine(scene, text.replace('timestep="0.0005"', f'timestep="{timestep_s}"'))


def main() -> None:
    """Runs the scene in this process, or joins a run as its machine."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--scene", default=FOLDER / "hitch.yaml", help="hitch.yaml, or hitch_particles.yaml")
    parser.add_argument("--duration", type=float, help="simulated time [s]; that of the scene unless given")
    parser.add_argument("--out", help="folder for the results; must not exist")
    parser.add_argument("--serve", action="store_true", help="join the run in ROS_DOMAIN_ID as its machine")
    args = parser.parse_args()
    scene = subsoil.load_scene(args.scene, {"duration_s": args.duration} if args.duration else None)
    machine = machine_of(scene)
    if args.serve:
        subsoil.serve(scene, machine)
        return
    print(subsoil.check(scene, machine=machine))
    run = subsoil.run(scene, args.out, machine=machine)
    draft = run.summary["series"]["draft_newton"]
    print(f"{run}\nmean draft {draft['mean']:.0f} N, {draft['min']:.0f} to {draft['max']:.0f} N")


if __name__ == "__main__":
    main()
