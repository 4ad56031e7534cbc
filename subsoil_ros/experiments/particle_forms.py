"""Particles of a calibration under each law, from the two numbers that are sought.

One is the friction; the other gives the cohesion. All else follows from a rule.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

from ..contact_laws.dampers import TANGENTIAL_DAMPING, damping_ratio_at
from ..scene.material import LaboratorySoil, mean_volume_radius_m
from ..yaml_document import Document
from .element_tests import NEIGHBOURS, rumpf_pa

ROLLING_FRICTION = 0.1
"""Stands for the shape of grains, unless a critical angle is given: small against the friction."""

RESTITUTION = 0.6
"""Restitution of two particles without attraction: dampers too weak to change the draft, and no rattling."""

TANGENTIAL_STIFFNESS = 0.8
"""Tangential over normal stiffness: a usual ratio."""

REST_OVERLAP = 0.01
"""Largest overlap over the radius by attraction alone: a larger one would shrink the bed by more than the
tolerance of its density."""

REACH = 0.05
"""Distance over the radius at which attraction ends: short enough that a pair separates before the particles
are sheared past each other."""

PLASTICITY, POISSON_RATIO = 0.75, 0.3
"""Plasticity and Poisson's ratio of spheres that yield: they unload four times as stiffly as they load, so
half of the speed of an impact is left; the Poisson's ratio is a usual one."""

BOND_STIFFNESS = 0.4
"""Stiffness of a bond over that of a contact: large enough to carry a part of the load before it breaks, and
small enough to shorten the step hardly at all."""

SHEAR_OVER_TENSION, CEMENT_ANGLE_DEG = 2.0, 30.0
"""Cohesion over tensile strength, and friction angle, of the cement: usual for parallel bonds. With these,
tension and bending break it first."""


class Wanted(NamedTuple):
    """Properties that the particles of a calibration must have."""

    soil: LaboratorySoil
    radius_m: float  # mean
    density_kg_per_m3: float  # of a particle
    stiffness: float  # of a contact that loads [N/m]
    rolling_friction: float = ROLLING_FRICTION

    @property
    def mean_radius_m(self) -> float:
        """Radius of the sphere of mean volume."""
        return mean_volume_radius_m(self.radius_m)

    @property
    def rows(self) -> tuple[Document, Document]:
        """Particle and boundary under linear springs without friction between particles."""
        mass = 0.5 * self.density_kg_per_m3 * 4.0 / 3.0 * math.pi * self.mean_radius_m**3
        damping = 2.0 * damping_ratio_at(RESTITUTION) * math.sqrt(mass * self.stiffness)
        row = {
            "stiffness_newton_per_m": self.stiffness,
            "tangential_stiffness_newton_per_m": TANGENTIAL_STIFFNESS * self.stiffness,
            "damping_newton_s_per_m": damping,
            "tangential_damping_newton_s_per_m": TANGENTIAL_DAMPING * damping,
        }
        return row, row

    def with_friction(self, friction: float) -> tuple[Document, Document]:
        """Frictions of particles, and of particles on metal."""
        on_metal = math.tan(math.radians(self.soil.metal_friction_angle_deg))
        own = {
            "static_friction": friction,
            "sliding_friction": friction,
            "rolling_friction": self.rolling_friction,
        }
        return own, dict.fromkeys(own, on_metal)

    @property
    def rumpf_pa(self) -> float:
        """Tensile strength over the attraction of a pair [Pa/N]."""
        return rumpf_pa(self.soil.solid_fraction * NEIGHBOURS, 1.0, 2.0 * self.mean_radius_m)


def _attracted(wanted: Wanted, friction: float, attraction_newton: float) -> Document:
    """attraction_newton: the largest of a pair of mean volume."""
    particle, boundary = wanted.rows
    own, metal = wanted.with_friction(friction)
    if attraction_newton == 0.0:
        return {"law": {"kind": "linear", "particle": particle | own, "boundary": boundary | metal}}
    reach = REACH * wanted.mean_radius_m
    bond = {
        "cohesive_stiffness_newton_per_m": attraction_newton / reach,
        "equilibrium_overlap_m": attraction_newton / wanted.stiffness,  # as steep in tension as in pressure
        "cohesion_range_m": reach,
    }
    free = bond | {"cohesive_stiffness_newton_per_m": 0.0}
    return {
        "law": {
            "kind": "cohesive_linear", "combining_rule": "none",
            "particle": particle | own | bond, "boundary": boundary | free | metal,
        }
    }  # fmt: skip


def _yielding(wanted: Wanted, friction: float, pull_off_newton: float) -> Document:
    """Load with the wanted stiffness, 2 E* R*; the metal does not stick.

    A constant pull-off and no surface energy: the attraction of that goes with the load, at most half of what
    yields, so under the pressures of the tests it reads as friction.
    """
    own, metal = wanted.with_friction(friction)
    row = {
        "youngs_modulus_pa": 2.0 * (1.0 - POISSON_RATIO**2) * wanted.stiffness / wanted.mean_radius_m,
        "poisson_ratio": POISSON_RATIO,
        "contact_plasticity": PLASTICITY,
        "restitution": RESTITUTION,
    }
    sticky = {"pull_off_newton": pull_off_newton}
    law = {"kind": "elasto_plastic_adhesive", "particle": row | own | sticky, "boundary": row | metal}
    return {"law": law}


def _bonded(wanted: Wanted, friction: float, tensile_strength_pa: float) -> Document:
    """Bonds carry all of the cohesion; where they are broken, the soil has none."""
    dry = _attracted(wanted, friction, 0.0)
    if tensile_strength_pa == 0.0:
        return dry
    return dry | {
        "bonds": {
            "youngs_modulus_pa": BOND_STIFFNESS * wanted.stiffness * 2.0 / (math.pi * wanted.mean_radius_m),
            "tensile_strength_pa": tensile_strength_pa,
            "cohesion_pa": SHEAR_OVER_TENSION * tensile_strength_pa,
            "friction_angle_deg": CEMENT_ANGLE_DEG,
        }
    }


class Form(NamedTuple):
    """Particles under one law."""

    fitted: str  # name of the number that gives the cohesion; 0: none
    sections: Callable[[Wanted, float, float], Document]  # of a scene's soil, from friction and that number
    tension_per_unit: Callable[[Wanted], float]  # by Rumpf [Pa over its unit]
    presses: bool  # attraction presses particles at rest


FORMS = {
    "cohesive_linear": Form("attraction_newton", _attracted, lambda wanted: wanted.rumpf_pa, presses=True),
    "elasto_plastic_adhesive": Form(
        "pull_off_newton", _yielding, lambda wanted: wanted.rumpf_pa, presses=True
    ),
    "bonded": Form("bond_tensile_strength_pa", _bonded, lambda wanted: 1.0, presses=False),
}
"""By the name that `subsoil calibrate --law` takes."""
