"""Clouds of a region, and rounded ones: what is kept, and how exactly."""

import dataclasses

import numpy as np
import pytest

from subsoil_ros.messages import SoilCloud
from subsoil_ros.recording.bag_reader import BagReader
from subsoil_ros.recording.bag_writer import BagWriter
from subsoil_ros.recording.soil_clouds import cloud_from_message, point_cloud, recorded_cloud
from subsoil_ros.scene.record import Record
from tests.unit.recording.recording_samples import INTERVAL_NS, SCENE, TICKS, TIMING, end_ns

RNG = np.random.default_rng(7)
POSITIONS = RNG.uniform((-0.1, -0.7, -0.4), (2.1, 0.7, 0.2), (20_000, 3)).astype(np.float32)
SPEEDS = (10.0 ** RNG.uniform(-8.0, 0.5, 20_000)).astype(np.float32)
CLOUD = SoilCloud(TICKS - 1, end_ns(TICKS - 1), POSITIONS, SPEEDS)


def test_without_options_the_cloud_is_the_very_same():
    """Lossless by default."""
    assert recorded_cloud(CLOUD, Record()) is CLOUD


def test_a_region_keeps_the_particles_inside_it_and_their_order():
    """Bounds belong to the box; a direction without bounds is open."""
    record = Record.model_validate({"cloud_region": {"x_m": [0.5, 1.0], "z_m": [-0.3, 0.0]}})
    kept = recorded_cloud(CLOUD, record)
    x, _, z = POSITIONS.T
    inside = (x >= 0.5) & (x <= 1.0) & (z >= -0.3) & (z <= 0.0)
    assert 0 < inside.sum() < len(inside)
    np.testing.assert_array_equal(kept.positions_m, POSITIONS[inside])
    np.testing.assert_array_equal(kept.speeds_m_per_s, SPEEDS[inside])


@pytest.mark.parametrize("windowed", [False, True])
def test_parts_of_broken_bonds_come_back_with_their_particles(windowed):
    """Beside identities and alone, through a region and a PointCloud2."""
    broken = RNG.random(20_000).astype(np.float32)
    identities = np.arange(20_000, dtype=np.uint32) if windowed else None
    cloud = dataclasses.replace(CLOUD, broken_parts=broken, identities=identities)
    kept = recorded_cloud(cloud, Record.model_validate({"cloud_region": {"x_m": [0.5, 1.0]}}))
    back = cloud_from_message(point_cloud(kept), INTERVAL_NS)
    inside = (POSITIONS[:, 0] >= 0.5) & (POSITIONS[:, 0] <= 1.0)
    np.testing.assert_array_equal(back.broken_parts, broken[inside])
    assert (back.identities is not None) == windowed


def test_radius_and_material_come_back_with_their_particles():
    """Through a region and a PointCloud2; without them the cloud has four fields."""
    radii, materials = RNG.random(20_000).astype(np.float32), np.arange(20_000, dtype=np.uint32) % 3
    cloud = dataclasses.replace(CLOUD, radii_m=radii, materials=materials)
    kept = recorded_cloud(cloud, Record.model_validate({"cloud_region": {"x_m": [0.5, 1.0]}}))
    message = point_cloud(kept)
    assert [(item.name, item.datatype) for item in message.fields[4:]] == [("radius", 7), ("material", 6)]
    back = cloud_from_message(message, INTERVAL_NS)
    inside = (POSITIONS[:, 0] >= 0.5) & (POSITIONS[:, 0] <= 1.0)
    np.testing.assert_array_equal(back.radii_m, radii[inside])
    np.testing.assert_array_equal(back.materials, materials[inside])
    assert len(point_cloud(CLOUD).fields) == 4


@pytest.mark.parametrize(("resolution_m", "step_m"), [(1e-3, 2.0**-10), (1e-4, 2.0**-14), (0.0625, 2.0**-4)])
def test_positions_are_rounded_to_the_power_of_two_below(resolution_m, step_m):
    """Multiples of the step, none further away than half of it."""
    rounded = recorded_cloud(CLOUD, Record(cloud_resolution_m=resolution_m)).positions_m
    assert rounded.dtype == np.float32
    assert step_m <= resolution_m
    steps = rounded.astype(np.float64) / step_m
    np.testing.assert_array_equal(steps, np.round(steps))
    assert np.abs(rounded.astype(np.float64) - POSITIONS).max() <= step_m / 2


def test_speeds_keep_eight_significant_bits():
    """To half a unit of the last bit that is left, 2^-8 of the value at most; the other bits are zero."""
    rounded = recorded_cloud(CLOUD, Record(cloud_resolution_m=1e-3)).speeds_m_per_s
    assert rounded.dtype == np.float32
    assert not np.any(rounded.view(np.uint32) & np.uint32(0xFFFF))
    assert np.abs(rounded.astype(np.float64) / SPEEDS - 1.0).max() <= 2.0**-8
    at_rest = recorded_cloud(
        SoilCloud(0, 0, POSITIONS[:1], np.zeros(1, np.float32)), Record(cloud_resolution_m=1e-3)
    )
    assert at_rest.speeds_m_per_s[0] == 0.0


def test_a_rounded_cloud_takes_half_the_room(tmp_path):
    """To a millimetre, zstd finds two zero bytes in four; the bag says what was done."""
    sizes = {}
    for name, extra in {
        "exact": {},
        "rounded": {"cloud_resolution_m": 1e-3},
        "part": {"cloud_region": {"y_m": [0.0, 0.1]}},
    }.items():
        record = Record.model_validate(SCENE.record.model_dump() | extra)
        writer = BagWriter(tmp_path / name, SCENE.model_copy(update={"record": record}), TIMING)
        writer.write(recorded_cloud(CLOUD, record))
        writer.close()
        sizes[name] = sum(path.stat().st_size for path in (tmp_path / name).glob("*.mcap"))
    assert sizes["rounded"] < 0.6 * sizes["exact"]
    text = (tmp_path / "rounded/metadata.yaml").read_text()
    assert "rounded: positions to multiples of 0.000976562 m, speeds to 8 significant bits" in text
    assert "only particles with their centre in y 0 to 0.1 m" in (tmp_path / "part/metadata.yaml").read_text()
    assert "cloud_re" not in (tmp_path / "exact/metadata.yaml").read_text()
    (cloud,) = BagReader(tmp_path / "part").clouds(INTERVAL_NS)
    assert len(cloud.positions_m) == np.sum((POSITIONS[:, 1] >= 0.0) & (POSITIONS[:, 1] <= 0.1))


@pytest.mark.parametrize(
    ("given", "complaint"),
    [
        ({"cloud_region": {}}, "gives no bounds"),
        ({"cloud_region": {"x_m": [1.0, 0.5]}}, r"x_m: given \[1, 0.5\]; it must be \[from, to\]"),
        ({"cloud_resolution_m": 1.0}, "less than or equal to 0.1"),
        ({"cloud_resolution_m": -1e-3}, "greater than or equal to 0"),
    ],
)
def test_nonsense_is_refused(given, complaint):
    """One message each, with what is allowed."""
    with pytest.raises(ValueError, match=complaint):
        Record.model_validate(given)


def test_identities_stay_with_their_particles():
    """Where particles come and go: through a region, a message and back; beyond what float32 counts."""
    identities = np.arange(len(POSITIONS), dtype=np.uint32) + np.uint32(2**31)
    cloud = dataclasses.replace(CLOUD, identities=identities)
    record = Record.model_validate({"cloud_region": {"x_m": [0.5, 1.0]}, "cloud_resolution_m": 1e-3})
    kept = recorded_cloud(cloud, record)
    inside = (POSITIONS[:, 0] >= 0.5) & (POSITIONS[:, 0] <= 1.0)
    np.testing.assert_array_equal(kept.identities, identities[inside])
    message = point_cloud(kept)
    assert [(field.name, field.offset, field.datatype) for field in message.fields][3:] == [
        ("speed", 12, 7),
        ("identity", 16, 6),
    ]
    back = cloud_from_message(message, INTERVAL_NS)
    np.testing.assert_array_equal(back.identities, kept.identities)
    np.testing.assert_array_equal(back.positions_m, kept.positions_m)
    assert cloud_from_message(point_cloud(CLOUD), INTERVAL_NS).identities is None
