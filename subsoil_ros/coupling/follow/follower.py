"""A motion source that follows poses as they come, at the pace of the machine that sends them."""

import math
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path

from ...errors import InputError, InterruptedRunError, RecordingError, RunError
from ...loading.loader import ResolvedScene
from ...messages import SpatialMotion, ToolMotion, ToolMotions, ToolWrench
from ...recording.checkpoint import Arrays
from ...recording.joined import open_record
from ...rotations import planar_quaternion, rotation_between
from ...scene.tools import Tool
from ...ticks import tick_end_ns
from ...yaml_document import Document
from ..exit_status import interrupted
from ..external import ASIDE_M
from . import BEHIND_S, FASTEST_M_PER_S
from .poses import Motion, Pose, PoseTrack

ASIDE_RAD = 0.01
"""Largest angle of a planar tool from its plane: at 0.1 m from the origin, ASIDE_M."""

CLOCKS_NS = 10_000_000_000
"""Difference of the first stamps of two tools that tells different clocks: wall time and a simulator's."""

_WAIT_S = 0.1


class Follower:
    """Moves the tools of a scene to the poses that `receive` takes, from another thread.

    The soil waits for the newest pose. It skips to it where it is more than `behind_s` behind the pose before
    that one. Time of the run has no gaps: `stamp_ns` is the time of the machine that belongs to its end.
    """

    keeps_state = False

    def __init__(
        self,
        resolved: ResolvedScene,
        stopped: Callable[[], int] = lambda: 0,
        *,
        behind_s: float = BEHIND_S,
        fastest_m_per_s: float = FASTEST_M_PER_S,
    ) -> None:
        self._tools: dict[str, Tool] = resolved.scene.tools
        self._step_ns = resolved.timing.communication_step_ns
        self._stopped, self._behind_ns = stopped, round(1e9 * behind_s)
        self.fastest_m_per_s = fastest_m_per_s
        self._tracks = {name: PoseTrack(fastest_m_per_s) for name in self._tools}
        self._angles_rad = {motion.tool: motion.angle_rad for motion in self.initial_motions()}
        self._news = threading.Condition()
        self._known: tuple[int, int] = (0, 0)  # times up to which all tools are known: now, and before that
        self._rose_s = time.monotonic()
        self._fault: Exception | None = None
        self.is_reset = False
        self._offset_ns: int | None = None  # from the time of the run to that of the machine
        self.stamp_ns, self._start_ns = 0, 0
        self.skipped_ns, self.skips = 0, 0
        self.refused: Counter[str] = Counter()

    def receive(self, tool: str, pose: Pose) -> None:
        """Take a pose of a tool in the world. It is refused, and counted, if it is late or not a pose."""
        with self._news:
            cause = self._out_of_plane(tool, pose) or self._tracks[tool].add(pose)
            known_ns = self._known_ns()
            if known_ns is not None and known_ns > self._known[0]:
                self._known, self._rose_s = (known_ns, self._known[0]), time.monotonic()
                self._news.notify()
        if cause:
            self.refuse(cause)

    def refuse(self, cause: str) -> None:
        """Count a pose that was refused."""
        self.refused[cause] += 1

    def fail(self, fault: Exception) -> None:
        """End the run: no pose can come any more."""
        with self._news:
            self._fault = fault
            self._news.notify()

    def reset(self) -> None:
        """End the run, so that another one begins."""
        with self._news:
            self.is_reset = True
            self._news.notify()

    @property
    def still_s(self) -> float:
        """Wall time since the poses of all tools went on."""
        return time.monotonic() - self._rose_s

    def facts(self) -> Document:
        """What it did, in the form of `run.followed` of summary.json."""
        return {
            "start_ns": self._start_ns,
            "end_ns": self.stamp_ns,
            "skipped_s": 1e-9 * self.skipped_ns,
            "skips": self.skips,
            "refused": dict(self.refused),
        }

    @property
    def behind_s(self) -> float:
        """How far the soil is behind the newest pose of all tools."""
        known_ns = self._known_ns()
        return 0.0 if known_ns is None or self._offset_ns is None else 1e-9 * (known_ns - self.stamp_ns)

    @property
    def awaited(self) -> list[str]:
        """Tools without a pose so far."""
        return [name for name, track in self._tracks.items() if track.newest_ns is None]

    def initial_motions(self) -> tuple[ToolMotion, ...]:
        """The start poses of the scene, at rest."""
        return tuple(_start(name, tool) for name, tool in self._tools.items())

    def advance(self, tick: int, wrenches: tuple[ToolWrench, ...]) -> tuple[ToolMotion, ...]:
        """Motions at the end of `tick`, once poses of all tools reach so far. No wrench moves them.

        Raises:
            InterruptedRunError: the run was stopped while it waited, or reset.
            RunError: no pose can come, or stamps of tools are of different clocks.
        """
        end_ns = tick_end_ns(tick, self._step_ns)
        with self._news:
            while self.is_reset or not self._reaches(end_ns):
                if self.is_reset:
                    raise InterruptedRunError("ended by reset_simulation")
                if number := self._stopped():
                    raise interrupted(number).error()
                if self._fault is not None:
                    raise RunError(f"poses: {type(self._fault).__name__}: {self._fault}") from self._fault
                self._news.wait(_WAIT_S)
            newest_ns = self._known_ns()
            assert newest_ns is not None
            if self._offset_ns is None:
                self._refuse_clocks()
                self._offset_ns, self._start_ns = newest_ns - end_ns, newest_ns
            late_ns = newest_ns - end_ns - self._offset_ns
            if late_ns > self._behind_ns + self._known[0] - self._known[1]:
                self._offset_ns += late_ns
                self.skipped_ns += late_ns
                self.skips += 1
            self.stamp_ns = end_ns + self._offset_ns
            found = []
            for name, track in self._tracks.items():
                found.append(self._motion(name, track.over(self.stamp_ns, self._step_ns)))
                track.forget(self.stamp_ns - self._step_ns)
            return tuple(found)

    def state_arrays(self) -> Arrays:
        """Nothing: who follows cannot go back."""
        return {}

    def restore(self, arrays: Arrays) -> None:
        """Never called, as it keeps no state."""
        raise AssertionError

    def _refuse_clocks(self) -> None:
        """Refuse tools whose stamps are far apart: the one that is behind would never be reached."""
        stamps = {name: track.newest_ns or 0 for name, track in self._tracks.items()}
        if max(stamps.values()) - min(stamps.values()) > CLOCKS_NS:
            words = ", ".join(f"{name} {1e-9 * stamp:.3f} s" for name, stamp in stamps.items())
            raise RunError(f"poses: stamps are of different clocks, {words}; stamp all by one clock")

    def _known_ns(self) -> int | None:
        """The time up to which all tools are known."""
        newest = [track.newest_ns for track in self._tracks.values()]
        return None if None in newest else min(stamp for stamp in newest if stamp is not None)

    def _reaches(self, end_ns: int) -> bool:
        known_ns = self._known_ns()
        return known_ns is not None and (self._offset_ns is None or known_ns >= end_ns + self._offset_ns)

    def _out_of_plane(self, tool: str, pose: Pose) -> str:
        model = self._tools[tool]
        if model.is_spatial or not all(map(math.isfinite, pose.quaternion)):
            return ""
        angle = _planar_angle(pose)
        off = math.hypot(*rotation_between(planar_quaternion(angle), pose.quaternion))
        beside = abs(pose.position_m[1] - model.lateral_m) > ASIDE_M or off > ASIDE_RAD
        return "out of the plane of travel" if beside else ""

    def _motion(self, tool: str, motion: Motion) -> ToolMotion:
        pose, velocity, spin = motion
        if self._tools[tool].is_spatial:
            return SpatialMotion.of(tool, pose.position_m, pose.quaternion, velocity, spin)
        last = self._angles_rad[tool]
        angle = self._angles_rad[tool] = last + math.remainder(_planar_angle(pose) - last, math.tau)
        x, _, z = pose.position_m
        return ToolMotion(tool, x, self._tools[tool].lateral_m, z, angle, velocity[0], velocity[2], -spin[1])


class Replay:
    """Moves the tools as they moved in a recorded run, tick by tick.

    Raises:
        InputError: there is no bag, or it has other tools or ticks than the scene.
        RecordingError: the bag was not closed, or is damaged.
    """

    keeps_state = False

    def __init__(self, resolved: ResolvedScene, run: Path) -> None:
        self._run = run
        self._records: Iterator[ToolMotions] = open_record(run).records(ToolMotions)
        first = next(self._records, None)
        wanted, found = list(resolved.scene.tools), [motion.tool for motion in first.tools] if first else []
        if first is not None and wanted != found:
            raise InputError(
                f"{run}: has motions of {found or 'no tools'}, the scene has {wanted}; name another run"
            )
        step_ns = resolved.timing.communication_step_ns
        second = next(open_record(run).records(ToolMotions, at=lambda time_ns: time_ns > 0), None)
        if first is None or second is None:
            raise InputError(f"{run}: has no tick; name another run")
        self._first = first.tools
        if second.end_time_ns != step_ns:
            raise InputError(
                f"{run}: has ticks of {second.end_time_ns} ns, the scene of {step_ns} ns; add "
                f"--set coupling.communication_step_ns={second.end_time_ns}"
            )

    def initial_motions(self) -> tuple[ToolMotion, ...]:
        """Motions before the first tick."""
        return self._first

    def advance(self, tick: int, wrenches: tuple[ToolWrench, ...]) -> tuple[ToolMotion, ...]:
        """Recorded motions at the end of `tick`. No wrench moves them."""
        record = next(self._records, None)
        if record is None or record.tick != tick:
            raise RecordingError(f"{self._run}: has no motions of tick {tick}")
        return record.tools

    def state_arrays(self) -> Arrays:
        """Nothing: a replay is not resumed."""
        return {}

    def restore(self, arrays: Arrays) -> None:
        """Never called, as it keeps no state."""
        raise AssertionError


def _planar_angle(pose: Pose) -> float:
    """Planar angle of an orientation near the plane of travel."""
    return -2.0 * math.atan2(pose.quaternion[1], pose.quaternion[3])


def _start(name: str, tool: Tool) -> ToolMotion:
    assert tool.path is not None
    position = tool.path.start_m(tool.lateral_m)
    if tool.is_spatial:
        none = (0.0, 0.0, 0.0)
        return SpatialMotion.of(name, position, tool.path.start_quaternion, none, none)
    return ToolMotion(name, position[0], position[1], position[2], tool.path.start_angle_rad, 0.0, 0.0, 0.0)
