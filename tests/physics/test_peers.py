"""The peers of benchmarks/peers compute what this engine computes; skipped where one is not installed."""

import numpy as np
import pytest

from benchmarks.peers import lammps_granular, liggghts, subsoil, yade_viscoelastic
from benchmarks.peers.job import Job, Law, Result

STEP_S = 1e-5
SPEED = 1.0  # closing speed of the collisions [m/s]


def collision(law: Law) -> Job:
    """Two spinning spheres that meet off centre, without weight; apart again at the end."""
    return Job(
        np.array([[0.30, 0.30, 0.300], [0.3193, 0.305, 0.302]]),
        np.array([[0.5, 0.2, 0.0], [-0.5, 0.0, 0.1]]),
        np.array([[10.0, 20.0, 30.0], [0.0, -40.0, 5.0]]),
        (0.0, 0.0, 0.0),
        (1.0, 1.0),
        steps=1000,
        gravity_m_per_s2=0.0,
        law=law,
        step_s=STEP_S,
    )


def bounce(law: Law) -> Job:
    """A spinning sphere that hits floor and wall."""
    return Job(
        np.array([[0.02, 0.30, 0.013]]),
        np.array([[-0.4, 0.3, -1.0]]),
        np.array([[10.0, -30.0, 20.0]]),
        (0.0, 0.0, 0.0),
        (1.0, 1.0),
        steps=4000,
        law=law,
        step_s=STEP_S,
    )


def reference(job: Job) -> Result:
    """What this engine gives."""
    return subsoil.run(job)


def assert_same_motion(job: Job, found: Result, part: float) -> None:
    """Velocities and rim speeds differ by less than `part` of the closing speed."""
    ours = reference(job)
    np.testing.assert_allclose(found.velocities_m_per_s, ours.velocities_m_per_s, rtol=0.0, atol=part * SPEED)
    rim, our_rim = job.radius_m * found.spins_rad_per_s, job.radius_m * ours.spins_rad_per_s
    np.testing.assert_allclose(rim, our_rim, rtol=0.0, atol=part * SPEED)


def overlap_part(job: Job) -> float:
    """Largest overlap over the diameter: by so much the levers of the codes differ."""
    mass = job.mass_kg if len(job.positions_m) == 1 else 0.5 * job.mass_kg  # of a sphere against a wall
    return SPEED * np.sqrt(mass / job.law.stiffness) / (2.0 * job.radius_m)


SLIDING = Law(damping=0.0, rolling_friction=0.0)
ROLLING = Law(damping=0.0)


@pytest.mark.skipif(liggghts.find() is None, reason="LIGGGHTS is not installed")
@pytest.mark.parametrize("make", [collision, bounce])
def test_liggghts_collides_alike(make):
    """Springs, friction and walls: the same scheme, so the same numbers but for round-off.

    1,000 contact steps of sums in another order: 1e-10 of the speed.
    """
    job = make(SLIDING)
    assert_same_motion(job, liggghts.run(job), 1e-10)


@pytest.mark.skipif(liggghts.find() is None, reason="LIGGGHTS is not installed")
def test_liggghts_rolls_alike():
    """With the rolling spring, its lever is the radius there and half the distance here."""
    job = collision(ROLLING)
    assert_same_motion(job, liggghts.run(job), overlap_part(job))


@pytest.mark.skipif(lammps_granular.find() is None, reason="LAMMPS is not installed")
@pytest.mark.parametrize("make", [collision, bounce])
@pytest.mark.parametrize("law", [SLIDING, ROLLING])
def test_lammps_collides_alike(make, law):
    """Friction acts on the radius there, on half the distance here."""
    job = make(law)
    assert_same_motion(job, lammps_granular.run(job), overlap_part(job))


@pytest.mark.skipif(yade_viscoelastic.find() is None, reason="Yade is not installed")
@pytest.mark.parametrize("make", [collision, bounce])
def test_yade_collides_alike(make):
    """Friction acts on the radius there too."""
    job = make(SLIDING)
    assert_same_motion(job, yade_viscoelastic.run(job), overlap_part(job))
