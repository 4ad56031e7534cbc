"""What the page is told of a run that goes on: each message once, its mean, and its newest soil."""

import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from subsoil_ros.api.read import read_run
from subsoil_ros.messages import SoilCloud
from subsoil_ros.workbench.asides import newest_soil
from subsoil_ros.workbench.live import MOST_PARTICLES, MOST_POINTS, GrowingBag, GrowingRun, drawn, soil_bytes
from tests.system.growing_run import write
from tests.unit.recording.recording_samples import raw_messages, write_bag


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finished bag."""
    return write_bag(tmp_path_factory.mktemp("whole") / "bag")


@given(cuts=st.lists(st.floats(0.0, 1.0), max_size=4))
def test_each_message_is_read_once_wherever_the_file_ends(
    whole: Path, tmp_path_factory: pytest.TempPathFactory, cuts: list[float]
) -> None:
    """A record that is cut off, be it in its head, waits for the rest of it."""
    content = next(whole.glob("*.mcap")).read_bytes()
    file = tmp_path_factory.mktemp("part") / "part.mcap"
    file.touch()
    bag, found = GrowingBag(file), []
    for cut in [*sorted(cuts), 1.0]:
        with file.open("ab") as stream:
            stream.write(content[os.path.getsize(file) : round(cut * len(content))])
        found += list(bag.added())
    assert found == [(topic, time_ns, data) for topic, time_ns, _, _, data in raw_messages(whole)]
    assert list(bag.added()) == []


def test_the_mean_is_that_of_the_summary(tmp_path: Path) -> None:
    """What was read piece by piece gives the mean and the interval that the run has as a whole."""
    write(tmp_path, particles=60, hz=100.0, lasts_s=1.0)
    growing = GrowingRun(tmp_path, next((tmp_path / "bag").glob("*.mcap")))
    assert growing.draft()["mean"] == ""
    assert np.frombuffer(growing.look(), "<f8", 1)[0] == pytest.approx(1.0)
    assert growing.look() == b""
    run = read_run(tmp_path)
    mean = run.summary["series"]["draft_newton"]
    told = growing.draft()
    assert told["mean"] == f"{mean['mean']:.0f} N +- {mean['stationarity']['mean_half_width']:.0f} N"
    assert told["draft_newton"] == run.series["draft_newton"].to_list()


def test_a_long_curve_is_thinned() -> None:
    time_s = np.arange(2 * MOST_POINTS + 1, dtype=np.float64)
    assert len(drawn(time_s, time_s, 1.0)["time_s"]) <= MOST_POINTS


def test_a_soil_is_drawn_about_its_middle() -> None:
    """Positions from the median; the fastest particle is the brightest; too many are thinned."""
    positions = np.array([[9.0, 0.0, 0.0], [10.0, 1.0, -1.0], [11.0, 2.0, -2.0]], np.float32)
    content = soil_bytes(SoilCloud(0, 2_000_000_000, positions, np.array([0.0, 0.1, 0.2], np.float32)))
    side = 0.98 * 2.0  # of 1 to 99 % of the soil
    assert np.frombuffer(content, "<f8", 3) == pytest.approx([2.0, side, (side**3 / 3.0) ** (1.0 / 3.0)])
    places = np.frombuffer(content, "<f4", 9, 24).reshape(3, 3)
    assert places.tolist() == [[-1.0, -1.0, 1.0], [0.0, 0.0, 0.0], [1.0, 1.0, -1.0]]
    assert np.frombuffer(content, np.uint8, -1, 60).reshape(3, 3)[:, 0].argmax() == 2
    many = np.zeros((MOST_PARTICLES + 1, 3), np.float32)
    assert len(soil_bytes(SoilCloud(0, 1, many, many[:, 0]))) <= 24 + 15 * MOST_PARTICLES
    assert soil_bytes(SoilCloud(0, 1, many[:0], many[:0, 0])) == b""


def test_no_soil_of_a_run_that_nobody_watches(tmp_path: Path) -> None:
    assert newest_soil(tmp_path, -1.0) == b""
