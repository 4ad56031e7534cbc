"""Units in names: of scene keys, columns and message fields.

Editors are told them by the scene's schema, and reference values in another unit are refused
(loading/reference.py). That a name has the unit of its quantity is tested: tests/system/test_units.py, for
messages tests/unit/repository/test_contracts.py. Keys in radians or kg/m3 whose values look like other units
are warned of by api/plausible.py.
"""

import re

UNITS = {
    "newton_m_s_per_rad": "N m s/rad",
    "newton_m_per_rad": "N m/rad",
    "newton_s_per_m": "N s/m",
    "joule_per_m3": "J/m3",
    "joule_per_m2": "J/m2",
    "joule_per_m": "J/m",
    "newton_per_m3": "N/m3",
    "newton_per_m": "N/m",
    "newton_m": "N m",
    "newton": "N",
    "kg_per_m3": "kg/m3",
    "kg_m2": "kg m2",
    "m_per_s2": "m/s2",
    "m_per_s": "m/s",
    "s_per_m": "s/m",
    "rad_per_s": "rad/s",
    "per_kg": "1/kg",
    "per_s": "1/s",
    "joule": "J",
    "watt": "W",
    "rad": "rad",
    "deg": "degrees",
    "kg": "kg",
    "m2": "m2",
    "hz": "Hz",
    "pa": "Pa",
    "ns": "ns",
    "m": "m",
    "s": "s",
}
"""Endings of keys and their units, the longer ones before those they end in."""


def unit_of(key: str) -> str:
    """The unit that a key ends in; empty if it names none."""
    return next((unit for ending, unit in UNITS.items() if key.endswith(f"_{ending}")), "")


def unit_of_path(path: str) -> str:
    """The unit of the last of the keys, joined by dots, that names one; empty if none does."""
    return next((unit for key in reversed(path.split(".")) if (unit := unit_of(key))), "")


def words_of(column: str) -> str:
    """A column in words, its unit in brackets: "draft [N]" for draft_newton."""
    ending = next((ending for ending in UNITS if column.endswith(f"_{ending}")), None)
    if ending is None:
        return re.sub("[._]", " ", column)
    return f"{re.sub('[._]', ' ', column.removesuffix(f'_{ending}'))} [{UNITS[ending]}]"
