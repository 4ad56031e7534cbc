"""Digests of the package's sources: they decide which kernels, beds and results in a cache are still valid.

They are taken over the syntax trees without docstrings: comments, docstrings and line breaks do not count.
"""

import ast
import functools
import hashlib
from collections.abc import Iterable
from importlib.metadata import version
from pathlib import Path

from .outside_laws import law_sources, outside_laws

PACKAGE = Path(__file__).parent

RESULT_LIBRARIES = ("numba", "numpy", "scipy")
"""Libraries whose versions are part of the digest of results."""

WITHOUT_RESULTS = ("cli", "ros", "figures", "dem/bench")
"""Folders that no recorded number depends on."""


LAWS = "contact_laws"
"""Folder of the contact laws, whose kernels those of the engines call."""


def kernel_digest(source: Path, package: Path = PACKAGE) -> str:
    """sha256 hex for the kernels of the file `source`: of it and all that it imports in its own folder.

    Its own folder is that below `package`, with subfolders: a kernel calls only kernels of the same engine,
    and those of contact laws. Laws are chosen when a kernel is compiled: all count that are there, with the
    sources of laws of other packages.
    The names of all modules and classes of the engine count too: a compiled kernel names the types of its
    arguments.
    """
    engine, laws = package / source.relative_to(package).parts[0], package / LAWS
    found = {source}
    waiting = [source]
    while waiting:
        imported = _imported(waiting.pop())
        if any(path.is_relative_to(laws) for path in imported):
            found.add(laws)
        new = {path for path in imported if path.is_relative_to(engine)} - found
        found |= new
        waiting.extend(new)
    types = sorted(f"{file.relative_to(engine)} {_classes(file)}" for file in engine.rglob("*.py"))
    outside = law_digests() if laws in found else {}
    return hashlib.sha256(f"{tree_digest(found, package)} {types} {outside}".encode()).hexdigest()


def result_digest(package: Path = PACKAGE) -> str:
    """sha256 hex for all that results depend on: libraries, and the package but for WITHOUT_RESULTS."""
    left_out = tuple(package / folder for folder in WITHOUT_RESULTS)
    sources = (
        path for path in package.rglob("*.py") if not any(path.is_relative_to(one) for one in left_out)
    )
    libraries = " ".join(f"{library} {version(library)}" for library in RESULT_LIBRARIES)
    text = f"{libraries} {tree_digest(sources, package)} {law_digests()}"
    return hashlib.sha256(text.encode()).hexdigest()


def law_digests() -> dict[str, str]:
    """sha256 hex of the sources of each contact law of another package, by its kind."""
    digests = {}
    for kind in outside_laws():
        digest = hashlib.sha256(repr(outside_laws()[kind].value).encode())
        for name, file in sorted(law_sources(kind).items()):
            digest.update(f"{name}\0{_dump(file)}\0".encode())
        digests[kind] = digest.hexdigest()
    return digests


def tree_digest(sources: Iterable[Path], package: Path = PACKAGE) -> str:
    """sha256 hex of Python files; a folder stands for all files in it and in its subfolders."""
    files = {file for source in sources for file in (source.rglob("*.py") if source.is_dir() else (source,))}
    digest = hashlib.sha256()
    for name, file in sorted((file.relative_to(package).as_posix(), file) for file in files):
        digest.update(f"{name}\0{_dump(file)}\0".encode())
    return digest.hexdigest()


@functools.cache
def _tree(file: Path) -> ast.Module:
    return ast.parse(file.read_bytes())


@functools.cache
def _dump(file: Path) -> str:
    """The syntax tree as text, without the strings that stand as statements: docstrings."""
    tree = _tree(file)
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        if isinstance(body, list):
            node.body = [statement for statement in body if not _is_docstring(statement)]  # type: ignore[attr-defined]
    return ast.dump(tree)


def _classes(file: Path) -> list[str]:
    return [node.name for node in _tree(file).body if isinstance(node, ast.ClassDef)]


def _is_docstring(statement: ast.stmt) -> bool:
    if not isinstance(statement, ast.Expr) or not isinstance(statement.value, ast.Constant):
        return False
    return isinstance(statement.value.value, str)


def _imported(file: Path) -> set[Path]:
    """Files of the package that `file` imports: `from .a import b` may mean a.py, or b.py in a folder a."""
    found = set()
    for node in ast.walk(_tree(file)):
        if isinstance(node, ast.ImportFrom) and node.level:
            place = file.parents[node.level - 1].joinpath(*(node.module.split(".") if node.module else ()))
            for module in (place, *(place / alias.name for alias in node.names)):
                found.add(module.with_suffix(".py") if not module.is_dir() else module / "__init__.py")
    return {path for path in found if path.is_file()}
