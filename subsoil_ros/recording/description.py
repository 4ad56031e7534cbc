"""Latched messages, published once a run: URDF of the machine, surfaces of its tools.

Markers contain their triangles, so the tools can be shown from the bag alone; the URDF names mesh files.
"""

from typing import Any

import numpy as np

from ..loading.loader import ResolvedScene
from ..scene.tool_mesh import ToolMesh, load_tool_mesh
from .robot_description import in_body, robot_description
from .standard import body_frame, header, vector
from .topics import ROBOT_DESCRIPTION, TOOL_MARKERS
from .types import message_class

_SHARE_COLOUR, _WHEEL_COLOUR = (0.55, 0.57, 0.6, 1.0), (0.25, 0.25, 0.28, 1.0)
_TRIANGLE_LIST = 11  # visualization_msgs/Marker


def latched_messages(resolved: ResolvedScene) -> dict[str, Any]:
    """The message of each latched topic of a scene; tool markers only if it has tools.

    Raises:
        SceneError: a mesh cannot be read.
    """
    text = robot_description(resolved.scene)
    messages = {ROBOT_DESCRIPTION: message_class("std_msgs/msg/String")(data=text)}
    if resolved.scene.tools:
        messages[TOOL_MARKERS] = tool_markers(resolved)
    return messages


def tool_markers(resolved: ResolvedScene) -> Any:
    """visualization_msgs/MarkerArray: the triangles of each facet group, fixed in the frame of its body.

    Stamp 0: RViz then places them by the newest /tf.
    """
    markers = []
    for name in resolved.scene.tools:
        mesh = load_tool_mesh(resolved.directory, resolved.scene, name)
        for index, group in enumerate(mesh.groups):
            markers.append(_marker(resolved, name, mesh, index, f"{name}/{group}"))
    return message_class("visualization_msgs/msg/MarkerArray")(markers=markers)


def _marker(resolved: ResolvedScene, name: str, mesh: ToolMesh, index: int, label: str) -> Any:
    tool = resolved.scene.tools[name]
    mechanism = resolved.scene.mechanism
    angle_rad = mechanism.bodies[tool.body].angle_rad if mechanism is not None and tool.body else 0.0
    corners = mesh.vertices_m[mesh.facets[mesh.facet_group == index].reshape(-1)]
    points = []
    for x, y, z in corners.tolist():
        turned_x, turned_z = in_body(angle_rad, x, z)
        points.append(vector((turned_x, y - tool.lateral_m, turned_z), "Point"))  # /tf has the lateral offset
    red, green, blue, alpha = _SHARE_COLOUR if tool.is_tillage else _WHEEL_COLOUR
    no_header, no_bytes = header(0, ""), np.empty(0, np.uint8)
    return message_class("visualization_msgs/msg/Marker")(
        header=header(0, body_frame(resolved.scene, name)),
        ns=label,
        id=index,
        type=_TRIANGLE_LIST,
        action=0,
        pose=message_class("geometry_msgs/msg/Pose")(
            position=vector((0.0, 0.0, 0.0), "Point"),
            orientation=vector((0.0, 0.0, 0.0, 1.0), "Quaternion"),
        ),
        scale=vector((1.0, 1.0, 1.0)),
        color=message_class("std_msgs/msg/ColorRGBA")(r=red, g=green, b=blue, a=alpha),
        lifetime=message_class("builtin_interfaces/msg/Duration")(sec=0, nanosec=0),
        frame_locked=True,
        points=points,
        colors=[],
        texture_resource="",
        texture=message_class("sensor_msgs/msg/CompressedImage")(header=no_header, format="", data=no_bytes),
        uv_coordinates=[],
        text="",
        mesh_resource="",
        mesh_file=message_class("visualization_msgs/msg/MeshFile")(filename="", data=no_bytes),
        mesh_use_embedded_materials=False,
    )
