"""Moments of a run for pictures: particles, tools and bodies at one time, read from its bag."""

from bisect import bisect_right
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..errors import RecordingError
from ..loading.loader import ResolvedScene
from ..messages import BodyState, MechanismState, SoilCloud, ToolMotion, ToolMotions
from ..recording.bag_reader import BagReader
from ..recording.joined import JoinedBags, open_record

RATE_HZ = 25.0
"""Moments per simulated second of a run without soil clouds: the rate of a film."""


@dataclass(frozen=True)
class Frame:
    """One moment, world axes. Without particles their arrays are empty."""

    time_s: float
    positions_m: NDArray[np.float32]  # (n, 3)
    speeds_m_per_s: NDArray[np.float32]  # (n,)
    displacements_m: NDArray[np.float32]  # (n,) from the first cloud that has the particle; nan where unknown
    broken_parts: NDArray[np.float32]  # (n,) of the bonds of each; nan where there are none
    radii_m: NDArray[np.float32]  # (n,) the mean radius of all particles where the cloud has none
    identities: NDArray[np.uint64]  # (n,) the same at all times; places in the list in a fixed set
    tools: tuple[ToolMotion, ...]
    bodies: tuple[BodyState, ...]  # of the machine, at the last recorded state up to then


class Snapshots:
    """The moments of a run, read one by one: memory is bounded by one of them."""

    def __init__(self, bag: Path, resolved: ResolvedScene) -> None:
        """Read the times of a bag.

        Raises:
            InputError: there is no bag.
            RecordingError: it is damaged, or nothing in it can be shown.
        """
        self._reader: BagReader | JoinedBags = open_record(bag)
        self._resolved = resolved
        self.has_particles = bool(clouds := self._reader.cloud_times_ns())
        self.times_ns: list[int] = (
            clouds if self.has_particles else _thinned(_times_ns(self._reader, ToolMotions))
        )
        if not self.times_ns:
            raise RecordingError(f"{self._reader.path}: no moment is in it that could be shown")

    def nearest_ns(self, time_s: float) -> int:
        """The moment nearest to a time."""
        return min(self.times_ns, key=lambda time_ns: abs(time_ns - time_s * 1e9))

    def read(self, times_ns: Sequence[int]) -> Iterator[Frame]:
        """Yield the moments at `times_ns`, in order of time."""
        wanted = sorted(set(times_ns))
        tools, states, state_at = self._machine(wanted)
        soil, terrain, radius = self._resolved.scene.particle_soil, self._resolved.scene.terrain_soil, 0.0
        if soil is not None:
            radius = soil.particles.mean_volume_radius_m
        elif terrain is not None:
            radius = 0.5 * terrain.cell_m
        for time_ns, cloud, displacements in self._clouds(wanted):
            count = len(np.asarray(cloud.positions_m))
            radii = np.full(count, radius) if cloud.radii_m is None else cloud.radii_m
            identities = range(count) if cloud.identities is None else cloud.identities
            broken = np.full(count, np.nan) if cloud.broken_parts is None else cloud.broken_parts
            yield Frame(
                time_s=time_ns * 1e-9,
                positions_m=np.asarray(cloud.positions_m, dtype=np.float32).reshape(-1, 3),
                speeds_m_per_s=np.asarray(cloud.speeds_m_per_s, dtype=np.float32),
                displacements_m=displacements,
                broken_parts=np.asarray(broken, dtype=np.float32),
                radii_m=np.asarray(radii, dtype=np.float32),
                identities=np.asarray(identities, dtype=np.uint64),
                tools=tools[time_ns].tools if time_ns in tools else (),
                bodies=states[state_at[time_ns]].bodies if time_ns in state_at else (),
            )

    def _machine(
        self, wanted: Sequence[int]
    ) -> tuple[dict[int, ToolMotions], dict[int, MechanismState], dict[int, int]]:
        """Motions by time, states by time, and the time of the last state up to each of `wanted`."""
        kinds: list[type] = [ToolMotions]
        state_at: dict[int, int] = {}
        if self._resolved.scene.mechanism is not None:
            kinds.append(MechanismState)
            times = _times_ns(self._reader, MechanismState)
            places = [(time_ns, bisect_right(times, time_ns)) for time_ns in wanted]
            state_at = {time_ns: times[place - 1] for time_ns, place in places if place}
        chosen = {*wanted, *state_at.values()}
        tools: dict[int, ToolMotions] = {}
        states: dict[int, MechanismState] = {}
        for record in self._reader.records(*kinds, at=lambda time: time in chosen):
            if isinstance(record, ToolMotions):
                tools[record.end_time_ns] = record
            else:
                states[record.end_time_ns] = record
        return tools, states, state_at

    def _clouds(self, wanted: Sequence[int]) -> Iterator[tuple[int, SoilCloud, NDArray[np.float32]]]:
        if not self.has_particles:
            for time_ns in wanted:
                yield time_ns, SoilCloud(0, time_ns, [], []), np.empty(0, dtype=np.float32)
            return
        soil = self._resolved.scene.particle_soil
        axes = [0, 2] if soil is not None and soil.bin.sides == "periodic" else [0, 1, 2]
        of_window = soil is not None and soil.window is not None
        nameless = not of_window and self._resolved.scene.record.cloud_region is not None  # come and go
        times = {self.times_ns[0], *wanted}
        first: NDArray[np.float64] = np.empty((0, 3))  # place of every particle where it was first recorded
        for cloud in self._reader.clouds(
            self._resolved.timing.communication_step_ns,
            at=lambda time: time in times or (of_window and time <= max(times)),
        ):
            positions = np.asarray(cloud.positions_m, dtype=np.float64).reshape(-1, 3)
            names = np.arange(len(positions)) if cloud.identities is None else np.asarray(cloud.identities)
            moved = np.full(len(positions), np.nan, dtype=np.float32)
            unlike = cloud.identities is None and len(first) not in (
                0,
                len(positions),
            )
            if len(positions) and not (nameless or unlike):
                missing = max(0, int(names.max()) + 1 - len(first))
                first = np.concatenate([first, np.full((missing, 3), np.nan)])
                start = np.where(np.isnan(first[names]), positions, first[names])
                first[names] = start
                moved = np.linalg.norm((positions - start)[:, axes], axis=1).astype(np.float32)
            if cloud.end_time_ns in wanted:
                yield cloud.end_time_ns, cloud, moved


def _times_ns(reader: BagReader | JoinedBags, kind: type) -> list[int]:
    """Times of all records of a kind [ns], without decoding them."""
    found: list[int] = []

    def passed(time_ns: int) -> bool:
        found.append(time_ns)
        return False

    for _ in reader.records(kind, at=passed):
        pass
    return found


def _thinned(times_ns: list[int]) -> list[int]:
    """Every n-th time, such that RATE_HZ of them are left per second, and the last."""
    if len(times_ns) < 2:
        return times_ns
    every = max(1, round(1e9 / RATE_HZ / (times_ns[1] - times_ns[0])))
    return sorted({*times_ns[every - 1 :: every], times_ns[-1]})
