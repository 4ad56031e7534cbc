"""Contact laws of other packages: found by entry point, so that every process sees them; not imported here.

A package names the class of its law in its metadata, under the law's `kind`:

    [project.entry-points."subsoil_ros.contact_laws"]
    hysteretic = "hysteretic.law:HystereticLaw"
"""

import functools
import importlib.util
import sys
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path

GROUP = "subsoil_ros.contact_laws"


@functools.cache
def installed_laws() -> dict[str, EntryPoint]:
    """Entry point of each law by its kind; of two of one kind, the first on sys.path."""
    found: dict[str, EntryPoint] = {}
    for entry in entry_points(group=GROUP):
        found.setdefault(entry.name, entry)
    return dict(sorted(found.items()))


@functools.cache
def law_sources(kind: str) -> dict[str, Path]:
    """Python files of the package that law `kind` comes in, by their name in it; none if it cannot be found.

    All files of the package count, whether the law's kernels use them or not.
    """
    package = installed_laws()[kind].module.partition(".")[0]
    try:
        spec = sys.modules[package].__spec__ if package in sys.modules else importlib.util.find_spec(package)
    except (ImportError, ValueError):
        return {}
    if spec is None:
        return {}
    folders = [Path(folder) for folder in spec.submodule_search_locations or ()]
    files = {file: folder.parent for folder in folders for file in folder.rglob("*.py")}
    if not folders and spec.origin:
        files = {Path(spec.origin): Path(spec.origin).parent}
    return {file.relative_to(base).as_posix(): file for file, base in files.items()}
