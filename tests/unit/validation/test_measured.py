"""validation.measured: what it reads, and what it refuses; particles and calibration are stood in for."""

import csv
import math
import re
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from subsoil_ros.errors import InputError
from subsoil_ros.loading.files import config_folder
from subsoil_ros.loading.material_file import read_material
from validation.blades import Soil
from validation.measured import blade_points, blade_table, page, plate_points, plate_table, plates
from validation.measured import runs as measured
from validation.measured.bearing import meyerhof_pa, vesic_pa
from validation.measured.blade_table import BLADES
from validation.measured.plate_table import PLATES
from validation.measured.table import kind_of
from validation.narrow_blade import Pull

TEMPLATE = Path(measured.__file__).with_name("template.csv")
PLATE_TEMPLATE = TEMPLATE.with_name("template_plates.csv")
ROW = ["made up", "soil", 9e3, 31.0, 1450.0, 22.0, 45.0, 0.05, 0.15, 0.5, 700.0, "", ""]
PLATE_ROW = ["made up", "soil", 0.0, 31.0, 1450.0, 22.0, 0.1, 0.02, 4e4, ""]


def table(path: Path, *rows: list[object]) -> Path:
    """The template with rows."""
    with path.open("w", newline="") as file:
        file.write((PLATE_TEMPLATE if len(rows[0]) == len(PLATE_ROW) else TEMPLATE).read_text())
        csv.writer(file).writerows(rows)
    return path


@pytest.mark.parametrize(("path", "kind"), [(TEMPLATE, BLADES), (PLATE_TEMPLATE, PLATES)])
def test_template_has_the_columns(path, kind):
    """And is refused while it is empty."""
    assert kind_of(path, (BLADES, PLATES)) is kind
    with pytest.raises(InputError, match="has no row"):
        kind.read(path)


def test_a_table_with_other_columns(capsys):
    """The columns of both kinds are named."""
    assert measured.main([str(TEMPLATE.with_name("li2013.csv")), "--out", "none"]) == 2
    assert re.search(
        r"columns are medium.*needed are source, .*, or source, .*pressure_pa", capsys.readouterr().err
    )


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
        ({4: 1.45}, "bulk_density_kg_per_m3: given 1.45; a soil has 500 to 3000"),
        ({10: 0.7}, "draft_newton: given 0.7; theory .Perumpral. says"),
        ({6: 0.0}, "rake_rad: 0 is outside"),
    ],
)
def test_a_soil_that_cannot_be(tmp_path, capsys, change, words):
    """One message before anything is computed; nothing is written."""
    row = [change.get(place, cell) for place, cell in enumerate(ROW)]
    path = table(tmp_path / "t.csv", ROW, row)
    assert measured.main([str(path), "--out", str(tmp_path / "out")]) == 2
    assert re.search(words, capsys.readouterr().err)
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
    monkeypatch.setattr(blade_table, "pulled", lambda *rest, **way: pull)
    monkeypatch.setattr(measured, "ProcessPoolExecutor", lambda *rest: ThreadPoolExecutor(1))
    path = table(tmp_path / "t.csv", ROW, [*ROW[:8], 0.2, *ROW[9:]])
    assert measured.main([str(path), "--out", str(tmp_path / "out")]) == 0
    assert [soil.cohesion_pa for soil in asked] == [9e3]
    with (tmp_path / "out" / "results.csv").open(newline="") as file:
        found = list(csv.DictReader(file))
    assert [row["simulated_newton"] for row in found] == ["650.0", "650.0"]
    assert float(found[1]["perumpral_newton"]) > float(found[0]["perumpral_newton"]) > 100.0
    assert "| 0.01 | 700 | 650 | 40 |" in capsys.readouterr().out
    monkeypatch.setattr(blade_table, "pulled", None)  # kept rows are not drawn again
    assert measured.main([str(path), "--out", str(tmp_path / "out")]) == 0
    assert capsys.readouterr().out.count("| 650 | 40 |") == 2
    other = table(tmp_path / "o.csv", [*ROW[:2], 5e3, *ROW[3:]])
    assert measured.main([str(other), "--out", str(tmp_path / "out")]) == 2
    assert "is of other laboratory values" in capsys.readouterr().err
    plate = table(tmp_path / "p.csv", PLATE_ROW)
    assert measured.main([str(plate), "--out", str(tmp_path / "out")]) == 2
    assert "is of another kind of table" in capsys.readouterr().err


def test_rows_of_a_plate_are_one_push(tmp_path, monkeypatch):
    """To its deepest sinkage; the mean pressure about each."""
    asked = []

    def pushed(plate, radius_m, seed):
        asked.append((plate.depth_m, radius_m, seed))
        depth = np.arange(0.0, plate.depth_m, 0.0005)
        run = np.zeros(len(depth), [(name, float) for name in plates.FIELDS])
        run["depth_m"], run["force_z_newton"] = depth, 1e6 * depth * plate.area_m2
        return run, 1000

    monkeypatch.setattr(plate_table, "pushed", pushed)
    path = table(tmp_path / "t.csv", PLATE_ROW, [*PLATE_ROW[:7], 0.03, 6e4, ""])
    loam = config_folder() / "materials" / "loam.yaml"
    found = PLATES.simulate(PLATES.read(path), loam, 0.01, 2, None)
    assert asked == [(pytest.approx(0.032), 0.01, 2)]
    assert [row["simulated_pa"] for row in found] == pytest.approx([2e4, 3e4], rel=0.02)
    assert found[1]["vesic_pa"] > found[0]["vesic_pa"] > 1e5  # the cohesion of loam


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({8: 40.0}, r"pressure_pa: given 40; theory .Vesic. says .* Pa .*: are both in Pa and Pa"),
        ({7: 20.0}, "sinkage_m: given 20; allowed is 0.001 to two diameters"),
        ({4: ""}, "bulk_density_kg_per_m3: given ''; it must be a number"),
    ],
)
def test_a_plate_that_cannot_be(tmp_path, change, words):
    """Another unit, a missing density."""
    path = table(tmp_path / "t.csv", [change.get(place, cell) for place, cell in enumerate(PLATE_ROW)])
    with pytest.raises(InputError, match=words):
        PLATES.read(path)


def test_shipped_sets_can_be_read():
    """Each set has its two readings of the soil, and the same measured drafts under both."""
    rows = BLADES.read(TEMPLATE.with_name("obermayr2013.csv"))
    readings = [
        [row["draft_newton"] for row in rows if row["cohesion_pa"] == cohesion] for cohesion in (1e3, 0)
    ]
    assert readings[0] == readings[1]
    assert len(readings[0]) == 8


def test_a_cohesion_that_the_draft_contradicts(tmp_path, capsys):
    """A warning with both forces, or pressures."""
    BLADES.read(table(tmp_path / "t.csv", [*ROW[:2], 40e3, *ROW[3:10], 700.0, "", ""]))
    assert re.search(r"line 2: cohesion_pa: 40000 makes .* measured are 700 N", capsys.readouterr().err)
    PLATES.read(table(tmp_path / "t.csv", [*PLATE_ROW[:2], 1.5e3, *PLATE_ROW[3:]]))
    assert re.search(r"line 2: cohesion_pa: 1500 makes .* measured are 40000 Pa", capsys.readouterr().err)


def test_every_set_can_be_read():
    """All cells of columns of numbers are numbers, or empty."""
    for path in plate_points.HERE.glob("*.csv"):
        with path.open(newline="") as file:
            for row in csv.DictReader(file):
                assert None not in row.values(), path
                for key, cell in row.items():
                    if re.search(r"_(mm|m2|deg|kpa|pa|newton|n|percent|per_cm3)$", key) and cell:
                        float(cell)


def test_the_report_follows_the_rules(monkeypatch):
    """Geometric mean of both readings over the measured; the factor of the grain from three radii."""
    row = dict.fromkeys(BLADES.header, "1") | {
        "width_m": "0.2", "depth_m": "0.15", "rake_deg": "90", "friction_angle_deg": "35",
        "draft_newton": "100", "bulk_density_kg_per_m3": "1440", "metal_friction_angle_deg": "16",
    }  # fmt: skip
    rows = [
        row
        | {
            "soil": soil,
            "radius_m": str(r),
            "simulated_newton": str(true * (1.0 + 2.0 * r / 0.15)),
            "simulated_error_newton": "8",
        }
        for soil, true in (("a", 80.0), ("b", 180.0))
        for r in (0.008, 0.012, 0.018)
    ]
    fit = blade_points.grain(rows[:3])
    assert fit[:2] == pytest.approx((2.0, 80.0))
    assert 8.0 < fit.half_newton < 24.0  # farther out than the measured radii
    assert blade_points.grain(rows[:2]) is None
    monkeypatch.setattr(blade_points, "read", lambda name: rows)
    (point,) = blade_points.points()
    assert (point.measured, point.predicted) == (100.0, pytest.approx(120.0))  # sqrt(80 x 180)
    words = "\n".join(blade_points.verdict())
    assert "1 rows of 8, mean absolute error 20.0%" in words
    assert "2.25 apart" in words
    assert "$F_0$ 180 +-" in words


def test_a_plate_that_rises_along_its_way():
    """At 45 degrees its front is up; a disc lies on its lower face; names tell runs apart."""
    plate = plates.submerged("peak_38")[2]
    assert plate.attack_deg == 45.0
    x, _, z = plate.mesh().vertices.T
    assert (x * z).sum() > 0.0
    disc = plates.discs("repose_29", (60,), 22, 40)[0]
    assert disc.mesh().bounds[0][2] == 0.0
    assert disc.area_m2 == pytest.approx(0.0028274, rel=1e-4)
    runs = [one for key, own in plates.SETS.items() if not key.endswith("_grain") for one in own]
    assert len({one.name(0.004) for one in runs}) == len(runs)


def test_bearing_capacity():
    """Tabulated factors at 30 degrees: N_q 18.40; N_c 30.14; N_gamma 22.40 (Vesic), 15.67 (Meyerhof)."""
    phi, weight = math.radians(30.0), 1000.0 * 9.81
    soil, firm = Soil(0.0, phi, 1000.0), Soil(weight, phi, 1000.0)
    strip, deep = (vesic_pa(soil, depth, 2.0, 0.0) / weight for depth in (0.0, 1.0))
    assert (strip, deep - strip) == (pytest.approx(22.40, abs=0.01), pytest.approx(18.40, abs=0.01))
    assert vesic_pa(soil, 0.0, 2.0, 1.0) / weight == pytest.approx(0.6 * strip)
    assert meyerhof_pa(soil, 0.0, 2.0, 0.0) / weight == pytest.approx(15.67, abs=0.01)
    for form in (vesic_pa, meyerhof_pa):
        cohesion = (form(firm, 0.0, 2.0, 0.0) - form(soil, 0.0, 2.0, 0.0)) / weight
        assert cohesion == pytest.approx(30.14, abs=0.01)


def test_a_kept_run_is_judged(monkeypatch):
    """Stress that grows with depth, also with the radius: slopes, pressures, the factor of the grain."""

    def record(name):
        radius = 1e-3 * float(re.search(r"_r([\d.]+)_", name)[1])
        down = np.arange(0.0, 0.0601, 0.0005)
        then = np.full(99, 0.05) if "drag" in name else down[::-1] if "lift" in name else down[:0]
        depth = np.concatenate([down, then])
        run = np.zeros(len(depth), plates_dtype)
        run["depth_m"], run["travel_m"][len(down) :] = depth, 0.03
        run["force_z_newton"] = 1e4 * depth * (1.0 + 4.0 * radius)
        run["force_x_newton"] = -0.5 * run["force_z_newton"]
        run["force_z_newton"][len(down) :] *= -0.25
        return run

    plates_dtype = [(name, float) for name in ("depth_m", "travel_m", "force_x_newton", "force_z_newton")]
    monkeypatch.setattr(plate_points, "record", record)
    assert plate_points.grain_of_discs() == pytest.approx(4.0 * 0.08)
    found = plate_points.components("peak_38")
    assert found[0, -90] == pytest.approx((0.0, -0.25))
    assert found[90, 0] == pytest.approx((0.5, -0.25))
    assert found[90, 90] == pytest.approx((0.0, 1.0))
    pressure = [point for point in plate_points.pavlov() if point.what == "80 mm, kPa at 20 mm"]
    assert pressure[0].predicted == pytest.approx(1e-3 * 1e4 * 0.02 / (0.25 * math.pi * 0.08**2))


def test_the_page_is_that_of_the_kept_runs():
    """`python -m validation.measured all` was run after the last change."""
    assert page.tables() in (plate_points.HERE / "REPORT.md").read_text()
