"""Names of compiled functions: code from the cache finds a function by its name and types."""

import subprocess
import sys

NAMES = """
import gc
from collections import Counter
from importlib import import_module
from pathlib import Path

import subsoil_ros
from numba.core.registry import CPUDispatcher

package = Path(subsoil_ros.__file__).parent
for folder in ("mbd", "dem", "wedge", "terrain", "contact_laws"):
    for path in (package / folder).rglob("*.py"):
        if "gpu" not in path.parts:
            import_module(".".join(path.relative_to(package.parent).with_suffix("").parts))
names = Counter(
    f"{kernel.py_func.__module__}.{kernel.py_func.__qualname__}"
    for kernel in gc.get_objects()
    if type(kernel) is CPUDispatcher and kernel.targetoptions.get("inline") != "always"
)
assert len(names) > 100
print(*(name for name, count in names.items() if count > 1))
"""


def test_no_two_kernels_have_one_name() -> None:
    """But for those that are written into their callers, and so have no code of their own.

    In a process of its own: where kernels were compiled, numba has made variants for types, of one name.
    """
    done = subprocess.run([sys.executable, "-c", NAMES], check=True, capture_output=True, text=True)
    assert done.stdout.split() == []
