"""Options of a run that every way to start it offers.

A field of RunOptions is --NAME of `subsoil run`, NAME:= of the launch file, a parameter of the nodes'
processes, and a field of RunSettings. No library is imported here: `subsoil run --help` comes at once.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any

from ..errors import InputError


@dataclass(frozen=True)
class Option:
    """What is said of an option, and who takes it."""

    default: bool | int
    description: str
    node: str  # of the protocol, whose process gets it
    limits: tuple[int, int] | None = None  # of a number

    @property
    def allowed(self) -> str:
        """Its values, in words."""
        return f"a whole number from {self.limits[0]} to {self.limits[1]}" if self.limits else "true or false"

    def parsed(self, name: str, text: str) -> bool | int:
        """The value that a text means.

        Raises:
            InputError: it is not allowed.
        """
        if self.limits is None and text.lower() in ("true", "false"):
            return text.lower() == "true"
        if self.limits is not None and text.isdecimal() and self.limits[0] <= int(text) <= self.limits[1]:
            return int(text)
        raise InputError(f"{name}: given '{text}'; it must be {self.allowed}")

    def arguments(self, name: str, value: bool | int) -> list[str]:
        """Arguments of `subsoil run` that give this value."""
        if self.limits is None:
            return [f"--{name}"] if value else []
        return [f"--{name}={value}"]


def _option(default: bool | int, description: str, node: str, limits: tuple[int, int] | None = None) -> Any:
    return field(default=default, metadata={"option": Option(default, description, node, limits)})


@dataclass(frozen=True, kw_only=True)
class RunOptions:
    """The options, by the names that they have everywhere."""

    threads: int = _option(1, "threads of the soil engine; results do not depend on it", "soil", (1, 1024))
    ranks: int = _option(1, "ranks of MPI that compute the soil (soil.engine: lammps)", "soil", (1, 100_000))
    paused: bool = _option(
        False,
        "stand before the first tick until the coupler's services resume or step are called",
        "coupler",
    )


OPTIONS: Mapping[str, Option] = {item.name: item.metadata["option"] for item in fields(RunOptions)}
