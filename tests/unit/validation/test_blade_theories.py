"""Closed forms of the draft of a blade against worked numbers, equilibrium, published tables and limits."""

import math
from dataclasses import replace

import numpy as np
import pytest

from subsoil_ros.wedge.failure_wedge import Plate, wedge_force
from validation import blades
from validation.blades import Blade, Soil

WORKED = 0.01
"""Of numbers printed with three digits."""

TWO_DIGITS = 0.02
"""Of numbers printed with two digits near 2.5."""

KERISEL_ABSI = 0.05
"""The tables round to two or three digits and the method of moments is a limit from above: +4.8 % at most."""


def soil(friction=30.0, delta=0.0, cohesion=0.0, density=1500.0, **more):
    """Angles in degrees."""
    return Soil(cohesion, math.radians(friction), density, math.radians(delta), **more)


def blade(rake=90.0, width=1.0, depth=0.3, speed=0.0):
    """Rake in degrees."""
    return Blade(width, depth, math.radians(rake), speed)


def total(force):
    """P where there is no adhesion along the blade."""
    return math.hypot(force.draft_newton, force.vertical_newton)


def weight_factor(theory, friction, delta, rake):
    """N_gamma of a theory of wide blades."""
    made, flat = soil(friction, delta), blade(rake)
    return total(theory(made, flat)) / (made.unit_weight * flat.depth_m**2)


@pytest.mark.parametrize(("rake", "expected"), [(30, 1.71), (45, 1.61), (60, 1.82), (75, 2.45), (90, 4.16)])
def test_reeces_worked_weight_factors(rake, expected):
    """phi 35, delta 20 degrees; at 60 degrees the plane rises at 28.1."""
    assert weight_factor(blades.reece, 35.0, 20.0, rake) == pytest.approx(expected, rel=WORKED)
    if rake == 60:
        beta = blades.reece(soil(35.0, 20.0), blade(60.0)).beta_rad
        assert math.degrees(beta) == pytest.approx(28.1, abs=0.05)


@pytest.mark.parametrize(
    ("friction", "ratios"),
    [(30.0, (3.53, 2.49, 2.34, 2.50, 3.06)), (35.0, (3.66, 2.67, 2.60, 2.91, 3.84))],
)
def test_rupture_distance_ratios(friction, ratios):
    """Rupture distance over depth at delta = 2 phi / 3, for rakes of 25 to 90 degrees."""
    for rake, expected in zip((25.0, 45.0, 60.0, 75.0, 90.0), ratios, strict=True):
        made, flat = soil(friction, friction / 1.5), blade(rake)
        for theory in (blades.reece, blades.godwin_odogherty):
            assert theory(made, flat).rupture_m / flat.depth_m == pytest.approx(expected, rel=WORKED)


@pytest.mark.parametrize(("rake", "beta", "speed"), [(90.0, 20.0, 0.0), (50.0, 35.0, 2.0), (25.0, 70.0, 1.0)])
def test_plane_wedge_balances_along_both_axes(rake, beta, speed):
    """P and the reaction of the plane hold weight, cohesion, adhesion, surcharge and momentum of the soil."""
    made = soil(33.0, 21.0, 4e3, adhesion_pa=1500.0, surcharge_pa=700.0)
    d, alpha, at, phi = 0.25, math.radians(rake), math.radians(beta), made.friction_rad
    length = d / math.tan(alpha) + d / math.tan(at)
    slope = np.array([math.cos(at), math.sin(at)])  # the soil moves up it
    downward = np.array([0.0, -1.0])
    loads = (0.5 * made.unit_weight * d * length + made.surcharge_pa * length) * downward
    loads = loads - made.cohesion_pa * d / math.sin(at) * slope
    loads += made.adhesion_pa * d * np.array([1.0 / math.tan(alpha), -1.0])
    loads -= made.density_kg_per_m3 * d * speed**2 * math.sin(alpha) / math.sin(alpha + at) * slope
    blade_pushes = [math.sin(alpha + made.delta_rad), math.cos(alpha + made.delta_rad)]
    plane_pushes = [-math.sin(at + phi), math.cos(at + phi)]
    p, _ = np.linalg.solve(np.transpose([blade_pushes, plane_pushes]), -loads)
    factors = blades.plane_factors(made, alpha, np.array(at))
    static = factors.pressure(made, blade(rake, depth=d))
    assert static + made.density_kg_per_m3 * speed**2 * d * factors.inertia == pytest.approx(p, rel=1e-12)


@pytest.mark.parametrize("theory", [blades.reece, blades.log_spiral])
def test_smooth_upright_wall(theory):
    """K_p = tan^2(45 + phi/2) without cohesion; 2 c d + gamma d^2 / 2 in clay; 2 c sqrt(K_p) between."""
    for friction in (10.0, 30.0, 45.0):
        k_p = math.tan(math.radians(45.0 + 0.5 * friction)) ** 2
        assert 2.0 * weight_factor(theory, friction, 0.0, 90.0) == pytest.approx(k_p, rel=1e-9)
        made = soil(friction, 0.0, 5e3, 0.0)
        expected = 2.0 * made.cohesion_pa * math.sqrt(k_p) * 0.3
        assert theory(made, blade()).draft_newton == pytest.approx(expected, rel=1e-9)
    clay = soil(0.0, 0.0, 5e3)
    expected = 2.0 * 5e3 * 0.3 + 0.5 * clay.unit_weight * 0.09
    assert theory(clay, blade()).draft_newton == pytest.approx(expected, rel=1e-9)
    assert theory(clay, blade()).vertical_newton == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(
    ("rake", "roughness", "coefficients"),
    [
        (90.0, 1.0, (1.66, 2.20, 3.10, 4.40, 6.50, 10.5, 18.0)),
        (90.0, 2.0 / 3.0, (1.59, 2.05, 2.75, 3.70, 5.30, 8.00, 12.0)),
        (90.0, 1.0 / 3.0, (1.51, 1.88, 2.40, 3.10, 4.00, 5.40, 7.60)),
        (75.0, 2.0 / 3.0, (1.39, 1.70, 2.10, 2.70, 3.50, 4.90, 6.90)),
        (105.0, 2.0 / 3.0, (1.72, 2.40, 3.40, 4.90, 7.50, 12.1, 21.0)),
        (60.0, 2.0 / 3.0, (1.14, 1.32, 1.57, 1.90, 2.30, 2.95, 3.90)),
    ],
)
def test_log_spiral_against_kerisel_and_absi(rake, roughness, coefficients):
    """J. Kerisel, E. Absi, Active and Passive Earth Pressure Tables (1990), level ground, phi 10 to 40.

    Their coefficient is P / (gamma l^2 / 2), l the length of the wall. Read from the transcription of
    the tables in github.com/EdisonJR624/PreqdFHWA (CasesKREA). The plane wedge lies up to 5 times above.
    """
    for friction, expected in zip(range(10, 41, 5), coefficients, strict=True):
        spiral = weight_factor(blades.log_spiral, friction, roughness * friction, rake)
        per_length = 2.0 * math.sin(math.radians(rake)) ** 2
        assert per_length * spiral == pytest.approx(expected, rel=KERISEL_ABSI)
        assert spiral <= weight_factor(blades.reece, friction, roughness * friction, rake)


@pytest.mark.parametrize(
    ("friction", "delta", "rake"), [(30, 20, 90), (30, 30, 90), (40, 20, 90), (30, 20, 100)]
)
def test_log_spiral_under_surcharge_against_slip_lines(friction, delta, rake):
    """Weightless soil has an exact field of slip lines (Prandtl): a fan between Rankine's zone and the blade.

    Stress on the blade by Mohr's circle, mean stress growing by exp(2 angle tan phi). Moments err upward, by
    less than 5 %, and not at all at delta = phi, where the fan reaches the blade as one spiral.
    """
    phi, at = math.radians(friction), math.radians(delta)
    turned = 0.5 * (math.asin(math.sin(at) / math.sin(phi)) + at) - math.radians(90 - rake)
    exact = (math.cos(at) + math.sqrt(math.sin(phi) ** 2 - math.sin(at) ** 2)) / (1.0 - math.sin(phi))
    exact *= math.exp(2.0 * turned * math.tan(phi)) / math.sin(math.radians(rake))
    made = soil(friction, delta, density=0.0, surcharge_pa=1.0)
    found = total(blades.log_spiral(made, blade(rake, depth=1.0)))
    assert exact * (1.0 - 1e-9) <= found < 1.05 * exact
    if delta == friction:
        assert found == pytest.approx(exact, rel=1e-6)


@pytest.mark.parametrize(("rake", "theta"), [(90.0, 0.4), (75.0, 0.6), (110.0, 1.0)])
def test_cohesion_corresponds_to_pressure(rake, theta):
    """Caquot: c and c_a = c tan delta / tan phi act as an all-round pressure of c cot phi, less itself.

    N_c + N_ca tan delta / tan phi = cot phi (N_q - 1 / (sin alpha cos delta)) on every failure surface.
    """
    made, alpha = soil(30.0, 20.0), math.radians(rake)
    ratio, cot = math.tan(made.delta_rad) / math.tan(made.friction_rad), 1.0 / math.tan(made.friction_rad)
    for factors in (
        blades.plane_factors(made, alpha, np.array(0.3 * theta)),
        blades.spiral_factors(made, alpha, theta)[0],
    ):
        expected = cot * (factors.surcharge - 1.0 / (math.sin(alpha) * math.cos(made.delta_rad)))
        assert factors.cohesion + ratio * factors.adhesion == pytest.approx(expected, rel=1e-4)


def test_flat_blades_have_no_spiral():
    """Friction bends the surface below the tip of steep blades only: at 45 degrees the plane fails first."""
    made = soil(35.0, 20.0, 5e3)
    assert blades.log_spiral(made, blade(45.0)) == blades.reece(made, blade(45.0))
    assert blades.log_spiral(made, blade(90.0)).beta_rad < 0.0 < blades.reece(made, blade(90.0)).beta_rad


THEORIES = [
    blades.reece,
    blades.log_spiral,
    blades.mckyes_ali,
    blades.perumpral,
    blades.godwin_odogherty,
    lambda soil, blade: blades.godwin_spoor(soil, blade)[0],
]


@pytest.mark.parametrize("theory", THEORIES)
def test_scales_with_the_size(theory):
    """Without cohesion, twice the size draws 8 times as much; wide blades at twice the depth 4 times."""
    made = soil(32.0, 20.0)
    small, large = theory(made, blade(60.0, 0.1, 0.2)), theory(made, blade(60.0, 0.2, 0.4))
    assert large.draft_newton == pytest.approx(8.0 * small.draft_newton, rel=1e-6)
    assert large.rupture_m == pytest.approx(2.0 * small.rupture_m, rel=1e-4)
    shallow, deep = theory(made, blade(60.0, 1e5, 0.2)), theory(made, blade(60.0, 1e5, 0.4))
    assert deep.draft_newton == pytest.approx(4.0 * shallow.draft_newton, rel=1e-5)


@pytest.mark.parametrize("theory", THEORIES[2:])
def test_wide_blades_are_the_plane_wedge(theory):
    """Sides are c d / w of a wide blade: a millionth here, at every rake."""
    for rake in (30.0, 60.0, 90.0):
        made, wide = soil(30.0, 20.0, 5e3), blade(rake, 1e6)
        expected = blades.reece(made, wide)
        assert theory(made, wide)[:2] == pytest.approx(expected[:2], rel=1e-5)
        narrow = replace(wide, width_m=0.06)
        assert theory(made, narrow).draft_newton > blades.reece(made, narrow).draft_newton


@pytest.mark.parametrize(
    ("cohesion", "friction", "density", "expected"),
    [(37.9e3, 23.1, 1296.0, 9.0e3), (23.1e3, 43.0, 1735.0, 5.7e3)],
)
def test_perumpral_of_the_tested_beds(cohesion, friction, density, expected):
    """A share of 60 mm at 25 degrees, 0.30 m deep, delta 23: strength of yuan_yu_2020/soil_tests.md."""
    share = blade(25.0, 0.06)
    made = soil(friction, 23.0, cohesion, density)
    assert blades.perumpral(made, share).draft_newton == pytest.approx(expected, rel=WORKED)


def test_mckyes_and_ali_of_the_same_share():
    """6.3 kN in the dense bed; in the others the least is the upright plane: 1.6 kN, and 0.95 in a loam."""
    share = blade(25.0, 0.06)
    dense = soil(43.0, 23.0, 23.1e3, 1735.0)
    assert blades.mckyes_ali(dense, share).draft_newton == pytest.approx(6.3e3, rel=WORKED)
    for made, expected in (
        (soil(23.1, 23.0, 37.9e3, 1296.0), 1.6e3),
        (soil(32.0, 23.0, 10e3, 1450.0), 0.95e3),
    ):
        least = blades.mckyes_ali(made, share)
        assert math.degrees(least.beta_rad) == pytest.approx(90.0, abs=0.1)
        assert least.draft_newton == pytest.approx(expected, rel=WORKED)


def test_mckyes_and_ali_is_the_wedge_model():
    """The same P as in the wedge model, with adhesion, surcharge and speed."""
    made = soil(32.0, 20.0, 8e3, adhesion_pa=2e3, surcharge_pa=500.0)
    tool = blade(60.0, 0.08, 0.2, 1.5)
    force = blades.mckyes_ali(made, tool)
    p = wedge_force(Plate(0.08, tool.rake_rad, 0.2, 0.2), made.strength, 1.5, force.beta_rad)
    at, adhesion = tool.rake_rad + made.delta_rad, 2e3 * 0.08 * 0.2
    assert force.draft_newton == pytest.approx(p * math.sin(at) + adhesion / math.tan(tool.rake_rad))
    assert force.vertical_newton == pytest.approx(p * math.cos(at) - adhesion)


def test_critical_depth_of_a_narrow_tine():
    """50 mm, upright, c 5 kPa, phi 30: 0.23 m, with delta = 2 phi / 3 and 1700 kg/m3, at any depth below."""
    made = soil(30.0, 20.0, 5e3, 1700.0)
    for depth in (0.4, 0.6):
        force, critical = blades.godwin_spoor(made, blade(90.0, 0.05, depth))
        assert critical == pytest.approx(0.23, rel=WORKED)
        assert force.draft_newton < blades.godwin_odogherty(made, blade(90.0, 0.05, depth)).draft_newton
    whole = blade(25.0, 0.06)
    loam = soil(32.0, 23.0, 10e3, 1450.0)
    force, critical = blades.godwin_spoor(loam, whole)
    assert critical == pytest.approx(0.3)
    assert force == blades.godwin_odogherty(loam, whole)


def test_speed_adds_momentum():
    """rho v^2 d N_a (w + 0.6 d), smooth, upright: N_a = cos phi / (cos beta cos(beta + phi)), 2 at 30."""
    made = soil(30.0, 0.0, 5e3, 1500.0)
    slow, fast = blade(90.0, 0.06, 0.2), blade(90.0, 0.06, 0.2, 2.0)
    more = blades.godwin_odogherty(made, fast).draft_newton - blades.godwin_odogherty(made, slow).draft_newton
    assert more == pytest.approx(1500.0 * 4.0 * 0.2 * 2.0 * (0.06 + 0.12), rel=1e-6)
    assert blades.reece(made, fast) == blades.reece(made, slow)


@pytest.mark.parametrize("theory", THEORIES)
def test_flat_blades_are_drawn_in_and_steep_ones_lifted(theory):
    """The force stands at rake + delta to the vertical: downward below 90 degrees, upward above."""
    made = soil(30.0, 20.0, 5e3)
    assert theory(made, blade(45.0, 0.06)).vertical_newton > 0.0
    assert theory(made, blade(90.0, 0.06)).vertical_newton < 0.0


def test_asabe_subsoiler():
    """0.30 m at 1.8 km/h: 30 (226 + 1.8 x 3.24) = 6955 N in fine soil; 1.9 kN in sand at 0.18 m."""
    assert blades.asabe_newton(0.30, 0.5, "fine") == pytest.approx(6954.96, abs=0.01)
    assert blades.asabe_newton(0.18, 0.5, "coarse") == pytest.approx(1.9e3, rel=TWO_DIGITS)
    assert blades.asabe_newton(0.15, 0.5, "fine") == pytest.approx(0.5 * 6954.96, abs=0.01)


@pytest.mark.parametrize("theory", THEORIES)
def test_refuses_a_blade_that_no_wedge_slides_up(theory):
    """rake + phi + delta of 180 degrees or more, with the angles and what to do."""
    with pytest.raises(
        ValueError, match=r"110 \+ 40 \+ 30 degrees leave no passive wedge.*Take a lower rake"
    ):
        theory(soil(40.0, 30.0), blade(110.0))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: soil(friction=90.0), "friction_rad: 1.5708 is outside 0"),
        (lambda: soil(cohesion=-1.0), "cohesion_pa: -1 is outside 0"),
        (lambda: soil(cohesion=math.nan), "cohesion_pa: nan is outside 0"),
        (lambda: blade(width=0.0), "width_m: 0 is outside 1e-06"),
        (lambda: blade(rake=180.0), "rake_rad: 3.14159 is outside 0.001"),
    ],
)
def test_refuses_values_of_no_soil_and_no_blade(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def test_command_prints_one_row_a_theory(monkeypatch, capsys):
    """Drafts as the functions give them; angles without a wedge end with status 2."""
    options = ["--cohesion-kpa", "5", "--friction-deg", "30", "--delta-deg", "20", "--rake-deg", "60"]
    monkeypatch.setattr("sys.argv", ["blades", *options, "--depth-m", "0.2", "--density", "1500"])
    blades.main()
    rows = [line.split(" | ") for line in capsys.readouterr().out.splitlines()[2:]]
    assert len(rows) == 9
    draft = blades.perumpral(soil(30.0, 20.0, 5e3), blade(60.0, 0.06, 0.2)).draft_newton
    assert float(next(row for row in rows if "Perumpral" in row[0])[1]) == round(draft)
    monkeypatch.setattr("sys.argv", ["blades", "--rake-deg", "130"])
    with pytest.raises(SystemExit) as left:
        blades.main()
    assert left.value.code == 2
    assert "no passive wedge" in capsys.readouterr().err
