"""Figures of a run."""

import matplotlib.image
import numpy as np
import pytest

from subsoil_ros.figures.run_figures import draw_figures
from subsoil_ros.figures.soil_cut import nearest_times_ns
from tests.unit.analysis.made_up_runs import Run, full_machine, machine_alone, tine


@pytest.mark.parametrize(
    ("make", "expected"),
    [
        (
            full_machine,
            {"draft", "spring_force", "share_angle", "shank_height", "over_travel", "tool", "soil_cut"},
        ),
        (tine, {"draft", "over_travel", "tool", "soil_cut"}),
        (machine_alone, {"draft", "spring_force", "share_angle", "shank_height"}),
    ],
)
def test_figures_are_what_the_run_has(make, expected, tmp_path):
    """A run draws the figures it has data for, none of them blank; the others are absent."""
    run = Run(make())
    directory = run.write(tmp_path / "run")
    paths = draw_figures(directory / "bag", run.resolved, directory / "figures")
    assert {path.stem for path in paths} == expected
    assert sorted(paths) == sorted((directory / "figures").iterdir())
    for path in paths:
        image = matplotlib.image.imread(path)[:, :, :3]
        assert image.shape[0] > 400
        assert image.shape[1] > 400
        middle = image[image.shape[0] // 4 : -image.shape[0] // 4, image.shape[1] // 4 : -image.shape[1] // 4]
        coloured = np.ptp(middle, axis=2) > 0.2  # curves and particles; frame, grid and window are not
        drawn = middle.max(axis=2) < 0.95 if path.stem == "tool" else coloured  # a tool is grey
        assert drawn.sum() > 400


def test_cut_has_three_times():
    """The clouds nearest to start, middle and end are shown, or three of all if the window has fewer."""
    times = [100_000_000 * k for k in range(1, 11)]
    assert nearest_times_ns(times, (0.31, 0.78)) == [300_000_000, 500_000_000, 800_000_000]
    assert nearest_times_ns(times, (0.5, 0.5)) == [100_000_000, 500_000_000, 1_000_000_000]
    assert nearest_times_ns(times[:2], (0.0, 1.0)) == times[:2]
    assert nearest_times_ns([], (0.0, 1.0)) == []
