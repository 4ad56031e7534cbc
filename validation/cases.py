"""A case, and the three ends it may have: a right answer, a refusal, a stop with a named cause."""

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from subsoil_ros.errors import InputError, RunError

from .laboratory import Laboratory

RIGHT, REFUSED, STOPPED = "right", "refused", "stopped"


class WrongEndError(Exception):
    """A case did not end as it must."""


@dataclass(frozen=True)
class Outcome:
    """How a case ended, and what was found."""

    ending: str
    found: str


@dataclass(frozen=True)
class Case:
    """One row of validation/extremes.md."""

    key: str
    endings: tuple[str, ...]  # that are allowed
    long: bool  # not part of the tests
    measure: Callable[[Laboratory], Outcome]

    @property
    def title(self) -> str:
        """What it is, in a line."""
        return (self.measure.__doc__ or "").strip().splitlines()[0].rstrip(".")

    def run(self, folder: Path) -> Outcome:
        """Runs it.

        Raises:
            WrongEndError: another end than it must have.
        """
        outcome = self.measure(Laboratory(folder))
        if outcome.ending not in self.endings:
            raise WrongEndError(
                f"{self.key}: ended '{outcome.ending}', must be {' or '.join(self.endings)}: {outcome.found}"
            )
        return outcome


class Cases(list[Case]):
    """The cases of one part, in the order of their definition."""

    def add(
        self, key: str, *endings: str, long: bool = False
    ) -> Callable[[Callable[[Laboratory], Outcome]], Callable[[Laboratory], Outcome]]:
        """Decorates the function that measures a case."""

        def keep(measure: Callable[[Laboratory], Outcome]) -> Callable[[Laboratory], Outcome]:
            self.append(Case(key, endings, long, measure))
            return measure

        return keep


def right(found: str) -> Outcome:
    """A right answer, already held against what it must be."""
    return Outcome(RIGHT, found)


def must(holds: object, what: str) -> None:
    """WrongEndError unless `holds`."""
    if not holds:
        raise WrongEndError(what)


def refused(action: Callable[[], object], words: str) -> Outcome:
    """`action` must be refused, with a message that matches `words` (a regular expression)."""
    return _ended(REFUSED, InputError, action, words)


def stopped(action: Callable[[], object], words: str) -> Outcome:
    """`action` must be stopped, with a message that matches `words`."""
    return _ended(STOPPED, RunError, action, words)


def right_or_stopped(action: Callable[[], str], words: str) -> Outcome:
    """`action` must give a right answer, or be stopped with a message that matches `words`."""
    try:
        return right(action())
    except RunError as error:
        must(re.search(words, str(error)), f"stopped with another cause: {error}")
        return Outcome(STOPPED, str(error))


def _ended(ending: str, kind: type[Exception], action: Callable[[], object], words: str) -> Outcome:
    try:
        result = action()
    except kind as error:
        must(re.search(words, str(error)), f"{ending} with another cause: {error}")
        return Outcome(ending, str(error))
    raise WrongEndError(f"must be {ending} ({words}), but went on: {result}")
