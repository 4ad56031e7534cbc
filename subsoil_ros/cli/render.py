"""subsoil render RECORD: pictures or a film of soil and machine, or VTK files of them."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import InputError
from ..extras import require
from ..figures import VIEWS
from .arguments import RECORD_HELP

if TYPE_CHECKING:
    from ..api.read import RecordedRun
    from ..figures.snapshots import Snapshots

SMALLEST_PIXELS, LARGEST_PIXELS = 64, 7680
"""Smallest and largest side of a picture: a thumbnail; 8K, within the limits of H.264."""

STRIP = 0.3
"""Part of a film's height for the draft under it."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("record", type=Path, help=RECORD_HELP)
    parser.add_argument(
        "--view",
        choices=VIEWS,
        help="longitudinal: the bed cut along its mid-plane, from the side; cross: cut at the tip of the "
        "tool, from the front; corner: cut along the mid-plane, from the front and above; above. Default: "
        "all of them; of a film, longitudinal",
    )
    parser.add_argument(
        "--at",
        type=float,
        nargs="+",
        metavar="S",
        help="simulated times of the pictures [s], the nearest recorded moments (default: the middle); of a "
        "film, its first and its last (default: all)",
    )
    parser.add_argument(
        "--colour",
        choices=("speed", "displacement", "height", "broken"),
        help="of the particles; displacement is from the first recorded moment, height above z = 0, broken "
        "the part of a particle's bonds that broke (default: speed; of a terrain height, its only one)",
    )
    parser.add_argument(
        "--range",
        dest="limits",
        type=float,
        nargs=2,
        metavar=("LOW", "HIGH"),
        help="of the colours (default: 0 to the speed of the tools, 0 to 5 particle diameters, the depth of "
        "the tools below and above z = 0, 0 to 1)",
    )
    parser.add_argument(
        "--size",
        type=int,
        nargs=2,
        default=(1280, 720),
        metavar=("W", "H"),
        help="pixels (default: 1280 720)",
    )
    parser.add_argument("--film", type=Path, metavar="FILE", help="write the moments as FILE, .mp4 or .gif")
    parser.add_argument(
        "--fps", type=float, metavar="N", help="pictures a second of a film (default: real time)"
    )
    parser.add_argument(
        "--draft", action="store_true", help="draw the draft up to each moment under a film's pictures"
    )
    parser.add_argument(
        "--vtk", type=Path, metavar="FOLDER", help="write all moments as .vtp files into a new FOLDER"
    )


def run(args: argparse.Namespace) -> int:
    """Draw the pictures, film or VTK files."""
    _check(args)
    require("drawing", "imageio", "imageio_ffmpeg", "matplotlib", "pyvista", "vtkmodules")
    from ..api.read import recorded_run

    with recorded_run(args.record) as recorded:
        soil = recorded.resolved.scene.particle_soil
        if args.colour == "broken" and (soil is None or soil.bonds is None):
            raise InputError(f"--colour broken: the soil of {args.record} has no bonds; leave it out")
        usual = "speed" if recorded.resolved.scene.terrain_soil is None else "height"
        if usual == "height" and args.colour not in (None, usual):
            raise InputError(f"--colour {args.colour}: {args.record} has a terrain; leave it out")
        args.colour = args.colour or usual
        return _render(args, recorded)


def _render(args: argparse.Namespace, recorded: RecordedRun) -> int:
    from ..figures.snapshots import Snapshots
    from .progress import working

    with working("reading the bag"):
        frames = Snapshots(recorded.bag, recorded.resolved)
    try:
        if args.vtk is not None:
            _write_vtk(args, recorded, frames)
        if args.film is not None or args.vtk is None:
            _draw(args, recorded, frames)
    except OSError as error:
        raise InputError(f"{error.filename}: cannot be written ({error.strerror})") from error
    return 0


def _check(args: argparse.Namespace) -> None:
    for pixels in args.size:
        if not SMALLEST_PIXELS <= pixels <= LARGEST_PIXELS or pixels % 2:
            raise InputError(
                f"--size: given {args.size[0]} {args.size[1]}, allowed are even numbers from "
                f"{SMALLEST_PIXELS} to {LARGEST_PIXELS}"
            )
    if args.limits is not None and not args.limits[0] < args.limits[1]:
        raise InputError(f"--range: given {args.limits[0]:g} {args.limits[1]:g}; the lower value comes first")
    if args.fps is not None and not 0.0 < args.fps <= 240.0:
        raise InputError(f"--fps: given {args.fps:g}, allowed is more than 0, up to 240")
    if args.fps is not None and args.film is None:
        raise InputError("--fps: is of a film; give --film FILE as well")
    if args.draft and args.film is None:
        raise InputError("--draft: is of a film; give --film FILE as well")
    if args.film is not None and args.at is not None and (len(args.at) != 2 or args.at[0] >= args.at[1]):
        given = " ".join(f"{time:g}" for time in args.at)
        raise InputError(f"--at: given {given}, a film needs its first and its last time, or no --at for all")
    if args.film is not None and args.film.suffix not in (".mp4", ".gif"):
        raise InputError(f"--film {args.film}: its ending is '{args.film.suffix}', allowed are .mp4 and .gif")
    if args.film is not None and not args.film.parent.is_dir():
        raise InputError(f"--film {args.film}: its folder is not there; make it, or name another")
    if args.vtk is not None and args.vtk.exists():
        raise InputError(f"--vtk {args.vtk}: exists already; nothing is written over, name another folder")


def _draw(args: argparse.Namespace, recorded: RecordedRun, frames: Snapshots) -> None:
    from ..analysis.series import read_series
    from ..figures.draft_strip import DraftStrip
    from ..figures.renderer import Renderer, Style, default_limits, save_film, save_pictures
    from .progress import counted

    given = args.limits
    limits = (given[0], given[1]) if given is not None else default_limits(recorded.resolved, args.colour)
    width, height = args.size
    strip_height = round(STRIP * height / 2) * 2 if args.draft else 0
    style = Style(args.colour, limits, (width, height - strip_height))
    renderer = Renderer(recorded.resolved, style)
    if args.film is not None:
        first, last = (
            (frames.times_ns[0], frames.times_ns[-1]) if args.at is None else map(frames.nearest_ns, args.at)
        )
        shown = [time_ns for time_ns in frames.times_ns if first <= time_ns <= last]
        with counted("drawing", len(shown)) as done:
            strip = None
            if args.draft:
                series = read_series(recorded.bag, recorded.resolved.scene)
                strip = DraftStrip(series, (width, strip_height), first * 1e-9, last * 1e-9)
            rate = save_film(frames, renderer, shown, args.view or VIEWS[0], args.film, args.fps, done, strip)
        print(f"{args.film}: {len(shown)} pictures, {rate:g} a second")
        return
    middle_s = 0.5e-9 * (frames.times_ns[0] + frames.times_ns[-1])
    times = sorted({frames.nearest_ns(time_s) for time_s in args.at or [middle_s]})
    views = [args.view] if args.view else list(VIEWS)
    recorded.make_directory()
    with counted("drawing", len(times) * len(views)) as done:
        paths = save_pictures(frames, renderer, times, views, recorded.directory / "pictures", done)
    for path in paths:
        print(path)


def _write_vtk(args: argparse.Namespace, recorded: RecordedRun, frames: Snapshots) -> None:
    from ..figures.renderer import write_vtk_series
    from .progress import counted

    with counted("writing VTK files", len(frames.times_ns)) as done:
        paths = write_vtk_series(recorded.resolved, frames, args.vtk, done)
    for path in paths:
        print(path)
