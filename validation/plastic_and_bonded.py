"""S16 and S17: spheres that yield and stick, and bonds that break, at the ends of their parameters."""

import math

import numpy as np

from subsoil_ros.dem.build import build_engine

from .cases import REFUSED, RIGHT, STOPPED, Cases, Outcome, must, refused, right, stopped
from .laboratory import MASS, RADIUS, Document, Laboratory, drag, linear, placed
from .laws import ROOM_M, at_rest, head_on

CASES = Cases()

STICKY = 1e9
"""Surface energy that no contact can make use of [J/m2]: attraction is capped by what k2 bears."""


def yielding(**values: float) -> Document:
    """Spheres that load with some 10 kN/m, smooth and undamped but for `values`."""
    row = {
        "youngs_modulus_pa": 2e6, "poisson_ratio": 0.3, "contact_plasticity": 0.5, "static_friction": 0.0,
        "sliding_friction": 0.0, **values,
    }  # fmt: skip
    return {"kind": "elasto_plastic_adhesive", "particle": row, "boundary": row}


def cement(**values: float) -> Document:
    """Bonds without dampers."""
    return {
        "youngs_modulus_pa": 1e6,
        "tensile_strength_pa": 1e4,
        "cohesion_pa": 2e4,
        "damping_ratio": 0.0,
        **values,
    }


def rebound(laboratory: Laboratory, plasticity: float, **values: float) -> tuple[float, bool]:
    """Speed after a head-on impact over that before, and whether the two are apart then."""
    law = yielding(contact_plasticity=plasticity, **values)
    step_s = laboratory.soil(law, ROOM_M, gravity=0.0).timing.soil_step_s
    resolved = laboratory.soil(law, ROOM_M, gravity=0.0, time_step_s=round(0.05 * step_s, 10))
    step = resolved.timing.soil_step_s
    stiffness = 2e6 / (1.0 - 0.3**2) * 0.5 * RADIUS
    steps = math.ceil(2.0 * math.pi * math.sqrt(0.5 * MASS / stiffness) / step) + 5
    overlaps = head_on(resolved, 0.1, 0.0, steps)
    return (overlaps[-2] - overlaps[-1]) / step / 0.1, overlaps[-1] < 0.0


@CASES.add("S16a", RIGHT)
def plastic_rebound(laboratory: Laboratory) -> Outcome:
    """Head-on impact, plasticity 0, 0.5, 0.99 and 0.9999, without attraction."""
    found = []
    for plasticity in (0.0, 0.5, 0.99, 0.9999):
        speed, expected = rebound(laboratory, plasticity)[0], math.sqrt(1.0 - plasticity)
        must(abs(speed - expected) < 0.01, f"plasticity {plasticity}: {speed} of the speed, not {expected}")
        found.append(f"{plasticity:g}: {speed:.4f} ({expected:.4f})")
    return right(f"rebound over approach: {'; '.join(found)}")


@CASES.add("S16b", RIGHT)
def endless_surface_energy(laboratory: Laboratory) -> Outcome:
    """The same with a surface energy that no contact can make use of, plasticity 0.5 and 0.75."""
    speed, parted = rebound(laboratory, 0.5, surface_energy_joule_per_m2=STICKY)
    must(parted and abs(speed - 0.5) < 0.01, f"plasticity 0.5: {speed} of the speed, not 0.5")
    must(not rebound(laboratory, 0.75, surface_energy_joule_per_m2=STICKY)[1], "plasticity 0.75: they part")
    return right(f"plasticity 0.5: {speed:.4f} of the speed; 0.75: they stay together")


@CASES.add("S16c", REFUSED)
def no_unloading(laboratory: Laboratory) -> Outcome:
    """Plasticity 1, another exponent, attraction of spheres that never yield."""
    refused(lambda: laboratory.soil(yielding(contact_plasticity=1.0)), "less than 1")
    refused(lambda: laboratory.soil(yielding() | {"exponent": 2.0}), "allowed are 1 and 1.5")
    without = yielding(contact_plasticity=0.0, surface_energy_joule_per_m2=1.0)
    return refused(lambda: laboratory.soil(without), "give a contact_plasticity above 0")


@CASES.add("S17a", RIGHT)
def torn_apart(laboratory: Laboratory) -> Outcome:
    """Two bonded spheres thrown apart, modulus 1e4 to 1e9 Pa, below and above what their bond bears."""
    found = []
    for modulus in (1e4, 1e6, 1e9):
        strength = 0.01 * modulus
        bonds = cement(youngs_modulus_pa=modulus, tensile_strength_pa=strength, cohesion_pa=2.0 * strength)
        section = math.pi * RADIUS**2
        stiffness = modulus * section / (2.0 * RADIUS)
        bears = strength * section / math.sqrt(stiffness * 0.5 * MASS)  # closing speed that just breaks it
        step_s = 0.01 / math.sqrt(stiffness / (0.5 * MASS))
        for part in (0.95, 1.05):
            resolved = laboratory.soil(
                linear(1e-6), ROOM_M, gravity=0.0, bonds=bonds, time_step_s=round(step_s, 12),
                allow=["unstable_time_step"],
            )  # fmt: skip
            half, speed = 0.5 * ROOM_M[0], part * bears
            places = [[half - RADIUS, 0.0, -0.06], [half + RADIUS, 0.0, -0.06]]
            engine = placed(resolved, places, [[-0.5 * speed, 0.0, 0.0], [0.5 * speed, 0.0, 0.0]])
            for tick in range(1000):
                engine.advance(tick, ())
            broke = engine.state("", 0, 0).broken_bond_count
            must(broke == (part > 1.0), f"{modulus:g} Pa at {part} of what it bears: {broke} broken")
            if broke:
                left = float(np.ptp(engine.velocities_m_per_s()[:, 0])) / bears
                expected = math.sqrt(part**2 - 1.0)
                must(abs(left - expected) < 0.02, f"{modulus:g} Pa: left with {left}, not {expected}")
                found.append(f"{modulus:g} Pa: {left:.4f} ({expected:.4f})")
    return right(f"speed left over what breaks it, at 1.05 of that: {'; '.join(found)}")


@CASES.add("S17b", RIGHT)
def bonded_bed(laboratory: Laboratory) -> Outcome:
    """Resting bed with bonds of 1e2 to 1e9 Pa, `auto`."""
    found = []
    for modulus in (1e2, 1e5, 1e7, 1e9):
        bonds = cement(youngs_modulus_pa=modulus, tensile_strength_pa=0.01 * modulus)
        found.append(f"{modulus:g} Pa, {at_rest(laboratory.soil(bonds=bonds))}")
    return right("; ".join(found))


@CASES.add("S17c", REFUSED)
def bonds_too_stiff_or_long(laboratory: Laboratory) -> Outcome:
    """Bonds of 1e9 Pa at the step of the bed without them; gaps beyond the lists; more tension than shear."""
    stiff = cement(youngs_modulus_pa=1e9)
    refused(lambda: laboratory.soil(bonds=stiff, time_step_s=4e-5), r"above the stable limit .* bonds of")
    refused(lambda: laboratory.soil(bonds=cement(gap_over_radius=0.31)), "the skin must be as wide")
    steep = cement(friction_angle_deg=80.0)
    return refused(lambda: laboratory.soil(bonds=steep), "where the shear strength ends")


@CASES.add("S17d", STOPPED)
def soil_that_cannot_break(laboratory: Laboratory) -> Outcome:
    """Tool driven into a bed whose bonds bear all that their modulus gives."""
    bonds = cement(youngs_modulus_pa=1e7, tensile_strength_pa=1e6, cohesion_pa=1e12)
    resolved = laboratory.soil(bonds=bonds, tool=laboratory.box(0.03, 0.04, 0.06))
    step = resolved.timing.soil_step_s
    return stopped(lambda: drag(build_engine(resolved), step, 0.2, lambda time_s: 0.5), "overlap")
