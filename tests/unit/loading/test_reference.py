"""`report.reference`: values of a paper or a field record beside those of a run."""

from pathlib import Path

import pytest

from subsoil_ros.errors import SceneError
from subsoil_ros.loading.files import config_folder
from subsoil_ros.loading.loader import load_scene
from subsoil_ros.loading.reference import Reference, read_reference
from subsoil_ros.loading.scene_bundle import pack, unpack

SCENES = Path(__file__).parents[3] / "config/scenes"
FIELD = """\
name: Field of 12 May
source: load cell
notes: [Wet.]
values:
  series.draft_newton.mean: {value: 1850.0, low: 1700.0, high: 2000.0, unit: N, source: three passes}
  series.draft_newton.max: {value: -200.0, tolerance: 0.1, unit: N}
  loads.tip_depth_m.mean: {low: 0.2, high: 0.3, unit: m}
  loads.power.draft_watt.mean: {value: 900.0, unit: W}
  series.draft_newton.meen: {value: 1.0, unit: N}
"""


def reference(text: str, folder: Path) -> Reference:
    """Of a file with this text."""
    path = folder / "field.yaml"
    path.write_text(text, encoding="utf-8")
    return read_reference(path)


@pytest.mark.parametrize(
    "path", sorted((config_folder() / "references").glob("*.yaml")), ids=lambda p: p.stem
)
def test_shipped_references_load(path):
    """By their bare names from any scene."""
    named = load_scene(SCENES / "tine.yaml", [f"report.reference={path.stem}"])
    assert named.reference == read_reference(path)
    assert Path(named.document["report"]["reference"]) == path


@pytest.mark.parametrize(
    ("old", "new", "wanted"),
    [
        (
            "low: 1700.0",
            "lowest: 1700.0",
            r"values\.series\.draft_newton\.mean.*'lowest'; did you mean 'low'\?",
        ),
        ("low: 1700.0, ", "", "a band needs both 'low' and 'high'"),
        ("low: 1700.0", "low: 2700.0", "low 2700 is above high 2000"),
        ("value: 900.0, ", "", r"power\.draft_watt\.mean: needs a 'value', or a band"),
        ("value: -200.0", "value: 0.0", "'tolerance' is a part of a 'value' that is not 0"),
        ("tolerance: 0.1", "tolerance: -0.1", "greater than 0"),
        ("unit: N,", "unit: kN,", r"draft_newton\.mean\.unit: kN given, and the run has this quantity in N"),
        ("value: 900.0, unit: W", "value: 900.0", r"power\.draft_watt\.mean\.unit: is missing"),
        ("value: 900.0", "value: '900'", r"draft_watt\.mean\.value: .*it must be a number"),
        ("name: Field of 12 May\n", "", "name: is missing"),
        ("source: load cell", "title: load cell", "unknown key 'title'"),
    ],
)
def test_wrong_files_are_refused(old, new, wanted, tmp_path):
    """The line names file, value and key, and says what is allowed."""
    assert old in FIELD
    with pytest.raises(SceneError, match=wanted) as raised:
        reference(FIELD.replace(old, new, 1), tmp_path)
    assert str(raised.value).startswith(f"report.reference: {tmp_path / 'field.yaml'}: ")


def test_units_are_those_of_columns_only(tmp_path):
    """A statistic with a unit of its own, and quantities outside the series, have the unit that is given."""
    lines = (
        "loads.specific.energy_joule_per_m: {value: 1850.0, unit: J/m}",
        'series.draft_newton.stationarity.drift: {value: 0.0, unit: "1"}',
        "series.body.shank.angle_rad.run.moving_10ms.range: {value: 0.1, unit: rad}",
    )
    text = "name: units\nvalues:\n" + "".join(f"  {line}\n" for line in lines)
    assert [item.unit for item in reference(text, tmp_path).values.values()] == ["J/m", "1", "rad"]


def test_missing_file_is_named():
    """With the scene, the key and the path that was looked for."""
    with pytest.raises(SceneError, match=r"report\.reference: .*nothing_there\.yaml: no such"):
        load_scene(SCENES / "tine.yaml", ["report.reference=nothing_there.yaml"])


def test_file_beside_the_scene_travels_with_it(tmp_path):
    """Its path is seen from the scene; a bundle carries it; the hash of the scene does not depend on it."""
    (tmp_path / "field.yaml").write_text(FIELD)
    scene = tmp_path / "scene.yaml"
    scene.write_text(f"base: {SCENES / 'mechanism_only.yaml'}\nreport: {{reference: field.yaml}}\n")
    resolved = load_scene(scene)
    assert resolved.reference is not None
    assert resolved.reference.name == "Field of 12 May"
    assert resolved.scene_hash == load_scene(SCENES / "mechanism_only.yaml").scene_hash
    (tmp_path / "there").mkdir()
    assert unpack(pack(resolved), tmp_path / "there").reference == resolved.reference
