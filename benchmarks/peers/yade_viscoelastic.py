"""Yade (Debian package `yade`): ViscElMat, linear springs and dashpot with tangential history and Coulomb.

It runs without rolling friction, and so computes less: its law has no rolling spring, and its torque
against the spin is unstable at these steps. Run inside Yade's interpreter, this file steps one job.
"""

import sys
import tempfile
from pathlib import Path

import numpy as np

NAME = "Yade"


def find() -> str | None:
    """The program; None where it is missing."""
    from .job import program

    return program("yade", "SUBSOIL_YADE")


def run(job):
    """Runs a job without plate; CPU time is that of the steps, taken inside Yade."""
    from .job import Result, run_program

    path = find()
    assert path is not None
    assert job.plate is None
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        law = job.law
        np.savez(
            folder / "job.npz",
            positions=job.positions_m, velocities=job.velocities_m_per_s, spins=job.spins_rad_per_s,
            lower=job.lower_m, upper=job.upper_m,
            law=[law.stiffness, law.tangential_stiffness, law.damping, law.friction],
            numbers=[job.steps, job.step_s, job.gravity_m_per_s2, job.radius_m, job.density_kg_per_m3,
                     job.skin_m],
        )  # fmt: skip
        run_program([path, "-x", "-n", "-j1", str(Path(__file__).resolve()), "job.npz"], folder)
        end = np.load(folder / "end.npz")
        return Result(end["positions"], end["velocities"], end["spins"], float(end["cpu_s"]), None)


def _inside_yade(path: str) -> None:
    import math
    import time

    import yade
    from yade import utils
    from yade.wrapper import (
        Bo1_Sphere_Aabb,
        Bo1_Wall_Aabb,
        ForceResetter,
        Ig2_Sphere_Sphere_ScGeom,
        Ig2_Wall_Sphere_ScGeom,
        InsertionSortCollider,
        InteractionLoop,
        Ip2_ViscElMat_ViscElMat_ViscElPhys,
        Law2_ScGeom_ViscElPhys_Basic,
        NewtonIntegrator,
        ViscElMat,
    )  # fmt: skip

    scene, job = yade.wrapper.Omega(), np.load(path)
    steps, step_s, gravity, radius, density, skin = job["numbers"].tolist()
    stiffness, tangential, damping, friction = job["law"].tolist()
    # Two bodies are springs in series (and dashpots likewise), so each has twice the pair's value.
    material = ViscElMat(
        kn=2.0 * stiffness, ks=2.0 * tangential, cn=2.0 * damping, cs=0.0, density=density,
        frictionAngle=math.atan(friction), mR=0.0, mRtype=1,
    )  # fmt: skip
    scene.materials.append(material)
    spheres = []
    for x, v, w in zip(job["positions"], job["velocities"], job["spins"], strict=True):
        body = utils.sphere(tuple(x), radius, material=material)
        body.state.vel, body.state.angVel = tuple(v), tuple(w)
        spheres.append(scene.bodies.append(body))
    for axis, sense, place in [
        *((a, 1, job["lower"][a]) for a in range(3)),
        *((a, -1, job["upper"][a]) for a in range(2)),
    ]:
        scene.bodies.append(utils.wall(float(place), axis, sense=sense, material=material))
    scene.engines = [
        ForceResetter(),
        InsertionSortCollider([Bo1_Sphere_Aabb(), Bo1_Wall_Aabb()], verletDist=0.5 * skin),
        InteractionLoop(
            [Ig2_Sphere_Sphere_ScGeom(), Ig2_Wall_Sphere_ScGeom()],
            [Ip2_ViscElMat_ViscElMat_ViscElPhys()],
            [Law2_ScGeom_ViscElPhys_Basic()],
        ),
        NewtonIntegrator(damping=0.0, gravity=(0.0, 0.0, -gravity)),
    ]
    scene.dt = step_s
    start = time.process_time()
    scene.run(int(steps), True)
    cpu_s = time.process_time() - start
    states = [scene.bodies[k].state for k in spheres]
    np.savez(
        "end.npz",
        positions=[list(s.pos) for s in states],
        velocities=[list(s.vel) for s in states],
        spins=[list(s.angVel) for s in states],
        cpu_s=cpu_s,
    )


if __name__ == "__main__":
    _inside_yade(sys.argv[-1])
