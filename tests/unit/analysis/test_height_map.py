"""The surface's height in the bag, as another program reads it."""

from pathlib import Path

import numpy as np
from rosbags.highlevel import AnyReader

from subsoil_ros.loading.loader import load_scene
from subsoil_ros.messages import SoilCloud
from subsoil_ros.recording.bag_writer import BagWriter
from subsoil_ros.recording.soil_clouds import height_grid, point_cloud
from subsoil_ros.recording.types import serialize

SCENES = Path(__file__).parents[3] / "config/scenes"
RESOLVED = load_scene(SCENES / "tine.yaml", ["soil.surface={x_m: [0.0], z_m: [-0.05]}"])
END_NS = RESOLVED.timing.communication_step_ns


def maps(bag: Path) -> list:
    """The height maps of a bag."""
    with AnyReader([bag]) as reader:
        connections = [item for item in reader.connections if item.topic == "/subsoil/soil/height_map"]
        return [reader.deserialize(data, item.msgtype) for item, _, data in reader.messages(connections)]


def test_every_cloud_has_a_map_of_the_highest_particles(tmp_path):
    """Rows and columns of cells one diameter wide: x, y, top, and lift over the scene's surface; NaN where
    empty."""
    places = np.array([[0.31, 0.0, -0.06], [0.31, 0.0, -0.02], [0.05, -0.1, -0.06]], dtype="f4")
    cloud = SoilCloud(0, END_NS, places, np.zeros(3, dtype="f4"))
    writer = BagWriter(tmp_path / "bag", RESOLVED.scene, RESOLVED.timing)
    writer.write(cloud)
    writer.close()
    (message,) = maps(tmp_path / "bag")
    assert [field.name for field in message.fields] == ["x", "y", "z", "lift"]
    points = message.data.view("<f4").reshape(message.height, message.width, 4)
    soil = RESOLVED.scene.soil
    assert points.shape[:2] == (round(soil.bin.width_m / 0.02), round(soil.bin.length_m / 0.02))
    known = np.argwhere(np.isfinite(points[:, :, 2]))
    assert len(known) == 2
    highest = points[tuple(known[-1])]
    np.testing.assert_allclose(highest[2:], [-0.02 + 0.01, -0.01 + 0.05], atol=1e-6)
    assert abs(highest[0] - 0.31) <= 0.0101
    assert abs(highest[1]) <= 0.0101


def test_bytes_give_the_same_map(tmp_path):
    """A recorder that takes CDR bytes derives the map that the direct run derives."""
    rng = np.random.default_rng(1)
    places = (rng.random((200, 3)) * (0.6, 0.25, 0.27) - (0.0, 0.125, 0.27)).astype("f4")
    cloud = SoilCloud(0, END_NS, places, np.zeros(200, dtype="f4"))
    one = BagWriter(tmp_path / "one", RESOLVED.scene, RESOLVED.timing)
    one.write(cloud)
    one.close()
    two = BagWriter(tmp_path / "two", RESOLVED.scene, RESOLVED.timing)
    two.write_raw("soil/points", 0, serialize(point_cloud(cloud)))
    two.close()
    ((first,), (second,)) = maps(tmp_path / "one"), maps(tmp_path / "two")
    np.testing.assert_array_equal(first.data, second.data)


def test_grid_ignores_who_left_the_box():
    """Particles beside the box fall into no cell of the other side."""
    places = np.array([[-0.01, 0.0, 5.0], [0.39, 0.21, 5.0], [0.2, 0.0, 0.1]])
    grid = height_grid(places, 0.01, ((0.0, -0.2), (0.4, 0.2)))
    assert np.nansum(grid.height_m) == np.float64(0.11)


def test_the_top_of_each_particle_is_its_own():
    """A large particle with a lower centre may be the highest."""
    places = np.array([[0.2, 0.0, 0.10], [0.2, 0.0, 0.11]])
    grid = height_grid(places, 0.02, ((0.0, -0.2), (0.4, 0.2)), np.array([0.03, 0.01]))
    assert np.nansum(grid.height_m) == np.float64(0.13)
