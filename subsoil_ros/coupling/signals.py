"""Signals that end a run in order: Ctrl-C, a polite kill, the terminal's end."""

import os
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager

STANDARD_STREAMS = (0, 1, 2)


@contextmanager
def caught_signals(handle: Callable[[int], None]) -> Iterator[None]:
    """Within it SIGINT, SIGTERM and SIGHUP go to `handle`, the last one unless it is ignored (nohup).

    When the terminal is gone, what is written to it goes nowhere instead of failing: a run still has to be
    brought to its end.
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
