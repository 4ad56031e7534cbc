"""Ctrl-C while a kernel compiles: a word within seconds, and the end at the second one. None is lost."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest

from subsoil_ros.cli.interrupts import answered_interrupts
from subsoil_ros.cli.progress import SweepProgress

HEARD = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)"
"""A program that is started in the background may ignore Ctrl-C."""

SLOW = """
import hashlib, signal
signal.signal(signal.SIGINT, lambda *_: None)  # one that comes before the long instruction ends nothing
from subsoil_ros.cli.interrupts import answered_interrupts

with answered_interrupts("run"):
    print("ready", flush=True)
    hashlib.pbkdf2_hmac("sha256", b"", b"", 2**31 - 1)  # one instruction, as the compilation of a kernel is
"""


def test_two_interrupts_in_one_long_instruction_end_the_program() -> None:
    """The first is answered though no handler can run; after the second the status is 130 at once."""
    with subprocess.Popen(
        [sys.executable, "-c", SLOW], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        assert process.stdout.readline() == "ready\n"
        process.send_signal(signal.SIGINT)
        line = process.stderr.readline()
        assert "subsoil run: interrupted, waits for the step in progress" in line
        assert "Ctrl-C again ends it at once" in line
        process.send_signal(signal.SIGINT)
        assert process.stderr.readline() == "subsoil run: interrupted twice, ended at once\n"
        assert process.wait() == 130


def test_the_first_compilation_says_what_is_awaited(tmp_path: Path) -> None:
    """`subsoil run` with an empty cache of kernels, interrupted as soon as it compiles."""
    words = ["run", "tine", "--mode", "direct", "--out", str(tmp_path / "run")]
    source = f"{HEARD}; from subsoil_ros.cli.main import main; raise SystemExit(main({words}))"
    with subprocess.Popen(
        [sys.executable, "-c", source],
        env={**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "kernels")},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stderr is not None
        while "compiling kernels" not in process.stderr.readline():
            assert process.poll() is None
        process.send_signal(signal.SIGINT)
        said = process.stderr.readline()
        if "interrupted, waits" in said:  # a long kernel: not one that was nearly done
            process.send_signal(signal.SIGINT)
            assert "ended at once" in process.stderr.readline()
        assert process.wait() == 130


def end_runs(progress: SweepProgress) -> None:
    """End 500 runs; the thread that hears of an interrupt may come later than the next of them."""
    for run in range(500):
        time.sleep(0.01)
        progress.ended(str(run), None)


@pytest.fixture
def hears() -> Iterator[None]:
    """Python's own handler; what is started in the background may ignore Ctrl-C."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("hears")
def test_an_interrupt_that_a_library_swallows_ends_the_runs_after_the_one_in_progress() -> None:
    """Python swallows an exception in `__del__` and in callbacks of weak references."""
    with answered_interrupts("sweep"), SweepProgress("sweep") as progress:
        progress.begin(0, 500)
        with suppress(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
        with pytest.raises(KeyboardInterrupt):
            end_runs(progress)
    with answered_interrupts("sweep"), SweepProgress("sweep") as progress:
        progress.begin(0, 1)
