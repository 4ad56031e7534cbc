"""Random values of the environment's variables, as the checks before a start read them.

Each environment must pass, or be refused in one message that names a variable with its value. One that passes
must be one that ROS and numba can read, and give folders that can be written. No process is started.
"""

import os
import re
import tempfile
from pathlib import Path
from unittest import mock

from hypothesis import strategies as st

from dev.fuzz import outcome
from subsoil_ros.cache_folders import user_cache_folder
from subsoil_ros.ros.transport.environment import LARGEST_DOMAIN, check_environment
from subsoil_ros.ros.transport.ros_domain import run_domain

NUMBERS = ("ROS_DOMAIN_ID", "ROS_LOCALHOST_ONLY", "NUMBA_NUM_THREADS")
FOLDERS = ("HOME", "XDG_CACHE_HOME", "NUMBA_CACHE_DIR", "ROS_SECURITY_KEYSTORE", "AMENT_PREFIX_PATH",
           "LD_LIBRARY_PATH", "FASTDDS_DEFAULT_PROFILES_FILE", "FASTRTPS_DEFAULT_PROFILES_FILE")  # fmt: skip
PEERS = ("ROS_STATIC_PEERS",)
WORDS = ("RMW_IMPLEMENTATION", "ROS_AUTOMATIC_DISCOVERY_RANGE", "ROS_SECURITY_ENABLE",
         "LANG", "PYTHONIOENCODING", "MPLBACKEND")  # fmt: skip

_text = st.text(st.characters(exclude_characters="\0"), max_size=20)  # also what no UTF-8 has
_peers = st.sampled_from(
    ["127.0.0.1", "127.0.0.1;;::1", "999.999.1.1", "a b;ü", "a" * 300, "a..b", "\x80", ";"]
)
_numbers = st.one_of(
    st.integers(-2, 300).map(str),
    st.sampled_from(["1e3", "0x10", "+5", " 5", "5\n", "05", "1_0", "٣", "²", "9" * 5000, "1.0", "abc"]),
)  # fmt: skip
_folders = st.sampled_from(
    [".", "file", "file/below", "/dev/null", "/proc", "/proc/none", "none", "~", "a" * 300, "b/" * 3000]
)
_words = st.sampled_from(
    ["rmw_fastrtps_cpp", "../rmw", "a" * 300, "SUBNET", "LOCALHOST", "OFF", "true", "C", "ascii"]
)
_any = st.one_of(st.just(""), _numbers, _folders, _words, _text)


def cases() -> st.SearchStrategy[dict[str, str]]:
    """Values of one to three variables: mostly of their kind, else of any."""
    kinds = ((NUMBERS, _numbers), (FOLDERS, _folders), (PEERS, _peers), (WORDS, _words))
    given = [st.tuples(st.just(name), st.one_of(kind, kind, _any)) for names, kind in kinds for name in names]
    return st.lists(st.one_of(given), min_size=1, max_size=3).map(dict)


def judge(given: dict[str, str]) -> str:
    """Raise AssertionError unless the environment is refused by name, or passes and can be used."""
    before = Path.cwd()
    with tempfile.TemporaryDirectory(prefix="subsoil_fuzz_") as folder, mock.patch.dict(os.environ):
        os.chdir(folder)
        Path("file").touch()
        for name in (*NUMBERS, *FOLDERS, *PEERS, *WORDS):
            os.environ.pop(name, None)
        os.environ.update(
            (name, os.fsdecode(value.encode("utf-8", "surrogatepass"))) for name, value in given.items()
        )
        try:
            return outcome(_start, _names_one)
        finally:
            os.chdir(before)


def _start() -> None:
    """What is read of the environment before a run with nodes starts."""
    check_environment()
    with run_domain() as domain:
        assert 0 <= domain <= LARGEST_DOMAIN
    assert os.access(user_cache_folder(), os.W_OK)
    for name in NUMBERS:  # C reads no other digits
        assert re.fullmatch(r"[0-9]*", os.environ.get(name, ""), re.ASCII), f"{name} is no number, and passes"


def _names_one(message: str) -> None:
    known = (*NUMBERS, *FOLDERS, *PEERS, *WORDS)
    shown = [name for name in known if f"environment: {name} is {os.environ.get(name, '')!r};" in message]
    assert len(shown) == 1, f"names no variable with its value: {message}"
    assert len(message.splitlines()) == 1, "is more than one line"
