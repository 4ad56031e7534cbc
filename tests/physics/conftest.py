"""Small soils for the verification tests: the paper's law unless a test changes it."""

import copy
import dataclasses
import os
from pathlib import Path

import numpy as np
import pytest
import yaml

from subsoil_ros.dem.bed import Bed
from subsoil_ros.dem.build import build_engine
from subsoil_ros.dem.engine import SoilEngine
from subsoil_ros.loading.loader import ResolvedScene, load_scene
from subsoil_ros.messages import ToolMotion
from tests.soils import BOUNDARY, PARTICLE
from validation.laboratory import box_mesh

DEVICE = os.environ.get("SUBSOIL_TEST_DEVICE", "cpu")
"""Of the soils of these tests: benchmarks/gpu.md."""


class SoilMaker:
    """Writes small scenes and builds their soil engines."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def scene(self, *overrides: str, law: dict | None = None, **changes: object) -> ResolvedScene:
        """A bin of 0.12 x 0.1 x 0.1 m at a step of 50 us; `law` changes both rows of the law."""
        document = {
            "name": "verification",
            "duration_s": 1.0,
            "soil": {
                "bin": {"length_m": 0.12, "width_m": 0.1, "depth_m": 0.1},
                "particles": {"radius_m": 0.01, "density_kg_per_m3": 1800.0},
                "bed": {"kind": "grid", "spacing_m": 0.018},
                "law": {
                    "kind": "cohesive_linear",
                    "particle": PARTICLE | (law or {}),
                    "boundary": BOUNDARY | (law or {}),
                },
                "time_step_s": 5.0e-5,
                "device": DEVICE,
            },
            **copy.deepcopy(changes),
        }
        return self.resolve(document, *overrides)

    def resolve(self, document: dict, *overrides: str) -> ResolvedScene:
        """A whole scene of one's own."""
        path = self.folder / f"scene_{len(list(self.folder.iterdir()))}.yaml"
        path.write_text(yaml.safe_dump(document, sort_keys=False))
        return load_scene(path, overrides)

    def engine(self, *overrides: str, threads: int = 1, book: bool = False, **kw: object) -> SoilEngine:
        """The soil engine of `scene` with the same arguments."""
        return build_engine(self.scene(*overrides, **kw), threads, book=book)

    def box(self, x_m: float, y_m: float, z_m: float, *, subdivide: int = 0) -> str:
        """STL of a box about its centre, in the maker's folder."""
        return box_mesh(self.folder, x_m, y_m, z_m, subdivide)


@pytest.fixture
def soil(tmp_path: Path) -> SoilMaker:
    """Maker of small soils in the test's own folder."""
    return SoilMaker(tmp_path)


def tool_at(
    x_m: float = 0.0, z_m: float = 0.0, angle_rad: float = 0.0, **rates: float
) -> tuple[ToolMotion, ...]:
    """Motion of a single tool named 'tool'; rates: vx, vz, rate."""
    return (
        ToolMotion(
            "tool",
            x_m,
            0.0,
            z_m,
            angle_rad,
            rates.get("vx", 0.0),
            rates.get("vz", 0.0),
            rates.get("rate", 0.0),
        ),
    )


@pytest.fixture
def at() -> object:
    """The function tool_at."""
    return tool_at


def one_tool(mesh: str, **keys: object) -> dict:
    """A scene's `tools` with one mesh at the origin of its path, and other keys of it."""
    return {"tool": {"path": {}, "groups": {"body": {"mesh": mesh}}} | keys}


@pytest.fixture
def one() -> object:
    """The function one_tool."""
    return one_tool


def most_move_m(scene: ResolvedScene, bed: Bed, duration_s: float) -> float:
    """How far 9 in 10 free particles of a bed that is left alone move at most [m]; loose ones may roll."""
    alone = scene.scene.model_copy(update={"mechanism": None, "tools": {}})
    engine = SoilEngine(dataclasses.replace(scene, scene=alone), bed)
    engine.start(())
    for tick in range(round(duration_s / scene.timing.communication_step_s)):
        engine.advance(tick, ())
    free = np.ones(len(bed.positions_m), np.bool_) if bed.held is None else ~bed.held
    return float(np.quantile(np.linalg.norm((engine.positions_m() - bed.positions_m)[free], axis=1), 0.9))
