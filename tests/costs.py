"""A pytest plugin: what each test file costs, added up over the workers; the ten dearest at the end.

CPU time is that of the tests with their fixtures and of the processes they started and waited for. Of it, the
compilation of kernels is shown apart: kernels from the cache on disk are not compiled and do not count. Of
every soil step that is compiled, the features of its contact law are named.

`--costs FILE` keeps the table; `python -m tests.costs FILE` fails if a file takes more than BUDGET of all.
"""

import json
import os
import sys
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest
from numba import types
from numba.core import event

from .soils import SOILS

STEP = "drift_and_contacts"
"""The kernel of which every soil has its own variant."""

SHOWN = 10

BUDGET = 0.1
"""Largest share of one file in the CPU time of all of `make test`. Shares vary by a half with the load."""


class Costs(event.Listener):
    """CPU seconds, seconds of compilation, kernels and variants of the soil step, by test file."""

    PARTS = ("cpu", "seconds", "kernels", "variants")

    def __init__(self) -> None:
        self.cpu: dict[str, float] = defaultdict(float)
        self.seconds: dict[str, float] = defaultdict(float)
        self.kernels: dict[str, int] = Counter()
        self.variants: dict[str, list[str]] = defaultdict(list)
        self._file, self._depth, self._since = "(collection)", 0, 0.0

    def on_start(self, event: Any) -> None:
        """Handle the start of the compilation of a kernel, or of one that it calls."""
        if self._depth == 0:
            self._since = cpu_s()
        self._depth += 1
        self.kernels[self._file] += 1
        if event.data["dispatcher"].py_func.__name__ == STEP:
            self.variants[self._file].append(variant_of(event.data["args"]))

    def on_end(self, event: Any) -> None:
        """Handle the end of that compilation."""
        self._depth -= 1
        if self._depth == 0:
            self.seconds[self._file] += cpu_s() - self._since

    def add(self, other: dict[str, Any]) -> None:
        """Add what a worker has found."""
        for part in self.PARTS:
            mine = getattr(self, part)
            for file, value in other[part].items():
                mine[file] += value

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
        """Count a test and its fixtures for its file."""
        self._file, start = item.location[0], cpu_s()
        try:
            return (yield)
        finally:
            self.cpu[self._file] += cpu_s() - start

    def pytest_sessionfinish(self, session: pytest.Session) -> None:
        """Hand over what a worker found, or keep the table."""
        event.unregister("numba:compile", self)
        output = getattr(session.config, "workeroutput", None)
        if output is not None:
            output["costs"] = {name: dict(getattr(self, name)) for name in self.PARTS}
        elif path := session.config.getoption("--costs"):
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(json.dumps(self.cpu, indent=1))

    @pytest.hookimpl(optionalhook=True)
    def pytest_testnodedown(self, node: Any) -> None:
        """Add what a worker that ended found; one that crashed left nothing."""
        if found := getattr(node, "workeroutput", {}).get("costs"):
            self.add(found)

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> None:
        """Print the table, dear files first."""
        terminalreporter.section("CPU time of the dearest files, of it compilation, kernels compiled")
        for file in sorted(self.cpu, key=self.cpu.__getitem__, reverse=True)[:SHOWN]:
            compiling = self.seconds.get(file, 0.0)
            terminalreporter.line(
                f"{self.cpu[file]:7.1f} s {compiling:7.1f} s {self.kernels[file]:5d}  {file}"
            )
        for file, variants in self.variants.items():
            for variant in variants:
                terminalreporter.line(f"soil step compiled by {file}: {variant}")
        total, compiling = sum(self.cpu.values()), sum(self.seconds.values())
        terminalreporter.line(f"{total:7.1f} s {compiling:7.1f} s {sum(self.kernels.values()):5d}  in all")


def cpu_s() -> float:
    """CPU time [s] of this process and of those it has waited for."""
    return sum(os.times()[:4])


def over_budget(costs: Mapping[str, float]) -> list[str]:
    """A line for each file that takes more than its share of the CPU time of all."""
    total = sum(costs.values())
    return [
        f"{file}: {seconds:.0f} s of {total:.0f} s of CPU time are {100 * seconds / total:.1f} %, "
        f"allowed are {100 * BUDGET:g} % (tests/costs.py): make it cheaper"
        for file, seconds in costs.items()
        if seconds > BUDGET * total
    ]


def variant_of(signature: Any) -> str:
    """Contact law, its features, and precision, that the types of a soil step's arguments tell."""
    features, law = (next(within(signature, name)) for name in ("Features", "Numbers"))
    present = [law.instance_class.__module__.split(".")[-2]]
    present += [name for name, kind in zip(features.fields, features.types, strict=True) if kind.ndim == 2]
    present += ["mixed precision"] * (law.types[0] == types.float32)
    names = [name for name, (features, _) in SOILS.items() if set(features) == set(present)]
    other = "not in tests/soils.py" if "tangential" in present else "preparation of a bed"
    return f"{', '.join(present)} ({', '.join(names) or other})"


def within(kind: Any, name: str) -> Iterator[Any]:
    """Types of the named tuples whose class has a name that ends so, among nested types of tuples."""
    if getattr(getattr(kind, "instance_class", None), "__name__", "").endswith(name):
        yield kind
    elif isinstance(kind, types.BaseTuple | tuple):
        for part in kind:
            yield from within(part, name)


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add --costs."""
    parser.addoption("--costs", type=Path, help="file for the CPU seconds of each test file")


def pytest_configure(config: pytest.Config) -> None:
    """See compilations from here on."""
    costs = Costs()
    event.register("numba:compile", costs)
    config.pluginmanager.register(costs)


def main() -> int:
    """Exit status: 1 if a file of the kept table is over its budget."""
    path = Path(sys.argv[1])
    if not path.exists():
        print(f"{path}: no costs are kept there, so no budget is compared; `make test` writes them")
        return 0
    lines = over_budget(json.loads(path.read_text()))
    print(*lines, sep="\n", end="\n" * bool(lines))
    return int(bool(lines))


if __name__ == "__main__":
    sys.exit(main())
