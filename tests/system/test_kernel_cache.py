"""Compiled kernels never outlive the sources they were made from."""

import ast
import importlib.util
import inspect
import os
import pkgutil
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest
from numba.core.dispatcher import Dispatcher

from subsoil_ros.source_digest import KEPT_AS, PACKAGE, _imported, kernel_digest, result_digest, source_of


@pytest.fixture(scope="module")
def package(tmp_path_factory):
    """A copy of the package's sources, to change."""
    copy = tmp_path_factory.mktemp("sources") / "subsoil_ros"
    shutil.copytree(PACKAGE, copy, ignore=shutil.ignore_patterns("__pycache__"))
    return copy


def digests_after(package, place, change):
    """(digest of the soil step's kernels, of the mechanism's step, of results) with one file changed."""
    file = package / place
    before = file.read_text()
    file.write_text(change(before))
    try:
        source_of.cache_clear()
        _imported.cache_clear()
        step, advance = package / "dem/step.py", package / "mbd/advance.py"
        return kernel_digest(step, package), kernel_digest(advance, package), result_digest(package)
    finally:
        file.write_text(before)


@pytest.fixture(scope="module")
def as_it_is(package):
    """Digests of the copy, unchanged."""
    return digests_after(package, "dem/contact.py", str)


@pytest.mark.parametrize(
    ("place", "kernels"),
    [
        ("dem/contact.py", "soil"),
        ("dem/periodic.py", "soil"),
        ("contact_laws/springs.py", "soil"),
        ("contact_laws/hertz/kernel.py", "soil"),
        ("contact_laws/hertz/law.py", "soil"),
        ("mbd/function_tables.py", "mechanism"),
        ("mbd/mechanism_engine.py", "none"),
        ("dem/packing/dense_random.py", "none"),
        ("scene/pair_laws.py", "none"),
        ("scene/soil.py", "none"),
        ("coupling/direct.py", "none"),
        ("wedge/failure_wedge.py", "none"),
    ],
)
def test_a_changed_source_outdates_its_kernels_and_all_results(package, as_it_is, place, kernels):
    """Bed preparation, combining rules and the exchange are no kernels: results know of them all the same."""
    changed = digests_after(package, place, lambda text: text + "\nCHANGED = 1\n")
    expected = (kernels == "soil", kernels == "mechanism", True)
    assert tuple(new != old for new, old in zip(changed, as_it_is, strict=True)) == expected


def test_a_comment_outdates_nothing(package, as_it_is):
    """Nor does a docstring, nor what no result depends on."""
    assert (
        digests_after(package, "dem/contact.py", lambda text: "# why\n" + text + '\n"""Said."""\n')
        == as_it_is
    )
    assert digests_after(package, "cli/run/__init__.py", lambda text: text + "\nCHANGED = 1\n") == as_it_is


@pytest.mark.full
def test_sources_are_read_again_only_when_they_changed(package, tmp_path):
    """By the next process; a change that keeps size and time of a file counts, and a damaged record is
    written anew."""
    show = (
        "import ast, sys; from pathlib import Path; from subsoil_ros import source_digest as sources\n"
        "parse, read = ast.parse, []; ast.parse = lambda text: read.append(text) or parse(text)\n"
        "package = Path(sys.argv[1])\n"
        "print(sources.kernel_digest(package / 'dem' / 'step.py', package), len(read))"
    )
    file, record = package / "dem" / "contact.py", tmp_path / KEPT_AS
    text, times = file.read_text(), file.stat()

    def digest_and_reads():
        done = subprocess.run(
            [sys.executable, "-c", show, str(package)], env=os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)},
            capture_output=True, text=True, check=True,
        )  # fmt: skip
        digest, read = done.stdout.split()
        return digest, int(read)

    time.sleep(1.1)  # what changed just now is not kept
    first, all_read = digest_and_reads()
    assert all_read > 50
    assert digest_and_reads() == (first, 0)
    other = text.replace("stride", "strode")
    assert other != text
    file.write_text(other)
    os.utime(file, ns=(times.st_atime_ns, times.st_mtime_ns))
    try:
        changed, read = digest_and_reads()
        assert changed != first
        assert read == 1
    finally:
        file.write_text(text)
    time.sleep(1.1)
    record.write_text("{")
    assert digest_and_reads() == (first, all_read)
    assert digest_and_reads() == (first, 0)


def test_kernels_take_nothing_from_outside_their_folder():
    """Their digest looks there, at the theory of wedges and at the contact laws."""
    for kernel in all_kernels():
        engine = kernel.py_func.__module__.split(".")[1]
        tree = ast.parse(Path(inspect.getfile(kernel.py_func)).read_bytes())
        for node in ast.walk(tree):
            if isinstance(node, ast.ImportFrom) and node.level:
                names = {alias.asname or alias.name for alias in node.names}
                used = names & set(kernel.py_func.__code__.co_names)
                module = importlib.util.resolve_name(
                    "." * node.level + (node.module or ""), kernel.py_func.__module__.rpartition(".")[0]
                )
                assert not used or module.split(".")[1] in (engine, "wedge", "contact_laws"), (
                    kernel,
                    used,
                )


def all_kernels():
    """Every compiled function of the engines."""
    import subsoil_ros

    found = []
    for engine in ("contact_laws", "dem", "mbd", "terrain", "wedge"):
        for module in pkgutil.walk_packages([str(PACKAGE / engine)], f"{subsoil_ros.__name__}.{engine}."):
            if ".gpu" not in module.name:
                values = vars(importlib.import_module(module.name)).values()
                found += [value for value in values if isinstance(value, Dispatcher)]
    assert len(found) > 50
    return found


def cache_folder_seen_by(**environment):
    """Where the engines of another process keep their kernels."""
    show = "from subsoil_ros.dem.step import drift_and_contacts as step; print(step._cache.cache_path)"
    kept = {k: v for k, v in os.environ.items() if k not in ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME")}
    return subprocess.run(
        [sys.executable, "-c", show], env=kept | environment, capture_output=True, text=True, check=True
    ).stdout.strip()


@pytest.mark.full
def test_kernels_are_kept_outside_the_package(tmp_path):
    """The engines point numba at the user's cache, and leave a folder given by the user alone."""
    plain = {"XDG_CACHE_HOME": str(tmp_path)}
    assert cache_folder_seen_by(**plain) == str(tmp_path / "subsoil_ros" / "kernels" / "dem")
    assert cache_folder_seen_by(**plain, NUMBA_CACHE_DIR="/given") == "/given/dem"


def test_kernels_find_a_place_without_a_home(tmp_path):
    """A home that cannot be written to: the temporary folder serves, and is found again."""
    homeless = {"HOME": "/dev/null", "TMPDIR": str(tmp_path)}
    folder = cache_folder_seen_by(**homeless)
    assert folder.startswith(str(tmp_path / f"cache-{os.getuid()}"))
    assert cache_folder_seen_by(**homeless) == folder


@pytest.mark.skipif(os.getuid() != 0, reason="only root can give a folder away")
def test_kernels_of_others_are_not_run(tmp_path):
    """A folder in the temporary folder that belongs to another user is not used: its kernels are code."""
    foreign = tmp_path / f"cache-{os.getuid()}"
    foreign.mkdir()
    os.chown(foreign, 12345, 12345)
    folder = cache_folder_seen_by(HOME="/dev/null", TMPDIR=str(tmp_path))
    assert folder.startswith(str(tmp_path))
    assert not folder.startswith(str(foreign) + "/")
