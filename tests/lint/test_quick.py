"""`make test-quick` covers the package."""

import ast
from pathlib import Path

from ..conftest import is_quick

ROOT = Path(__file__).parents[2]
NOT_QUICK = {"subsoil_ros.dem.gpu"}
"""Folders without a quick test: on a machine without a GPU its kernels are simulated."""


def imported(path: Path) -> set[str]:
    """Names that a file imports, as MODULE.NAME."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {name.name for name in node.names}
        elif isinstance(node, ast.ImportFrom) and not node.level:
            found |= {f"{node.module}.{name.name}" for name in node.names}
    return found


def test_every_folder_of_the_package_is_imported_by_a_quick_test():
    """A file that imports a folder without goes into QUICK of tests/conftest.py."""
    names = set()
    for path in (ROOT / "tests").rglob("test_*.py"):
        names |= imported(path) if is_quick(path) else set()
    folders = {path.parent.relative_to(ROOT) for path in (ROOT / "subsoil_ros").rglob("*.py")}
    modules = {".".join(folder.parts) for folder in folders}
    assert {
        module for module in modules if not any(name.startswith(f"{module}.") for name in names)
    } == NOT_QUICK
