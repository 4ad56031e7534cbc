"""dev/same_bits.py: values that were renamed are paired, and whatever is not the same bits is named."""

import numpy as np
import pytest

from dev.same_bits import compare, named_alike

BASE = {
    "soil.spins": np.array([1.0, 2.0]),
    "soil.equilibrium_overlap_m": 0.002,
    "body.count": 3,
    "wall_s": 7.0,
    "zero": [0.0, 1.0],
}
RULES = {"spin": "angular_velocity", "^soil": "bed"}


def test_renamed_values_are_equal() -> None:
    """Rules act one after the other; what is left out needs no partner; a changed type is told apart."""
    here = {
        "bed.angular_velocitys": np.array([1.0, 2.0]),
        "bed.equilibrium_overlap_m": 0.002,
        "body.count": 3.0,
        "zero": [0.0, 1.0],
    }
    assert compare(named_alike(BASE, RULES, ["wall"]), here) == ([], ["body.count: int is now float"])


def test_differences_are_named() -> None:
    """The last bit, the sign of zero, the type of an array, a name without partner."""
    here = {
        "soil.spins": np.array([1.0, 2.0], np.float32),
        "soil.equilibrium_overlap_m": np.nextafter(0.002, 1.0).item(),
        "body.total": 3,
        "wall_s": 7.0,
        "zero": [-0.0, 1.0],
    }
    different, retyped = compare(BASE, here)
    assert different == [
        "body.count: only in BASE",
        "body.total: only in this checkout",
        "soil.equilibrium_overlap_m: 0.002, here 0.0020000000000000005",
        "soil.spins: float64 (2,), here float32 (2,)",
        "zero: 1 of 2 values, the first [0]: 0.0, here -0.0",
    ]
    assert retyped == []


def test_rules_keep_names_apart() -> None:
    """Two names that become one would hide a value."""
    with pytest.raises(ValueError, match="two names become 'a'"):
        named_alike({"a": 1, "b": 1}, {"b": "a"}, [])
