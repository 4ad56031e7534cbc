"""How a run ends: exit status and reason, and the signals that end it in order.

Errors decide the status by their class (errors.py); where nodes run as processes, which of them is the cause
is decided in ros/process/supervisor.py.
"""

import os
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from ..errors import InterruptedRunError, RunError

SIGNAL_STATUS = 128
"""A run ended by a signal has the exit status a shell gives it: this plus the signal's number."""


@dataclass(frozen=True)
class ExitStatus:
    """Exit code and, unless all went well, the reason in one line."""

    code: int = 0
    reason: str = ""

    def error(self) -> RunError:
        """This status as an error."""
        kind = InterruptedRunError if self.code > SIGNAL_STATUS else RunError
        error = kind(self.reason)
        error.exit_status = self.code
        return error


def interrupted(signal_number: int) -> ExitStatus:
    """Status of a run that a signal ended. A run whose terminal was closed has failed."""
    if signal_number == signal.SIGHUP:
        reason = "ended by SIGHUP: the terminal was closed; nohup keeps a run going"
        return ExitStatus(RunError.exit_status, reason)
    return ExitStatus(SIGNAL_STATUS + signal_number, f"ended by {signal.Signals(signal_number).name}")


STANDARD_STREAMS = (0, 1, 2)


@contextmanager
def caught_signals(handle: Callable[[int], None]) -> Iterator[None]:
    """Pass SIGINT, SIGTERM and SIGHUP to `handle`, the last one unless it is ignored (nohup).

    After SIGHUP, output to the terminal is discarded instead of raising errors, so that the run can still end
    in order.
    """
    of_terminal = [stream for stream in STANDARD_STREAMS if os.isatty(stream)]

    def caught(number: int, _: object) -> None:
        if number == signal.SIGHUP:
            nowhere = os.open(os.devnull, os.O_RDWR)
            for stream in of_terminal:
                os.dup2(nowhere, stream)
        handle(number)

    numbers = [signal.SIGINT, signal.SIGTERM]
    if signal.getsignal(signal.SIGHUP) != signal.SIG_IGN:
        numbers.append(signal.SIGHUP)
    before = [signal.signal(number, caught) for number in numbers]
    try:
        yield
    finally:
        for number, handler in zip(numbers, before, strict=True):
            signal.signal(number, handler)


@contextmanager
def counted_interrupts(stopped: list[int]) -> Iterator[None]:
    """Context in which Ctrl-C appends its signal to `stopped`; without effect outside of the main thread."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, lambda number, _: stopped.append(number))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
