"""Replay of soil and machine for a page: a plotly figure with one animation frame for each shown moment."""

import math
from collections.abc import Iterator, Sequence
from html import escape

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray
from plotly.basedatatypes import BaseTraceType

from ..errors import RecordingError
from ..loading.loader import ResolvedScene
from ..recording.soil_clouds import soil_span_m
from ..yaml_document import Document
from .interactive_plots import NUMBER_BYTES
from .machine_shapes import COLOURS, Segments, Shapes
from .snapshots import Frame, Snapshots
from .soil_cut import SPEED_SCALE_M_PER_S

LARGEST_MOMENTS = 80
"""Most moments of a replay: at 10 a second it lasts 8 s, enough to follow a tool through a bin."""

MOMENT_S = 0.1
"""Shortest time for which a moment is shown: a browser needs about as long to draw 10,000 particles."""

_HEIGHT_PIXELS = 640
_UNIT_PIXELS = 284.0
"""Length on the screen of plotly's unit of a scene, with this camera and height (measured in a browser)."""

_LARGEST_UNITS = np.array([2.6, 2.0, 1.25])
"""Sides of a scene, x, y and z, that fit in the page at the first zoom."""

_CAMERA = {"eye": {"x": 0.5, "y": -1.6, "z": 0.7}, "projection": {"type": "orthographic"}}
_WIDTHS = {"body": 8, "spring": 10, "soil": 3}
_SCATTER = 2654435761  # 2^32 over the golden ratio: multiples of it spread evenly below 2^32 (Knuth)


def replay(snapshots: Snapshots, resolved: ResolvedScene, room_bytes: float) -> tuple[go.Figure, str]:
    """Figure of a run's moments in about `room_bytes` of JSON at most, and a text about what is left out.

    Moments are read one by one; memory is bounded by the part that is shown.

    Raises:
        RecordingError: the bag is damaged, or has no moment with all tools.
    """
    shapes, times = Shapes(resolved), snapshots.times_ns
    sample = list(_whole(snapshots, [times[0], times[len(times) // 2], times[-1]], resolved))
    if not sample:
        raise RecordingError("the bag has no moment with the motions of all tools")
    behind = max(int((frame.positions_m[:, 1] >= 0.0).sum()) for frame in sample)
    machine = _traces(sample[0], resolved, shapes, 0.0)
    fixed_bytes = 1000.0 + sum(NUMBER_BYTES * len(trace[axis]) for trace in machine for axis in "xyz")
    every = math.ceil(len(times) * max(1.0 / LARGEST_MOMENTS, 2.0 * fixed_bytes / room_bytes))
    shown = times[::every]
    particle_bytes = NUMBER_BYTES * (5 if behind and np.ptp(sample[0].radii_m) > 0.0 else 4)
    a_moment = room_bytes / (len(shown) + 1) - fixed_bytes  # the middle one is there twice
    part = min(1.0, a_moment / (particle_bytes * max(1, behind)))
    moments = [
        (frame.time_s, _traces(frame, resolved, shapes, part)) for frame in _whole(snapshots, shown, resolved)
    ]
    words = f"Shown: {len(moments)} of {len(times)} recorded moments"
    if behind:
        words += (
            f"; of the soil the half behind the mid-plane (y > 0), {100.0 * part:.3g} % of its {behind:,} "
            "particles at most, in their true size until you zoom"
        )
    if _follows(resolved):
        words += f"; the view travels with {next(iter(resolved.scene.tools))}"
    step_s = 1e-9 * (shown[-1] - shown[0]) / max(1, len(shown) - 1)
    if 0.0 < step_s < 0.9 * MOMENT_S:
        words += f"; played at least {MOMENT_S / step_s:.2g} times slower than simulated"
    return _animated(moments, max(step_s, MOMENT_S)), f"{words}."


def _whole(snapshots: Snapshots, times_ns: Sequence[int], resolved: ResolvedScene) -> Iterator[Frame]:
    """Moments that have all tools; the last of a killed run may be without them."""
    return (frame for frame in snapshots.read(times_ns) if len(frame.tools) == len(resolved.scene.tools))


def _follows(resolved: ResolvedScene) -> bool:
    """Whether the view moves with the tools, because soil exists only near them."""
    soil = resolved.scene.particle_soil
    return soil is not None and soil.window is not None


def _traces(frame: Frame, resolved: ResolvedScene, shapes: Shapes, part: float) -> list[BaseTraceType]:
    """One moment: a part of the particles behind the mid-plane, tools, lines of machine and bed."""
    scene, soil = resolved.scene, resolved.scene.particle_soil
    low, high = (0.0, 0.0) if soil is None else soil_span_m(frame.positions_m, soil)
    zero = frame.tools[0].x_m if _follows(resolved) else 0.0
    traces: list[BaseTraceType] = []
    if part > 0.0 and soil is not None:
        chosen = frame.identities * _SCATTER % 2**32 < part * 2**32
        traces.append(_particles(frame, chosen & (frame.positions_m[:, 1] >= 0.0), zero))
    for surface in shapes.surfaces(frame):
        i, j, k = surface.facets.T
        places = _places(surface.vertices_m, zero)
        style = {"color": COLOURS["tool"], "flatshading": True, "hoverinfo": "name"}
        traces.append(go.Mesh3d(**places, i=i, j=j, k=k, name=escape(surface.tool), **style))
    if scene.mechanism is not None:
        traces.append(_lines(np.concatenate([shapes.skeleton(frame), shapes.wheels(frame)]), zero, "body"))
        traces.append(_lines(shapes.springs(frame), zero, "spring"))
    if scene.soil is not None:
        size = scene.soil.bin
        span = (0.0, size.length_m) if soil is None else (low, high)
        traces.append(_lines(_box(span, size.width_m, size.depth_m), zero, "soil"))
    return traces


def _places(points_m: NDArray[np.floating], zero_m: float) -> dict[str, NDArray[np.float32]]:
    """Coordinates (n,) of points (n, 3), x from `zero_m`."""
    moved = np.asarray(points_m - np.array((zero_m, 0.0, 0.0)), np.float32)
    return {axis: np.ascontiguousarray(moved[:, column]) for column, axis in enumerate("xyz")}


def _particles(frame: Frame, keep: NDArray[np.bool_], zero_m: float) -> go.Scatter3d:
    """Points coloured by speed; marker.size holds diameters in metres."""
    diameters = 2.0 * frame.radii_m[keep]
    marker = {
        "color": frame.speeds_m_per_s[keep],
        "size": diameters if np.ptp(frame.radii_m) > 0.0 else float(2.0 * frame.radii_m[0]),
        "cmin": SPEED_SCALE_M_PER_S[0],
        "cmax": SPEED_SCALE_M_PER_S[1],
        "colorscale": "Viridis",
        "colorbar": {"title": "speed [m/s]", "len": 0.6},
        "opacity": 1.0,
        "line": {"width": 1, "color": "#303030"},
    }
    places = _places(frame.positions_m[keep], zero_m)
    hover = "%{marker.color:.3g} m/s<extra></extra>"
    return go.Scatter3d(**places, mode="markers", marker=marker, hovertemplate=hover)


def _lines(ends_m: Segments, zero_m: float, kind: str) -> go.Scatter3d:
    """Segments as one curve, with a gap of NaN between two of them."""
    gaps = np.full((len(ends_m) // 2, 1, 3), np.nan)
    points = np.concatenate([ends_m.reshape(-1, 2, 3), gaps], axis=1).reshape(-1, 3)
    line = {"color": COLOURS[kind], "width": _WIDTHS[kind]}
    return go.Scatter3d(**_places(points, zero_m), mode="lines", line=line, hoverinfo="skip", name=kind)


def _box(span_m: tuple[float, float], width_m: float, depth_m: float) -> Segments:
    """The twelve edges of the bed."""
    corners = np.array([(x, y, z) for x in span_m for y in (-0.5, 0.5) for z in (-1.0, 0.0)])
    corners *= (1.0, width_m, depth_m)
    pairs = [(a, b) for a in range(8) for b in (a ^ 1, a ^ 2, a ^ 4) if a < b]
    return corners[np.array(pairs).ravel()]


def _animated(moments: Sequence[tuple[float, list[BaseTraceType]]], step_s: float) -> go.Figure:
    """The moments with play, pause and a slider, the middle one first; sides in proportion, the same for
    all."""
    middle = len(moments) // 2
    every_trace = [trace for _, traces in moments for trace in traces]
    reach = [np.concatenate([trace[axis] for trace in every_trace]) for axis in "xyz"]
    lows, highs = (np.array([pick(places) for places in reach]) for pick in (np.nanmin, np.nanmax))
    margin = 0.03 * float((highs - lows).max())
    lows, highs = lows - margin, highs + margin
    units_per_m = float((_LARGEST_UNITS / (highs - lows)).min())
    for trace in every_trace:
        if _is_soil(trace):
            trace.marker.size = _UNIT_PIXELS * units_per_m * trace.marker.size
    names = [str(place) for place in range(len(moments))]
    frames = [
        go.Frame(name=name, data=[_moving(trace) for trace in traces], traces=list(range(len(traces))))
        for name, (_, traces) in zip(names, moments, strict=True)
    ]
    playing = {"frame": {"duration": 1e3 * step_s, "redraw": True}, "transition": {"duration": 0}}
    at_once = {"frame": {"duration": 0, "redraw": True}, "transition": {"duration": 0}, "mode": "immediate"}
    buttons = [
        {"label": "Play", "method": "animate", "args": [None, {**playing, "fromcurrent": True}]},
        {"label": "Pause", "method": "animate", "args": [[None], at_once]},
    ]
    steps = [
        {"label": f"{time_s:.3f}", "method": "animate", "args": [[name], at_once]}
        for name, (time_s, _) in zip(names, moments, strict=True)
    ]
    axes = {
        f"{axis}axis": {"range": [float(low), float(high)], "visible": False}
        for axis, low, high in zip("xyz", lows, highs, strict=True)
    }
    ratio = dict(zip("xyz", (units_per_m * (highs - lows)).tolist(), strict=True))
    layout = {
        "template": "none",
        "height": _HEIGHT_PIXELS,
        "margin": {"l": 0, "r": 0, "t": 0, "b": 120},
        "showlegend": False,
        "scene": {**axes, "aspectmode": "manual", "aspectratio": ratio, "camera": _CAMERA},
        "updatemenus": [{"type": "buttons", "buttons": buttons, "direction": "left", "x": 0.0, "y": 0.0,
                         "xanchor": "left", "yanchor": "top", "pad": {"t": 35}}],
        "sliders": [{"steps": steps, "active": middle, "x": 0.16, "len": 0.82, "y": 0.0,
                     "currentvalue": {"prefix": "t = ", "suffix": " s"}}],
    }  # fmt: skip
    return go.Figure(moments[middle][1], layout, frames)


def _moving(trace: BaseTraceType) -> Document:
    """The part of a trace that changes from moment to moment."""
    found = {"type": trace.type, "x": trace.x, "y": trace.y, "z": trace.z}
    if _is_soil(trace):
        found["marker"] = {"color": trace.marker.color, "size": trace.marker.size}
    return found


def _is_soil(trace: BaseTraceType) -> bool:
    return trace.type == "scatter3d" and trace.mode == "markers"
