"""Which tests touch which lines: `python -m dev.touched FOLDER [arguments of pytest]`.

Runs the tests under coverage, in their processes and in those they start, each line with the tests that
execute it. FOLDER gets `coverage` (read it with coverage.py) and `seconds.json` (duration and outcome of each
test). Prints the covered share of lines by folder of the package (tests/README.md). Compiled kernels are
invisible to coverage, so their functions are left out. Lines executed at import belong to no test.
"""

import argparse
import ast
import json
import os
import subprocess
import sys
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import coverage
import pytest

ROOT = Path(__file__).resolve().parents[1]
SETTINGS = """[run]
source_pkgs = subsoil_ros
parallel = true
sigterm = true
disable_warnings = no-data-collected, module-not-measured, module-not-imported
context = ${TOUCHED_TEST-}
data_file = ${TOUCHED_FOLDER}/parts/coverage
"""
COMPILED = ("kernel", "njit", "jit", "jitable")
"""What the name of a decorator ends in whose function is compiled; `cuda.jit` and `law_kernel` among them."""


def test_name(nodeid: str) -> str:
    """A test without its parameters: lines are kept by function."""
    return nodeid.partition("[")[0]


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[None]:
    """Lines from here on, also of processes that the test starts, are touched by it."""
    name = test_name(item.nodeid)
    os.environ["TOUCHED_TEST"] = name
    if current := coverage.Coverage.current():
        current.switch_context(name)
    return (yield)


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Append duration and outcome of a phase; the controller hears of every worker's."""
    if "PYTEST_XDIST_WORKER" in os.environ:
        return
    with (Path(os.environ["TOUCHED_FOLDER"]) / "phases.jsonl").open("a") as stream:
        stream.write(json.dumps([report.nodeid, report.duration, report.outcome]) + "\n")


def compiled_lines(file: Path) -> set[int]:
    """Lines of the functions of a file that numba compiles: decorated, or in a module named kernel."""
    lines: set[int] = set()
    for node in ast.walk(ast.parse(file.read_text())):
        compiled = file.name == "kernel.py" or any(map(compiles, getattr(node, "decorator_list", ())))
        if isinstance(node, ast.FunctionDef) and compiled:
            lines.update(range(node.body[0].lineno, (node.end_lineno or 0) + 1))
    return lines


def compiles(decorator: ast.expr) -> bool:
    """Whether a decorator hands its function to numba."""
    called = decorator.func if isinstance(decorator, ast.Call) else decorator
    return ast.unparse(called).endswith(COMPILED)


def by_folder(data: Path) -> dict[str, tuple[int, int]]:
    """Covered and all executable lines of each folder of the package."""
    measured = coverage.Coverage(data_file=str(data), config_file=False)
    measured.load()
    found: dict[str, list[int]] = defaultdict(lambda: [0, 0])
    for file in sorted((ROOT / "subsoil_ros").rglob("*.py")):
        hidden = compiled_lines(file)
        _, lines, _, missing, _ = measured.analysis2(str(file))
        seen = set(lines) - hidden
        folder = file.parent.relative_to(ROOT).as_posix()
        found[folder][0] += len(seen - set(missing))
        found[folder][1] += len(seen)
    return {folder: (covered, count) for folder, (covered, count) in found.items() if count}


def durations(folder: Path) -> dict[str, dict[str, Any]]:
    """Seconds and worst outcome of each test, its parameters added up."""
    found: dict[str, dict[str, Any]] = {}
    for line in (folder / "phases.jsonl").read_text().splitlines():
        nodeid, seconds, outcome = json.loads(line)
        test = found.setdefault(test_name(nodeid), {"seconds": 0.0, "outcome": "passed"})
        test["seconds"] += seconds
        if outcome != "passed" and test["outcome"] != "failed":
            test["outcome"] = outcome
    return found


def main() -> int:
    """Exit status of pytest."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("folder", type=Path, help="new folder for the results")
    given, of_pytest = parser.parse_known_args()
    folder = given.folder.resolve()
    (folder / "parts").mkdir(parents=True)
    settings = folder / "coverage.ini"
    settings.write_text(SETTINGS)
    start = folder / "start"  # on PYTHONPATH: starts coverage in every process
    start.mkdir()
    (start / "sitecustomize.py").write_text("import coverage\n\ncoverage.process_startup()\n")
    path = os.pathsep.join(filter(None, (str(start), str(ROOT), os.environ.get("PYTHONPATH"))))
    environment = os.environ | {
        "TOUCHED_FOLDER": str(folder), "COVERAGE_PROCESS_START": str(settings), "PYTHONPATH": path,
    }  # fmt: skip
    command = [sys.executable, "-m", "pytest", "-p", "dev.touched", *of_pytest]
    status = subprocess.run(command, cwd=ROOT, env=environment).returncode
    together = coverage.Coverage(data_file=str(folder / "coverage"), config_file=False)
    together.combine([str(folder / "parts")], keep=True)
    together.save()
    (folder / "seconds.json").write_text(json.dumps(durations(folder), indent=0))
    for name, (covered, count) in by_folder(folder / "coverage").items():
        print(f"{name:45} {covered:6d} of {count:6d} lines {100 * covered / count:6.1f} %")
    return status


if __name__ == "__main__":
    sys.exit(main())
