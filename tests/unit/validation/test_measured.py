"""validation.measured: what it reads, and what it refuses; particles and calibration are stood in for."""

import csv
from concurrent.futures import ThreadPoolExecutor
from importlib import import_module
from pathlib import Path

import pytest

from subsoil_ros.errors import InputError
from subsoil_ros.loading.files import config_folder
from subsoil_ros.loading.material_file import read_material
from validation.measured import report
from validation.narrow_blade import Pull

measured = import_module("validation.measured.__main__")
TEMPLATE = Path(measured.__file__).with_name("template.csv")
ROW = ["made up", "soil", 9e3, 31.0, 1450.0, 22.0, 45.0, 0.05, 0.15, 0.5, 700.0, "", ""]


def table(path: Path, *rows: list[object]) -> Path:
    """The template with rows."""
    with path.open("w", newline="") as file:
        file.write(TEMPLATE.read_text())
        csv.writer(file).writerows(rows)
    return path


def test_template_has_the_columns(tmp_path):
    """And is refused while it is empty."""
    assert TEMPLATE.read_text().strip() == ",".join(measured.COLUMNS)
    with pytest.raises(InputError, match="has no row"):
        measured.read_table(TEMPLATE)


def test_a_cell_that_is_no_number(tmp_path, capsys):
    """Says the line and the column; nothing is written."""
    path = table(tmp_path / "t.csv", ROW, [*ROW[:10], "many", "", ""])
    assert measured.main([str(path), "--out", str(tmp_path / "out")]) == 2
    assert "line 3: draft_newton: given 'many'; it must be a number" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({1: "a/b"}, "soil 'a/b': allowed are letters"),
        ({3: 75.0}, "friction_angle_deg: given 75"),
        ({2: "nan"}, "cohesion_pa"),
        ({2: 5e3}, "has several sets of laboratory values"),
    ],
)
def test_a_soil_that_cannot_be(tmp_path, capsys, change, words):
    """One message before anything is computed; nothing is written."""
    row = [change.get(place, cell) for place, cell in enumerate(ROW)]
    path = table(tmp_path / "t.csv", ROW, row)
    assert measured.main([str(path), "--out", str(tmp_path / "out")]) == 2
    assert words in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_row_is_simulated_in_its_calibrated_soil(tmp_path, monkeypatch, capsys):
    """One calibration for a soil; results beside the measured values and the closed forms."""
    loam = read_material(config_folder() / "materials" / "loam.yaml", "loam")
    asked = []

    def calibrate(soil, *rest):
        asked.append(soil)
        return loam.model_copy(update={"soil": soil})

    monkeypatch.setattr(measured, "calibrate", calibrate)
    pull = Pull((650.0, 40.0), (120.0, 30.0), 0.3, 1.0, 1000, (0.3, 0.3, 0.3))
    monkeypatch.setattr(measured, "pulled", lambda *rest, **way: pull)
    monkeypatch.setattr(measured, "ProcessPoolExecutor", lambda *rest: ThreadPoolExecutor(1))
    path = table(tmp_path / "t.csv", ROW, [*ROW[:8], 0.2, *ROW[9:]])
    assert measured.main([str(path), "--out", str(tmp_path / "out")]) == 0
    assert [soil.cohesion_pa for soil in asked] == [9e3]
    with (tmp_path / "out" / "results.csv").open(newline="") as file:
        found = list(csv.DictReader(file))
    assert [row["simulated_newton"] for row in found] == ["650.0", "650.0"]
    assert float(found[0]["perumpral_newton"]) > float(found[1]["perumpral_newton"]) > 100.0  # deepest first
    assert "| 10 | 700 | 650 +- 40 |" in capsys.readouterr().out
    monkeypatch.setattr(measured, "pulled", None)  # kept rows are not drawn again
    assert measured.main([str(path), "--out", str(tmp_path / "out")]) == 0
    assert capsys.readouterr().out.count("650 +- 40") == 2
    other = table(tmp_path / "o.csv", [*ROW[:2], 5e3, *ROW[3:]])
    assert measured.main([str(other), "--out", str(tmp_path / "out")]) == 2
    assert "is of other laboratory values" in capsys.readouterr().err


def test_shipped_sets_can_be_read():
    """Each set has its two readings of the soil, and the same measured drafts under both."""
    rows = measured.read_table(TEMPLATE.with_name("obermayr2013.csv"))
    readings = [
        [row["draft_newton"] for row in rows if row["cohesion_pa"] == cohesion] for cohesion in (1e3, 0)
    ]
    assert readings[0] == readings[1]
    assert len(readings[0]) == 8


def test_the_report_follows_the_rules():
    """Geometric mean of both readings over the measured; the factor of the grain from three radii."""
    row = dict.fromkeys(measured.COLUMNS, "1") | {
        "width_m": "0.2", "depth_m": "0.15", "rake_deg": "90", "friction_angle_deg": "35",
        "draft_newton": "100", "bulk_density_kg_per_m3": "1440", "metal_friction_angle_deg": "16",
    }  # fmt: skip
    rows = [
        row | {"soil": soil, "radius_m": str(r), "simulated_newton": str(true * (1.0 + 2.0 * r / 0.15))}
        for soil, true in (("a", 80.0), ("b", 180.0))
        for r in (0.008, 0.012, 0.018)
    ]
    assert report.grain_slope(rows[:3]) == pytest.approx(2.0)
    assert report.grain_slope(rows[:2]) is None
    lines = list(report.report(rows))
    assert lines[2].startswith("| 0.2 | 0.15 | 100 | 1.39 | 1.20 |")  # sqrt(80 x 180) = 120, times 1.16
    assert lines[2].endswith("| 2.25 |")
    assert any(line.startswith("| particles, without grain | 1 | 20% | 20% | +20% |") for line in lines)
