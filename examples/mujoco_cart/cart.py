"""The smallest machine in MuJoCo: a cart with a sprung shank pulls a tine through particles of loam.

python examples/mujoco_cart/cart.py --out runs/cart
"""

import argparse
from pathlib import Path

import mujoco

import subsoil_ros as subsoil

FOLDER = Path(__file__).parent


def control(model: mujoco.MjModel, data: mujoco.MjData, time_s: float) -> None:
    """Set the speed of the cart before each step; the soil's forces are added by MujocoMachine."""
    data.actuator("governor").ctrl = 0.5


def main() -> None:
    """Check and run the scene."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", help="folder for the results; must not exist")
    args = parser.parse_args()
    scene = subsoil.load_scene(FOLDER / "cart.yaml")
    machine = subsoil.MujocoMachine(scene, FOLDER / "cart.xml", control)
    print(subsoil.check(scene, machine=machine))
    run = subsoil.run(scene, args.out, machine=machine)
    print(f"{run}\nmean draft {run.series['draft_newton'].mean():.0f} N")


if __name__ == "__main__":
    main()
