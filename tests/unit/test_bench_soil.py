"""What `subsoil bench soil` measures, on a bed of some hundred particles. No test looks at a time."""

import dataclasses

import numpy as np
import pytest

from subsoil_ros.dem.beds.prepare import prepare_bed
from subsoil_ros.dem.bench.cases import GRID, cohesive_case, linear_case, stirred_velocities
from subsoil_ros.dem.bench.measure import array_bytes, bed_hash, measure
from subsoil_ros.dem.bench.phases import PHASES, phase_parts
from subsoil_ros.dem.engine import SoilEngine
from subsoil_ros.dem.kernel_calls import KernelCalls
from subsoil_ros.dem.tools.surface import ToolSurface

SIZE_M = (0.3, 0.12, 0.2)


def test_a_stirred_bed_has_its_lists_rebuilt():
    """Random velocities of 0.25 m/s: half the skin, 1 mm, is passed within 50 steps of 0.1 ms (5 mm)."""
    line = measure(linear_case(GRID, SIZE_M, 50, "small"), threads=1, repeats=2)
    assert line.rebuild_count > 0
    assert line.particle_count == len(
        prepare_bed(linear_case(GRID, SIZE_M, 1, "").resolved, None).positions_m
    )
    assert line.contacts_per_particle <= line.listed_pairs_per_particle
    assert line.particle_steps_per_cpu_s_min <= line.particle_steps_per_cpu_s
    assert line.particle_steps_per_cpu_s <= line.particle_steps_per_cpu_s_max


def test_every_phase_takes_time(tmp_path):
    """A kernel that was renamed would show here: no phase is empty, and together they are the whole."""
    case = cohesive_case(GRID, SIZE_M, 300, "small", tmp_path)  # the plate moves 7.5 mm: lists are rebuilt
    parts = phase_parts(case, prepare_bed(case.resolved, SoilEngine))
    assert set(parts) == {*PHASES, "other"}
    assert all(part > 0.0 for part in parts.values())
    assert sum(parts.values()) == pytest.approx(1.0)


def test_clocks_are_taken_off_again(tmp_path):
    """After a profile the engine runs as before."""
    before = (KernelCalls.bind, SoilEngine._rebuild, ToolSurface.forces)
    case = linear_case(GRID, SIZE_M, 1, "small")
    phase_parts(case, prepare_bed(case.resolved, SoilEngine))
    assert (KernelCalls.bind, SoilEngine._rebuild, ToolSurface.forces) == before


def test_bytes_count_an_array_once():
    """Views count as what they are views of; an array that is held twice counts once."""
    whole = np.zeros((100, 3))
    assert array_bytes((whole, {"a": whole[10:], "b": [whole]}, np.zeros(5, np.int32))) == 2400 + 20


def test_the_hash_tells_beds_apart():
    """A position or a wall that differs changes it; the velocities come from a seed."""
    bed = prepare_bed(linear_case(GRID, SIZE_M, 1, "").resolved, SoilEngine)
    moved = dataclasses.replace(bed, positions_m=bed.positions_m + 1e-12)
    walled = dataclasses.replace(bed, upper_m=(bed.upper_m[0] + 1e-12, bed.upper_m[1]))
    assert len({bed_hash(bed), bed_hash(moved), bed_hash(walled)}) == 3
    np.testing.assert_array_equal(stirred_velocities(10), stirred_velocities(10))
