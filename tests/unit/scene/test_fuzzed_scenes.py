"""Random changes and names in scenes: each can be run, or is refused with one message."""

import re
from typing import Any

import pytest

from dev import fuzz_names, fuzz_scenes
from dev.fuzz import run
from subsoil_ros import check
from subsoil_ros.errors import SceneError


@pytest.mark.full
def test_a_changed_scene_passes_or_is_refused() -> None:
    """The same cases in every run; `make fuzz` draws 20,000. Both ends are met often."""
    assert min(run(fuzz_scenes, 100).values()) > 5


def test_odd_names_are_refused_or_can_be_used_everywhere() -> None:
    """Tools, groups, bodies, joints, springs, scenes and files; some of the accepted ones run."""
    found = run(fuzz_names, 100)
    assert min(found["runs"], found["refused"]) > 20


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"duration_s": 1e300}, "duration_s: given 1e+300; it must be a number at most 2.14748e+09"),
        (
            {"gravity_m_per_s2": 1e-300},
            "gravity_m_per_s2: given 1e-300; it must be 0 or a magnitude from 1e-30",
        ),
        ({"soil.particles.density_kg_per_m3": 1e200}, "density_kg_per_m3: given 1e+200; it must be 0 or a"),
        ({"soil.law.particle.damping_newton_s_per_m": 1e29}, "is below the clock's resolution of 1 ns"),
        ({"coupling.communication_step_ns": 10**15}, "would take more than 1,000,000 soil steps of"),
        ({"coupling.communication_step_ns": 10**40}, "communication_step_ns: given 1000000"),
        ({"soil.bin.length_m": 1e4}, "particles of radius 0.01 m, allowed are 100,000,000"),
        ({"soil.bed.kind": {"kind": 1}}, "soil.bed.kind: given the mapping {kind: 1}, allowed are grid"),
    ],
    ids=lambda value: next(iter(value)) if isinstance(value, dict) else "",
)
def test_numbers_out_of_reach_are_refused(changes: dict[str, Any], words: str) -> None:
    """What no run could be computed with, or no machine could hold, is refused where it stands."""
    with pytest.raises(SceneError, match=re.escape(words)):
        check("tine", changes)


def test_a_window_of_a_depth_out_of_reach_is_refused() -> None:
    """The length that a window has by default is not computed from it."""
    with pytest.raises(SceneError, match=re.escape("soil.bin.depth_m: given 1.7e+308; it must be 0 or a")):
        check("field_tine", {"soil.bin.depth_m": 1.7e308})
