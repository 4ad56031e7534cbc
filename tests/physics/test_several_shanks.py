"""Several shanks side by side: each with its own place, force and share of the draft."""

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from subsoil_ros.analysis.series import Series, read_series
from subsoil_ros.analysis.summarize import summarize
from subsoil_ros.api.run_frame import simulate
from subsoil_ros.coupling.run_settings import RunSettings
from subsoil_ros.figures.run_figures import draw_figures
from subsoil_ros.loading.loader import ResolvedScene, load_scene
from subsoil_ros.run_results import print_summary

SCENES = Path(__file__).parents[2] / "config" / "scenes"
SHANKS = ("shank", "shank_left", "shank_right")


def run(resolved: ResolvedScene, bag: Path) -> Series:
    """A direct run of a scene."""
    simulate(RunSettings(resolved, bag=bag))
    return read_series(bag, resolved.scene)


def test_the_outer_shanks_mirror_each_other(tmp_path: Path) -> None:
    """In a bed that is its own mirror image, shares at +-0.4 m meet mirrored forces, the middle none in y.

    The meshes are float32 (2^-25 m at 0.3 m) and not mirrored to the bit: each contact may differ by its
    stiffness times that.
    """
    resolved = load_scene(
        SCENES / "three_shanks.yaml",
        [
            "soil.bin={length_m: 0.4, width_m: 1.188, depth_m: 0.25}", "duration_s=0.006",
            "mechanism.initial.translate_x_m=0.05", "record.series_ticks=1", "record.cloud_hz=0",
        ],
    )  # fmt: skip
    series = run(resolved, tmp_path / "bag")
    left, right = (f"tool.shank_{side}.force" for side in ("left", "right"))
    scale = np.abs(series[f"{left}_x_newton"]).max()
    assert scale > 10.0
    stiffness_newton_per_m = 10.0 * 10e3 * 16e3 / 26e3  # at a tool: factor, particle, boundary
    atol = series["tool.shank_left.contact_count"].max() * stiffness_newton_per_m * 2.0**-25
    assert atol < 1e-2 * scale
    for axis, sign in (("x", 1.0), ("y", -1.0), ("z", 1.0)):
        mirrored = sign * series[f"{right}_{axis}_newton"]
        assert_allclose(series[f"{left}_{axis}_newton"], mirrored, atol=atol)
    assert_allclose(series["tool.shank.force_y_newton"], 0.0, atol=atol)


@pytest.mark.full
def test_each_shank_has_its_part_of_the_draft(tmp_path: Path) -> None:
    """On the wedge model: parts add up to the shares' draft, each shank works, the summary names them."""
    resolved = load_scene(SCENES / "three_shanks_wedge.yaml", ["duration_s=1.3"])
    series = run(resolved, tmp_path / "bag")
    parts = [series[f"draft.tool.{name}_newton"] for name in SHANKS]
    assert_allclose(np.sum(parts, axis=0), series["draft.share_newton"], rtol=1e-12)
    late = series["time_s"] > 0.9
    means = [part[late].mean() for part in parts]
    assert min(means) > 1000.0
    # one soil, one depth: they differ by the scatter of single failures alone (variation 4.5 % of each)
    assert_allclose(means, np.mean(means), rtol=0.1)
    places = [series[f"tool.{name}.x_m"] for name in SHANKS]
    assert np.ptp([place[-1] for place in places]) < 0.02  # one frame pulls them
    summary = summarize(tmp_path / "bag", resolved, {}, series)
    for name, part in zip(SHANKS, parts, strict=True):
        assert summary.series[f"draft.tool.{name}_newton"].run.max == part.max()


def test_summary_and_figures_name_every_shank(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A line of the table for each; the figures are drawn."""
    resolved = load_scene(SCENES / "three_shanks_wedge.yaml", ["duration_s=0.05"])
    series = run(resolved, tmp_path / "bag")
    print_summary(summarize(tmp_path / "bag", resolved, {}, series), resolved.scene, tmp_path)
    shown = capsys.readouterr().out
    assert all(f"of it {name} [N]" in shown for name in SHANKS)
    paths = draw_figures(tmp_path / "bag", resolved, tmp_path / "figures", series)
    assert "draft.png" in {path.name for path in paths}
