"""Moments of a run read from its bag: displacement of particles that come and go."""

import numpy as np
import pytest

from subsoil_ros.figures import snapshots
from subsoil_ros.loading.loader import load_scene
from subsoil_ros.messages import SoilCloud

TICK_NS = 1_000_000


class _Bag:
    """A reader of three clouds: particle 7 leaves, particle 9 enters with the second."""

    def __init__(self, named: bool):
        places = [[(0.0, 0, 0), (1.0, 0, 0)], [(1.1, 0, 0), (2.0, 0, 0)], [(1.3, 0, 0), (2.4, 0, 0)]]
        names = [(7, 8), (8, 9), (8, 9)]
        self.found = [
            SoilCloud(k, k * TICK_NS, place, [0.0, 0.0], identities=np.array(name, "u4") if named else None)
            for k, (place, name) in enumerate(zip(places, names, strict=True), 1)
        ]

    def cloud_times_ns(self):
        return [cloud.end_time_ns for cloud in self.found]

    def clouds(self, _, at):
        return (cloud for cloud in self.found if at(cloud.end_time_ns))

    def records(self, *_, at):
        return ()


@pytest.mark.parametrize(("named", "moved"), [(True, (0.3, 0.4)), (False, (np.nan, np.nan))])
def test_displacement_of_particles_that_come_and_go(named, moved, monkeypatch, tmp_path):
    """In a window, from where each was first recorded; in a region, without names, unknown."""
    bag = _Bag(named)
    monkeypatch.setattr(snapshots, "open_record", lambda _: bag)
    region = {"x_m": [0.0, 3.0], "y_m": [-1.0, 1.0], "z_m": [-1.0, 1.0]}
    scene = load_scene("field_tine") if named else load_scene("tine", {"record.cloud_region": region})
    (frame,) = snapshots.Snapshots(tmp_path, scene).read([3 * TICK_NS])
    np.testing.assert_allclose(frame.displacements_m, moved, rtol=1e-6)
