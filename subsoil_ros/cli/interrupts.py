"""Ctrl-C at any moment: what is awaited is said at once, and a second one ends the program.

Python runs handlers of signals between its own instructions only, and a kernel takes a minute to compile. So
a thread reads the signals from a pipe. And a library may swallow the exception that Python raises, in
`__del__` for one; so work of many parts asks between them.
"""

import os
import select
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager

from ..errors import InterruptedRunError

SILENT_S = 0.7
"""Time that a program has to end before a line says what it waits for."""

_seen = threading.Event()


@contextmanager
def answered_interrupts(verb: str) -> Iterator[None]:
    """Context of a verb in the main thread; in another one signals do not arrive, and nothing is done."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    reader, writer = os.pipe()
    os.set_blocking(writer, False)
    _seen.clear()
    before = signal.set_wakeup_fd(writer, warn_on_full_buffer=False)
    thread = threading.Thread(target=_answer, args=(reader, verb), daemon=True)
    thread.start()
    try:
        yield
    finally:
        signal.set_wakeup_fd(before)
        os.write(writer, bytes(1))
        thread.join()
        os.close(writer)
        os.close(reader)


def end_if_interrupted() -> None:
    """Raise KeyboardInterrupt if Ctrl-C has come, also where the first one was swallowed."""
    if _seen.is_set():
        raise KeyboardInterrupt


def _answer(reader: int, verb: str) -> None:
    """Answer the first SIGINT of a pipe, end the process at the second; return at a zero."""
    count = 0
    while 0 not in (numbers := os.read(reader, 64)):
        count += numbers.count(signal.SIGINT)
        if count == 0:
            continue
        _seen.set()
        if count == 1 and not select.select([reader], [], [], SILENT_S)[0]:
            _say(f"subsoil {verb}: interrupted, {_awaited()}; Ctrl-C again ends it at once")
        elif count > 1:
            _end_at_once(verb)


def _awaited() -> str:
    kernels = sys.modules.get("subsoil_ros.kernel_cache")  # without it, nothing compiles
    if kernels is not None and kernels.compiling():
        return "waits for a kernel to be compiled, which may take a minute"
    return "waits for the step in progress, then closes what is open"


def _end_at_once(verb: str) -> None:
    import psutil

    for child in psutil.Process().children(recursive=True):
        child.kill()
    _say(f"subsoil {verb}: interrupted twice, ended at once")
    os._exit(InterruptedRunError.exit_status)


def _say(line: str) -> None:
    os.write(2, f"\n{line}\n".encode() if os.isatty(2) else f"{line}\n".encode())
