"""The core of a graded bed (scene.coarse): as wide and deep as the tools cut, and the soil they break."""

import math
from collections.abc import Mapping

import numpy as np

from ..errors import SceneError
from ..scene.meshes import ToolMesh
from ..scene.model import Scene
from .soil_at_work import speed_and_depth

REACH_ASIDE = 0.5
"""Width of core beyond the tools' sides, over their depth: the block that a narrow tool breaks out widens by
about its depth to each side at the surface, and so by half of it on average (569 cm2 are loosened by a share
of 60 mm, 0.20 m deep: validation/field.md)."""

DIAMETERS_BELOW = 2.0
"""Depth of the core below the tools, in the coarsest diameters, so that the share touches the core only."""


def tillage_reach_m(scene: Scene, meshes: Mapping[str, ToolMesh]) -> tuple[float, float]:
    """Half width and depth [m] that the tillage tools reach to; depth 0 where none is below the surface."""
    cutting = [name for name, tool in scene.tools.items() if tool.is_tillage]
    half_width = max((float(np.abs(meshes[name].vertices_m[:, 1]).max()) for name in cutting), default=0.0)
    depth = max((speed_and_depth(scene, name, meshes[name])[1] for name in cutting), default=0.0)
    return half_width, depth


def core_m(scene: Scene, meshes: Mapping[str, ToolMesh]) -> dict[str, float]:
    """`beyond_m` and `below_m` of the scene's graded bed [m], those not given from its tillage tools.

    Raises:
        SceneError: no tillage tool is below the surface to take them from, or one reaches out of the core.
    """
    soil = scene.particle_soil
    assert soil is not None
    coarse = soil.particles.coarse
    assert coarse is not None
    half_width, depth = tillage_reach_m(scene, meshes)
    needs = {"beyond_m": half_width, "below_m": depth}
    larger = 2.0 * coarse.times * soil.particles.mean_volume_radius_m
    usual = {"beyond_m": half_width + REACH_ASIDE * depth, "below_m": depth + DIAMETERS_BELOW * larger}
    found = {}
    for key, needed in needs.items():
        given = getattr(coarse, key)
        if given is None and depth <= 0.0:
            raise SceneError(
                f"soil.particles.coarse.{key}: is missing, and no tillage tool is below the surface to take "
                "it from; give it"
            )
        found[key] = given or math.ceil(1e3 * usual[key]) / 1e3
        if found[key] < needed:
            raise SceneError(
                f"soil.particles.coarse.{key}: {found[key]:g} m given, and the tillage tools reach to "
                f"{needed:.4g} m; allowed is no less; without the key it is {usual[key]:.3g} m"
            )
    return found
