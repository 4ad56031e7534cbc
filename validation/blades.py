"""Closed forms of the draft of a blade, which discrete elements are compared with, and a table of them.

    python -m validation.blades [--cohesion-kpa C] [--friction-deg PHI] [--density RHO] [--width-m W] ...

Angles [rad]: rake alpha of the blade and beta of the failure plane against the horizontal, friction phi of
the soil, delta between soil and blade. A blade of width w reaches from the surface to its tip at depth d. P
is the force on the blade, at the angle delta to its normal. Vertical forces are positive downward: such a
force pulls the blade into the soil.

Sources: A.R. Reece, Proc. Inst. Mech. Eng. 179 (3F) (1964) 16-22; D.R.P. Hettiaratchi, A.R. Reece,
Geotechnique 24 (1974) 289-310; K. Terzaghi, Theoretical Soil Mechanics (1943), chapter 7; J.V. Perumpral,
R.D. Grisso, C.S. Desai, Trans. ASAE 26 (1983) 991-995; R.J. Godwin, G. Spoor, J. Agric. Eng. Res. 22 (1977)
213-228; R.J. Godwin, M.J. O'Dogherty, J. Terramechanics 44 (2007) 3-14; ASABE D497.7 (R2015), table 1.
For McKyes and Ali (1977) see the wedge model (docs/wedge.md).
"""

import argparse
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from subsoil_ros.wedge.failure_wedge import Plate, Strength, lateral_pressure, least_wedge

Values = NDArray[np.float64]

GRAVITY_M_PER_S2 = 9.81

TEXTURES = {"fine": 1.0, "medium": 0.70, "coarse": 0.45}
"""F_i of ASABE D497.7: textures of soil."""

ASABE_RANGE = 0.50
"""Part by which ASABE D497.7 expects single drafts to differ."""


def _within(name: str, value: float, low: float, high: float) -> None:
    if not low <= value < high:
        raise ValueError(f"{name}: {value:g} is outside {low:g} (included) to {high:g}; give a value inside")


@dataclass(frozen=True)
class Soil:
    """A Mohr-Coulomb soil against a blade. ValueError for a value that no soil has."""

    cohesion_pa: float
    friction_rad: float
    density_kg_per_m3: float
    delta_rad: float = 0.0
    adhesion_pa: float = 0.0
    surcharge_pa: float = 0.0

    def __post_init__(self) -> None:
        for name in ("friction_rad", "delta_rad"):
            _within(name, getattr(self, name), 0.0, 0.5 * math.pi)
        for name in ("cohesion_pa", "density_kg_per_m3", "adhesion_pa", "surcharge_pa"):
            _within(name, getattr(self, name), 0.0, math.inf)

    @property
    def unit_weight(self) -> float:
        """gamma [N/m3]."""
        return self.density_kg_per_m3 * GRAVITY_M_PER_S2

    @property
    def strength(self) -> Strength:
        """The same for the functions of the wedge model."""
        return Strength(
            self.unit_weight, self.density_kg_per_m3, self.cohesion_pa, self.friction_rad,
            self.adhesion_pa, self.delta_rad, self.surcharge_pa, 1.0,
        )  # fmt: skip


@dataclass(frozen=True)
class Blade:
    """A flat blade that stands out of the surface. ValueError for a value that no blade has."""

    width_m: float
    depth_m: float
    rake_rad: float
    speed_m_per_s: float = 0.0

    def __post_init__(self) -> None:
        for name in ("width_m", "depth_m"):
            _within(name, getattr(self, name), 1e-6, math.inf)
        _within("rake_rad", self.rake_rad, 1e-3, math.pi)
        _within("speed_m_per_s", self.speed_m_per_s, 0.0, math.inf)


class Force(NamedTuple):
    """What a theory gives of a blade."""

    draft_newton: float
    vertical_newton: float  # on the blade, positive downward
    rupture_m: float  # along the surface, from the blade to where the failure surface comes out
    beta_rad: float  # of the failure surface at the tip


class Factors(NamedTuple):
    """P / w = gamma d^2 N_g + c d N_c + c_a d N_ca + q d N_q (+ rho v^2 d N_a)."""

    weight: Values
    cohesion: Values
    adhesion: Values
    surcharge: Values
    inertia: Values | float = 0.0

    def pressure(self, soil: Soil, blade: Blade) -> Values:
        """P / w [N/m] without inertia."""
        d = blade.depth_m
        static = soil.unit_weight * d * self.weight + soil.cohesion_pa * self.cohesion
        static += soil.adhesion_pa * self.adhesion + soil.surcharge_pa * self.surcharge
        return d * static


def _least(function: Callable[[Values], Values], low: float, high: float) -> float:
    """x in [low, high] of the least of function(x (n,)): a grid, narrowed to the neighbours of its best."""
    best = low
    for _ in range(6):  # 20 times narrower each
        x = np.linspace(low, high, 41)
        at = int(np.argmin(function(x)))
        best, low, high = float(x[at]), float(x[max(at - 1, 0)]), float(x[min(at + 1, 40)])
    return best


def plane_factors(soil: Soil, rake_rad: float, beta: Values) -> Factors:
    """Factors of the plane wedge at beta [rad], (n,).

    Equilibrium at right angles to the reaction of the plane, per width: P sin(alpha + beta + phi + delta)
    = W sin(beta + phi) + c d cos phi / sin beta - c_a d cos(alpha + beta + phi) / sin alpha
    + rho v^2 d cos phi sin alpha / sin(alpha + beta), the last the momentum given to the soil.
    """
    phi, total = soil.friction_rad, rake_rad + beta + soil.friction_rad + soil.delta_rad
    d_factor = np.sin(total) / np.sin(beta + phi)
    length = 1.0 / math.tan(rake_rad) + 1.0 / np.tan(beta)
    return Factors(
        weight=0.5 * length / d_factor,
        cohesion=(1.0 + 1.0 / (np.tan(beta) * np.tan(beta + phi))) / d_factor,
        adhesion=-np.cos(rake_rad + beta + phi) / (math.sin(rake_rad) * np.sin(total)),
        surcharge=length / d_factor,
        inertia=math.sin(rake_rad) * math.cos(phi) / (np.sin(rake_rad + beta) * np.sin(total)),
    )


def _least_beta(soil: Soil, blade: Blade, force: Callable[[Values], Values]) -> float:
    """beta [rad] of the least force(beta). ValueError where no wedge can be pushed up at any beta."""
    angles = (blade.rake_rad, soil.friction_rad, soil.delta_rad)
    last = math.pi - sum(angles)
    if last <= 1e-3:
        degrees = " + ".join(f"{math.degrees(angle):g}" for angle in angles)
        raise ValueError(
            f"rake + friction + delta: {degrees} degrees leave no passive wedge; "
            "their sum must be below 180. Take a lower rake, or less friction"
        )
    return _least(force, 1e-4 * last, (1.0 - 1e-9) * last)


def _plane_beta(soil: Soil, blade: Blade) -> float:
    return _least_beta(
        soil, blade, lambda beta: plane_factors(soil, blade.rake_rad, beta).pressure(soil, blade)
    )


def _force(soil: Soil, blade: Blade, p_newton: float, beta: float, rupture_m: float) -> Force:
    """H and V of P and of the adhesion along the blade."""
    at = blade.rake_rad + soil.delta_rad
    adhesion = soil.adhesion_pa * blade.width_m * blade.depth_m
    draft = p_newton * math.sin(at) + adhesion / math.tan(blade.rake_rad)
    return Force(draft, p_newton * math.cos(at) - adhesion, rupture_m, beta)


def _plane_rupture(blade: Blade, beta: float) -> float:
    return blade.depth_m * (1.0 / math.tan(blade.rake_rad) + 1.0 / math.tan(beta))


def reece(soil: Soil, blade: Blade) -> Force:
    """The plane wedge before a wide blade (Reece 1964), at the beta of least force; without inertia."""
    beta = _plane_beta(soil, blade)
    p = blade.width_m * float(plane_factors(soil, blade.rake_rad, np.array(beta)).pressure(soil, blade))
    return _force(soil, blade, p, beta, _plane_rupture(blade, beta))


def spiral_factors(soil: Soil, rake_rad: float, theta: float) -> tuple[Factors, float]:
    """Factors of a log spiral that turns by theta [rad] from the tip, and rupture distance / d.

    Terzaghi's composite surface: the spiral ends on the ray that falls from the blade's top at 45 - phi/2
    degrees; a plane goes on to the surface at that angle, with Rankine's passive state above it. The pole
    lies on the line of the ray, so the reactions of the spiral have no moment about it. Moments of blade,
    spiral and the vertical section at its end balance; P of the weight acts at d / 3 above the tip, P of the
    others at d / 2. As theta goes to 0 the surface becomes the plane. NaN where P cannot turn the soil up.
    """
    down = 0.25 * math.pi - 0.5 * soil.friction_rad
    k_p, cot = 1.0 / math.tan(down) ** 2, 1.0 / math.tan(rake_rad)
    length, ray = 1.0 / math.sin(rake_rad), np.exp(-1j * down)  # points are x + i z, d = 1
    radius = length * math.sin(rake_rad - down) / math.sin(theta)
    top = (radius * math.cos(theta) - length * math.cos(rake_rad - down)) * ray  # all points from the pole
    tip = top + cot - 1j
    turned = np.linspace(0.0, theta, 201)
    arc = radius * ray * np.exp(turned * math.tan(soil.friction_rad) + 1j * (turned - theta))
    end, above = arc[-1], arc[-1].real + 1j * top.imag
    height = above.imag - end.imag

    def moment(point: Any, force: Any) -> Any:
        return (np.conj(point) * force).imag

    outline = np.array([top, *arc, above])
    following = np.roll(outline, -1)
    weight = -np.sum(moment(outline, following) * (outline + following).real) / 6.0
    middle = end + 0.5j * height
    loads = (
        weight + moment(end + 1j * height / 3.0, -0.5 * k_p * height**2),
        -np.sum(moment(arc[:-1], arc[1:])) + moment(middle, -2.0 * math.sqrt(k_p) * height),
        moment(0.5 * (top + tip), cot - 1j),
        moment(0.5 * (top + above), -1j * (above - top).real) + moment(middle, -k_p * height),
    )
    unit = np.exp(1j * (0.5 * math.pi - rake_rad - soil.delta_rad))  # P on the soil
    arms = [moment(tip + part * (top - tip), unit) for part in (1.0 / 3.0, 0.5, 0.5, 0.5)]
    if min(arms) <= 0.0 or above.real <= top.real:
        return Factors(*[np.array(math.nan)] * 4), math.nan
    factors = Factors(*(np.array(-load / arm) for load, arm in zip(loads, arms, strict=True)))
    return factors, float((above - top).real + height / math.tan(down))


def log_spiral(soil: Soil, blade: Blade) -> Force:
    """The least of log spirals, from the plane to the one about the blade's top, and of plane wedges.

    Friction of the blade bends the failure surface below its tip; a smooth or flat blade has the plane.
    """
    plane = reece(soil, blade)
    widest = blade.rake_rad - 0.25 * math.pi + 0.5 * soil.friction_rad
    if widest <= 1e-3:
        return plane

    def pressure(theta: float) -> float:
        value = float(spiral_factors(soil, blade.rake_rad, theta)[0].pressure(soil, blade))
        return value if value > 0.0 else math.inf

    theta = _least(lambda thetas: np.array([pressure(float(theta)) for theta in thetas]), 1e-3, widest)
    rupture_m = blade.depth_m * spiral_factors(soil, blade.rake_rad, theta)[1]
    beta = 0.25 * math.pi - 0.5 * soil.friction_rad - theta
    spiral = _force(soil, blade, blade.width_m * pressure(theta), beta, rupture_m)
    return spiral if spiral.draft_newton < plane.draft_newton else plane


def mckyes_ali(soil: Soil, blade: Blade) -> Force:
    """Crescents beside the wedge (McKyes and Ali 1977), as in the wedge model, with inertia."""
    _plane_beta(soil, blade)  # refuses what has no wedge
    plate = Plate(blade.width_m, blade.rake_rad, blade.depth_m, blade.depth_m)
    beta, p = least_wedge(plate, soil.strength, blade.speed_m_per_s)
    return _force(soil, blade, p, beta, _plane_rupture(blade, beta))


def perumpral(soil: Soil, blade: Blade) -> Force:
    """Strength on the two vertical sides of the plane wedge (Perumpral, Grisso, Desai 1983).

    Each side, A = d^2 (cot alpha + cot beta) / 2, carries c A + (1 - sin phi) gamma (d / 3) A tan phi against
    the motion along the plane. Neither surcharge nor inertia.
    """
    phi, d = soil.friction_rad, blade.depth_m
    rest = (1.0 - math.sin(phi)) * soil.unit_weight * d / 3.0
    unloaded = replace(soil, surcharge_pa=0.0)

    def force(beta: Values) -> Values:
        factors = plane_factors(soil, blade.rake_rad, beta)
        area = 0.5 * d**2 * (1.0 / math.tan(blade.rake_rad) + 1.0 / np.tan(beta))
        sides = 2.0 * area * (soil.cohesion_pa + rest * math.tan(phi)) * math.cos(phi)
        sides /= np.sin(blade.rake_rad + beta + phi + soil.delta_rad)
        return factors.pressure(unloaded, blade) * blade.width_m + sides

    beta = _least_beta(soil, blade, force)
    return _force(soil, blade, float(force(np.array(beta))), beta, _plane_rupture(blade, beta))


def godwin_odogherty(soil: Soil, blade: Blade) -> Force:
    """A narrow tine with crescents of the radius m d (Godwin and O'Dogherty 2007), with inertia.

    Factors at the beta of least force of the plane wedge, N_ca for c standing for c N_c + c_a N_ca; the
    rupture distance ratio m, as their chart of it, from angles alone: the plane wedge of weight. As printed,
    H and V hold no adhesion along the blade.
    """
    d, m = blade.depth_m, _rupture_ratio(soil, blade)
    beta = _plane_beta(soil, blade)
    factors = plane_factors(soil, blade.rake_rad, np.array(beta))
    crescents = float(factors.pressure(soil, blade)) * (blade.width_m + d * (m - (m - 1.0) / 3.0))
    inertia = soil.density_kg_per_m3 * blade.speed_m_per_s**2 * float(factors.inertia) * d
    p = crescents + inertia * (blade.width_m + 0.6 * d)
    at = blade.rake_rad + soil.delta_rad
    return Force(p * math.sin(at), p * math.cos(at), m * d, beta)


def _rupture_ratio(soil: Soil, blade: Blade) -> float:
    beta = _least_beta(soil, blade, lambda beta: plane_factors(soil, blade.rake_rad, beta).weight)
    return _plane_rupture(blade, beta) / blade.depth_m


def godwin_spoor(soil: Soil, blade: Blade) -> tuple[Force, float]:
    """A narrow tine, and its critical depth [m], below which soil goes around it (Godwin and Spoor 1977).

    Above the critical depth Godwin and O'Dogherty's tine; below it c N_c' + (1 - sin phi)(gamma z + q) N_q'
    on the width, horizontally. The critical depth is that of least draft, the tip's where none is less.
    """

    def both(depth: float) -> tuple[Force, float]:
        above = godwin_odogherty(soil, replace(blade, depth_m=depth))
        pressure = lateral_pressure(soil.strength, 0.5 * (depth + blade.depth_m), 0.0)
        below = blade.width_m * (blade.depth_m - depth) * pressure
        return above._replace(draft_newton=above.draft_newton + below), depth

    def drafts(depths: Values) -> Values:
        return np.array([both(float(depth))[0].draft_newton for depth in depths])

    return both(_least(drafts, 0.01 * blade.depth_m, blade.depth_m))


def asabe_newton(depth_m: float, speed_m_per_s: float, texture: str) -> float:
    """Draft of one subsoiler with a narrow point by ASABE D497.7 [N]: F_i (226 + 1.8 S^2) T, S speed [km/h],
    T depth [cm]; single drafts differ from it by up to ASABE_RANGE. texture: a key of TEXTURES.
    """
    return TEXTURES[texture] * (226.0 + 1.8 * (3.6 * speed_m_per_s) ** 2) * 100.0 * depth_m


def table(soil: Soil, blade: Blade) -> str:
    """One Markdown row a theory."""
    tine, critical_m = godwin_spoor(soil, blade)
    theories = {
        "Reece, plane wedge": reece(soil, blade),
        "log spiral": log_spiral(soil, blade),
        "McKyes and Ali": mckyes_ali(soil, blade),
        "Perumpral, Grisso and Desai": perumpral(soil, blade),
        "Godwin and O'Dogherty": godwin_odogherty(soil, blade),
        f"Godwin and Spoor, critical depth {critical_m:.3g} m": tine,
    }
    lines = [
        "| theory | draft N | vertical N, down | rupture distance m | beta deg |",
        "|---|---|---|---|---|",
    ]
    for name, (draft, vertical, rupture, beta) in theories.items():
        lines.append(f"| {name} | {draft:.0f} | {vertical:.0f} | {rupture:.3f} | {math.degrees(beta):.1f} |")
    for texture in TEXTURES:
        draft = asabe_newton(blade.depth_m, blade.speed_m_per_s, texture)
        low, high = (1.0 - ASABE_RANGE) * draft, (1.0 + ASABE_RANGE) * draft
        lines.append(
            f"| ASABE D497.7, subsoiler, {texture} soil | {draft:.0f} ({low:.0f} to {high:.0f}) | | | |"
        )
    return "\n".join(lines)


def main() -> None:
    """Prints the table of a soil and a blade; the defaults are a loam and a blade of 60 mm."""
    parser = argparse.ArgumentParser(prog="python -m validation.blades", description=main.__doc__)
    defaults = {
        "cohesion-kpa": 10.0, "friction-deg": 32.0, "density": 1450.0, "delta-deg": 23.0, "adhesion-kpa": 0.0,
        "width-m": 0.06, "depth-m": 0.30, "rake-deg": 45.0, "speed": 0.5,
    }  # fmt: skip
    for name, value in defaults.items():
        parser.add_argument(f"--{name}", type=float, default=value, help="default: %(default)s")
    args = parser.parse_args()
    try:
        soil = Soil(
            1e3 * args.cohesion_kpa, math.radians(args.friction_deg), args.density,
            math.radians(args.delta_deg), 1e3 * args.adhesion_kpa,
        )  # fmt: skip
        blade = Blade(args.width_m, args.depth_m, math.radians(args.rake_deg), args.speed)
        print(table(soil, blade))
    except ValueError as error:
        parser.error(str(error))


if __name__ == "__main__":
    main()
