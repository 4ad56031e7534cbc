"""Stamped poses: of one frame by time, and of frames in a tree of transforms."""

import math
from bisect import bisect_left
from collections import deque
from collections.abc import Collection, Iterator
from typing import NamedTuple

from ...rotations import Quaternion, Vector, product, quaternion_of, rotation_between, turned

KEPT = 4096
"""Poses of each transform that are kept: four seconds of one that is published a thousand times a second."""

LARGEST_TURN_RAD, FASTEST_RAD_PER_S = 1.0, 300.0
"""Turn from one pose to the next that counts as a leap, and its rate: poses at 30 Hz tell 30 rad/s, a fast
rotor's, and their stamps may be ten times nearer to each other than the poses were."""

LENGTH_TOLERANCE = 0.01
"""Of a quaternion: people write 0.7071."""

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


def proper(pose: Pose) -> Pose | None:
    """The pose with a quaternion of length 1; None if its numbers are not finite, or it is no rotation."""
    length = math.hypot(*pose.quaternion)
    if not all(map(math.isfinite, pose.position_m)) or not abs(length - 1.0) <= LENGTH_TOLERANCE:
        return None
    x, y, z, w = pose.quaternion
    return pose._replace(quaternion=(x / length, y / length, z / length, w / length))


class PoseTrack:
    """Poses of one frame in the order of their stamps, joined by straight lines and turns about one axis.

    fastest_m_per_s: from one pose to the next; what is faster is a leap: the frame stays until the later one.
    kept: most poses that are kept; None: all that are not forgotten.
    """

    def __init__(self, fastest_m_per_s: float, kept: int | None = None) -> None:
        self._fastest_m_per_s = fastest_m_per_s
        self._poses: deque[Pose] = deque(maxlen=kept)

    @property
    def oldest_ns(self) -> int | None:
        """Stamp of the oldest pose that is kept; None: there is none."""
        return self._poses[0].time_ns if self._poses else None

    @property
    def newest_ns(self) -> int | None:
        """Stamp of the newest pose; None: there is none."""
        return self._poses[-1].time_ns if self._poses else None

    def add(self, pose: Pose) -> str:
        """Add a pose; return why it was refused, empty if it was not."""
        found, newest = proper(pose), self.newest_ns
        if found is None:
            return "not a pose"
        if newest is not None and pose.time_ns <= newest:
            return "repeated" if pose.time_ns == newest else "late"
        self._poses.append(found)
        return ""

    def forget(self, before_ns: int) -> None:
        """Drop the poses that no motion at `before_ns` or later needs."""
        while len(self._poses) > 1 and self._poses[1].time_ns <= before_ns:
            self._poses.popleft()

    def stamps(self, after_ns: int, to_ns: int) -> list[int]:
        """Stamps of its poses later than `after_ns`, up to `to_ns`."""
        return [pose.time_ns for pose in self._poses if after_ns < pose.time_ns <= to_ns]

    def over(self, time_ns: int, interval_ns: int) -> Motion:
        """The motion at a time, with mean rates over the interval before it, unless the frame leaps there."""
        before, after = self.at(time_ns - interval_ns).pose, self.at(time_ns)
        to_s = 1e9 / interval_ns
        x, y, z = (to_s * (b - a) for a, b in zip(before.position_m, after.pose.position_m, strict=True))
        turn = rotation_between(before.quaternion, after.pose.quaternion)
        if self._is_leap(math.hypot(x, y, z), math.hypot(*turn), 1.0 / to_s):
            return after
        return Motion(after.pose, (x, y, z), (to_s * turn[0], to_s * turn[1], to_s * turn[2]))

    def _is_leap(self, speed_m_per_s: float, turn_rad: float, span_s: float) -> bool:
        fast = speed_m_per_s > self._fastest_m_per_s or turn_rad > FASTEST_RAD_PER_S * span_s
        return fast or turn_rad > LARGEST_TURN_RAD

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
        if self._is_leap(math.hypot(x, y, z) / span_s, math.hypot(*turn), span_s):
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

    Each transform may come at its own rate: a frame is known up to the time to which all that carry it are,
    and has a pose at each of their stamps.
    """

    def __init__(self, world: str, frames: Collection[str], fastest_m_per_s: float) -> None:
        self._world, self._frames, self._fastest_m_per_s = world, frames, fastest_m_per_s
        self._parent: dict[str, str] = {}
        self._fixed: dict[str, Pose] = {}
        self._tracks: dict[str, PoseTrack] = {}
        self._given_ns: dict[str, int] = {}  # the last pose of each frame

    def add(self, parent: str, child: str, pose: Pose, *, fixed: bool) -> str:
        """Add a transform; return why it was refused, empty if it was not."""
        if fixed:
            found = proper(pose)
            if found is None:
                return "not a pose"
            self._fixed[child] = found
        else:
            track = self._tracks.setdefault(child, PoseTrack(self._fastest_m_per_s, KEPT))
            if cause := track.add(pose):
                return cause
        self._parent[child] = parent
        return ""

    def poses(self) -> Iterator[tuple[str, Pose]]:
        """Poses of the frames, by name, that became known since the last call."""
        for frame in self._frames:
            way = self._way(frame)
            tracks = [self._tracks[child] for child in way if child in self._tracks]
            newest = [track.newest_ns for track in tracks if track.newest_ns is not None]
            if not newest or len(newest) < len(tracks):
                continue
            to_ns = min(newest)
            oldest_ns = max(track.oldest_ns or 0 for track in tracks)  # before it, some are not known
            after_ns = max(self._given_ns.get(frame, -1), oldest_ns - 1)
            for time_ns in sorted({stamp for track in tracks for stamp in track.stamps(after_ns, to_ns)}):
                self._given_ns[frame] = time_ns
                yield frame, self._pose(way, time_ns)

    def _pose(self, way: list[str], time_ns: int) -> Pose:
        """Of the first frame of a way in the world."""
        position, orientation = NONE, (0.0, 0.0, 0.0, 1.0)
        for child in reversed(way):
            track = self._tracks.get(child)
            step = track.at(time_ns).pose if track is not None else self._fixed[child]
            x, y, z = turned(orientation, step.position_m)
            position = (position[0] + x, position[1] + y, position[2] + z)
            orientation = product(orientation, step.quaternion)
        return Pose(time_ns, position, orientation)

    def _way(self, frame: str) -> list[str]:
        """Frames from this one to that in the world, empty while some are unknown."""
        way: list[str] = []
        while frame != self._world:
            if frame not in self._parent or frame in way:
                return []
            way.append(frame)
            frame = self._parent[frame]
        return way
