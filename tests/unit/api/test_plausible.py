"""Sizes and places that cannot be meant: warned of, or refused where nothing can come of them."""

from pathlib import Path
from typing import Any

import pytest
import trimesh

import subsoil_ros as subsoil
from subsoil_ros.api.plausible import implausible
from subsoil_ros.errors import SceneError
from subsoil_ros.loading.files import config_folder
from tests.soils import LINEAR


def scene(
    folder: Path, scale: float = 1.0, more: dict[str, Any] | None = None, **path: Any
) -> dict[str, Any]:
    """A plate of 20 x 160 x 150 mm on a path through a bin of 0.4 x 0.36 x 0.2 m."""
    trimesh.creation.box((0.02, 0.16, 0.15)).export(folder / "plate.stl")
    tool = {
        "path": {"start_x_m": -0.02, "start_z_m": -0.02, "speed_x_m_per_s": constant(0.5), **path},
        "groups": {"plate": {"mesh": str(folder / "plate.stl"), "scale": scale}},
    }
    return {
        "name": "plate",
        "duration_s": 0.2,
        "soil": {
            "bin": {"length_m": 0.4, "width_m": 0.36, "depth_m": 0.2},
            "particles": {"radius_m": 0.02, "density_kg_per_m3": 1800.0},
            "bed": {"kind": "grid", "spacing_m": "rest"},
            "law": LINEAR,
        },
        "tools": {"plate": {**tool, **(more or {})}},
    }


def constant(value: float) -> dict[str, Any]:
    """A time function."""
    return {"kind": "constant", "value": value}


def test_a_sound_scene_is_not_doubted(tmp_path: Path) -> None:
    """No warning."""
    assert subsoil.check(scene(tmp_path)).warnings == ()


@pytest.mark.parametrize(
    ("scale", "path", "words"),
    [
        (39.37, {}, "is 6.3 m wide, soil.bin 0.36 m"),
        (100.0, {"start_z_m": 5.0}, "groups.plate: is 16 m large; is 'scale' that of the file's unit?"),
        (0.001, {}, "groups.plate: is 0.00016 m large"),
        (1.0, {"start_z_m": 0.5}, "tools.plate: stays above the soil, so no force acts on it"),
        (1.0, {"start_x_m": -5.0}, "tools.plate: does not reach the soil, so no force acts on it"),
        (1.0, {"start_angle_rad": 25.0}, "start_angle_rad: 25 rad is more than a whole turn"),
    ],
)
def test_what_can_hardly_be_meant_is_warned_of(
    scale: float, path: dict[str, Any], words: str, tmp_path: Path
) -> None:
    """By check; a run prints the same."""
    assert words in " ".join(subsoil.check(scene(tmp_path, scale, **path)).warnings)


def test_a_density_in_other_units_is_warned_of(tmp_path: Path) -> None:
    """Grams per cubic centimetre."""
    given = scene(tmp_path)
    given["soil"]["particles"]["density_kg_per_m3"] = 1.8
    assert "1.8 kg/m3 is less than any soil has" in " ".join(subsoil.check(given).warnings)


@pytest.mark.parametrize(
    ("path", "more", "words"),
    [
        ({"start_z_m": -0.5}, {}, "is under the floor, z = -0.2 m"),
        ({"start_x_m": 50.0}, {}, "is past the end of the soil, x = 0.4 m"),
        ({}, {"lateral_m": 0.4}, "is beside the soil, from y = 0.32 to 0.48 m of -0.18 to 0.18 m"),
    ],
)
def test_a_run_of_which_nothing_can_come_is_refused(
    path: dict[str, Any], more: dict[str, Any], words: str, tmp_path: Path
) -> None:
    """By check and run, and nothing is written."""
    given = scene(tmp_path, 1.0, more, **path)
    for refused in (lambda: subsoil.check(given), lambda: subsoil.run(given, tmp_path / "run")):
        with pytest.raises(SceneError, match=f"tools.plate: {words}: no tool touches soil"):
            refused()
    assert not (tmp_path / "run").exists()


def test_shipped_scenes_are_not_doubted() -> None:
    """None of them has such a value."""
    for name in sorted(path.stem for path in (config_folder() / "scenes").glob("*.yaml")):
        assert not implausible(subsoil.load_scene(name)), name
