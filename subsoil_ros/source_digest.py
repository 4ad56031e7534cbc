"""Digests of the package's sources: they decide which kernels, beds and results in a cache are still valid.

They are taken over the syntax trees without docstrings: comments, docstrings and line breaks do not count.
Parsing them all would take every process seconds, so what is taken from a file is kept beside the kernels.
"""

import ast
import atexit
import contextlib
import functools
import hashlib
import json
import os
import sys
import time
from collections.abc import Iterable
from importlib.metadata import version
from pathlib import Path
from typing import NamedTuple

from .cache_folders import kernel_cache_folder
from .installed_laws import installed_laws, law_sources

PACKAGE = Path(__file__).parent

RESULT_LIBRARIES = ("numba", "numpy", "scipy")
"""Libraries whose versions are part of the digest of results."""

WITHOUT_RESULTS = ("cli", "workbench", "ros", "figures")
"""Folders that no recorded number depends on."""


LAWS = "contact_laws"
"""Folder of the contact laws, whose kernels those of the engines call."""

THEORY = "wedge"
"""Folder of the theory of failing soil, whose kernels those of a terrain call."""

KEPT_AS = f"sources-{sys.version_info.major}.{sys.version_info.minor}.json"
"""File of what was taken from sources; syntax trees differ between versions of Python."""

SETTLED_NS = 1_000_000_000
"""What is read from a file within this time after its last change is not kept: file systems count time in
steps of some milliseconds, so another change could leave the same stamp."""


class Source(NamedTuple):
    """What is taken from a Python file."""

    stamp: list[int]  # that the file on disk must still have
    digest: str  # sha256 hex of its syntax tree without docstrings
    classes: list[str]
    imported: list[str]  # files that it may import from: `from .a import b`, a.py, or b.py in a folder a


def kernel_digest(source: Path, package: Path = PACKAGE) -> str:
    """sha256 hex for the kernels of the file `source`: of it and all that it imports in its own folder.

    Its own folder is that below `package`, with subfolders: a kernel calls only kernels of the same engine,
    those of the theory of wedges, and those of contact laws. Laws are chosen when a kernel is compiled: all
    count that are there, with the sources of laws of other packages.
    The names of all modules and classes of the engine count too: a compiled kernel names the types of its
    arguments.
    """
    engine, laws = package / source.relative_to(package).parts[0], package / LAWS
    followed = (engine, package / THEORY)
    found = {source}
    waiting = [source]
    while waiting:
        imported = _imported(waiting.pop())
        if any(path.is_relative_to(laws) for path in imported):
            found.add(laws)
        new = {path for path in imported if any(map(path.is_relative_to, followed))} - found
        found |= new
        waiting.extend(new)
    types = sorted(f"{file.relative_to(engine)} {source_of(file).classes}" for file in engine.rglob("*.py"))
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
    for kind in installed_laws():
        digest = hashlib.sha256(repr(installed_laws()[kind].value).encode())
        for name, file in sorted(law_sources(kind).items()):
            digest.update(f"{name}\0{source_of(file).digest}\0".encode())
        digests[kind] = digest.hexdigest()
    return digests


def tree_digest(sources: Iterable[Path], package: Path = PACKAGE) -> str:
    """sha256 hex of Python files; a folder stands for all files in it and in its subfolders."""
    files = {file for source in sources for file in (source.rglob("*.py") if source.is_dir() else (source,))}
    digest = hashlib.sha256()
    for name, file in sorted((file.relative_to(package).as_posix(), file) for file in files):
        digest.update(f"{name}\0{source_of(file).digest}\0".encode())
    return digest.hexdigest()


@functools.cache
def source_of(file: Path) -> Source:
    """What is taken from a file, as it was when this process first asked."""
    stat = file.stat()
    stamp = [stat.st_size, stat.st_mtime_ns, stat.st_ctime_ns, stat.st_ino]
    kept = _kept()
    known = kept.get(str(file))
    if known is not None and known.stamp == stamp:
        return known
    found = _read(file, stamp)
    if time.time_ns() - stat.st_ctime_ns > SETTLED_NS:
        kept[str(file)] = found
        _unsaved.add(str(file))
    return found


_unsaved: set[str] = set()
"""Files that this process read itself."""


@functools.cache
def _kept() -> dict[str, Source]:
    atexit.register(_keep)
    try:
        kept = json.loads((kernel_cache_folder() / KEPT_AS).read_text())
        return {file: Source(*values) for file, values in kept.items()}
    except (OSError, ValueError, TypeError, AttributeError):
        return {}  # missing or damaged: all is read anew


def _keep() -> None:
    """Add what this process read; of two that end at once, the last one's is kept."""
    if not _unsaved:
        return
    found = {file: source for file, source in _kept().items() if os.path.exists(file)}
    path = kernel_cache_folder() / KEPT_AS
    part = path.with_name(f"{KEPT_AS}.{os.getpid()}")
    with contextlib.suppress(OSError):
        path.parent.mkdir(parents=True, exist_ok=True)
        part.write_text(json.dumps(found))
        part.replace(path)


def _read(file: Path, stamp: list[int]) -> Source:
    tree = ast.parse(file.read_bytes())
    classes = [node.name for node in tree.body if isinstance(node, ast.ClassDef)]
    imported = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.level:
            place = file.parents[node.level - 1].joinpath(*(node.module.split(".") if node.module else ()))
            for module in (place, *(place / alias.name for alias in node.names)):
                imported |= {str(module.with_suffix(".py")), str(module / "__init__.py")}
        body = getattr(node, "body", None)
        if isinstance(body, list):
            body[:] = [statement for statement in body if not _is_docstring(statement)]
    digest = hashlib.sha256(ast.dump(tree).encode()).hexdigest()
    return Source(stamp, digest, classes, sorted(imported))


def _is_docstring(statement: ast.stmt) -> bool:
    if not isinstance(statement, ast.Expr) or not isinstance(statement.value, ast.Constant):
        return False
    return isinstance(statement.value.value, str)


@functools.cache
def _imported(file: Path) -> frozenset[Path]:
    """Files of the package that `file` imports."""
    return frozenset(path for path in map(Path, source_of(file).imported) if path.is_file())
