"""setup.cfg, package.xml, requirement lists, lock file, imports and the forge's CI say the same."""

import ast
import configparser
import re
import sys
import xml.etree.ElementTree as ElementTree
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest
from catkin_pkg.package import parse_package
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from ruamel.yaml import YAML

from subsoil_ros.extras import EXTRA_OF

ROOT = Path(__file__).parents[3]
ROSDEP_NAMES = {"yaml": "PyYAML"}
"""Names in rosdep keys, python3-NAME, that are not those of the Python package."""

BROUGHT = {"llvmlite", "pydantic_core"}
"""Modules on which a required package is built: numba, pydantic."""


def requirements(text: str) -> dict[str, Requirement]:
    """Requirements by name, of lines with comments."""
    found = [Requirement(line) for line in text.splitlines() if line and not line.startswith("#")]
    return {canonicalize_name(item.name): item for item in found}


def file_names(name: str) -> set[str]:
    """Packages of a list of requirements/."""
    return set(requirements((ROOT / "requirements" / f"{name}.txt").read_text()))


CONFIG = configparser.ConfigParser()
CONFIG.read(ROOT / "setup.cfg")
PLAIN = requirements(CONFIG["options"]["install_requires"])
EXTRAS = {name: requirements(text) for name, text in CONFIG["options.extras_require"].items()}
LOCK = [
    Requirement(line)
    for line in (ROOT / "requirements" / "lock.txt").read_text().splitlines()
    if line and not line.startswith("#")
]
RUN = PLAIN.keys() | EXTRAS["cad"].keys() | EXTRAS["report"].keys()
"""What `make run` installs beside ROS."""

INSTALLED = RUN.union(*(EXTRAS[extra].keys() for extra in ("live", "render", "study", "workbench")))
"""What `make setup-extras` installs beside ROS."""

MANIFEST = (ROOT / "package.xml").read_text()
EXEC_DEPENDS = [str(node.text) for node in ElementTree.fromstring(MANIFEST).findall("exec_depend")]


def test_lists_are_those_of_the_extras():
    """`make run` installs a plain installation with two extras; each further list adds its own."""
    python = {name for name in file_names("run") if not name.startswith("ros-")}
    assert python == RUN | {"setuptools"}  # the editable install
    assert file_names("extras") == INSTALLED - RUN
    tools = {name for name in file_names("test") if not name.startswith("colcon-")}
    assert tools | file_names("check") == EXTRAS["dev"].keys()
    assert file_names("docs") == EXTRAS["docs"].keys()


def test_lists_need_no_other_list_twice():
    """A package stands in one list only."""
    lists = ("run", "build", "extras", "test", "check", "docs")
    names = [name for path in lists for name in file_names(path)]
    assert sorted(names) == sorted(set(names))


def test_locked_versions_are_allowed():
    """setup.cfg allows every locked version. The extra gpu, which `make` leaves out, is not locked."""
    locked: dict[str, set[str]] = {}
    for item in LOCK:
        (version,) = item.specifier
        locked.setdefault(canonicalize_name(item.name), set()).add(version.version)
    groups = [PLAIN, *(packages for extra, packages in EXTRAS.items() if extra != "gpu")]
    for name, item in ((name, item) for group in groups for name, item in group.items()):
        assert name in locked
        assert all(item.specifier.contains(version) for version in locked[name]), name


def test_the_manifest_names_every_package():
    """package.xml has a rosdep key for each Python package that is required, or says that it has none."""
    keys = [name.removeprefix("python3-") for name in EXEC_DEPENDS if name.startswith("python3-")]
    named = [canonicalize_name(ROSDEP_NAMES.get(key, key)) for key in keys]
    (remark,) = re.findall(r"<!-- ([\w\s,-]+) have no certain rosdep key", MANIFEST)
    assert sorted(named + re.split(r",\s+|\s+and\s+", remark)) == sorted(INSTALLED)


def test_ros_packages_are_in_the_manifest():
    """What requirements/run.txt takes from the ROS wheels stands in package.xml."""
    ros = {name.removeprefix("ros-") for name in file_names("run") if name.startswith("ros-")}
    assert ros <= {canonicalize_name(name) for name in EXEC_DEPENDS}


@pytest.mark.parametrize("folder", ["", "msg_defs"])
def test_the_manifest_is_valid(folder):
    """ROS's own reader takes package.xml, the maintainer's address among it, without a warning."""
    warnings: list[str] = []
    package = parse_package(ROOT / folder, warnings=warnings)
    package.validate(warnings=warnings)
    assert warnings == []


def imported_modules() -> set[str]:
    """Top-level names of all absolute imports of the package."""
    found = set()
    for path in (ROOT / "subsoil_ros").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                found |= {name.name.partition(".")[0] for name in node.names}
            elif isinstance(node, ast.ImportFrom) and not node.level:
                found.add(str(node.module).partition(".")[0])
    return found


def test_every_import_is_declared():
    """A module that is imported is required, or in an extra that extras.py knows, or of ROS."""
    distributions = packages_distributions()
    undeclared = imported_modules() - sys.stdlib_module_names - set(EXEC_DEPENDS) - BROUGHT
    for module in undeclared - EXTRA_OF.keys():
        names = {canonicalize_name(name) for name in distributions.get(module, ())}
        assert names & PLAIN.keys(), f"{module} is imported, and setup.cfg does not name its package"


def test_extras_install_what_is_looked_for():
    """Each module of extras.py comes with the extra that its message names."""
    distributions = packages_distributions()
    for module, extra in EXTRA_OF.items():
        names = {canonicalize_name(name) for name in distributions.get(module, ())}
        assert extra == "gpu" or names & EXTRAS[extra].keys(), module


def test_the_forge_runs_the_same_commands():
    """.github/workflows/ci.yml runs the commands of .ci/run in their order."""
    commands = re.findall(r"^make .*$", (ROOT / ".ci/run").read_text(), re.MULTILINE)
    workflow = YAML(typ="safe").load(ROOT / ".github/workflows/ci.yml")
    steps = [step["run"] for step in workflow["jobs"]["all"]["steps"] if "run" in step]
    assert [step for step in steps if step.startswith("make ")] == commands


def test_the_forge_tests_every_python():
    """The quick job runs the quick tests under each Python that the Makefile accepts."""
    workflow = YAML(typ="safe").load(ROOT / ".github/workflows/ci.yml")
    low, high = re.search(r"Python 3\.(\d+) to 3\.(\d+)", (ROOT / "Makefile").read_text()).groups()
    versions = [f"3.{minor}" for minor in range(int(low), int(high) + 1)]
    assert workflow["jobs"]["quick"]["strategy"]["matrix"]["python"] == versions
    assert workflow["jobs"]["quick"]["steps"][-1]["run"] == "make test-quick"
