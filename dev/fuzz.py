"""Random cases against what must always hold: python -m dev.fuzz [FUZZER ...] [--cases N] [--seed S]

A fuzzer is a module dev/fuzz_*.py with `cases`, a Hypothesis strategy, and `judge`, which names the outcome
of a case or raises. Hypothesis reduces a failing case to the smallest one and prints it.
"""

import argparse
import importlib
import warnings
from collections import Counter
from collections.abc import Callable
from typing import Any, Protocol

from hypothesis import HealthCheck, given, seed, settings
from hypothesis.strategies import SearchStrategy

from subsoil_ros.errors import InputError

FUZZERS = ("scenes", "names", "environments", "machines", "tools")
CASES = 20_000


class Fuzzer(Protocol):
    """What a module dev/fuzz_*.py has."""

    cases: Callable[[], SearchStrategy[Any]]
    judge: Callable[[Any], str]


def run(fuzzer: Fuzzer, count: int, chosen: int | None = None) -> Counter[str]:
    """Judge `count` cases, of the seed `chosen` or the same ones in every run; return how often each outcome
    came. Raises what a case raises."""
    found: Counter[str] = Counter()

    @settings(
        max_examples=count,
        derandomize=chosen is None,
        deadline=None,
        database=None,
        suppress_health_check=list(HealthCheck),
    )
    @given(fuzzer.cases())
    def judged(case: Any) -> None:
        found[fuzzer.judge(case)] += 1

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        warnings.simplefilter("error", RuntimeWarning)  # numpy's, of numbers that are none
        (judged if chosen is None else seed(chosen)(judged))()
    return found


def outcome(work: Callable[[], object], check_message: Callable[[str], object] = str) -> str:
    """ "runs", or "refused" where the work ends in one message. Raises what it raises otherwise."""
    try:
        work()
    except InputError as error:
        if not str(error).strip():
            raise AssertionError("refused without a message") from error
        check_message(str(error))
        return "refused"
    return "runs"


def main() -> int:
    """Runs the fuzzers. Raises what a case raises."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("fuzzers", nargs="*", metavar="FUZZER", help=f"of {', '.join(FUZZERS)}; all")
    parser.add_argument("--cases", type=int, default=CASES)
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    for name in args.fuzzers or FUZZERS:
        fuzzer: Any = importlib.import_module(f"dev.fuzz_{name}")
        found = run(fuzzer, args.cases, args.seed)
        print(
            f"{name}: {', '.join(f'{count} {outcome}' for outcome, count in sorted(found.items()))}",
            flush=True,
        )
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
