"""A robot arm with a bucket digs in dry sand: MuJoCo moves the arm, particles answer.

python examples/bucket_arm/bucket.py --out runs/bucket
"""

import argparse
import math
from pathlib import Path
from typing import Any

import numpy as np

import subsoil_ros as subsoil
from subsoil_ros.loading.loader import ResolvedScene

FOLDER = Path(__file__).parent
SHOULDER_M, UPPER_M, FORE_M = (-0.3, 0.6), 0.7, 0.6
"""Place (x, z) of the shoulder, lengths of both links: chosen, as of a robot that carries 30 kg."""

TIMES_S = (0.0, 0.5, 1.5, 2.0, 3.0)
WAYPOINTS = np.array(
    [  # x, z of the bucket's pin [m], pitch of the bucket and yaw of the arm [rad]
        (0.60, 0.25, -0.7, 0.0),
        (0.58, 0.12, -0.7, 0.0),  # the lip 70 mm deep
        (0.32, 0.12, -0.2, 0.0),  # drawn to the arm
        (0.30, 0.18, 0.6, 0.0),  # curled
        (0.30, 0.45, 0.6, 0.5),  # lifted and swung aside
    ]
)


def pose_at(time_s: float) -> list[float]:
    """Waypoints, from one to the next along a half cosine."""
    k = min(max(int(np.searchsorted(TIMES_S, time_s, side="right")) - 1, 0), len(TIMES_S) - 2)
    part = min((time_s - TIMES_S[k]) / (TIMES_S[k + 1] - TIMES_S[k]), 1.0)
    way = 0.5 - 0.5 * math.cos(math.pi * part)
    return (WAYPOINTS[k] + way * (WAYPOINTS[k + 1] - WAYPOINTS[k])).tolist()


def angles_of(x_m: float, z_m: float, pitch_rad: float, yaw_rad: float) -> list[float]:
    """Yaw, shoulder, elbow and wrist [rad]; angles about y turn x down. The elbow is above."""
    dx, dz = x_m - SHOULDER_M[0], z_m - SHOULDER_M[1]
    reach = math.hypot(dx, dz)
    inner = math.acos((UPPER_M**2 + reach**2 - FORE_M**2) / (2.0 * UPPER_M * reach))
    bend = math.acos((reach**2 - UPPER_M**2 - FORE_M**2) / (2.0 * UPPER_M * FORE_M))
    shoulder = math.atan2(-dz, dx) - inner
    return [yaw_rad, shoulder, bend, pitch_rad - shoulder - bend]


def model() -> str:
    """The arm as MJCF, at the first waypoint."""
    start = " ".join(map(repr, angles_of(*pose_at(0.0))))
    x, z = SHOULDER_M
    servo = '<position joint="{}" kp="1.5e5" kv="5e3"/>'
    return f"""
<mujoco model="bucket_arm">
  <option timestep="0.0001" integrator="implicitfast"/>
  <default> <geom contype="0" conaffinity="0"/> </default>
  <worldbody>
    <body name="column" pos="{x} 0 {z}">
      <joint name="yaw" axis="0 0 1"/>
      <geom type="cylinder" size="0.08 0.1" mass="20"/>
      <body name="upper_arm">
        <joint name="shoulder" axis="0 1 0"/>
        <geom type="capsule" fromto="0 0 0 {UPPER_M} 0 0" size="0.05" mass="20"/>
        <body name="fore_arm" pos="{UPPER_M} 0 0">
          <joint name="elbow" axis="0 1 0"/>
          <geom type="capsule" fromto="0 0 0 {FORE_M} 0 0" size="0.04" mass="12"/>
          <body name="bucket" pos="{FORE_M} 0 0">
            <joint name="wrist" axis="0 1 0"/>
            <geom type="box" pos="0 0 -0.09" size="0.1 0.1 0.075" mass="10"/>
            <site name="bucket"/>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
  <actuator> {" ".join(map(servo.format, ("yaw", "shoulder", "elbow", "wrist")))} </actuator>
  <keyframe> <key qpos="{start}" ctrl="{start}"/> </keyframe>
</mujoco>"""


def control(model: Any, data: Any, time_s: float) -> None:
    """The servos follow the waypoints."""
    data.ctrl[:] = angles_of(*pose_at(time_s))


def machine_of(scene: ResolvedScene) -> subsoil.MujocoMachine:
    """The arm, at the start of the scene."""
    return subsoil.MujocoMachine(scene, model(), control)


def main() -> None:
    """Runs the scene in this process."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--duration", type=float, help="simulated time [s]; that of the scene unless given")
    parser.add_argument("--out", help="folder for the results; must not exist")
    args = parser.parse_args()
    scene = subsoil.load_scene(
        FOLDER / "bucket.yaml", {"duration_s": args.duration} if args.duration else None
    )
    machine = machine_of(scene)
    print(subsoil.check(scene, machine=machine))
    run = subsoil.run(scene, args.out, machine=machine)
    load = -run.series["tool.bucket.force_z_newton"].iloc[-20:].mean()
    print(run, f"load in the bucket at the end: {load:.0f} N")


if __name__ == "__main__":
    main()
