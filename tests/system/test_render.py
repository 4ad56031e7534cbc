"""Pictures, films and VTK files of a run: what stands where, in which colour, at what time."""

import argparse
import json
import shutil
from pathlib import Path

import imageio_ffmpeg
import numpy as np
import pytest
import pyvista
from PIL import Image

from subsoil_ros.cli import new, render, run
from subsoil_ros.cli.main import main
from subsoil_ros.errors import InputError
from subsoil_ros.figures import VIEWS
from subsoil_ros.figures.renderer import Renderer, Style, default_limits
from subsoil_ros.figures.snapshots import Frame, Snapshots
from subsoil_ros.loading.loader import ResolvedScene, load_scene
from subsoil_ros.messages import ToolMotions
from subsoil_ros.recording.bag_reader import BagReader

SIZE = (640, 360)
LIMITS = (0.0, 0.2)
TEMPLATE_CLOUDS = 5


def verb(module, *words: object) -> int:
    parser = argparse.ArgumentParser()
    module.add_arguments(parser)
    return module.run(parser.parse_args([str(word) for word in words]))


@pytest.fixture(scope="module")
def recorded(tmp_path_factory) -> Path:
    """The folder of a run of a machine in soil, 10 ms with a cloud every 2 ms."""
    folder = tmp_path_factory.mktemp("render")
    verb(new, folder / "scene", "--template", "machine")
    changes = ["duration_s=0.0101", "record.cloud_hz=500", "record.series_ticks=5"]
    words = [word for change in changes for word in ("--set", change)]
    verb(run, folder / "scene/scene.yaml", "--out", folder / "run", "--mode", "direct", *words)
    return folder / "run"


@pytest.fixture(scope="module")
def resolved(recorded) -> ResolvedScene:
    return load_scene(recorded / "scene.yaml")


def block(x: tuple[float, float], y: tuple[float, float], speed: float) -> tuple[np.ndarray, np.ndarray]:
    """Particles on a fine grid in a part of the bin, all at one speed."""
    axes = [np.arange(low + 0.01, high, 0.015) for low, high in (x, y, (-0.27, 0.0))]
    places = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 3).astype(np.float32)
    return places, np.full(len(places), speed, dtype=np.float32)


def made_up(*blocks: tuple[np.ndarray, np.ndarray]) -> Frame:
    """A moment with these particles and no machine."""
    places, speeds = (np.concatenate(parts) for parts in zip(*blocks, strict=True))
    zeros = np.zeros_like(speeds)
    return Frame(0.0, places, speeds, zeros, zeros, np.full_like(speeds, 0.01), zeros, (), ())


def is_soil(pixel: np.ndarray) -> bool:
    """Whether a pixel has a colour, unlike background, tool and text."""
    return int(np.ptp(pixel.astype(int))) > 40


def is_fast(pixel: np.ndarray) -> bool:
    """Whether a pixel is of the upper end of the colours (yellow), not of the lower one (violet)."""
    return int(pixel[0]) > int(pixel[2])


def pixel(picture: np.ndarray, right: float, up: float) -> np.ndarray:
    """The brightest-coloured pixel near a place, as parts of the picture from its lower left corner."""
    column, row = round(right * picture.shape[1]), round((1.0 - up) * picture.shape[0])
    near = picture[row - 4 : row + 5, column - 4 : column + 5].reshape(-1, 3)
    return near[np.argmax(np.ptp(near.astype(int), axis=1))]


def test_frames_are_what_was_recorded(recorded, resolved):
    """Every cloud is a moment, with the poses of its tick; displacement is counted from the first."""
    frames = Snapshots(recorded / "bag", resolved)
    reader = BagReader(recorded)
    assert frames.times_ns == reader.cloud_times_ns()
    clouds = {c.end_time_ns: c for c in reader.clouds(resolved.timing.communication_step_ns)}
    motions = {m.end_time_ns: m for m in reader.records(ToolMotions)}
    found = list(frames.read(frames.times_ns))
    assert len(found) == len(clouds) >= TEMPLATE_CLOUDS
    first = np.asarray(clouds[frames.times_ns[0]].positions_m)
    for time_ns, frame in zip(frames.times_ns, found, strict=True):
        assert frame.time_s == time_ns * 1e-9
        np.testing.assert_array_equal(frame.positions_m, clouds[time_ns].positions_m)
        moved = np.linalg.norm(np.asarray(clouds[time_ns].positions_m) - first, axis=1)
        np.testing.assert_allclose(frame.displacements_m, moved, rtol=1e-6)
        assert frame.tools == motions[time_ns].tools
        assert {body.name for body in frame.bodies} == {"trolley", "tine"}
    assert found[0].displacements_m.max() == 0.0


@pytest.mark.parametrize("radius", [0.02, 0.06])
def test_particles_are_drawn_in_their_own_size(radius, resolved):
    """Diameter in pixels of one particle beside a small one, to two pixels."""
    places = np.array([[0.45, 0.05, -0.13], [0.1, 0.05, -0.13]], "f4")
    zeros, radii = np.zeros(2, "f4"), np.array([radius, 0.005], "f4")
    frame = Frame(0.0, places, zeros + 0.1, zeros, zeros, radii, zeros, (), ())
    picture = Renderer(resolved, Style("speed", LIMITS, (640, 360))).draw(frame, "longitudinal").astype(int)
    metres = 1.06 * 0.72 / 360
    x = 0.3 + (np.arange(640) + 0.5 - 320) * metres
    row = picture[round(180 + (0.13 + 0.09) / metres)]
    soil = (row.min(axis=1) < 250) & (np.abs(x - 0.45) < 0.09)
    assert soil.sum() * metres == pytest.approx(2.0 * radius, abs=2 * metres)


def test_longitudinal_has_x_to_the_right(resolved):
    """Soil that is fast in the front half of the bin is bright on the right, below the surface only."""
    slow, fast = block((0.0, 0.3), (0.0, 0.125), 0.0), block((0.3, 0.6), (0.0, 0.125), 0.2)
    picture = Renderer(resolved, Style("speed", LIMITS, SIZE)).draw(made_up(slow, fast), "longitudinal")
    assert picture.shape == (SIZE[1], SIZE[0], 3)
    # the view is 1.06 (0.27 + 0.45) m high and centred on the middle of bin and headroom
    high = 1.06 * 0.72
    wide = high * SIZE[0] / SIZE[1]
    left, right = (pixel(picture, 0.5 + (x - 0.3) / wide, 0.5 + (-0.135 - 0.09) / high) for x in (0.1, 0.5))
    assert is_soil(left)
    assert is_soil(right)
    assert is_fast(right)
    assert not is_fast(left)
    assert not is_soil(pixel(picture, 0.5, 0.5 + (0.2 - 0.09) / high))
    assert not is_soil(pixel(picture, 0.5 - 0.4 / wide, 0.5 + (-0.135 - 0.09) / high))


def test_longitudinal_is_cut_at_the_mid_plane(resolved):
    """Particles on the side of the eye are taken away."""
    near, far = block((0.0, 0.6), (-0.125, -0.005), 0.2), block((0.0, 0.6), (0.0, 0.125), 0.0)
    picture = Renderer(resolved, Style("speed", LIMITS, SIZE)).draw(made_up(near, far), "longitudinal")
    assert not is_fast(pixel(picture, 0.5, 0.5 + (-0.135 - 0.09) / (1.06 * 0.72)))


def test_cross_is_seen_from_the_front(resolved):
    """The machine's left, +y, is on the right, and what stands before the cut is taken away."""
    left, right = block((0.0, 0.3), (0.02, 0.125), 0.2), block((0.0, 0.3), (-0.125, -0.02), 0.0)
    before = block((0.35, 0.6), (-0.125, 0.125), 0.2)
    picture = Renderer(resolved, Style("speed", LIMITS, SIZE)).draw(made_up(left, right, before), "cross")
    high = 1.06 * 0.72
    wide = high * SIZE[0] / SIZE[1]
    up = 0.5 + (-0.135 - 0.09) / high
    assert is_fast(pixel(picture, 0.5 + 0.07 / wide, up))
    assert is_soil(pixel(picture, 0.5 - 0.07 / wide, up))
    assert not is_fast(pixel(picture, 0.5 - 0.07 / wide, up))


@pytest.mark.parametrize("size", [(320, 180), (1280, 720), (640, 640)], ids=["small", "usual", "square"])
@pytest.mark.parametrize("colour", ["speed", "displacement"])
def test_bar_of_colours_is_whole(size, colour, resolved):
    frame = made_up(block((0.1, 0.3), (0.0, 0.15), 0.1))
    picture = Renderer(resolved, Style(colour, LIMITS, size)).draw(frame, "above")
    right = (picture[:, size[0] * 9 // 10 :] < 128).any(axis=2)
    assert right.any()  # bar and title
    assert not right[:, -2:].any()


def test_a_terrain_is_coloured_by_height(tmp_path):
    """Spheres as wide as a cell; those of the trench that a blade has cut are darker than those beside it."""
    blade = {
        "path": {"start_x_m": 0.2, "start_z_m": -0.1, "speed_x_m_per_s": {"kind": "constant", "value": 1}}
    }
    tool = blade | {"groups": {"blade": {"mesh": str(tmp_path / "blade.stl")}}}
    pyvista.Box((-0.01, 0.01, -0.15, 0.15, 0.0, 0.4)).triangulate().save(tmp_path / "blade.stl")
    box = {"length_m": 1.0, "width_m": 0.6, "depth_m": 0.3}
    soil = {"model": "terrain", "material": "dry_sand", "bin": box, "cell_m": 0.02}
    scene = {"name": "dug", "duration_s": 0.3, "soil": soil, "tools": {"blade": tool}}
    (tmp_path / "scene.yaml").write_text(json.dumps(scene | {"record": {"cloud_hz": 10.0}}))
    verb(run, tmp_path / "scene.yaml", "--out", tmp_path / "run", "--mode", "direct")
    resolved = load_scene(tmp_path / "run/scene.yaml")
    frames = Snapshots(tmp_path / "run/bag", resolved)
    (frame,) = frames.read(frames.times_ns[-1:])
    assert set(frame.radii_m) == {np.float32(0.01)}
    limits = default_limits(resolved, "height")
    assert limits == pytest.approx((-0.1, 0.1))
    picture = Renderer(resolved, Style("height", limits, SIZE)).draw(frame, "above").astype(int)
    (up, across), per_m = np.array(SIZE[::-1]) // 2, min(SIZE[1] / 0.6, SIZE[0] / 1.2) / 1.06
    trench, beside = (picture[up - round(y * per_m), across - round(0.15 * per_m)] for y in (0.05, 0.25))
    assert trench[1] < beside[1] - 40  # green grows with height
    with pytest.raises(InputError, match=r"--colour speed: .* has a terrain; leave it out"):
        verb(render, tmp_path / "run", "--colour", "speed")


def test_tool_stands_at_its_pose(recorded, resolved):
    """The tip of the share is where the bag says: grey pixels there, none below or before it."""
    frames = Snapshots(recorded / "bag", resolved)
    frame = next(frames.read(frames.times_ns[-1:]))
    none = np.empty(0, "f4")
    bare = Frame(frame.time_s, np.empty((0, 3), "f4"), none, none, none, none, none, frame.tools, ())
    picture = Renderer(resolved, Style("speed", LIMITS, SIZE)).draw(bare, "longitudinal").astype(int)
    high = 1.06 * 0.72
    metres = high / SIZE[1]
    x = 0.3 + (np.arange(SIZE[0]) + 0.5 - 0.5 * SIZE[0]) * metres
    z = 0.09 - (np.arange(SIZE[1]) + 0.5 - 0.5 * SIZE[1]) * metres
    grey = (np.ptp(picture, axis=2) < 12) & (picture.max(axis=2) < 200) & (z < -0.01)[:, None]
    rows, columns = np.nonzero(grey)
    assert len(rows) > 50
    tip_x = -0.05 + 0.5 * frame.time_s
    # to three pixels, and the little that the spring gives way
    np.testing.assert_allclose(x[columns].max(), tip_x, atol=3 * metres + 0.003)
    np.testing.assert_allclose(z[rows].min(), -0.20, atol=3 * metres + 0.003)


def test_pictures_of_all_views(recorded, capsys):
    """`subsoil render DIR` leaves one picture of every view, of the size asked for."""
    assert verb(render, recorded, "--size", *SIZE, "--at", "0.004") == 0
    names = [f"{view}_0.004s.png" for view in VIEWS]
    assert [Path(line).name for line in capsys.readouterr().out.splitlines()] == names
    for name in names:
        picture = np.asarray(Image.open(recorded / "pictures" / name))
        assert picture.shape == (SIZE[1], SIZE[0], 3)
        assert (np.ptp(picture.astype(int), axis=2) > 40).sum() > 500


def test_displacement_and_range(recorded, resolved):
    """Displacement has a scale of its own, and a picture needs no speed for it."""
    assert default_limits(resolved, "speed") == (0.0, 0.5)  # of the tine
    radius = resolved.scene.particle_soil.particles.mean_volume_radius_m
    assert default_limits(resolved, "displacement") == (0.0, pytest.approx(10.0 * radius))
    words = ["--colour", "displacement", "--range", "0", "1e-4", "--view", "above", "--size", *SIZE]
    assert verb(render, recorded, *words) == 0


@pytest.mark.parametrize("name", ["film.mp4", "film.gif"])
def test_film_has_every_moment(name, recorded, resolved, tmp_path):
    """As many pictures as moments, readable by others, of the size and at the rate asked for."""
    count = len(Snapshots(recorded / "bag", resolved).times_ns)
    path = tmp_path / name
    assert verb(render, recorded, "--film", path, "--fps", "10", "--size", *SIZE, "--draft") == 0
    if path.suffix == ".gif":
        with Image.open(path) as film:
            assert film.n_frames == count
            assert film.size == SIZE
            assert film.info["duration"] == pytest.approx(100.0)
    else:
        frames, seconds = imageio_ffmpeg.count_frames_and_secs(str(path))
        assert frames == count
        assert seconds == pytest.approx(count / 10.0, abs=0.11)
    assert [item.name for item in tmp_path.iterdir()] == [name]


def test_film_of_a_part(recorded, resolved, tmp_path):
    """`--at` of a film names its first and its last moment: one cycle of a long run."""
    times = Snapshots(recorded / "bag", resolved).times_ns
    path = tmp_path / "part.gif"
    ends = [repr(times[k] * 1e-9) for k in (1, len(times) - 2)]
    assert verb(render, recorded, "--film", path, "--at", *ends, "--size", *SIZE) == 0
    with Image.open(path) as film:
        assert film.n_frames == len(times) - 2 >= 2


def test_vtk_series(recorded, resolved, tmp_path):
    """ParaView's series files name all moments with their times, and VTK reads back what was recorded."""
    frames = Snapshots(recorded / "bag", resolved)
    assert verb(render, recorded, "--vtk", tmp_path / "vtk") == 0
    for name in ("soil", "tools", "machine"):
        series = json.loads((tmp_path / "vtk" / f"{name}.vtp.series").read_text())
        assert [item["time"] for item in series["files"]] == [time_ns * 1e-9 for time_ns in frames.times_ns]
        assert all((tmp_path / "vtk" / item["name"]).is_file() for item in series["files"])
    last = next(frames.read(frames.times_ns[-1:]))
    mesh = pyvista.read(tmp_path / "vtk" / f"soil_{len(frames.times_ns) - 1:04d}.vtp")
    np.testing.assert_array_equal(mesh.points, last.positions_m)
    np.testing.assert_array_equal(mesh.point_data["speed_m_per_s"], last.speeds_m_per_s)
    tools = pyvista.read(tmp_path / "vtk/tools_0000.vtp")
    assert tools.is_manifold
    with pytest.raises(InputError, match="exists already"):
        verb(render, recorded, "--vtk", tmp_path / "vtk")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--size", "641", "360"], "even numbers"),
        (["--range", "2", "1"], "the lower value comes first"),
        (["--film", "film.avi"], "allowed are .mp4 and .gif"),
        (["--fps", "10"], "give --film"),
        (["--draft"], "give --film"),
        (["--colour", "broken"], "has no bonds"),
        (["--film", "film.mp4", "--at", "1"], "its first and its last time"),
    ],
)
def test_bad_arguments(words, message, recorded):
    """One message for what cannot be drawn."""
    with pytest.raises(InputError, match=message):
        verb(render, recorded, *words)


def test_no_run(tmp_path):
    """A folder without a run is bad input."""
    with pytest.raises(InputError, match="no folder of a run"):
        verb(render, tmp_path)


def test_pictures_of_a_bag_folder_alone(machine_bag: Path, tmp_path: Path) -> None:
    """Tools have their meshes; a folder that rosbag2 knows is left as it is."""
    bag = tmp_path / "sent"
    shutil.copytree(machine_bag, bag)
    size = ["--size", "320", "180"]
    assert main(["render", str(bag), "--view", "longitudinal", *size]) == 0
    assert len(list((tmp_path / "sent_report/pictures").glob("*.png"))) == 1
    assert {path.name for path in bag.iterdir()} == {path.name for path in machine_bag.iterdir()}
