"""What may take minutes is announced on standard error, once, and stays out of the way of logs."""

import numba
import pytest

from subsoil_ros.cli.progress import KernelAnnouncer, announce_kernels_of_nodes
from subsoil_ros.source_digest import PACKAGE, kernel_digest


def test_a_compilation_is_announced_before_and_timed_after(capsys: pytest.CaptureFixture[str]) -> None:
    """One line before the first kernel, whatever the number of kernels, and one at the end."""

    @numba.njit
    def inner(x):
        return x + 1

    @numba.njit
    def outer(x):
        return 2 * inner(x)

    with KernelAnnouncer():
        assert outer(1) == 4
        assert inner(0.5) == 1.5
    first, last = capsys.readouterr().err.splitlines()
    assert first.startswith("compiling kernels, once, in 1 to 4 minutes: kept in ")
    assert last.startswith("compiled 3 kernels in ")


def test_kernels_that_are_there_pass_in_silence(capsys: pytest.CaptureFixture[str]) -> None:
    """Nothing is compiled, nothing is said; before each tick, neither."""
    ticks = []
    with KernelAnnouncer() as kernels:
        kernels.before(ticks.append)(7)
    assert ticks == [7]
    assert capsys.readouterr().err == ""


def test_nodes_announce_only_a_cold_cache(tmp_path, monkeypatch, capsys: pytest.CaptureFixture[str]) -> None:
    """A line before and one at the first tick; with kernels of the soil engine in the cache, no word."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    ticks = []
    on_tick = announce_kernels_of_nodes(ticks.append)
    assert str(tmp_path) in capsys.readouterr().err
    for tick in (0, 1):
        on_tick(tick)
    assert ticks == [0, 1]
    assert len(capsys.readouterr().err.splitlines()) == 1
    (tmp_path / "dem").mkdir()
    digest = kernel_digest(PACKAGE / "dem" / "step.py")[:16]
    (tmp_path / "dem" / f"step.drift_and_contacts-{digest}.py311.1.nbc").touch()
    assert announce_kernels_of_nodes(print) is print
    assert capsys.readouterr().err == ""
