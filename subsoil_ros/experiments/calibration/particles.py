"""How the particles of a calibration are made under each law, from two numbers that are sought.

Friction is one of them; the other makes cohesion. All else follows from a rule.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

from ...contact_laws.dampers import TANGENTIAL_DAMPING, damping_ratio_at
from ...scene.material import LaboratorySoil, mean_volume_radius_m
from ...yaml_document import Document
from ..soil_tests.element import NEIGHBOURS
from ..soil_tests.runs import rumpf_pa

ROLLING_FRICTION = 0.1
"""Stands for the shape of grains (chosen: small against the friction, so that one number is left to fit)."""

RESTITUTION = 0.6
"""Of two particles without attraction (chosen: dampers that draft does not notice, and no rattling)."""

TANGENTIAL_STIFFNESS = 0.8
"""Over the normal one: a usual part."""

REST_OVERLAP = 0.01
"""Largest overlap over the radius that attraction alone presses two particles to (chosen: stronger ones would
shrink the bed by more than its density may)."""

REACH = 0.05
"""Distance over the radius at which attraction ends (chosen: a bond breaks before the particle is sheared
by)."""

PLASTICITY, POISSON_RATIO = 0.75, 0.3
"""Of spheres that yield (chosen: they unload four times as stiffly as they load, so half of the speed of an
impact is left; a usual ratio)."""

BOND_STIFFNESS = 0.4
"""Of a bond over that of a contact (chosen: it carries a part of the load before it breaks, and the step
becomes hardly shorter)."""

SHEAR_OVER_TENSION, CEMENT_ANGLE_DEG = 2.0, 30.0
"""Strengths of the cement (chosen: usual of parallel bonds; tension and bending break it first)."""


class Wanted(NamedTuple):
    """What particles are made for."""

    soil: LaboratorySoil
    radius_m: float  # mean
    density_kg_per_m3: float  # of a particle
    stiffness: float  # of a contact that loads [N/m]

    @property
    def mean_radius_m(self) -> float:
        """Of the sphere of mean volume."""
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
            "rolling_friction": ROLLING_FRICTION,
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
    """Bonds carry all of the cohesion; where they broke the soil is dry."""
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

    fitted: str  # the number that makes cohesion, 0 without
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
