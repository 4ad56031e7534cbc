"""Check of a bag with an independent viewer: rerun opens it and takes a picture.

rerun's own MCAP importer reads the bag; its layout contains: soil, tools and bodies in space, and
curves of draft, spring force, share angle, height and energy residual from the fields of our messages. The
viewer runs without a screen, on Vulkan in software (lavapipe):

    apt install mesa-vulkan-drivers libvulkan1          # Debian, once
    pip install rerun-sdk                               # 0.41 or later
    python -m dev.rerun_picture runs/quick --out docs/pictures/rerun.png

It fails unless every view of the picture has something in it: earth-coloured pixels where the soil is, pixels
in the colour of the line in each of the plots, and no error message of the viewer.
"""

import argparse
import io
import os
import socket
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from matplotlib.image import imread
from rerun.blueprint.encodings import ComponentSourceKind, VisualizerComponentMapping
from rerun.experimental import ViewerClient

from subsoil_ros.loading.loader import load_scene
from subsoil_ros.messages import MechanismState
from subsoil_ros.recording.bag_reader import BagReader, mcap_path

STATE, REPORT, CLOUD = "/subsoil/mechanism_state", "/subsoil/coupling_report", "/subsoil/soil/points"
EARTH, LINE = (150, 108, 62), (64, 200, 190)  # of soil and curves (chosen: nothing else has them)
CURVES = 5
LIMIT_S = 120.0
"""Time for the viewer to load and draw on a slow machine."""


def curve(topic: str, kind: str, field: str, name: str) -> rrb.TimeSeriesView:
    """A plot of one field of one of our messages."""
    source = VisualizerComponentMapping(
        target="Scalars:scalars",
        source_kind=ComponentSourceKind.SourceComponent,
        source_component=f"subsoil_msgs.msg.{kind}:message",
        selector=field,
    )
    lines = rr.SeriesLines(names=name, colors=LINE, widths=2.0).visualizer(mappings=[source])
    return rrb.TimeSeriesView(origin=topic, name=name, overrides={topic: [lines]})


def layout(state: MechanismState, shank: str, spring: str, radius_m: float) -> rrb.Blueprint:
    """What is shown: soil and machine on the left, five curves on the right."""
    body = [item.name for item in state.bodies].index(shank)
    force = [item.name for item in state.forces].index(spring)
    soil = rr.Points3D.from_fields(radii=radius_m, colors=EARTH)
    eye = rrb.EyeControls3D(position=(-0.3, -2.3, 1.0), look_target=(0.45, 0.0, 0.05), eye_up=(0.0, 0.0, 1.0))
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Spatial3DView(
                origin="/", name="soil and machine", overrides={CLOUD: [soil]}, eye_controls=eye
            ),
            rrb.Vertical(
                curve(STATE, "MechanismState", ".draft_newton", "draft [N]"),
                curve(STATE, "MechanismState", f".forces[{force}].load", "spring force [N]"),
                curve(STATE, "MechanismState", f".bodies[{body}].angle_rad", "share angle [rad]"),
                curve(STATE, "MechanismState", f".bodies[{body}].z_m", "height of the shank [m]"),
                curve(REPORT, "CouplingReport", ".residual_ratio", "energy residual / work"),
            ),
            column_shares=[3, 2],
        ),
        rrb.TimePanel(state="collapsed", timeline="message_log_time"),
        collapse_panels=True,
    )


def imported(run: Path, rrd: Path) -> None:
    """Lets rerun import the bag of a run into `rrd`, with the layout."""
    resolved = load_scene(run / "scene.yaml")
    report, soil = resolved.scene.report, resolved.scene.particle_soil
    state = next(BagReader(run).records(MechanismState), None)
    if soil is None or state is None or report.shank is None or report.spring is None:
        sys.exit(f"{run}: must be a run of a machine in soil of particles that names its shank and spring")
    recording = rr.RecordingStream("subsoil")
    shown = layout(state, report.shank, report.spring, soil.particles.mean_volume_radius_m)
    recording.save(str(rrd), default_blueprint=shown)
    recording.log_file_from_path(str(mcap_path(run)))
    recording.flush()
    recording.disconnect()


def coloured(png: bytes, colour: tuple[int, int, int]) -> int:
    """Pixels of a picture that have the hue of `colour`: light and shade change its brightness alone."""
    pixels = imread(io.BytesIO(png), format="png")[..., :3].reshape(-1, 3)
    wanted = np.array(colour) / np.linalg.norm(colour)
    brightness = np.linalg.norm(pixels, axis=1)
    likeness = pixels @ wanted / np.maximum(brightness, 1e-9)
    return int(np.sum((likeness > 0.995) & (brightness > 0.25)))


def what_is_missing(viewer: ViewerClient) -> list[str]:
    """What a view complains of, or does not show."""
    state = viewer.get_state()
    views = [view for view in state.views if view.visible]
    if state.loading or sum(view.view_class == "TimeSeries" for view in views) != CURVES:
        return ["the layout is not there yet"]
    missing = []
    for view in views:
        try:
            png = viewer.take_screenshot(view.view_id)
        except ConnectionError as error:  # not painted yet
            return [f"{view.name}: {error}"]
        colour, least = (EARTH, 2000) if view.view_class == "3D" else (LINE, 100)
        count = coloured(png, colour)
        print(f"{view.name}: {count} pixels in the colour of what it shows")
        if count < least:
            missing.append(f"{view.name}: {count} such pixels, needed are {least}")
        missing += [f"{view.name}: {complaint}" for complaint in view.reports]
    return missing


def picture(rrd: Path, out: Path) -> list[str]:
    """Opens `rrd` without a screen, saves the picture, and tells what is missing in it."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    viewer = ViewerClient.spawn(
        headless=True, port=port, executable_path=str(Path(sys.executable).with_name("rerun"))
    )
    try:
        viewer.open([str(rrd)])
        deadline = time.monotonic() + LIMIT_S
        while True:
            missing = what_is_missing(viewer)
            if not missing or time.monotonic() > deadline:
                break
            time.sleep(1.0)
        out.parent.mkdir(parents=True, exist_ok=True)
        out.write_bytes(viewer.take_screenshot(max_size=1600))
        return missing
    finally:
        viewer.quit()


def main() -> int:
    """Exit status 0 if the picture shows soil and curves."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("run", type=Path, help="folder of a run of a machine in soil of particles")
    parser.add_argument("--out", type=Path, required=True, help="the picture (.png)")
    args = parser.parse_args()
    os.environ.setdefault("AMENT_PREFIX_PATH", sys.prefix)  # where the URDF's meshes are looked for
    with tempfile.TemporaryDirectory(prefix="subsoil_rerun_") as folder:
        rrd = Path(folder) / "bag.rrd"
        imported(args.run, rrd)
        missing = picture(rrd, args.out)
    for line in missing:
        print(f"missing: {line}", file=sys.stderr)
    return 1 if missing else 0


if __name__ == "__main__":
    raise SystemExit(main())
