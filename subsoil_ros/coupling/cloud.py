"""The soil's cloud as it is recorded: whole or a region, and rounded for compression, as the scene sets."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..messages import SoilCloud
from ..scene.record import SPEED_BITS, Record, position_step_m

MORE = ("identities", "broken_parts", "radii_m", "materials")
"""Optional fields of a cloud, beside position and speed of each particle."""

_SIGNIFICANT_BITS = 24  # of a float32


def recorded_cloud(cloud: SoilCloud, record: Record) -> SoilCloud:
    """The part of `cloud` that the scene records; `cloud` itself without region and resolution."""
    if record.cloud_region is None and record.cloud_resolution_m == 0.0:
        return cloud
    positions = np.asarray(cloud.positions_m, dtype=np.float32)
    speeds = np.asarray(cloud.speeds_m_per_s, dtype=np.float32)
    more: dict[str, Any] = {name: getattr(cloud, name) for name in MORE}
    if record.cloud_region is not None:
        inside = np.ones(len(positions), dtype=bool)
        for axis, span in enumerate(record.cloud_region.spans_m):
            if span is not None:
                inside &= (positions[:, axis] >= span[0]) & (positions[:, axis] <= span[1])
        positions, speeds = positions[inside], speeds[inside]
        more = {name: None if values is None else values[inside] for name, values in more.items()}
    if record.cloud_resolution_m > 0.0:
        positions = _rounded(positions, position_step_m(record.cloud_resolution_m))
        speeds = _shortened(speeds, SPEED_BITS)
    return SoilCloud(cloud.tick, cloud.end_time_ns, positions, speeds, **more)


def _rounded(values: NDArray[np.float32], step: float) -> NDArray[np.float32]:
    """The nearest multiples of a power of two, by exact operations: the same bits on every machine."""
    scale = np.float32(step)
    return np.rint(values / scale) * scale


def _shortened(values: NDArray[np.float32], bits: int) -> NDArray[np.float32]:
    """The nearest float32 with `bits` significant bits; `values` must not be negative."""
    dropped = _SIGNIFICANT_BITS - bits
    words: NDArray[Any] = values.view(np.uint32) + np.uint32(1 << (dropped - 1))  # carries into the exponent
    return (words & np.uint32(0xFFFFFFFF ^ ((1 << dropped) - 1))).view(np.float32)
