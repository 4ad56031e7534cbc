"""A soil in the words of LAMMPS: box, contact laws, walls and integration.

Source: pages `pair_style granular` and `fix wall/gran` of the LAMMPS manual. How its laws differ from those
of the package: docs/cluster.md.
"""

import math

from ...contact_laws.base import PairValues
from ...contact_laws.dampers import restitution_at
from ...scene.pair_laws import boundary_values, layer_soils, particle_values, sphere_mass_kg
from ...scene.soil import Soil
from ..domain import Domain
from ..model import SoilModel

HISTORY = "tool_contacts"
"""Property of an atom: its contacts with tools."""

TOOLS = "tools"
"""Fix through which tools act."""

TOUCHING = "touching"
"""Compute of the distances of pairs in contact, and of their atoms."""

_MARGIN_RADII = 4.0
"""Room between a wall and the end of LAMMPS's box at first."""

STYLES = (
    "units si", "atom_style sphere", "atom_modify map yes", "newton off", "comm_modify vel yes",
    "processors * * 1", "atom_modify sort 0 0.0",
)  # fmt: skip
"""Commands before there is a box. Velocities go with ghosts: dashpots need them. Ranks share the field, not
its depth. Atoms are not sorted: LAMMPS 2025 reverses a rolling spring whose two atoms change their order."""


def empty_box(model: SoilModel, domain: Domain) -> list[str]:
    """Commands that make the box of a domain; a type of atom for each layer, and then for its held ones."""
    bed, margin = domain.bed, _MARGIN_RADII * model.radius_m
    (x0, y0, z0), (x1, y1) = bed.lower_m, bed.upper_m
    aside = 0.0 if bed.period_m is not None else margin
    ends = (x0 - margin, x1 + margin, y0 - aside, y1 + aside, z0 - margin, domain.ceiling_m + margin)
    return [
        f"boundary m {'m' if bed.period_m is None else 'p'} m",  # grows with what leaves it
        f"region soil block {' '.join(repr(float(end)) for end in ends)}",
        f"create_box {2 * model.layers} soil",
    ]


def laws(model: SoilModel, history: int) -> list[str]:
    """Commands for what acts between atoms; history: numbers that an atom keeps of contacts with tools."""
    soil, layers = model.soil, layer_soils(model.soil)
    found = [
        f"fix {HISTORY} all property/atom d2_{HISTORY} {history} ghost no",
        "pair_style granular",
        f"neighbor {soil.skin_m!r} bin",
        "neigh_modify every 1 delay 0 check yes",
        f"timestep {model.step_s!r}",
        "thermo_modify lost error",
    ]
    for i, first in enumerate(layers):
        for j, second in enumerate(layers[i:], i):
            between = _granular(soil, _between(model, first, second))
            found += [f"pair_coeff {a} {b} {between}" for a, b in _types(i, j, len(layers))]
    return found


def motion(model: SoilModel, domain: Domain) -> list[str]:
    """Commands for weight, walls, tools and integration; they need the atoms."""
    layers, bed = layer_soils(model.soil), domain.bed
    (x0, y0, z0), (x1, y1) = bed.lower_m, bed.upper_m
    planes = {"x": ("xplane", x0, x1), "y": ("yplane", y0, y1), "z": ("zplane", z0, "NULL")}
    if bed.period_m is not None:
        del planes["y"]
    found = [f"group free type {' '.join(str(k + 1) for k in range(len(layers)))}"]
    for k, layer in enumerate(layers):
        found.append(f"group layer_{k} type {k + 1} {k + 1 + len(layers)}")
        law = _granular(model.soil, _at_wall(model, layer))
        found += [
            f"fix wall_{k}_{axis} layer_{k} wall/gran granular {law} {style} {low} {high}"
            for axis, (style, low, high) in planes.items()
        ]
    return [
        *found,
        f"fix weight all gravity {model.gravity_m_per_s2!r} vector 0.0 0.0 -1.0",
        f"fix {TOOLS} all external pf/callback 1 1",
        "fix motion free nve/sphere",
        f"compute {TOUCHING} all pair/local dist cutoff radius",
        f"compute {TOUCHING}_pairs all property/local patom1 patom2 cutoff radius",
    ]


def _types(i: int, j: int, layers: int) -> list[tuple[int, int]]:
    """Pairs of types of atoms, the lower first, of two layers: free and held ones."""
    found = {tuple(sorted((a + 1, b + 1))) for a in (i, i + layers) for b in (j, j + layers)}
    return sorted((a, b) for a, b in found)


def _between(model: SoilModel, first: Soil, second: Soil) -> PairValues:
    if _by_size(model):
        return particle_values(first, second, 1.0, 1.0)
    one, two = (sphere_mass_kg(layer, model.radius_m) for layer in (first, second))
    return particle_values(first, second, 0.5 * model.radius_m, one * two / (one + two))


def _at_wall(model: SoilModel, layer: Soil) -> PairValues:
    if _by_size(model):
        return boundary_values(layer, 1.0, 1.0)
    return boundary_values(layer, model.radius_m, sphere_mass_kg(layer, model.radius_m))


def _by_size(model: SoilModel) -> bool:
    """Whether values are taken at a radius of 1 m and a mass of 1 kg: LAMMPS then scales them itself."""
    return model.soil.particles.sizes is not None or model.soil.law.kind == "hertz_mindlin"


def _granular(soil: Soil, values: PairValues) -> str:
    """Words of a contact for `pair_coeff` and `fix wall/gran`; values as _between and _at_wall give them."""
    mu, tangential = values.sliding_friction, values.tangential_stiffness
    damping, style = values.damping, "velocity"
    if soil.law.kind == "hertz_mindlin":
        # a dashpot of 2 sqrt(5/6) beta sqrt(S m), S = 3/2 of the stiffness per root of overlap
        ratio = values.damping / (2.0 * math.sqrt(5.0 / 6.0 * 1.5 * values.stiffness))
        damping, style = restitution_at(ratio), "coeff_restitution"
    elif values.damping_of_restitution and soil.particles.sizes is not None:
        damping, style = (
            restitution_at(values.damping / (2.0 * math.sqrt(values.stiffness))),
            "coeff_restitution",
        )
    normal = "hertz" if soil.law.kind == "hertz_mindlin" else "hooke"
    along = "mindlin_rescale/force" if soil.law.kind == "hertz_mindlin" else "linear_history"
    part = values.tangential_damping / values.damping if values.damping > 0.0 else 0.0
    words = [f"{normal} {values.stiffness!r} {damping!r} damping {style}"]
    if tangential > 0.0:
        words.append(f"tangential {along} {tangential!r} {part!r} {mu!r}")
    if values.rolling_friction > 0.0:
        words.append(f"rolling sds {tangential!r} 0.0 {values.rolling_friction!r}")
    return " ".join(words)
