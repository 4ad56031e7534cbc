"""Overlap, damping ratio and inertial number of soil while a tool works; warnings out of range."""

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..contact_laws.dampers import restitution_at
from ..rotations import placed_m, quaternion_of
from ..scene.pair_laws import layer_soils, pair_values, particle_mass_kg
from ..scene.scene import Scene
from ..scene.soil import Soil
from ..scene.time_laws import ConstantLaw, Law, RampLaw, TableLaw
from ..scene.tool_mesh import ToolMesh
from ..scene.tools import Path
from .stable_steps import MAX_OVERLAP, step_limits

WORKING_STRESS_PA, UPPER_STRESS_PA = 100e3, 300e3
"""Stress before a share: drafts of 1.2 kN (a loam at 0.2 m) and 3.6 kN on a front of 0.06 m by 0.2 m; at the
first overlaps are bounded by MAX_OVERLAP."""

SHEAR_BAND_DIAMETERS = 10.0
"""Width of a shear band. Source: K.H. Roscoe, Geotechnique 20 (1970) 129-170."""

SOLID_FRACTION = 0.6
"""Solid fraction of the bed above the tip: random beds have 0.55 to 0.64, and only its root matters."""

QUASI_STATIC, COLLISIONAL = 1e-3, 0.1
"""Inertial numbers between which soil flows densely. Source: GDR MiDi, Eur. Phys. J. E 14 (2004) 341-365."""


class Finding(NamedTuple):
    """One number of the soil at work."""

    name: str
    text: str
    warning: str | None = None  # None: in its range


def overlap_under(soil: Soil, stress_pa: float) -> float:
    """Overlap beyond rest, over the radius, of two like particles under stress d^2; soil without layers.

    The force is 1.2 times the mean by Rumpf (solid fraction 0.6, 6.5 contacts); some contacts carry several
    times as much.
    """
    radius = soil.particles.mean_volume_radius_m
    return pair_values(soil)[0].loaded_m(stress_pa * (2.0 * radius) ** 2) / radius


def force_exponent(soil: Soil) -> float:
    """n of a normal force ~ overlap^n, from the overlaps at work: 1 of a linear spring, 1.5 of Hertz."""
    growth = overlap_under(soil, UPPER_STRESS_PA) / overlap_under(soil, WORKING_STRESS_PA)
    return math.log(UPPER_STRESS_PA / WORKING_STRESS_PA) / math.log(growth)


def damping_ratio(soil: Soil) -> float:
    """sqrt(2 n / (n + 1)) C / (2 sqrt(K m)): K, C of the tangent at work, m the reduced mass of a pair.

    y = x^((n + 1) / 2) makes m x'' + c x^((n - 1) / 2) x' + k x^n = 0 a linear oscillator of this ratio.
    """
    n, radius = force_exponent(soil), soil.particles.mean_volume_radius_m
    linear = pair_values(soil)[0].linear_at(overlap_under(soil, WORKING_STRESS_PA) * radius)
    critical = 2.0 * math.sqrt(linear.stiffness * 0.5 * particle_mass_kg(soil))
    return math.sqrt(2.0 * n / (n + 1.0)) * linear.damping / critical


def inertial_number(speed_m_per_s: float, depth_m: float, gravity_m_per_s2: float) -> float:
    """Inertial number of soil that a tool shears, rate d sqrt(rho / p) (GDR MiDi); d and rho cancel.

    rate = speed / (10 d); p = 0.6 rho g depth, the weight on the tip: tool and cohesion press further, so
    this is an upper bound.
    """
    return speed_m_per_s / (SHEAR_BAND_DIAMETERS * math.sqrt(SOLID_FRACTION * gravity_m_per_s2 * depth_m))


def soil_at_work(scene: Scene, meshes: Mapping[str, ToolMesh]) -> tuple[Finding, ...]:
    """Overlap, damping ratio and inertial number, of layers the worst; empty without particles or tools."""
    soil = scene.particle_soil
    if soil is None or not (scene.tools or scene.mechanism):
        return ()
    return _overlap(soil), _damping(soil), _inertia(scene, meshes)


def _overlap(soil: Soil) -> Finding:
    layers = layer_soils(soil)
    overlap, k = max((overlap_under(layer, WORKING_STRESS_PA), k) for k, layer in enumerate(layers))
    upper = f"{100.0 * overlap_under(layers[k], UPPER_STRESS_PA):.3g} % at {UPPER_STRESS_PA * 1e-3:g} kPa"
    text = f"{100.0 * overlap:.3g} % of the radius beyond rest at {WORKING_STRESS_PA * 1e-3:g} kPa, {upper}"
    if round(overlap, 3) <= MAX_OVERLAP:
        return Finding("overlap at work", text)
    factor = (overlap / MAX_OVERLAP) ** force_exponent(layers[k])
    needed = _needed(soil, k, factor, "stiffness_newton_per_m", "youngs_modulus_pa")
    limits = step_limits(soil)
    step_s = min(limit.limit_s / (1.0 if limit.damped else math.sqrt(factor)) for limit in limits)
    binding = f"{limits[0].limit_s * 1e6:.3g} us ({limits[0].cause})"
    falls = f"falls from {binding} to {step_s * 1e6:.3g} us"
    step = f"the stable step {falls if step_s < limits[0].limit_s else f'stays {binding}'}"
    told = f"{needed} or more for {100.0 * MAX_OVERLAP:g} %: contacts overlap by {text}; {step}"
    return Finding("overlap at work", text, told)


def _damping(soil: Soil) -> Finding:
    ratio, k = max((damping_ratio(layer), k) for k, layer in enumerate(layer_soils(soil)))
    text = f"{ratio:.3g} of a pair of particles, restitution {restitution_at(ratio):.2g} of the dashpot alone"
    if round(ratio, 2) <= 1.0:
        return Finding("damping ratio", text)
    needed = _needed(soil, k, 1.0 / ratio, "damping_newton_s_per_m")
    told = f"at a damping ratio of {ratio:.3g}, above 1, draft rises with speed through dashpots"
    return Finding("damping ratio", text, f"{needed} or less, or stiffer contacts: {told}")


def _needed(soil: Soil, k: int, factor: float, *keys: str) -> str:
    """`factor` times what layer k gives for the one of `keys` that its law has."""
    where = f"soil.layers.{k}.law" if soil.layers and soil.layers[k].law else "soil.law"
    row = layer_soils(soil)[k].law.particle
    for key in (key for key in keys if hasattr(row, key)):
        return f"{where}.particle.{key}: given {getattr(row, key):g}, needed {factor * getattr(row, key):.3g}"
    return f"{where}: needed {factor:.3g} times as much"


def _inertia(scene: Scene, meshes: Mapping[str, ToolMesh]) -> Finding:
    found, gravity = [], scene.gravity_m_per_s2
    for name, mesh in meshes.items():
        speed, depth = speed_and_depth(scene, name, mesh)
        if scene.tools[name].is_tillage and min(speed, depth, gravity) > 0.0:
            found.append((inertial_number(speed, depth, gravity), name, speed, depth))
    if not found:
        return Finding(
            "inertial number", "not known: in the scene no tillage tool is below z = 0 and moves on"
        )
    number, name, speed, depth = max(found)
    text = f"{number:.2g} of tool {name}, {speed:g} m/s at {depth:.3g} m"
    if round(number, 3) <= COLLISIONAL:
        regime = "quasi-static" if number < QUASI_STATIC else "dense flow, rate dependent"
        return Finding("inertial number", f"{text}: {regime}")
    told = f"{text}: collisional, draft depends on speed through collisions and the grain"
    slower = f"needed for {COLLISIONAL:g} is {speed * COLLISIONAL / number:.3g} m/s or less"
    return Finding(
        "inertial number", f"{text}: collisional", f"tools.{name}: inertial number {told}; {slower}"
    )


def speed_and_depth(scene: Scene, name: str, mesh: ToolMesh) -> tuple[float, float]:
    """Largest speed along x of the path, or of body, drivers of x and controller [m/s]; depth of the lowest
    vertex where the path starts, or in the reference pose, or at the deepest of given poses [m]."""
    tool, mechanism, controller = scene.tools[name], scene.mechanism, scene.controller
    if tool.path is not None and tool.path.is_spatial:
        return _speed_and_depth_in_space(tool.path, mesh.about_body())
    depth = -lowest_m(scene, name, mesh)[1]
    if tool.path is not None:
        return _largest(tool.path.speed_x_m_per_s), depth
    assert mechanism is not None
    body = mechanism.bodies[tool.body or ""]
    speeds = [abs((body.velocity_m_per_s or (0.0, 0.0))[0])]
    for key, joint in mechanism.joints.items():
        if joint.kind == "driver" and joint.coordinate == "x":
            speeds.append(_largest(joint.speed))
            if controller is not None and controller.driver == key:
                speeds.append(controller.highest_speed)
    return max(speeds), depth


def lowest_m(scene: Scene, name: str, mesh: ToolMesh) -> tuple[float, float]:
    """Place (x, z) [m] of a planar tool's lowest vertex where its path starts, or in the reference pose."""
    tool, turn = scene.tools[name], 0.0
    if tool.path is not None:
        begin, turn = (tool.path.start_x_m, tool.path.start_z_m), tool.path.start_angle_rad
    else:
        assert scene.mechanism is not None
        begin = scene.mechanism.bodies[tool.body or ""].position_m
    x, z = mesh.vertices_m[:, [0, 2]].T
    heights = math.sin(turn) * x + math.cos(turn) * z
    k = int(np.argmin(heights))
    return float(begin[0] + math.cos(turn) * x[k] - math.sin(turn) * z[k]), float(begin[1] + heights[k])


def _speed_and_depth_in_space(path: Path, mesh: ToolMesh) -> tuple[float, float]:
    """The same for a path in space; for given poses, at the fastest and the deepest of them."""
    depth, poses = -float(deepest_vertices_m(path, mesh)[:, 2].min()), path.poses
    if poses is None:
        return _largest(path.speed_x_m_per_s), depth
    from scipy.interpolate import CubicSpline  # slow to import, and rarely used

    speeds = CubicSpline(poses.times_s, poses.positions_m)(poses.times_s, 1)
    return float(np.abs(speeds[:, 0]).max()), depth


def deepest_vertices_m(path: Path, mesh: ToolMesh) -> NDArray[np.float64]:
    """Vertices (n, 3) [m] of a tool, their y measured from its path: in world axes where the path starts, and
    for given poses at the deepest of them."""
    if path.poses is None:
        return placed_m(mesh.vertices_m, (0.0, 0.0, path.start_z_m), path.start_quaternion)
    places = zip(path.poses.positions_m, map(quaternion_of, path.poses.rotations_rad), strict=True)
    return min((placed_m(mesh.vertices_m, *place) for place in places), key=lambda found: found[:, 2].min())


def _largest(law: Law | None) -> float:
    """Magnitude of a constant, a ramp's end or a table; 0 of others, which no tool follows for long."""
    if isinstance(law, TableLaw):
        return max(map(abs, law.values))
    if isinstance(law, RampLaw):
        return abs(law.end_value)
    return abs(law.value) if isinstance(law, ConstantLaw) else 0.0
