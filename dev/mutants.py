"""Judge the tests by mutants: changes of one line that some test should notice.

    python -m dev.touched build/touched -n 2 --dist loadfile       which tests touch which lines
    python -m dev.mutants sample --seed 1 --count 80               writes dev/mutants.csv
    python -m dev.mutants run build/touched COLUMN [--jobs 2]      adds COLUMN to dev/mutants.csv

A mutant is made in a copy of the working tree. The tests that touch its line run, cheap ones first, until one
fails (`killed`), or none does (`survived`), or SECONDS of the tests' own time are spent (`survived`, with the
tests that were left). A line of a compiled kernel is touched by the tests that KERNEL_TESTS names for its
file; one that is executed at import, by the tests that touch its file. A mutant whose line is no longer there
is `gone`. In the end the share of those that were killed in the first column and are in the last is printed.
"""

import argparse
import ast
import csv
import json
import os
import random
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from queue import SimpleQueue
from typing import NamedTuple

import coverage

from .touched import ROOT, compiled_lines, test_name

LIST = Path(__file__).with_suffix(".csv")
PACKAGE = ROOT / "subsoil_ros"
UNTESTED = ("@", "import", "from", "print(", "_log", "raise", 'f"', '"', "'")
"""How a line begins that no test need tell apart: a word of a message, a decorator."""

KERNEL_SHARE = 0.25
SECONDS = 120.0
"""Time of the tests that a mutant may cost at most, as they took when they were measured."""

LIMIT = 600.0
"""Wall time [s] after which a run counts as hung, and the mutant as killed."""

COMPARISONS = {
    ast.Lt: "<=", ast.LtE: "<", ast.Gt: ">=", ast.GtE: ">", ast.Eq: "!=", ast.NotEq: "==",
    ast.Is: "is not", ast.IsNot: "is", ast.In: "not in", ast.NotIn: "in",
}  # fmt: skip
OPERATIONS = {ast.Add: "-", ast.Sub: "+", ast.Mult: "/", ast.Div: "*", ast.FloorDiv: "*", ast.Mod: "*"}

_V = "tests/physics/test_"
KERNEL_TESTS: dict[str, tuple[str, ...]] = {
    f"subsoil_ros/{place}": tuple(f"{_V}{name}.py" for name in names.split())
    for place, names in {
        "contact_laws": "dem_roots dem_laws dem_closed_forms dem_contact dem_reference dem_chung_ooi",
        "contact_laws/cohesive_linear": "dem_laws dem_closed_forms dem_contact dem_reference",
        "contact_laws/elasto_plastic_adhesive": "dem_elasto_plastic dem_laws",
        "contact_laws/hertz": "dem_chung_ooi dem_laws dem_contact",
        "dem": "dem_closed_forms dem_contact dem_neighbours dem_reference dem_conservation dem_particles",
        "dem/bonds": "dem_bonds",
        "dem/monitors.py": "dem_monitors dem_closed_forms balances",
        "dem/neighbours.py": "dem_neighbours dem_particles dem_reference dem_periodic dem_sizes",
        "dem/tools": "dem_tools spatial_tools free_tools dem_reference",
        "mbd": "mbd_minimal mbd_joints mbd_motion mbd_steps mbd_orders mbd_benchmarks mbd_machine",
        "mbd/forces": "mbd_forces mbd_parts mbd_motion mbd_machine mbd_sticking mbd_benchmarks",
        "mbd/joints": "mbd_joints mbd_minimal mbd_motion mbd_crank mbd_benchmarks mbd_orders",
        "wedge": "wedge_formulas wedge_engine wedge_yaw wedge_fluctuation",
    }.items()
} | {"subsoil_ros/dem/gpu": ("tests/physics/gpu/test_gpu_engine.py",)}
"""Tests of the kernels in a file or folder of the package, the most telling first."""


class Mutant(NamedTuple):
    """One changed line."""

    file: str  # below the root
    line: int  # where it was
    old: str  # without indentation
    new: str
    kernel: bool


def candidates(file: Path) -> Iterator[Mutant]:
    """All mutants of a file, one for each place that can change."""
    text = file.read_text()
    lines, hidden = text.splitlines(), compiled_lines(file)
    for node in ast.walk(ast.parse(text)):
        for number, start, end, new in changes(node, lines):
            if annotated(lines[number - 1], start):
                continue
            old = lines[number - 1]
            changed = old.encode()[:start] + new.encode() + old.encode()[end:]
            name = file.relative_to(ROOT).as_posix()
            yield Mutant(name, number, old.strip(), changed.decode().strip(), number in hidden)


def changes(node: ast.AST, lines: Sequence[str]) -> Iterator[tuple[int, int, int, str]]:
    """Line, first and last byte column, and new text of the changes of one node, on one line."""
    if isinstance(node, ast.Compare) and len(node.ops) == 1:
        yield from between(node.left, node.comparators[0], COMPARISONS.get(type(node.ops[0])))
    elif isinstance(node, ast.BinOp) and not isinstance(node.left, ast.Constant | ast.JoinedStr):
        yield from between(node.left, node.right, OPERATIONS.get(type(node.op)))
    elif isinstance(node, ast.BoolOp) and len(node.values) == 2:
        yield from between(*node.values, "or" if isinstance(node.op, ast.And) else "and")
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not | ast.USub):
        if node.lineno == node.operand.lineno:
            yield node.lineno, node.col_offset, node.operand.col_offset, ""
    elif isinstance(node, ast.Constant) and type(node.value) in (int, float):
        new = repr(node.value + 1 if isinstance(node.value, int) else 1.1 * node.value or 0.1)
        yield node.lineno, node.col_offset, node.end_col_offset or 0, new
    elif isinstance(node, ast.Expr) and isinstance(node.value, ast.Call) and node.lineno == node.end_lineno:
        yield node.lineno, node.col_offset, node.end_col_offset or 0, "pass"
    elif isinstance(node, ast.If | ast.While) and node.test.lineno == node.test.end_lineno:
        test, end = node.test, node.test.end_col_offset or 0
        text = lines[test.lineno - 1].encode()[test.col_offset : end].decode()
        yield test.lineno, test.col_offset, end, f"not ({text})"


def between(left: ast.expr, right: ast.expr, new: str | None) -> Iterator[tuple[int, int, int, str]]:
    """The operator between two operands, with the brackets about it left to the syntax check."""
    if new is not None and left.end_lineno == right.lineno:
        yield right.lineno, left.end_col_offset or 0, right.col_offset, f" {new} "


def annotated(line: str, start: int) -> bool:
    """Whether the place is in a type, a log line or a print, which no test need tell apart."""
    text = line.strip()
    before = line[:start]
    typed = " -> " in before or (" | " in before and ": " in before) or "Field(" in text
    return typed or "logger" in text or text.startswith(UNTESTED)


def sample(seed: int, count: int, left_out: Sequence[str]) -> list[Mutant]:
    """`count` mutants, a quarter in kernels, the rest over all folders, by the root of their lines."""
    draw = random.Random(seed)
    folders: dict[tuple[bool, str], list[Mutant]] = {}
    for file in sorted(PACKAGE.rglob("*.py")):
        if any(file.relative_to(PACKAGE).as_posix().startswith(one) for one in left_out):
            continue
        for mutant in candidates(file):
            folders.setdefault((mutant.kernel, Path(mutant.file).parent.as_posix()), []).append(mutant)
    found: list[Mutant] = []
    kernels = round(KERNEL_SHARE * count)
    for kernel, wanted in ((False, count - kernels), (True, kernels)):
        places = [place for place in folders if place[0] == kernel]
        weights = [len(folders[place]) ** 0.5 for place in places]
        chosen = draw.sample(places, min(wanted, len(places)))
        chosen += draw.choices(places, weights, k=wanted - len(chosen))
        for place in chosen:
            taken = {(one.file, one.line) for one in found}
            free = [one for one in folders[place] if (one.file, one.line) not in taken]
            found.append(next(one for one in draw.sample(free, len(free)) if valid(one)))
    return sorted(found)


def valid(mutant: Mutant) -> bool:
    """Whether the changed file can be compiled."""
    try:
        compile(changed(ROOT, mutant), mutant.file, "exec")
    except (SyntaxError, ValueError):
        return False
    return True


def changed(root: Path, mutant: Mutant) -> str:
    """Text of the file with the mutant. ValueError if the line is gone."""
    lines = (root / mutant.file).read_text().splitlines()
    places = [number for number, line in enumerate(lines, 1) if line.strip() == mutant.old]
    if not places:
        raise ValueError(f"{mutant.file}: no line '{mutant.old}'")
    number = min(places, key=lambda place: abs(place - mutant.line))
    line = lines[number - 1]
    lines[number - 1] = line[: len(line) - len(line.lstrip())] + mutant.new
    return "\n".join(lines) + "\n"


class Touched:
    """What dev.touched measured."""

    def __init__(self, folder: Path) -> None:
        self._data = coverage.CoverageData(str(folder / "coverage"))
        self._data.read()
        self._tests = json.loads((folder / "seconds.json").read_text())
        self._files = {Path(file).relative_to(self._root()).as_posix(): file for file in self._measured()}

    def _measured(self) -> set[str]:
        return {file for file in self._data.measured_files() if "/subsoil_ros/" in file}

    def _root(self) -> Path:
        return next(path for path in Path(min(self._measured())).parents if (path / "package.xml").exists())

    def tests(self, mutant: Mutant) -> list[str]:
        """Tests that passed and touch the mutant, cheap ones first; those of a kernel in their order."""
        if mutant.kernel:
            names = max((key for key in KERNEL_TESTS if mutant.file.startswith(key)), key=len)
            found = [test for name in KERNEL_TESTS[names] for test in self._of_file(name)]
        else:
            by_line = self._data.contexts_by_lineno(self._files.get(mutant.file, mutant.file))
            found = [name.rpartition("|")[2] for name in by_line.get(mutant.line, ()) if name]
            if not found:
                found = [name.rpartition("|")[2] for names in by_line.values() for name in names if name]
            found.sort(key=self.seconds)
        return [test for test in dict.fromkeys(found) if self._passed(test)]

    def _of_file(self, name: str) -> list[str]:
        of_file = [test for test in self._tests if test.startswith(name)]
        return sorted(of_file, key=self.seconds)

    def _passed(self, test: str) -> bool:
        return self._tests.get(test, {}).get("outcome") == "passed"

    def seconds(self, test: str) -> float:
        """Duration of a test when it was measured."""
        return float(self._tests.get(test, {}).get("seconds", 0.0))


def judge(mutant: Mutant, tree: Path, touched: Touched) -> str:
    """Result of a mutant in a copy of the working tree."""
    target = tree / mutant.file
    if not target.exists() or mutant.old not in map(str.strip, target.read_text().splitlines()):
        return "gone"
    tests, chosen, spent = touched.tests(mutant), [], 0.0
    for test in tests:
        if chosen and spent + touched.seconds(test) > SECONDS:
            break
        chosen.append(test)
        spent += touched.seconds(test)
    if not chosen:
        return "survived: no test touches it"
    original, remaining = target.read_text(), chosen
    while remaining:
        target.write_text(changed(tree, mutant))
        try:
            failed = first_failure(tree, remaining)
        finally:
            target.write_text(original)
        if not failed:
            break
        if failed not in remaining or not first_failure(tree, [failed]):
            return f"killed by {failed}"
        remaining = remaining[remaining.index(failed) + 1 :]  # it fails without the mutant too
    left = f", {len(tests) - len(chosen)} tests left" if len(tests) > len(chosen) else ""
    return f"survived {len(chosen)} tests{left}"


def first_failure(tree: Path, tests: Sequence[str]) -> str:
    """The test that fails first; none if all pass."""
    path = os.pathsep.join(filter(None, (str(tree), os.environ.get("PYTHONPATH"))))
    command = [
        sys.executable,
        "-m",
        "pytest",
        "-x",
        "-q",
        "-p",
        "no:cacheprovider",
        "--tb=no",
        "-rfE",
        *tests,
    ]
    process = subprocess.Popen(
        command, cwd=tree, env=os.environ | {"PYTHONPATH": path}, stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT, text=True, start_new_session=True,
    )  # fmt: skip
    try:
        out, _ = process.communicate(timeout=LIMIT)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, 9)
        process.communicate()
        return "no end"
    if process.returncode == 0:
        return ""
    named = [line.split()[1] for line in out.splitlines() if line.startswith(("FAILED ", "ERROR "))]
    return test_name(named[0]) if named else f"exit status {process.returncode}"


def copy_of_tree(folder: Path) -> Path:
    """The tracked files as they are now, with links to nothing else."""
    names = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, check=True, capture_output=True).stdout
    for name in filter(None, names.decode().split("\0")):
        if (ROOT / name).is_file():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, folder / name)
    return folder


def read_list() -> list[dict[str, str]]:
    """Rows of the list."""
    with LIST.open(newline="") as stream:
        return list(csv.DictReader(stream))


def write_list(rows: Sequence[dict[str, str]]) -> None:
    """Write the list as a whole."""
    part = LIST.with_suffix(".part")
    with part.open("w", newline="") as stream:
        writer = csv.DictWriter(stream, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    part.replace(LIST)


def run(folder: Path, column: str, jobs: int) -> None:
    """Judge every mutant without a result in the column; each result is written as it comes."""
    rows, touched = read_list(), Touched(folder)
    for row in rows:
        row.setdefault(column, "")
    with tempfile.TemporaryDirectory() as temporary:
        trees: SimpleQueue[Path] = SimpleQueue()
        for number in range(jobs):
            trees.put(copy_of_tree(Path(temporary) / str(number)))

        def one(row: dict[str, str]) -> None:
            tree, start = trees.get(), time.monotonic()
            mutant = Mutant(row["file"], int(row["line"]), row["old"], row["new"], row["kernel"] == "True")
            row[column] = judge(mutant, tree, touched)
            trees.put(tree)
            print(
                f"{time.monotonic() - start:6.0f} s  {mutant.file}:{mutant.line}  {row[column]}", flush=True
            )
            write_list(rows)

        with ThreadPoolExecutor(jobs) as pool:
            todo = [row for row in rows if not row[column]]
            list(pool.map(one, sorted(todo, key=lambda row: row["kernel"])))  # kernels, which are dear, last


def report() -> None:
    """Print the survivors and the share of mutants still killed."""
    rows = read_list()
    columns = list(rows[0])[len(Mutant._fields) :]
    for column in columns:
        killed = sum(row[column].startswith("killed") for row in rows)
        print(
            f"{column}: {killed} killed, {sum(row[column].startswith('survived') for row in rows)} survived"
        )
    first, last = columns[0], columns[-1]
    before = [row for row in rows if row[first].startswith("killed") and row[last] not in ("", "gone")]
    lost = [row for row in before if not row[last].startswith("killed")]
    for row in lost:
        print(f"lost: {row['file']}:{row['line']}: {row['old']} -> {row['new']}: {row[last]}")
    print(f"{len(before) - len(lost)} of {len(before)} that {first} kills are killed in {last}")


def main() -> None:
    """Sample, run, report."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    verbs = parser.add_subparsers(dest="verb", required=True)
    sampling = verbs.add_parser("sample")
    sampling.add_argument("--seed", type=int, required=True)
    sampling.add_argument("--count", type=int, default=80)
    sampling.add_argument("--without", nargs="*", default=[], help="folders or files of the package left out")
    running = verbs.add_parser("run")
    running.add_argument("touched", type=Path)
    running.add_argument("column")
    running.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    verbs.add_parser("report")
    given = parser.parse_args()
    if given.verb == "sample":
        found = sample(given.seed, given.count, given.without)
        write_list([{key: str(value) for key, value in one._asdict().items()} for one in found])
    elif given.verb == "run":
        run(given.touched, given.column, given.jobs)
    if given.verb != "sample":
        report()


if __name__ == "__main__":
    main()
