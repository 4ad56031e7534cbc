"""One exception tree. The class decides the exit status of the command line."""


class SubsoilError(Exception):
    """Base of every error this package raises on purpose."""

    exit_status = 3


class InputError(SubsoilError):
    """Input that cannot be used. The message has the place, what was given, what is allowed, what to do."""

    exit_status = 2


def environment_error(name: str, given: str, allowed: str) -> InputError:
    """The refusal of an environment variable."""
    return InputError(f"environment: {name} is {given!r}; it must be {allowed}; set it so, or unset it")


class SceneError(InputError):
    """A scene file (or an override of it) is wrong."""


class RunError(SubsoilError):
    """A run that had started cannot go on."""


class PhysicsError(RunError):
    """The numbers are no longer physics: NaN, an overlap too deep, a residual above its bound."""


class SingularMechanismError(RunError):
    """The mechanism is in a singular position, in which its motion is not determined."""


class ProtocolError(RunError):
    """A lockstep message is missing, repeated, of another run or malformed."""


class RecordingError(RunError):
    """A bag cannot be written or read."""


class InterruptedRunError(RunError):
    """The user ended the run (Ctrl-C)."""

    exit_status = 130
