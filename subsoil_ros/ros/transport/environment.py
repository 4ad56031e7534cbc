"""Environment variables of ROS, checked before anything starts: ROS itself ends late, or waits in silence."""

import os
import re
import socket
import sys
from pathlib import Path

from ...errors import environment_error
from ...numba_environment import check_numba_environment

LARGEST_DOMAIN = 232
"""Above it the ports of the domain (RTPS specification) do not exist."""

_RANGES = ("SUBNET", "LOCALHOST", "SYSTEM_DEFAULT")
_PROFILES = ("FASTDDS_DEFAULT_PROFILES_FILE", "FASTRTPS_DEFAULT_PROFILES_FILE")


def check_environment() -> None:
    """Check what ROS and numba will read.

    Raises:
        InputError: a variable has a value with which no node starts, or none finds another.
    """
    check_numba_environment()
    given = {name: value for name, value in os.environ.items() if value}
    domain = given.get("ROS_DOMAIN_ID", "0")
    if not re.fullmatch("0|[1-9][0-9]{0,2}", domain) or int(domain) > LARGEST_DOMAIN:  # 010 is 8 in ROS
        allowed = f"a whole number from 0 to {LARGEST_DOMAIN} (better, to 101)"
        raise environment_error("ROS_DOMAIN_ID", domain, allowed)
    reach = given.get("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    if reach not in _RANGES:
        words = "; with OFF no node finds another" if reach == "OFF" else ""
        raise environment_error("ROS_AUTOMATIC_DISCOVERY_RANGE", reach, f"{', '.join(_RANGES)}{words}")
    only_here = given.get("ROS_LOCALHOST_ONLY", "0")
    if only_here not in ("0", "1"):
        raise environment_error("ROS_LOCALHOST_ONLY", only_here, "0 or 1")
    peers = given.get("ROS_STATIC_PEERS", "") if only_here == "0" else ""
    if not all(_is_host(peer) for peer in peers.split(";") if peer):
        raise environment_error("ROS_STATIC_PEERS", peers, "addresses or names of hosts, with ; between them")
    middleware = given.get("RMW_IMPLEMENTATION")
    if middleware is not None and not _is_installed(middleware):
        raise environment_error(
            "RMW_IMPLEMENTATION", middleware, "the name of an installed one, as rmw_fastrtps_cpp"
        )
    for name in _PROFILES:
        if name in given and not os.path.isfile(given[name]):
            raise environment_error(name, given[name], "an existing file")
    keys = given.get("ROS_SECURITY_KEYSTORE", "")
    if given.get("ROS_SECURITY_ENABLE") == "true" and not os.path.isdir(keys):
        raise environment_error(
            "ROS_SECURITY_KEYSTORE", keys, "an existing folder where ROS_SECURITY_ENABLE is true"
        )


def _is_host(peer: str) -> bool:
    """Whether the name of a host, or its address, is known; else no node can be made."""
    try:
        return bool(socket.getaddrinfo(peer, None))
    except (OSError, UnicodeError):
        return False


def _is_installed(middleware: str) -> bool:
    """Whether the library of an RMW implementation is there; loading another one would end this process."""
    prefixes = [sys.prefix, *os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)]
    folders = [Path(prefix) / "lib" for prefix in prefixes if prefix]
    folders += [Path(entry) for entry in os.environ.get("LD_LIBRARY_PATH", "").split(os.pathsep) if entry]
    return any(os.path.isfile(folder / f"lib{middleware}.so") for folder in folders)
