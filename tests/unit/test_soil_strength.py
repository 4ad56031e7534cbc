"""The line of Mohr and Coulomb, and what `subsoil soil-test` refuses."""

import math
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.stats import linregress

from subsoil_ros.cli.main import main
from subsoil_ros.errors import InputError
from subsoil_ros.experiments.soil_tests.strength import fit_coulomb

SCENES = Path(__file__).parents[2] / "config" / "scenes"


def test_a_line_is_found_without_error() -> None:
    """Points on c + sigma tan(phi) give c and phi back, with no error left."""
    normal = np.array([5e3, 10e3, 20e3, 40e3])
    fit = fit_coulomb(normal, 7e3 + normal * math.tan(math.radians(31.0)))
    assert_allclose([fit.cohesion_pa, fit.friction_angle_deg, fit.r_squared], [7e3, 31.0, 1.0], rtol=1e-12)
    assert fit.cohesion_error_pa < 1e-6
    assert fit.friction_angle_error_deg < 1e-8


ROW = (
    "{youngs_modulus_pa: 1e7, poisson_ratio: 0.3, contact_plasticity: 0.5, pull_off_newton: 1.0, "
    "static_friction: 0.3, sliding_friction: 0.3}"
)
YIELDING = f"{{kind: elasto_plastic_adhesive, particle: {ROW}, boundary: {ROW}}}"


def test_errors_are_those_of_linear_regression() -> None:
    """Standard errors and R^2 as scipy finds them; the angle's by the derivative of atan."""
    normal = np.array([5e3, 9e3, 20e3, 31e3])
    shear = np.array([11.2e3, 12.9e3, 20.1e3, 25.3e3])
    fit, other = fit_coulomb(normal, shear), linregress(normal, shear)
    assert_allclose(fit.cohesion_pa, other.intercept, rtol=1e-12)
    assert_allclose(fit.cohesion_error_pa, other.intercept_stderr, rtol=1e-9)
    assert_allclose(math.tan(math.radians(fit.friction_angle_deg)), other.slope, rtol=1e-12)
    error = math.degrees(other.stderr / (1.0 + other.slope**2))
    assert_allclose(fit.friction_angle_error_deg, error, rtol=1e-9)
    assert_allclose(fit.r_squared, other.rvalue**2, rtol=1e-9)


@pytest.mark.parametrize("normal", [[1e3, 2e3], [1e3, 1e3, 1e3], []])
def test_too_few_stresses(normal: list[float]) -> None:
    """No line with an error through two points, or through one."""
    with pytest.raises(InputError, match="at least 3"):
        fit_coulomb(normal, normal)


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["tine.yaml", "--normal-pa", "1e4", "2e4"], "--normal-pa: given 10000 20000; give 3 or more"),
        (["tine.yaml", "--normal-pa", "0", "1e4", "2e4"], "above 0"),
        (
            ["tine.yaml", "--size-m", "0.24", "0.15", "0.16"],
            "--size-m: given 0.24 0.15 0.16; it must be at least 0.24 0.16 0.16, 12 x 8 x 8 of the largest",
        ),
        (["tine.yaml", "--inertial-number", "0"], "--inertial-number: given 0"),
        (["mechanism_only.yaml"], "has no 'soil'"),
        (
            ["tine.yaml", "--set", f"soil.law={YIELDING}", "--set", "soil.bed.spacing_m=rest"],
            "soil.law: given 'elasto_plastic_adhesive' with attraction",
        ),
        (["tine.yaml", "--out", str(SCENES)], "exists already"),
        (["tine.yaml", "--normal-pa", "100", "200", "300"], "below the weight of lid and soil"),
    ],
)
def test_refusals(arguments: list[str], complaint: str, capsys: pytest.CaptureFixture[str]) -> None:
    """One message and exit status 2."""
    assert main(["soil-test", str(SCENES / arguments[0]), *arguments[1:]]) == 2
    assert complaint in " ".join(capsys.readouterr().err.split())


def test_a_failed_series_leaves_nothing(tmp_path: Path) -> None:
    """Neither the folder nor a part of it, when the load turns out too small for the specimen."""
    scene = str(SCENES / "tine.yaml")
    out = tmp_path / "results" / "soil"
    assert main(["soil-test", scene, "--out", str(out), "--normal-pa", "100", "200", "300"]) == 2
    assert list(out.parent.iterdir()) == []
