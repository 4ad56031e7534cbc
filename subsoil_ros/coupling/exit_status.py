"""How a run ended: exit status and reason."""

import signal
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
