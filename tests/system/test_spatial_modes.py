"""A disc in six degrees of freedom that rolls freely, in particles and a terrain, run in every way in fresh
processes: the same bits."""

from pathlib import Path

import pytest

from tests.system.conftest import Run
from tests.system.test_modes import without_wall_time

EXAMPLES = Path(__file__).parents[2] / "examples"
DISC = (
    "soil.bin.length_m=0.3",
    "soil.bin.width_m=0.3",
    "tools.disc.path.start_x_m=0.07",
    "record.series_ticks=5",
    "record.cloud_hz=200",
    "coupling.communication_step_ns=160000",
    "coupling.force=tick_mean",
)
TERRAIN = (
    "coupling.residual_grace_joule=10",
    "soil={model: terrain, material: loam, bin: {length_m: 0.4, width_m: 0.3, depth_m: 0.2}, cell_m: 0.01}",
)

pytestmark = pytest.mark.full  # make test has test_modes.py for the machine in particles


def three_ways(factory: pytest.TempPathFactory, *overrides: str) -> dict[str, Path]:
    """Result folders, by mode."""
    folders = {}
    changes = [item for change in overrides for item in ("--set", change)]
    for mode in ("direct", "composed", "nodes"):
        scene = EXAMPLES / "tilted_disc" / "disc.yaml"
        run = Run(factory.mktemp(mode) / "out", mode, 0.02, *changes, scene=scene)
        status, _, err = run.finish()
        assert status == 0, err
        folders[mode] = run.out
    return folders


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Of the disc in particles."""
    return three_ways(tmp_path_factory, *DISC)


def test_the_disc_turns_in_the_soil(results: dict[str, Path]) -> None:
    """The comparison is not one of zeros."""
    head, *_, last = (results["direct"] / "series.csv").read_text().splitlines()
    row = dict(zip(head.split(","), map(float, last.split(",")), strict=True))
    assert abs(row["tool.disc.force_y_newton"]) > 1.0
    assert all(abs(row[f"tool.disc.angular_velocity_{axis}_rad_per_s"]) > 1e-3 for axis in "xyz")
    assert "tool.disc.angle_rad" not in row


@pytest.mark.parametrize("mode", ["composed", "nodes"])
def test_series_and_bags_are_equal(results: dict[str, Path], mode: str) -> None:
    """series.csv byte for byte, the bag message for message."""
    assert (results[mode] / "series.csv").read_bytes() == (results["direct"] / "series.csv").read_bytes()
    assert without_wall_time(results[mode]) == without_wall_time(results["direct"])


def test_a_terrain_gives_equal_series_and_bags(tmp_path_factory: pytest.TempPathFactory) -> None:
    """The same disc in a terrain: its wrenches turn it, its clouds are in the bag."""
    found = three_ways(tmp_path_factory, *DISC, *TERRAIN)
    one = (found["direct"] / "series.csv").read_bytes()
    for mode in ("composed", "nodes"):
        assert (found[mode] / "series.csv").read_bytes() == one
        assert without_wall_time(found[mode]) == without_wall_time(found["direct"])
