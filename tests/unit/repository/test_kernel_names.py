"""Names of compiled functions: code from the cache finds a function by its name and types."""

import gc
from collections import Counter
from importlib import import_module
from pathlib import Path

from numba.core.registry import CPUDispatcher

PACKAGE = Path(__file__).parents[3] / "subsoil_ros"
FOLDERS = ("mbd", "dem", "wedge", "contact_laws")


def test_no_two_kernels_have_one_name() -> None:
    """But for those that are written into their callers, and so have no code of their own."""
    for folder in FOLDERS:
        for path in (PACKAGE / folder).rglob("*.py"):
            if "gpu" not in path.parts:
                import_module(".".join(path.relative_to(PACKAGE.parent).with_suffix("").parts))
    names = Counter(
        f"{kernel.py_func.__module__}.{kernel.py_func.__qualname__}"
        for kernel in gc.get_objects()
        if type(kernel) is CPUDispatcher
        and kernel.py_func.__module__.startswith("subsoil_ros.")
        and kernel.targetoptions.get("inline") != "always"
    )
    assert len(names) > 100
    assert [name for name, count in names.items() if count > 1] == []
