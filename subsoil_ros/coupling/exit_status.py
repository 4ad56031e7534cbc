"""How a run ended: exit status and reason."""

import signal
from dataclasses import dataclass

from ..errors import InterruptedRunError, RunError

SIGNAL_STATUS = 128
"""A run ended by a signal has the exit status a shell gives it: this plus the signal's number."""

KEEP_S = 5.0
"""Time for a run that is interrupted to write a checkpoint (chosen: 130,000 particles take about 1 s)."""


@dataclass(frozen=True)
class ExitStatus:
    """Exit status and, unless all went well, the reason in one line."""

    exit_status: int = 0
    reason: str = ""

    def error(self) -> RunError:
        """The status as an error with this exit status."""
        kind = InterruptedRunError if self.exit_status > SIGNAL_STATUS else RunError
        error = kind(self.reason)
        error.exit_status = self.exit_status
        return error


def interrupted(signal_number: int) -> ExitStatus:
    """The status of a run by a signal. A terminal that closes is nobody's requested: the run has failed."""
    if signal_number == signal.SIGHUP:
        reason = "ended by SIGHUP: the terminal was closed; nohup keeps a run going"
        return ExitStatus(RunError.exit_status, reason)
    return ExitStatus(SIGNAL_STATUS + signal_number, f"ended by {signal.Signals(signal_number).name}")
