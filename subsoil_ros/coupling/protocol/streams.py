"""The ticks of one kind of message: all of one run, each exactly once, in order."""

from collections import deque
from typing import Generic, TypeVar

from ...errors import ProtocolError
from ...messages import DriverCommand, ToolMotions, ToolWrenches
from ...schedule import Schedule

Answer = TypeVar("Answer", ToolMotions, ToolWrenches)


class Stream:
    """The ticks of one kind of message: all of one run, each exactly once, in order.

    Ticks are `first`, by default the first one of the run, `first` + `every`, and so on.
    """

    def __init__(
        self, name: str, run_id: str, schedule: Schedule, first: int | None = None, every: int = 1
    ) -> None:
        self.next_tick = schedule.first_tick if first is None else first
        self._every = every
        self._name = name
        self._run_id = run_id
        self._last_tick = schedule.last_tick

    def accept(self, run_id: str, tick: int) -> None:
        """Accept the next message.

        Raises:
            ProtocolError: it is of another run, or not of the expected tick.
        """
        self.refuse_foreign(run_id, tick)
        if tick != self.next_tick:
            what = (
                "repeated" if tick < self.next_tick else f"{(tick - self.next_tick) // self._every} missing"
            )
            if (tick - self.next_tick) % self._every:
                what = f"one is due every {self._every} ticks"
            raise ProtocolError(f"{self._name}: tick {tick} came where tick {self.next_tick} is due ({what})")
        if tick > self._last_tick:
            raise ProtocolError(
                f"{self._name}: tick {tick} came, but the run ends with tick {self._last_tick}"
            )
        self.next_tick += self._every

    def refuse_foreign(self, run_id: str, tick: int) -> None:
        """Raises ProtocolError if a message of `tick` is of another run."""
        if run_id != self._run_id:
            raise ProtocolError(
                f"{self._name}: tick {tick} is of run '{run_id}', this is run '{self._run_id}', at tick "
                f"{self.next_tick}; give every run a ROS_DOMAIN_ID of its own"
            )


def refuse_other_tools(name: str, tick: int, given: tuple[str, ...], tools: tuple[str, ...]) -> None:
    if given != tools:
        raise ProtocolError(f"{name}: tick {tick} has tools {list(given)}, the scene has {list(tools)}")


class AnswerStream(Stream, Generic[Answer]):
    """Motions or wrenches, kept until `take` returns them in order."""

    def __init__(self, name: str, run_id: str, schedule: Schedule, tools: tuple[str, ...]) -> None:
        super().__init__(name, run_id, schedule)
        self._tools = tools
        self._kept: deque[Answer] = deque()

    def add(self, answer: Answer) -> None:
        """Keep the next message. Raises ProtocolError if it is not the next, or has other tools."""
        self.accept(answer.run_id, answer.tick)
        refuse_other_tools(self._name, answer.tick, tuple(t.tool for t in answer.tools), self._tools)
        self._kept.append(answer)

    def __len__(self) -> int:
        return len(self._kept)

    def take(self) -> Answer:
        """Remove and return the oldest message kept."""
        return self._kept.popleft()


class CommandStream(Stream):
    """Commands of a controller, at the control ticks of the run."""

    def __init__(self, run_id: str, schedule: Schedule) -> None:
        first = schedule.next_control(schedule.first_tick)
        super().__init__("driver_command", run_id, schedule, first, schedule.control_ticks)
        self._controlled = schedule.control_ticks > 0
        self._kept: deque[DriverCommand] = deque()

    def add(self, command: DriverCommand) -> None:
        """Keep the next command. Raises ProtocolError if it is not the next."""
        if not self._controlled:
            raise ProtocolError(f"driver_command: tick {command.tick} came, but the scene has no controller")
        self.accept(command.run_id, command.tick)
        self._kept.append(command)

    def has(self, tick: int) -> bool:
        """Whether the command of `tick` has come."""
        return bool(self._kept) and self._kept[0].tick == tick

    def take(self) -> DriverCommand:
        """Remove and return the oldest command kept."""
        return self._kept.popleft()
