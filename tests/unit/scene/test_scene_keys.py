"""The reference of the keys of a scene, made from its schema for the documentation."""

import re

from dev.scene_keys import scene_keys
from subsoil_ros.scene.mechanism import RotationFriction
from subsoil_ros.scene.scene import Coupling, Report, Scene
from subsoil_ros.scene.soil import Soil
from subsoil_ros.scene.tools import Poses
from subsoil_ros.scene.wedge_soil import WedgeValues

TEXT = scene_keys()
ANCHORS = re.findall(r'^<a id="(\S+)"></a>$', TEXT, re.MULTILINE)


def row(section: str, key: str) -> list[str]:
    """Cells of a key, without the key itself."""
    part = TEXT.split(f'<a id="{section}"></a>\n\n')[1].split("\n<a id=")[0]
    (line,) = [line for line in part.splitlines() if line.startswith(f"| `{key}` |")]
    return [cell.strip() for cell in line.strip("|").split(" | ")][1:]


def test_every_key_has_a_row():
    """Those of the models, down to the deepest ones, and those of the loader."""
    listed = set(re.findall(r"^\| `(\w+)` \|", TEXT, re.MULTILINE))
    for model in (Scene, Soil, Coupling, Report, RotationFriction, Poses, WedgeValues):
        assert set(model.model_fields) - {"model"} <= listed
    assert {"base", "preset", "material"} <= listed


def test_links_lead_to_sections():
    """Each section has one name, and every link leads to one of them."""
    assert len(set(ANCHORS)) == len(ANCHORS)
    assert set(re.findall(r"\]\(#([^)]*)\)", TEXT)) <= set(ANCHORS)


def test_rows_have_limits_defaults_and_units():
    """A number, a choice, a key that must be given, a time function."""
    assert row("key-soil-bed-kind-tiled", "solid_fraction")[:2] == ["number ≥ 0.55, ≤ 0.64", "`0.6`"]
    assert row("key-soil-bin", "depth_m")[:4] == ["number > 0", "required", "m", "of the bed."]
    assert row("key-coupling", "force")[1] == "`auto`"
    assert row("key-soil-values-of-wedge", "rate_s_per_m")[2] == "s/m"
    assert row("key-tools-name-path", "speed_x_m_per_s")[0].startswith("[time function](#")
