"""Stamped poses: of one frame by time, and of frames in a tree of transforms."""

import math
from bisect import bisect_left
from collections import deque
from collections.abc import Collection, Iterator
from typing import NamedTuple

from ...rotations import Quaternion, Vector, is_unit, product, quaternion_of, rotation_between, turned

KEPT = 4096
"""Poses of a frame that are kept: four seconds of one that is published a thousand times a second."""

LARGEST_TURN_RAD = 1.0
"""Turn from one pose to the next that counts as a leap: poses at 30 Hz tell 30 rad/s, a fast rotor's."""

NONE: Vector = (0.0, 0.0, 0.0)


class Pose(NamedTuple):
    """Place of a frame in its parent."""

    time_ns: int
    position_m: Vector
    quaternion: Quaternion  # (x, y, z, w)


class Motion(NamedTuple):
    """A pose with its rates, in the axes of the parent."""

    pose: Pose
    velocity_m_per_s: Vector = NONE
    spin_rad_per_s: Vector = NONE


class PoseTrack:
    """Poses of one frame in the order of their stamps, joined by straight lines and turns about one axis.

    fastest_m_per_s: from one pose to the next; what is faster is a leap: the frame stays until the later one.
    """

    def __init__(self, fastest_m_per_s: float) -> None:
        self._fastest_m_per_s = fastest_m_per_s
        self._poses: deque[Pose] = deque(maxlen=KEPT)

    @property
    def newest_ns(self) -> int | None:
        """Stamp of the newest pose; None: there is none."""
        return self._poses[-1].time_ns if self._poses else None

    def add(self, pose: Pose) -> str:
        """Add a pose; return why it was refused, empty if it was not."""
        if not all(map(math.isfinite, pose.position_m)) or not is_unit(pose.quaternion):
            return "not a pose"
        newest = self.newest_ns
        if newest is not None and pose.time_ns <= newest:
            return "repeated" if pose.time_ns == newest else "late"
        self._poses.append(pose)
        return ""

    def at(self, time_ns: int) -> Motion:
        """The motion at a time up to `newest_ns`; before all poses that are kept, at rest in the first."""
        k = bisect_left(self._poses, time_ns, key=lambda pose: pose.time_ns)
        second = self._poses[k]
        if k == 0:
            return Motion(second)
        first = self._poses[k - 1]
        span_s, part = 1e-9 * (second.time_ns - first.time_ns), 1.0
        x, y, z = (b - a for a, b in zip(first.position_m, second.position_m, strict=True))
        turn = rotation_between(first.quaternion, second.quaternion)
        if math.hypot(x, y, z) > self._fastest_m_per_s * span_s or math.hypot(*turn) > LARGEST_TURN_RAD:
            return Motion(second if time_ns == second.time_ns else first._replace(time_ns=time_ns))
        pose = second
        if time_ns < second.time_ns:
            part = (time_ns - first.time_ns) / (second.time_ns - first.time_ns)
            x0, y0, z0 = first.position_m
            turned_so_far = (part * turn[0], part * turn[1], part * turn[2])
            pose = Pose(
                time_ns,
                (x0 + part * x, y0 + part * y, z0 + part * z),
                product(quaternion_of(turned_so_far), first.quaternion),
            )
        return Motion(
            pose,
            (x / span_s, y / span_s, z / span_s),
            (turn[0] / span_s, turn[1] / span_s, turn[2] / span_s),
        )


class FrameTree:
    """Transforms between frames, as /tf has them, and the poses of some frames in the world that follow.

    Each transform may come at its own rate: a frame is known up to the time to which all that carry it are.
    """

    def __init__(self, world: str, frames: Collection[str], fastest_m_per_s: float) -> None:
        self._world, self._frames, self._fastest_m_per_s = world, frames, fastest_m_per_s
        self._parent: dict[str, str] = {}
        self._fixed: dict[str, Pose] = {}
        self._tracks: dict[str, PoseTrack] = {}
        self._given_ns: dict[str, int] = {}  # the last pose of each frame

    def add(self, parent: str, child: str, pose: Pose, *, fixed: bool) -> str:
        """Add a transform; return why it was refused, empty if it was not."""
        self._parent[child] = parent
        if fixed:
            self._fixed[child] = pose
            return ""
        return self._tracks.setdefault(child, PoseTrack(self._fastest_m_per_s)).add(pose)

    def poses(self) -> Iterator[tuple[str, Pose]]:
        """Poses of the frames, by name, that became known since the last call."""
        for frame in self._frames:
            way = self._way(frame)
            times = [self._tracks[child].newest_ns for child in way if child in self._tracks]
            known = [time for time in times if time is not None]
            if not known or len(known) < len(times) or min(known) <= self._given_ns.get(frame, -1):
                continue
            time_ns = self._given_ns[frame] = min(known)
            position, orientation = NONE, (0.0, 0.0, 0.0, 1.0)
            for child in reversed(way):
                track = self._tracks.get(child)
                step = track.at(time_ns).pose if track is not None else self._fixed[child]
                x, y, z = turned(orientation, step.position_m)
                position = (position[0] + x, position[1] + y, position[2] + z)
                orientation = product(orientation, step.quaternion)
            yield frame, Pose(time_ns, position, orientation)

    def _way(self, frame: str) -> list[str]:
        """Frames from this one to that in the world, empty while some are unknown."""
        way: list[str] = []
        while frame != self._world:
            if frame not in self._parent or frame in way:
                return []
            way.append(frame)
            frame = self._parent[frame]
        return way
