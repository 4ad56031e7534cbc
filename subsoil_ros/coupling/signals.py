"""Signals that end a run in order: SIGINT (Ctrl-C), SIGTERM, SIGHUP (the terminal was closed)."""

import os
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager

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
