"""A pytest plugin: what each test file compiled, printed at the end, added up over the workers.

Kernels from the cache on disk are not compiled and do not count, nor do those that a process started
by a test compiles. Of every soil step that is compiled, the features of its contact law are named.
"""

import time
from collections import Counter, defaultdict
from collections.abc import Iterator
from typing import Any

import pytest
from numba import types
from numba.core import event

from .soils import SOILS

STEP = "drift_and_contacts"
"""The kernel of which every soil has its own variant."""


class CompileTimes(event.Listener):
    """CPU seconds of compilation, kernels and variants of the soil step, by test file."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = defaultdict(float)
        self.kernels: dict[str, int] = Counter()
        self.variants: dict[str, list[str]] = defaultdict(list)
        self._file, self._depth, self._since = "(collection)", 0, 0.0

    def on_start(self, event: Any) -> None:
        """A kernel, or one that it calls, is compiled from here."""
        if self._depth == 0:
            self._since = time.process_time()
        self._depth += 1
        self.kernels[self._file] += 1
        if event.data["dispatcher"].py_func.__name__ == STEP:
            self.variants[self._file].append(variant_of(event.data["args"]))

    def on_end(self, event: Any) -> None:
        """To here."""
        self._depth -= 1
        if self._depth == 0:
            self.seconds[self._file] += time.process_time() - self._since

    def add(self, other: dict[str, Any]) -> None:
        """What a worker has found."""
        for file, seconds in other["seconds"].items():
            self.seconds[file] += seconds
            self.kernels[file] += other["kernels"][file]
            self.variants[file] += other["variants"].get(file, [])

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
        """The file whose test and fixtures run."""
        self._file = item.location[0]
        return (yield)

    def pytest_sessionfinish(self, session: pytest.Session) -> None:
        """A worker hands over what it found."""
        event.unregister("numba:compile", self)
        output = getattr(session.config, "workeroutput", None)
        if output is not None:
            output["compile_times"] = {
                name: dict(getattr(self, name)) for name in ("seconds", "kernels", "variants")
            }

    @pytest.hookimpl(optionalhook=True)
    def pytest_testnodedown(self, node: Any) -> None:
        """A worker has ended; one that crashed left nothing."""
        if found := getattr(node, "workeroutput", {}).get("compile_times"):
            self.add(found)

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> None:
        """The table, costly files first."""
        if not self.kernels:
            return
        terminalreporter.section("kernels compiled")
        for file in sorted(self.seconds, key=self.seconds.__getitem__, reverse=True):
            terminalreporter.line(f"{self.seconds[file]:7.1f} s {self.kernels[file]:5d}  {file}")
            for variant in self.variants[file]:
                terminalreporter.line(f"{'':16}soil step: {variant}")
        total, count = sum(self.seconds.values()), sum(self.kernels.values())
        steps = sum(map(len, self.variants.values()))
        terminalreporter.line(f"{total:7.1f} s {count:5d}  in all, {steps} variants of the soil step")


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


def pytest_configure(config: pytest.Config) -> None:
    """From here on compilations are seen."""
    times = CompileTimes()
    event.register("numba:compile", times)
    config.pluginmanager.register(times)
