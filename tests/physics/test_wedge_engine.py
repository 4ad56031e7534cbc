"""The wedge model engine: signs, dissipation, failure cycle, wheels, and no need of the DEM."""

import copy
import json
import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh
import yaml
from numpy.testing import assert_allclose

from subsoil_ros.errors import PhysicsError
from subsoil_ros.loading.loader import load_scene
from subsoil_ros.messages import ToolMotion
from subsoil_ros.wedge.wedge_engine import WedgeEngine

CONFIG = Path(__file__).parents[2] / "config"
VALUES = {
    "density_kg_per_m3": 1300.0,
    "cohesion_pa": 8e3,
    "friction_angle_rad": 0.5,
    "adhesion_pa": 1e3,
    "tool_friction_angle_rad": 0.3,
    "variation": 0.0,
    "drop": 0.0,
}
BLOCKS = {
    "failure": "gradual", "drop": 0.95, "block_depth_m": 0.05, "length_variation": 0.5, "period_m": 0.03,
    "rate_s_per_m": 0.5,
}  # fmt: skip
STEP_M = 5e-4
"""Per tick: 0.5 m/s at the default tick of 1 ms."""


@pytest.fixture
def engine(tmp_path):
    """Makes an engine for the meshes of the tine, its share 0.2 m deep; values and soil keys may change."""

    def make(values=None, mesh=None, share=True, **soil):
        groups = {"share": {"mesh": str(CONFIG / "meshes" / "share.stl")}}
        if mesh is not None:
            mesh.export(tmp_path / "tool.stl")
            groups = {"share": {"mesh": str(tmp_path / "tool.stl")}}
        elif share == "both":
            groups["blade"] = {"mesh": str(CONFIG / "meshes" / "shank.stl")}
        document = {
            "name": "wedge",
            "duration_s": 1.0,
            "soil": {
                "model": "wedge",
                "bin": {"length_m": 2.0, "width_m": 0.5, "depth_m": 0.5},
                "values": copy.deepcopy(VALUES) | (values or {}),
                **soil,
            },
            "tools": {"tool": {"path": {}, "groups": groups, "role": "tillage" if share else "wheel"}},
        }
        path = tmp_path / "scene.yaml"
        path.write_text(yaml.safe_dump(document, sort_keys=False))
        return WedgeEngine(load_scene(path))

    return make


def at(x=0.5, z=0.1, phi=0.0):
    """Motion of the single tool; the share's tip stands at (0.12, -0.30) of its frame."""
    return (ToolMotion("tool", x, 0.0, z, phi, 0.0, 0.0, 0.0),)


def drawn(soil, poses):
    """Wrenches along poses (x, z, phi)."""
    soil.start(at(*poses[0]))
    return [soil.advance(tick, at(*pose))[0] for tick, pose in enumerate(poses[1:])]


def forward(count, z=0.1, x=0.5):
    """Poses of a pull by STEP_M per tick."""
    return [(x + k * STEP_M, z, 0.0) for k in range(count)]


def test_force_resists_pushes_down_on_a_low_rake_and_balances_its_groups(engine):
    """A share of 25 degrees: soil pushes it back and down; the wrench is the sum over its groups."""
    last = drawn(engine(share="both"), forward(200))[-1]
    share, blade = last.groups
    assert share.force_x_newton < 0.0
    assert share.force_z_newton < 0.0
    assert blade.force_x_newton < 0.0
    assert last.force_x_newton == share.force_x_newton + blade.force_x_newton
    assert (last.force_y_newton, last.torque_x_newton_m, last.torque_z_newton_m) == (0.0, 0.0, 0.0)
    assert last.work_joule == pytest.approx(last.force_x_newton * STEP_M, rel=1e-9)


def test_steady_share_has_the_force_of_the_theory(engine):
    """H = P sin(alpha + delta) + c_a h w cot(alpha), V = P cos(alpha + delta) - c_a h w."""
    from subsoil_ros.wedge.failure_wedge import Plate, Strength, failure

    soil = engine({"adhesion_pa": 1e3})
    last = drawn(soil, forward(300))[-1]
    rake, height = math.radians(25.0), 0.18 * math.sin(math.radians(25.0))
    strength = Strength(1300.0 * 9.81, 1300.0, 8e3, 0.5, 1e3, 0.3, 0.0, 1.0)
    force = failure(Plate(0.06, rake, 0.2, height), strength, 0.5)[1]
    side = 2.0 * 0.0045 * 1.0  # area of a side is about 45 cm2; checked to a part of the whole below
    h = force * math.sin(rake + 0.3) + 1e3 * height * 0.06 / math.tan(rake)
    v = force * math.cos(rake + 0.3) - 1e3 * height * 0.06
    pressure = (1.0 - math.sin(0.5)) * 1300.0 * 9.81 * (0.2 - 0.5 * height)
    sides = side * (1e3 + pressure * math.tan(0.3))
    assert -last.force_x_newton == pytest.approx(h + sides, abs=0.25 * sides + 2e-3 * h)
    assert -last.force_z_newton == pytest.approx(v, rel=1e-3)


def test_a_failing_wedge_bears_more_the_faster_it_is_pushed(engine):
    """Steady: P (1 + rate v sin alpha) on the plate; the spring before it takes the same force."""
    rate, speed = 0.4, STEP_M / 1e-3
    plain, faster = (
        engine({"adhesion_pa": 0.0, "rate_s_per_m": part, "speed_factor": 0.0}) for part in (0.0, rate)
    )
    drawn(plain, forward(400))
    drawn(faster, forward(400))
    (slow,), (quick,) = plain.memory.tools[0].normal_newton, faster.memory.tools[0].normal_newton
    assert quick / slow == pytest.approx(1.0 + rate * speed * math.sin(math.radians(25.0)), rel=1e-6)


def test_speed_raises_the_least_force_of_a_wedge_as_much_as_its_peak(engine):
    """The limit of every phase is multiplied, so the force fluctuates by the same part at every speed."""
    values = {"adhesion_pa": 0.0, "tool_friction_angle_rad": 0.0, "speed_factor": 0.0, "variation": 0.0}
    values |= {"drop": 0.5, "period_m": 0.2}
    ranges = []
    for rate in (0.0, 1.0):
        soil = engine(values | {"rate_s_per_m": rate})
        forces = -np.array([w.force_x_newton for w in drawn(soil, forward(1000))][200:])
        ranges.append((forces.min(), forces.max()))
    raised = 1.0 + STEP_M / 1e-3 * math.sin(math.radians(25.0))
    assert_allclose(ranges[1], raised * np.array(ranges[0]), rtol=0.02)


def test_length_and_strength_vary_each_by_their_own(engine):
    """Even strengths with uneven lengths: the force rises to the same peak each time, after other travels."""
    values = {"variation": 0.0, "length_variation": 0.8, "drop": 0.4, "period_m": 0.02}
    soil = engine(values)
    forces = -np.array([w.force_x_newton for w in drawn(soil, forward(2000))])
    peaks = np.flatnonzero((forces[1:-1] > forces[:-2]) & (forces[2:] < 0.8 * forces[1:-1])) + 1
    assert len(peaks) > 10
    assert np.std(forces[peaks]) < 0.03 * forces[peaks].mean()
    assert np.std(np.diff(peaks)) > 0.4 * np.diff(peaks).mean()
    assert soil.memory.tools[0].strength == [1.0]


def test_rising_soil_lifts_an_upright_blade(engine):
    """Soil in front of it slides up, so friction is upward: V = -P sin(delta), H = P cos(delta)."""
    blade = trimesh.creation.box((0.02, 0.05, 0.6)).apply_translation((0.0, 0.0, -0.1))
    soil = engine({"adhesion_pa": 0.0, "density_kg_per_m3": 1e-3}, mesh=blade)
    last = drawn(soil, forward(200))[-1]
    assert last.force_z_newton == pytest.approx(
        -last.force_x_newton * math.tan(0.3), rel=5e-3
    )  # signs below 1 mm/s


def test_zero_in_air_before_the_soil_and_behind_it(engine):
    """No soil, no force: above the surface, at x < 0 and beyond the bin."""
    soil = engine(share="both")
    for x, z in ((0.5, 0.31), (-0.5, 0.1), (2.5, 0.1)):
        wrenches = drawn(soil, forward(5, z=z, x=x))
        assert all(w.force_x_newton == w.force_z_newton == w.work_joule == 0.0 for w in wrenches)
        assert wrenches[-1].contact_count == 0


def test_turning_the_nose_down_raises_the_rake(engine):
    """phi < 0 lowers the nose: 33 instead of 25 degrees at the same tip, and another force."""
    soil = engine()
    turn = math.radians(-8.0)
    tip_x = math.cos(turn) * 0.12 + math.sin(turn) * 0.30
    tip_z = math.sin(turn) * 0.12 - math.cos(turn) * 0.30
    steep = [(0.62 - tip_x + k * STEP_M, -0.2 - tip_z, turn) for k in range(200)]
    wrench = drawn(soil, steep)[-1]
    flat = drawn(soil, forward(200))[-1]
    # tan of the force's slope is tan(alpha + delta): the friction cone turns with the share
    assert wrench.force_z_newton / wrench.force_x_newton < flat.force_z_newton / flat.force_x_newton


@pytest.mark.parametrize("values", [{"drop": 0.4, "variation": 0.2}, BLOCKS])
@pytest.mark.parametrize("seed", range(4))
def test_soil_never_gives_energy(engine, seed, values):
    """Over closed paths of any kind, turning ones too, the soil's work is never positive."""
    random = np.random.default_rng(seed)
    soil = engine(values, share="both")
    time = np.linspace(0.0, 2.0 * np.pi, 1500)
    shape = sum(
        random.normal(size=(3, 1)) * np.sin(k * time + random.uniform(0.0, 6.28, (3, 1))) for k in (1, 3, 7)
    )
    poses = np.array([[0.6], [0.12], [-0.05]]) + np.array([[0.02], [0.015], [0.02]]) * shape
    poses[:, -1] = poses[:, 0]
    work, held = [0.0], 0.0
    soil.start(at(*poses[:, 0].tolist()))
    for tick, pose in enumerate(poses.T.tolist()):
        work.append(work[-1] + soil.advance(tick, at(*pose))[0].work_joule)
        share, blade = soil.memory.tools[0].normal_newton
        held = max(held, share**2 / (2.0 * 2e7 * 0.06 * 0.18) + blade**2 / (2.0 * 2e7 * 0.03 * 0.68))
    assert work[-1] < 0.0
    assert np.max(np.array(work) - np.minimum.accumulate(work)) <= held  # the springs', and no more


def test_spring_gives_back_no_more_than_it_took(engine):
    """Pressed in below failure and let out again: the work is negative, and the spring is empty."""
    soil = engine({"adhesion_pa": 0.0, "tool_friction_angle_rad": 0.0})
    there = [(0.5 + 1e-4 * k, 0.1, 0.0) for k in range(6)]
    work = sum(w.work_joule for w in drawn(soil, there + there[::-1]))
    assert work < 0.0
    assert soil.memory.tools[0].normal_newton[0] == pytest.approx(0.0, abs=1e-6)


def test_failure_cycle_builds_and_drops(engine):
    """(1 - drop) P to P and back, every period_factor wedge lengths of travel; without variation exactly."""
    soil = engine({"drop": 0.4, "period_factor": 0.1, "bed_modulus_newton_per_m3": 1e9})
    wrenches = drawn(soil, forward(1400))[200:]
    force = np.array([-w.force_x_newton for w in wrenches])
    falls = np.flatnonzero(np.diff(force) < -0.1 * force.max())
    period = np.diff(falls) * STEP_M
    assert len(period) >= 5
    assert np.ptp(period) <= STEP_M * 1.001
    assert (force.max() - force.min()) / force.max() == pytest.approx(0.4, abs=0.05)  # sides do not drop
    assert np.all(np.diff(force)[np.setdiff1d(np.arange(len(force) - 1), falls)] > -1e-9 * force.max())
    from subsoil_ros.wedge.failure_wedge import Plate, Strength, failure

    strength = Strength(1300.0 * 9.81, 1300.0, 8e3, 0.5, 1e3, 0.3, 0.0, 1.0)
    length = failure(Plate(0.06, math.radians(25.0), 0.2, 0.0761), strength, 0.5)[2]
    assert period.mean() == pytest.approx(0.1 * length, rel=0.02)


def test_variation_is_seeded(engine):
    """The same seed gives the same bits, another seed another series of about the same mean."""

    def forces(seed):
        soil = engine({"drop": 0.3, "variation": 0.2, "period_factor": 0.03}, seed=seed)
        return np.array([w.force_x_newton for w in drawn(soil, forward(2000))])

    one, again, other = forces(1), forces(1), forces(2)
    assert np.array_equal(one, again)
    assert not np.array_equal(one, other)
    # some 70 wedges of 20 % deviation: 2.4 % of the mean, three times that between two
    assert one.mean() == pytest.approx(other.mean(), rel=0.1)


def test_point_of_action_lies_on_the_share(engine):
    """The wrench about the body's centre of mass has its line through the share, between tip and top."""
    soil = engine({"adhesion_pa": 0.0, "tool_friction_angle_rad": 0.0})
    w = drawn(soil, forward(300))[-1]
    # torque_y = z F_x - x F_z; points of the share: (0.12 - s cos, -0.30 + s sin), s along it
    c, s = math.cos(math.radians(25.0)), math.sin(math.radians(25.0))
    along = (w.torque_y_newton_m + 0.30 * w.force_x_newton + 0.12 * w.force_z_newton) / (
        s * w.force_x_newton + c * w.force_z_newton
    )
    assert 0.3 * 0.18 <= along <= 0.55 * 0.18


def test_speed_term_is_inertia(engine):
    """Density x speed^2 in two dimensions is what speed adds; speed_factor 0 removes it."""

    def draft(step, factor):
        soil = engine({"speed_factor": factor, "cohesion_pa": 0.0, "adhesion_pa": 0.0})
        return -drawn(soil, [(0.5 + k * step, 0.1, 0.0) for k in range(200)])[-1].force_x_newton

    slow, fast, none = draft(1e-4, 1.0), draft(2e-3, 1.0), draft(2e-3, 0.0)
    assert none == pytest.approx(slow, rel=0.02)
    assert fast > 1.05 * none


def wheel(radius=0.2, width=0.1):
    """A wheel about its centre, axle along y."""
    mesh = trimesh.creation.cylinder(radius, width, sections=64)
    return mesh.apply_transform(trimesh.transformations.rotation_matrix(math.pi / 2.0, (1, 0, 0)))


BED = {"wheels": {"cohesive_modulus": 0.0, "frictional_modulus": 4e6, "exponent": 1.0}}


def test_wheel_sinks_to_its_load_and_rolls_against_resistance(engine):
    """Standing: W(z) alone. Rolling: R against travel, no torque; skidding: a torque that spins it up."""
    soil = engine(BED, mesh=wheel(), share=False)
    z, load = 0.18, 0.1 * 4e6 * math.sqrt(0.4) * 0.02**1.5 * 2.0 / 3.0
    first = soil.start(at(0.5, z))[0]
    assert first.force_z_newton == pytest.approx(load)
    assert first.force_x_newton == first.torque_y_newton_m == 0.0
    radius = 0.2
    rolled = drawn(soil, [(0.5 + k * STEP_M, z, -k * STEP_M / radius) for k in range(200)])[-1]
    assert rolled.force_x_newton == pytest.approx(-0.1 * 4e6 * 0.02**2 / 2.0, rel=3e-3)
    assert rolled.torque_y_newton_m == pytest.approx(0.0, abs=1e-4)  # radius as float32 in the mesh
    skid = drawn(soil, [(0.5 + k * STEP_M, z, 0.0) for k in range(400)])[-1]
    assert skid.force_x_newton < rolled.force_x_newton - 0.3 * load * math.tan(0.5)
    assert skid.torque_y_newton_m > 0.0  # about +y: x forward turns under, as rolling does


def test_standing_wheel_stays(engine):
    """A wheel at rest is neither pushed nor turned, and lifted it feels nothing."""
    soil = engine(BED, mesh=wheel(), share=False)
    still = drawn(soil, [(0.5, 0.19, 0.0)] * 10)[-1]
    assert still.force_x_newton == still.torque_y_newton_m == still.work_joule == 0.0
    assert drawn(soil, [(0.5, 0.21, 0.0)] * 3)[-1].force_z_newton == 0.0


def test_share_that_turns_out_of_the_theory_stops_the_run(engine):
    """Below 15 degrees the wedge theory says nothing; the error names tool and tick."""
    soil = engine()
    with pytest.raises(PhysicsError, match=r"tick 0: tools.tool: its share has a rake of 13\.5 degrees"):
        drawn(soil, [(0.5, 0.1, 0.0), (0.5, 0.1, 0.2)])


@pytest.mark.parametrize("values", [{"drop": 0.3, "variation": 0.2, "period_factor": 0.03}, BLOCKS])
def test_state_is_all_there_is(engine, values):
    """An engine that takes over another's memory goes on alike, bit for bit."""
    one, two = engine(values, share="both"), engine(values, share="both")
    poses = [(x, z + 0.05 * math.sin(0.02 * k), phi) for k, (x, z, phi) in enumerate(forward(600))]
    drawn(one, poses[:300])
    two.restore({name: np.array(array) for name, array in one.state_arrays().items()})
    for tick, pose in enumerate(poses[300:]):
        assert one.advance(tick, at(*pose)) == two.advance(tick, at(*pose))


def test_no_particle_code_is_imported(tmp_path):
    """A run on the wedge model, command line and summary included, imports nothing of the DEM."""
    scene = tmp_path / "scene.yaml"
    values = json.dumps({k: v for k, v in VALUES.items()})
    scene.write_text(
        f"base: {CONFIG / 'scenes' / 'tine.yaml'}\nname: wedge\nduration_s: 0.05\n"
        f"soil: {{model: wedge, values: {values}}}\n"
    )
    code = (
        "import sys; from subsoil_ros.cli.main import main\n"
        f"status = main(['run', {str(scene)!r}, '--mode', 'direct', '--out', {str(tmp_path / 'out')!r}])\n"
        f"status += main(['check', {str(scene)!r}])\n"
        f"status += main(['report', {str(tmp_path / 'out')!r}])\n"
        "assert not [name for name in sys.modules if name.startswith('subsoil_ros.dem')], 'imported'\n"
        "sys.exit(status)"
    )
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr
    head = (tmp_path / "out" / "series.csv").read_text().splitlines()[0].split(",")
    assert not [name for name in head if name.startswith("soil.")]  # nothing to monitor, nothing invented
    figures = sorted(path.name for path in (tmp_path / "out" / "figures").iterdir())
    assert figures == ["draft.png", "over_travel.png", "tool.png"]
    assert json.loads((tmp_path / "out" / "summary.json").read_text())["particles"]["count"] == 0


def test_a_blunt_tip_is_lifted_as_much_as_it_is_held_back(engine):
    """By bearing pressure times width times height of the tip; with the wedge as far as it is mobilised."""
    values = {"theory": "perumpral", "adhesion_pa": 0.0, "speed_factor": 0.0}
    sharp, blunt = (drawn(engine({**values, "tip_m": tip}), forward(400))[-1] for tip in (0.0, 0.01))
    tangent = math.tan(0.5)
    n_q = math.tan(0.25 * math.pi + 0.25) ** 2 * math.exp(math.pi * tangent)
    pressure = 8e3 * (n_q - 1.0) / tangent + 1300.0 * 9.81 * 0.2 * n_q
    assert n_q == pytest.approx(16.0, rel=0.02)  # at 28.6 degrees, between 14.7 at 28 and 16.4 at 29
    lift = 0.06 * 0.01 * pressure
    assert sharp.force_x_newton - blunt.force_x_newton == pytest.approx(lift, rel=5e-3)
    assert blunt.force_z_newton - sharp.force_z_newton == pytest.approx(lift, rel=5e-3)


def test_a_shank_parts_broken_soil_at_its_bearing_pressure(engine):
    """H = pressure at half its depth times its front; cohesion counts by the part that is left."""
    values = {"theory": "perumpral", "adhesion_pa": 0.0, "tool_friction_angle_rad": 0.0, "speed_factor": 0.0}
    forces = [
        -drawn(engine({**values, "shank_fraction": part}, share="both"), forward(400))[-1]
        .groups[1]
        .force_x_newton
        for part in (0.0, 0.25, 0.5)
    ]
    assert forces[2] - forces[1] == pytest.approx(forces[1] - forces[0], rel=1e-6)
    tangent = math.tan(0.5)
    n_q = math.tan(0.25 * math.pi + 0.25) ** 2 * math.exp(math.pi * tangent)
    front_m2 = (forces[1] - forces[0]) / (0.25 * 8e3 * (n_q - 1.0) / tangent)
    blade = trimesh.load(CONFIG / "meshes" / "shank.stl")
    height = -(0.1 + blade.bounds[0, 2])  # of what is in the soil
    assert front_m2 == pytest.approx(np.ptp(blade.bounds[:, 1]) * height, rel=0.02)
    assert forces[0] == pytest.approx(1300.0 * 9.81 * 0.5 * height * n_q * front_m2, rel=0.02)


def test_gradual_failure_falls_as_it_rises(engine):
    """Along a parabola from P to (1 - drop) P and back: mean 1 - 2 drop / 3, rising on half of the travel."""
    values = {"speed_factor": 0.0, "variation": 0.0, "length_variation": 0.5, "period_m": 0.05}
    found = []
    for change in ({"drop": 0.0}, {"drop": 0.6, "failure": "gradual"}):
        soil = engine(values | change, bin={"length_m": 6.0, "width_m": 0.5, "depth_m": 0.5})
        drawn(soil, forward(1000))
        normal = []
        for tick in range(6000):
            soil.advance(tick, at(x=1.0 + tick * STEP_M))
            normal.append(soil.memory.tools[0].normal_newton[0])
        found.append(np.array(normal))
    over = found[1] / found[0]
    assert_allclose([over.mean(), over.min(), over.max()], [0.6, 0.4, 1.0], rtol=0.02)
    assert (np.diff(over) > 0.0).mean() == pytest.approx(0.5, abs=0.04)


def test_deeper_wedges_fail_in_more_blocks(engine):
    """Blocks of one size: at twice the depth four, so half the deviation; up to block_depth_m one."""
    values = {
        "drop": 0.4, "block_depth_m": 0.1, "period_m": 0.02, "adhesion_pa": 0.0,
        "variation": 0.0, "length_variation": 0.5,
    }  # fmt: skip
    found = []
    for z in (0.11, 0.21, 0.25):  # tip 0.19, 0.09 and 0.05 m deep
        soil = engine(values, bin={"length_m": 6.0, "width_m": 0.5, "depth_m": 0.5})
        drawn(soil, forward(1000, z=z))
        normal, memory = [], soil.memory.tools[0]
        for tick in range(6000):
            soil.advance(tick, at(x=1.0 + tick * STEP_M, z=z))
            normal.append(memory.normal_newton[0])
        found.append((len(memory.phase), np.std(normal) / np.mean(normal)))
    assert [count for count, _ in found] == [4, 1, 1]
    single = 0.4 / np.sqrt(12.0) / (1.0 - 0.5 * 0.4)
    assert_allclose([deviation for _, deviation in found], [0.5 * single, single, single], rtol=0.1)
