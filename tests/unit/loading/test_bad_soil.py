"""Bad soils on the command line: check and run refuse them with one message and leave nothing behind."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh

from subsoil_ros.cli.main import main
from subsoil_ros.dem.packing.bed_file import write_bed
from subsoil_ros.dem.packing.grid import prepare_grid
from subsoil_ros.loading.loader import load_scene

TINE = Path(__file__).parents[3] / "config" / "scenes" / "tine.yaml"
SMALL = ("soil.bin.length_m=0.2", "soil.bin.width_m=0.1", "soil.bin.depth_m=0.1")


@pytest.fixture
def refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Callable[..., str]:
    """Runs `subsoil check` and `subsoil run` on the tine with overrides; gives their one message."""

    def refuse(*overrides: str) -> str:
        changes = [part for text in (*SMALL, *overrides) for part in ("--set", text)]
        said = []
        for verb in (["check"], ["run", "--mode", "direct", "--out", str(tmp_path / "out")]):
            assert main([verb[0], str(TINE), *verb[1:], *changes]) == 2
            captured = capsys.readouterr()
            lines = captured.err.strip().splitlines()
            assert len(lines) == 1, captured.err
            said.append(lines[0].split(": ", 1)[1])
        assert said[0] == said[1]
        assert not (tmp_path / "out").exists()
        return said[0]

    return refuse


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        (["soil.particles.radius_m=0"], ["soil.particles.radius_m", "greater than 0"]),
        (["soil.particles.density_kg_per_m3=-1"], ["soil.particles.density_kg_per_m3", "given -1"]),
        (["soil.bin.depth_m=0"], ["soil.bin.depth_m", "greater than 0"]),
        (["soil.bin.length_m=0.01"], ["holds no particle of radius 0.01 m", "make every side larger"]),
        (["soil.bed.spacing_m=0.009"], ["soil.bed.spacing_m: 0.009 m", "at least 0.013 m"]),
        (["soil.bed.jitter_m=0.01"], ["soil.bed.jitter_m: 0.01 m", "at most 0.0025 m"]),
        (["soil.bin.sides=open"], ["soil.bin.sides", "'walls'", "'periodic'"]),
        (["soil.bin.sides=periodic", "soil.bin.width_m=0.06"], ["soil.bin.width_m", "at least 0.075 m"]),
        (["soil.bin.sides=periodic"], ["tools.tine: is from y =", "must stay between"]),
        (["soil.monitors.every_steps=0"], ["soil.monitors.every_steps", "given 0"]),
        (["soil.monitors.rms_spin=3"], ["no key 'rms_spin' in soil.monitors"]),
        (["soil.max_lost_particles=-1"], ["soil.max_lost_particles", "given -1"]),
        (["soil.time_step_s=1e-4"], ["above the stable limit", "add allow: [unstable_time_step]"]),
        (["soil.materal=loam"], ["--set soil.materal", "did you mean 'material'?"]),
        (["allow=[unstable_step]"], ["allow.0", "did you mean 'unstable_time_step'?", "--set allow"]),
        (["allow=unstable_time_step"], ["allow: given the text", "must be a list"]),
        (
            ["allow=[unstable_time_step]"],
            ["allow: 'unstable_time_step' is about a number in soil.time_step_s"],
        ),
        (["allow=[beyond_fitted_range]"], ["allow: 'beyond_fitted_range' is about a soil.file"]),
        (["soil.bed={kind: saved, file: none.npz}"], ["soil.bed.file", "No such file"]),
    ],
)
def test_a_bad_value(refused: Callable[..., str], overrides: list[str], words: list[str]) -> None:
    """Where, what was given, what is allowed."""
    message = refused(*overrides)
    for word in words:
        assert word in message


def test_a_facet_without_area(refused: Callable[..., str], tmp_path: Path) -> None:
    """A triangle whose corners lie on one line is named by its number."""
    box = trimesh.creation.box((0.02, 0.02, 0.02))
    line = [[0.0, 0.0, 0.0], [0.01, 0.0, 0.0], [0.02, 0.0, 0.0]]
    whole = trimesh.util.concatenate([box, trimesh.Trimesh(line, [[0, 1, 2]], process=False)])
    path = tmp_path / "line.stl"
    whole.export(path)
    message = refused(f"tools.tine.groups.share.mesh={path}")
    assert "tools.tine.groups.share.mesh" in message
    assert "have no area; remove degenerate facets" in message


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"version": np.array(1)}, ["has version 1, readable is"]),
        ({"law_hash": np.array("0" * 64)}, ["another law or with other particles"]),
        ({"sides": np.array("periodic")}, ["prepared between sides 'periodic'"]),
        ({"upper_m": np.array([0.4, 0.1])}, ["give soil.bin the size of the bed"]),
        ("outside", ["particle 0 at [9.0, 0.0, 0.0] m is outside the bin"]),
        ("not a number", ["particle 0 at [nan, nan, nan] m is outside the bin"]),
        ("overlap", ["particles 0 and 1 overlap by", "would be shot apart"]),
        ("damaged", ["is damaged or no bed file"]),
    ],
)
def test_an_unfit_bed_file(
    refused: Callable[..., str], tmp_path: Path, change: dict[str, np.ndarray] | str, words: list[str]
) -> None:
    """Another version, law, kind of sides or bin; a particle outside or inside another; a torn file."""
    soil = load_scene(TINE, SMALL).scene.soil
    assert soil is not None
    path = tmp_path / "bed.npz"
    write_bed(path, prepare_grid(soil, 9.81), soil)
    with np.load(path) as file:
        content = dict(file)
    first = {"outside": [9.0, 0.0, 0.0], "not a number": [np.nan] * 3}
    if change == "damaged":
        path.write_bytes(path.read_bytes()[:1000])
    elif isinstance(change, dict):
        np.savez_compressed(path, **{**content, **change})
    else:
        places = content["positions_m"]
        places[0] = first.get(change, places[1] + 1e-4)
        np.savez_compressed(path, **content)
    message = refused(f"soil.bed={{kind: saved, file: {path}}}")
    assert "soil.bed.file" in message
    for word in words:
        assert word in message
