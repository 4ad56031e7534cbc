"""Print the shape of the package: `python -m dev.structure [--circles] [--tick]`.

Files and lines, functions with many parameters, files of one name, circles of imports (those inside functions
and for types count too), and how often types are given up. --circles lists the circles. --tick runs a short
scene with the nodes in one process and lists the files, engines apart, whose functions a tick calls.
"""

import argparse
import ast
import contextlib
import io
import re
import tempfile
import threading
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import FrameType
from typing import Any

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "subsoil_ros"
SMALL, MANY, MOST = 60, 10, 12
OFTEN = {"__init__.py", "law.py", "kernel.py"}
"""Names that every folder of a kind may have."""

ENGINES = ("contact_laws", "dem", "mbd", "wedge")
SCENE = "config/scenes/subsoiler_1s300_quick.yaml"
TICKS, TICK_S = 200, 32e-6

Graph = dict[str, set[str]]


def sources() -> dict[str, str]:
    """Text of every file of the package, by its module's dotted name without the package."""
    return {
        ".".join(path.relative_to(PACKAGE).with_suffix("").parts): path.read_text()
        for path in sorted(PACKAGE.rglob("*.py"))
    }


def imports(modules: Mapping[str, str]) -> Graph:
    """Modules that each module imports. A package's own module is `FOLDER.__init__`."""
    graph: Graph = {name: set() for name in modules}
    for name, text in modules.items():
        for node in ast.walk(ast.parse(text)):
            for targets in _targets(name, node):
                known = [one for one in targets for one in (one, f"{one}.__init__") if one in modules]
                graph[name] |= set(known[:1]) - {name}
    return graph


def _targets(name: str, node: ast.AST) -> Iterator[tuple[str, ...]]:
    """Names of each thing that a node imports, as a module, or of the module that it is in."""
    if isinstance(node, ast.Import):
        for alias in node.names:
            if alias.name.startswith("subsoil_ros."):
                yield (alias.name.removeprefix("subsoil_ros."),)
    elif isinstance(node, ast.ImportFrom):
        base = (node.module or "").removeprefix("subsoil_ros.")
        if node.level:
            base = ".".join([*name.split(".")[: -node.level], *filter(None, [node.module])])
        if node.level or (node.module or "").startswith("subsoil_ros."):
            for alias in node.names:
                yield f"{base}.{alias.name}".lstrip("."), base


def circles(graph: Graph) -> list[list[str]]:
    """Groups of nodes that reach each other (Tarjan's strongly connected components of more than one)."""
    index: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []
    found: list[list[str]] = []

    def visit(node: str) -> None:
        index[node] = low[node] = len(index)
        stack.append(node)
        for other in sorted(graph[node]):
            if other not in index:
                visit(other)
                low[node] = min(low[node], low[other])
            elif other in stack:
                low[node] = min(low[node], index[other])
        if low[node] == index[node]:
            group = stack[stack.index(node) :]
            del stack[stack.index(node) :]
            if len(group) > 1:
                found.append(sorted(group))

    for node in graph:
        if node not in index:
            visit(node)
    return found


def rooms(graph: Graph) -> list[Graph]:
    """For every folder, the imports between what it holds: its files, and its folders as a whole."""
    found: dict[str, Graph] = {}
    for name, targets in graph.items():
        parts = name.split(".")
        for depth in range(len(parts)):
            folder, unit = ".".join(parts[:depth]), ".".join(parts[: depth + 1])
            inside = {
                ".".join(target.split(".")[: depth + 1])
                for target in targets
                if not folder or target.startswith(f"{folder}.")
            }
            found.setdefault(folder, {}).setdefault(unit, set()).update(inside - {unit})
    return list(found.values())


def parameters(modules: Mapping[str, str]) -> dict[str, int]:
    """Parameters of every function, by module and name; `self` counts."""
    counts = {}
    for name, text in modules.items():
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.FunctionDef):
                a = node.args
                counts[f"{name}.{node.name}:{node.lineno}"] = len([*a.posonlyargs, *a.args, *a.kwonlyargs])
    return counts


def tick_files() -> list[str]:
    """Files, engines apart, whose functions the nodes' threads call for each further tick of a run."""
    short, long = calls(TICKS), calls(2 * TICKS)
    return sorted(
        file for file, count in long.items() if count - short[file] >= TICKS and not file.startswith(ENGINES)
    )


def calls(ticks: int) -> Counter[str]:
    """Calls of functions in each file of the package during a run with the nodes in one process."""
    from subsoil_ros.cli.main import main as subsoil

    called: Counter[str] = Counter()

    def note(frame: FrameType, event: str, _: Any) -> None:
        if event == "call" and frame.f_code.co_filename.startswith(str(PACKAGE)):
            called[frame.f_code.co_filename.removeprefix(f"{PACKAGE}/")] += 1

    threading.setprofile(note)
    try:
        with tempfile.TemporaryDirectory() as folder:
            words = ["run", str(ROOT / SCENE), "--out", f"{folder}/run", "--mode", "composed"]
            with contextlib.redirect_stdout(io.StringIO()):
                subsoil([*words, "--set", f"duration_s={ticks * TICK_S}"])
    finally:
        threading.setprofile(None)  # type: ignore[arg-type]
    return called


def main() -> None:
    """Print the table, and what is asked besides."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--circles", action="store_true", help="list the circles")
    parser.add_argument("--tick", action="store_true", help="list the files a tick passes; runs a scene")
    args = parser.parse_args()
    modules = sources()
    lines = {name: text.count("\n") for name, text in modules.items()}
    names = Counter(f"{name.rpartition('.')[2]}.py" for name in modules)
    twice = sorted(name for name, count in names.items() if count > 1 and name not in OFTEN)
    many = sorted(((n, name) for name, n in parameters(modules).items() if n >= MANY), reverse=True)
    graph = imports(modules)
    of_files, of_rooms = circles(graph), [one for room in rooms(graph) for one in circles(room)]
    text = "\n".join(modules.values())
    rows = [
        ("files", len(modules)),
        ("lines", sum(lines.values())),
        ("mean lines of a file", round(sum(lines.values()) / len(modules))),
        (f"files under {SMALL} lines", sum(count < SMALL for count in lines.values())),
        ("names that several files have", len(twice)),
        (f"functions with {MANY} or more parameters", len(many)),
        (f"functions with more than {MOST} parameters", sum(n > MOST for n, _ in many)),
        ("most parameters of a function", many[0][0] if many else 0),
        ("circles between files", len(of_files)),
        ("files in a circle", sum(map(len, of_files))),
        ("circles within a folder", len(of_rooms)),
        ("`type: ignore`", len(re.findall(r"# type: ignore", text))),
        ("`Any`", len(re.findall(r"\bAny\b", text))),
    ]
    for title, value in rows:
        print(f"{title:45} {value:6}")
    print("names that several files have:", ", ".join(twice))
    print("most parameters:", *(f"{n} {name}" for n, name in many), sep="\n  ")
    for group in (of_files + of_rooms) * args.circles:
        print("circle:", ", ".join(group))
    if args.tick:
        passed = tick_files()
        print(f"{len(passed)} files of a tick outside the engines:", *passed, sep="\n  ")


if __name__ == "__main__":
    main()
