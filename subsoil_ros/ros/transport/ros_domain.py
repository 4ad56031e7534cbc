"""A ROS domain of its own for every run on this machine."""

import fcntl
import os
import socket
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ...errors import RunError

_DOMAINS = range(1, 102)  # 0 is the default of ROS; above 101 the ports are Linux' ephemeral ones
_PORT_BASE, _PORTS_PER_DOMAIN = 7400, 250  # of the RTPS specification
_FIRST_PARTICIPANT_PORT = 10


@contextmanager
def run_domain() -> Iterator[int]:
    """The domain for one run: the environment's ROS_DOMAIN_ID, or a free one, locked while it is used.

    Raises:
        RunError: no domain is free.
    """
    given = os.environ.get("ROS_DOMAIN_ID", "")
    if given:
        yield int(given)
        return
    shift = os.getpid() % len(_DOMAINS)
    for domain in (*_DOMAINS[shift:], *_DOMAINS[:shift]):
        path = Path(tempfile.gettempdir()) / f"subsoil_domain_{os.getuid()}_{domain}.lock"
        with path.open("w") as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:
                continue  # another run's
            if _is_quiet(domain):
                yield domain
                return
    raise RunError(
        "no ROS domain from 1 to 101 is free on this machine; end other runs, or set ROS_DOMAIN_ID"
    )


def _is_quiet(domain: int) -> bool:
    """Whether no participant of the domain holds its first ports."""
    base = _PORT_BASE + _PORTS_PER_DOMAIN * domain
    for port in (base, base + _FIRST_PARTICIPANT_PORT):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            try:
                probe.bind(("", port))
            except OSError:
                return False
    return True
