"""Particles as point clouds, and back."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..messages import SoilCloud
from .standard import header, time_ns_of
from .types import message_class

POINT_FIELDS = ("x", "y", "z", "speed")
_MORE = {
    "identity": "identities",
    "broken_part": "broken_parts",
    "radius": "radii_m",
    "material": "materials",
}
"""Optional fields of a point cloud, and the corresponding ones of SoilCloud."""

_WHOLE = ("identity", "material")
"""The fields that are uint32."""

_FLOAT32, _UINT32 = 7, 6  # sensor_msgs/PointField


def point_cloud(cloud: SoilCloud) -> Any:
    """sensor_msgs/PointCloud2 of the particles: x, y, z [m] and speed [m/s], float32, little-endian. With a
    window also their identity, uint32; with bonds, the part of the bonds that broke; with several sizes,
    their radius [m]; with layers, their material, uint32."""
    positions = np.asarray(cloud.positions_m)
    more: dict[str, Any] = {name: getattr(cloud, key) for name, key in _MORE.items()}
    names = (*POINT_FIELDS, *(name for name, values in more.items() if values is not None))
    points = np.empty((len(positions), len(names)), dtype="<f4")
    points[:, :3] = positions
    points[:, 3] = cloud.speeds_m_per_s
    for k, name in enumerate(names[4:], 4):
        points.view("<u4" if name in _WHOLE else "<f4")[:, k] = more[name]
    return points_message(cloud.end_time_ns, points[None], names, is_dense=True)


def points_message(time_ns: int, points: NDArray[Any], names: Sequence[str], *, is_dense: bool) -> Any:
    """sensor_msgs/PointCloud2 of points (rows, columns, fields) with named fields, little-endian: float32,
    and uint32 of _WHOLE.

    is_dense: no value is NaN.
    """
    rows, columns, _ = points.shape
    return message_class("sensor_msgs/msg/PointCloud2")(
        header=header(time_ns),
        height=rows,
        width=columns,
        fields=[
            message_class("sensor_msgs/msg/PointField")(
                name=name, offset=4 * i, datatype=_UINT32 if name in _WHOLE else _FLOAT32, count=1
            )
            for i, name in enumerate(names)
        ],
        is_bigendian=False,
        point_step=4 * len(names),
        row_step=4 * len(names) * columns,
        data=points.reshape(-1).view(np.uint8),
        is_dense=is_dense,
    )


def cloud_from_message(message: Any, communication_step_ns: int) -> SoilCloud:
    """The SoilCloud of a PointCloud2 made by `point_cloud`."""
    words = message.point_step // 4
    points = np.frombuffer(memoryview(message.data), dtype="<f4").reshape(-1, words)
    places = {field.name: field.offset // 4 for field in message.fields}
    more = {
        key: points.view("<u4" if name in _WHOLE else "<f4")[:, places[name]]
        for name, key in _MORE.items()
        if name in places
    }
    time_ns = time_ns_of(message.header.stamp)
    tick = time_ns // communication_step_ns - 1
    return SoilCloud(tick, time_ns, points[:, :3], points[:, 3], **more)
