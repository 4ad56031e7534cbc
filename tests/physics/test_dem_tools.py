"""Tools in the soil: geometry of contact, exchange of momentum, energy."""

import math

import numpy as np
import pytest
import trimesh
from numpy.testing import assert_allclose

from subsoil_ros.dem.tools.motion import motion_within
from subsoil_ros.errors import PhysicsError
from subsoil_ros.messages import ToolMotion
from tests.soils import NEGLIGIBLE

MASS = 1800.0 * 4.0 / 3.0 * math.pi * 0.01**3
NO_ADHESION = {"cohesive_stiffness_newton_per_m": NEGLIGIBLE}


def rest_on_a_box(soil, at, one, subdivide, setback_m=0.0):
    """A sphere slides and comes to rest on the top of a box, 0.06 m above the floor, less the setback."""
    engine = soil.engine(
        "soil.bin.length_m=0.4",
        law={"rolling_friction": 0.01},
        tools=one(soil.box(0.3, 0.1, 0.04, subdivide=subdivide), setback_m=setback_m),
    )
    top = engine.bed.lower_m[2] + 0.08
    engine.place([(0.15, 0.003, top + 0.0081 - setback_m)], [(0.3, 0.02, 0.0)])
    motions = at(0.2, top - 0.02)
    engine.start(motions)
    for tick in range(3000):
        wrench = engine.advance(tick, motions)[0]
    return engine.positions_m()[0] - (0.0, 0.0, top), engine.angular_velocities_rad_per_s()[0], wrench


@pytest.mark.parametrize("subdivide", [1, 5])
def test_a_plane_is_the_same_however_it_is_meshed(soil, at, one, subdivide):
    """Facets larger and much smaller than the sphere give one contact and the same motion."""
    coarse = rest_on_a_box(soil, at, one, 0)
    fine = rest_on_a_box(soil, at, one, subdivide)
    assert fine[2].contact_count == 1
    # the foot of the centre on a facet is known to round-off of the mesh's float32 corners: 1e-8 m
    assert_allclose(fine[0], coarse[0], atol=1e-7)
    assert_allclose(fine[1], coarse[1], atol=1e-4)


def test_a_facet_plane_acts_as_a_wall_does(soil, at, one):
    """The same sphere on the floor and on a box: same slide, same overlap, weight on the tool."""
    facets = rest_on_a_box(soil, at, one, 0)
    engine = soil.engine("soil.bin.length_m=0.4", law={"rolling_friction": 0.01})
    floor = engine.bed.lower_m[2]
    engine.place([(0.15, 0.003, floor + 0.0081)], [(0.3, 0.02, 0.0)])
    engine.start(())
    for tick in range(3000):
        engine.advance(tick, ())
    # z of the box's top is a float32 in the file
    assert_allclose(facets[0], engine.positions_m()[0] - (0.0, 0.0, floor), atol=1e-7)
    assert_allclose(facets[2].force_z_newton, -MASS * 9.81, rtol=1e-3)


def test_a_setback_moves_the_surface_that_is_felt_and_nothing_else(soil, at, one):
    """The sphere slides and rests as on the surface itself, deeper by the setback."""
    level, back = rest_on_a_box(soil, at, one, 0), rest_on_a_box(soil, at, one, 0, setback_m=0.006)
    assert_allclose(back[0], level[0] - (0.0, 0.0, 0.006), atol=1e-7)
    assert_allclose(back[1], level[1], atol=1e-9)
    assert_allclose(back[2].force_z_newton, level[2].force_z_newton, rtol=1e-9)


@pytest.mark.parametrize("angle_rad", [0.0, 0.3])
def test_convex_edges_and_vertices_are_one_contact(soil, at, one, angle_rad):
    """Near an edge or a corner of a box: one contact, its force along the line to the nearest point."""
    half = np.array([0.05, 0.02, 0.03])
    for direction in ((1, 0, 1), (1, 1, 0), (0, 1, 1), (1, 1, 1), (-1, 1, -1)):
        engine = soil.engine(
            "gravity_m_per_s2=0", "soil.bin.length_m=0.4", "soil.bin.width_m=0.3", "soil.bin.depth_m=0.3",
            law=NO_ADHESION | {"rolling_friction": NEGLIGIBLE}, tools=one(soil.box(*(2 * half), subdivide=2)),
        )  # fmt: skip
        unit = np.array(direction) / np.linalg.norm(direction)
        local = half * np.array(direction) + unit * 0.0079  # overlap 2.1 mm: 0.1 mm into repulsion
        if 0 in direction:
            local[direction.index(0)] = 0.007
        c, s = math.cos(angle_rad), math.sin(angle_rad)

        def world(v, c=c, s=s):
            return np.array([c * v[0] - s * v[2], v[1], s * v[0] + c * v[2]])

        engine.place([np.add(world(local), (0.2, 0.0, -0.15))])
        # start removes what presses on the tool, so the tool comes from outside in one step
        far = at(0.2 - 0.5, -0.15, angle_rad)
        engine.start(far)
        here = at(0.2, -0.15, angle_rad)
        wrench = engine.advance(0, here)[0]
        assert wrench.contact_count == 1, direction
        force = np.array([wrench.force_x_newton, wrench.force_y_newton, wrench.force_z_newton])
        stiffness = 10_000.0 * 16_000.0 / 26_000.0
        assert_allclose(force, -world(unit) * stiffness * 1e-4, rtol=2e-3, atol=1e-4)


def test_edges_meshed_much_finer_than_a_particle_miss_no_contact(soil, at, one, tmp_path):
    """Spheres along the edges of a bar, facets 1.6 mm by 0.3 mm in any order: every one has its one contact,
    with the force of the coarse bar."""
    half, off = np.array((0.05, 0.01, 0.01)), 0.01 + 0.0079 * math.sqrt(0.5)
    place = [
        (0.2 + 0.025 * k + 0.0007 * (y + 2 * z), y * off, -0.15 + z * off)
        for k in (-1, 0, 1) for y in (-1, 1) for z in (-1, 1)
    ]  # fmt: skip
    mesh = trimesh.creation.box(2.0 * half)
    forces = []
    for cuts in (0, 6):
        for _ in range(cuts):
            mesh = mesh.subdivide()
        mesh.faces = np.random.default_rng(1).permutation(mesh.faces)
        path = tmp_path / f"bar_{cuts}.stl"
        mesh.export(path)
        engine = soil.engine(
            "gravity_m_per_s2=0", "soil.bin.length_m=0.4", "soil.bin.width_m=0.3", "soil.bin.depth_m=0.3",
            law=NO_ADHESION | {"rolling_friction": NEGLIGIBLE}, tools=one(str(path)),
        )  # fmt: skip
        engine.place(place)
        engine.start(at(-0.3, -0.15))
        assert engine.advance(0, at(0.2, -0.15))[0].contact_count == len(place)
        forces.append(engine.forces_newton())
    # corners of the mesh are float32: 1e-9 m, times the stiffness
    assert_allclose(forces[1], forces[0], atol=1e-4)
    assert_allclose(np.linalg.norm(forces[0], axis=1), 1e-4 * 10_000.0 * 16_000.0 / 26_000.0, rtol=2e-3)


def groove() -> trimesh.Trimesh:
    """A block with a right-angled groove along y, open to +z: concave edge at the origin."""
    outline = [(0.0, 0.0), (0.05, 0.05), (0.05, -0.05), (-0.05, -0.05), (-0.05, 0.05)]
    front = [(x, -0.04, z) for x, z in outline]
    back = [(x, 0.04, z) for x, z in outline]
    cap = [(0, 2, 1), (0, 3, 2), (0, 4, 3)]
    sides = []
    for k in range(5):
        n = (k + 1) % 5
        sides += [(k, n, n + 5), (k, n + 5, k + 5)]
    facets = cap + [(a + 5, c + 5, b + 5) for a, b, c in cap] + sides
    mesh = trimesh.Trimesh(front + back, facets)
    mesh.fix_normals()
    return mesh


def test_a_concave_corner_is_two_contacts(soil, at, one, tmp_path):
    """A sphere in a groove touches both faces; each carries 1 / sqrt(2) of the weight."""
    path = tmp_path / "groove.stl"
    groove().export(path)
    engine = soil.engine(
        "soil.bin.depth_m=0.3", law=NO_ADHESION | {"rolling_friction": NEGLIGIBLE}, tools=one(str(path))
    )
    rest = 0.008 * math.sqrt(2.0)
    engine.place([(0.06, 0.0, -0.15 + rest + 2e-4)])
    motions = at(0.06, -0.15)
    engine.start(motions)
    for tick in range(4000):
        wrench = engine.advance(tick, motions)[0]
    assert wrench.contact_count == 2
    assert_allclose(wrench.force_z_newton, -MASS * 9.81, rtol=1e-6)
    stiffness = 10_000.0 * 16_000.0 / 26_000.0
    # no tangential force is left once the damped sphere has settled by pure normal motion
    sunk = rest - (engine.positions_m()[0, 2] + 0.15)
    assert_allclose(sunk, MASS * 9.81 / (2.0 * stiffness * 0.5), rtol=0.2)


@pytest.mark.parametrize("setback_m", [0.0, 0.008])
def test_a_particle_pressed_through_a_thin_share_stays_on_its_side(soil, at, one, setback_m):
    """A plate of 8 mm, thinner than the sphere, drives it into the wall until its centre is behind the face:
    the force keeps its direction, and on release the sphere comes back out of the same face."""
    engine = soil.engine(
        "gravity_m_per_s2=0", "soil.bin.length_m=0.2", "soil.max_tool_overlap_m=0.02", law=NO_ADHESION,
        tools=one(soil.box(0.008, 0.06, 0.06), setback_m=setback_m),
    )  # fmt: skip
    far_wall = engine.bed.upper_m[0]
    engine.place([(far_wall - 0.008, 0.0, -0.05)])
    face = far_wall - 0.016 - 0.004
    engine.start(at(face - 1e-6, -0.05))
    place, deepest = face, 0.0
    for tick in range(2000):
        speed = 0.4 if tick < 1000 else -0.4
        place += 5e-5 * speed
        wrench = engine.advance(tick, at(place, -0.05, vx=speed))[0]
        centre = engine.positions_m()[0, 0]
        deepest = max(deepest, place + 0.004 - centre)
        assert wrench.force_x_newton <= 10.0 * 0.4  # on the way back the dashpot may pull: C v
    assert deepest > 0.0
    assert engine.positions_m()[0, 0] > place + 0.004


def pressed_against_the_wall(soil, at, one, mesh, setback_m=0.0):
    """Engine with a sphere of 10 mm, 2 mm in the far wall, and the x of its front."""
    engine = soil.engine(
        "gravity_m_per_s2=0", "soil.bin.length_m=0.2", law=NO_ADHESION, tools=one(mesh, setback_m=setback_m)
    )
    wall = engine.bed.upper_m[0]
    engine.place([(wall - 0.008, 0.0, -0.05)])
    return engine, wall - 0.018


@pytest.mark.parametrize("setback_m", [0.0, 0.0067])
def test_a_sharp_edge_that_passes_a_centre_parts_the_sphere_from_itself(soil, at, one, tmp_path, setback_m):
    """A knife of 20 degrees, head-on: past the centre its faces hold the sphere, and push it aside."""
    half = 0.06 * math.tan(math.radians(10.0))
    corners = [(x, y, z) for y in (-0.03, 0.03) for x, z in ((0.0, 0.0), (-0.06, half), (-0.06, -half))]
    trimesh.convex.convex_hull(np.array(corners)).export(tmp_path / "knife.stl")
    engine, face = pressed_against_the_wall(soil, at, one, str(tmp_path / "knife.stl"), setback_m)
    place = face + setback_m
    engine.start(at(place - 1e-6, -0.05))
    for tick in range(950):
        place += 2e-5
        wrench = engine.advance(tick, at(place, -0.05, vx=0.4))[0]
        (x, _, z) = engine.positions_m()[0]
        if place > x + 0.002 and abs(z + 0.05) < 0.009 - setback_m:  # not yet beside the knife
            assert wrench.contact_count == 1
    assert place > engine.positions_m()[0, 0] + 0.002
    assert abs(engine.positions_m()[0, 2] + 0.05) > 0.002


def test_a_sphere_that_is_pressed_through_ends_the_run(soil, at, one):
    """By the default of soil.max_tool_overlap_m, before its contact ends in a thick box."""
    engine, face = pressed_against_the_wall(soil, at, one, soil.box(0.06, 0.06, 0.06))
    place = face - 0.03
    engine.start(at(place - 1e-6, -0.05))

    def push() -> None:
        for tick in range(2200):
            engine.advance(tick, at(place + 2e-5 * (tick + 1), -0.05, vx=0.4))

    with pytest.raises(PhysicsError, match="is pressed through a face of tool tool, where its contact ends"):
        push()


def test_a_thin_plate_captures_no_sphere(soil, at, one):
    """Pressed past the back of a plate of 3 mm, the sphere comes out of the face that it was pressed into."""
    engine, face = pressed_against_the_wall(soil, at, one, soil.box(0.003, 0.06, 0.06))
    place = face - 0.0015
    engine.start(at(place - 1e-6, -0.05))
    for tick in range(2800):
        speed = 0.4 if tick < 1400 else -0.4
        place += 5e-5 * speed
        wrench = engine.advance(tick, at(place, -0.05, vx=speed))[0]
        assert wrench.contact_count <= 1
        if tick == 1399:
            assert engine.positions_m()[0, 0] < place - 0.0015  # behind the back
    assert engine.positions_m()[0, 0] > place + 0.0015


def test_particles_that_a_tool_overlaps_are_removed(soil, at, one):
    """After the start no particle presses on the tool or is inside it."""
    engine = soil.engine("soil.bin.length_m=0.3", tools=one(soil.box(0.06, 0.04, 0.08)))
    before = engine.particle_count
    engine.start(at(0.15, -0.05))
    x = engine.positions_m() - (0.15, 0.0, -0.05)
    gap = np.maximum(np.abs(x) - (0.03, 0.02, 0.04), 0.0)
    distance = np.linalg.norm(gap, axis=1)
    assert engine.particle_count < before
    assert distance.min() >= 0.008 - 1e-9


def ploughed(soil, at, one, step, steps, threads=1, book=True):
    """A box dragged and turned through a jittered bed; yields engine, wrench and wall force per step."""
    engine = soil.engine(
        f"soil.time_step_s={step}", "soil.bin.length_m=0.3", "soil.bed.jitter_m=0.0004",
        tools=one(soil.box(0.03, 0.04, 0.08, subdivide=1)), threads=threads, book=book,
    )  # fmt: skip
    engine.start(at(0.05, -0.04))
    for tick in range(steps):
        t = (tick + 1) * step
        motions = at(0.05 + 0.4 * t, -0.04, 2.0 * t, vx=0.4, rate=2.0)
        yield engine, engine.advance(tick, motions)[0]


def test_tool_impulse_is_the_change_of_bed_momentum_less_walls_and_gravity(soil, at, one):
    """Each sum apart, and together the force on the particles; half kicks make the impulse exact."""
    step, totals, momenta = 5e-5, [], []
    for engine, wrench in ploughed(soil, at, one, step, 400, book=False):
        on_tool = np.array([wrench.force_x_newton, wrench.force_y_newton, wrench.force_z_newton])
        weight = np.array([0.0, 0.0, -engine.mass_kg * 9.81 * engine.particle_count])
        totals.append(engine.wall_force_newton + weight - on_tool)
        momenta.append(engine.momentum_kg_m_per_s)
    force = np.array(totals)
    impulse = (0.5 * (force[1:] + force[:-1]) * step).sum(axis=0)
    assert np.abs(force[:, 0]).max() > 10.0
    # round-off of sums over 1200 particles and 400 steps of forces of the order of 100 N
    assert_allclose(momenta[-1] - momenta[0], impulse, atol=1e-10)


def test_the_energy_book_closes_better_when_the_step_halves(soil, at, one):
    """Kinetic + gravity + stored + every sink - tool work is constant up to first order in the step."""

    def defect(step):
        start = None
        for engine, _ in ploughed(soil, at, one, step, round(0.05 / step)):
            if start is None:
                start = engine.energy().total_joule
        book = engine.energy()
        assert min(book.sinks_joule.values()) >= 0.0
        assert book.tool_work_joule > 0.5
        return abs(book.total_joule - start) / book.tool_work_joule

    coarse, fine = defect(4e-5), defect(2e-5)
    assert coarse < 0.01
    assert fine < 0.7 * coarse


def test_the_torque_on_a_tool_is_what_the_particle_gains(soil, at, one):
    """One step of one sphere: its angular momentum about the tool's centre changes by minus half the torque
    impulse (the first kick of velocity Verlet is a half one), in all three components."""
    step, centre = 5e-5, np.array([0.2, 0.0, -0.12])
    engine = soil.engine(
        "gravity_m_per_s2=0", "soil.bin.length_m=0.4", "soil.bin.width_m=0.3", "soil.bin.depth_m=0.3",
        tools=one(soil.box(0.08, 0.05, 0.06)),
    )  # fmt: skip
    place = np.add(centre, (0.02, 0.013, 0.0385))
    velocity, spin = np.array([0.3, -0.2, -0.4]), np.array([4.0, -9.0, 6.0])
    engine.place([place], [velocity], [spin])
    engine.start(at(*(centre + 1.0)[[0, 2]]))  # far away: no force before the step
    wrench = engine.advance(0, at(centre[0], centre[2], vx=0.1, rate=3.0))[0]
    x = engine.positions_m()[0] - centre
    gained = MASS * np.cross(x, engine.velocities_m_per_s()[0] - velocity)
    gained += 0.4 * MASS * 0.01**2 * (engine.angular_velocities_rad_per_s()[0] - spin)
    torque = np.array([wrench.torque_x_newton_m, wrench.torque_y_newton_m, wrench.torque_z_newton_m])
    assert np.abs(torque).min() > 1e-3
    assert_allclose(gained, -0.5 * step * torque, rtol=1e-9)


def test_a_rebuild_of_the_lists_changes_nothing(soil, at, one):
    """Contact histories pass from list to list: many rebuilds (small skin) or few give the same motion."""
    places, rebuilds = [], []
    for skin in (0.0004, 0.008):
        engine = soil.engine(
            f"soil.skin_m={skin}", "soil.bin.length_m=0.3", "soil.bed.jitter_m=0.0004",
            tools=one(soil.box(0.03, 0.04, 0.08)),
        )  # fmt: skip
        engine.start(at(0.05, -0.04))
        for tick in range(300):
            engine.advance(tick, at(0.05 + 0.4 * (tick + 1) * 5e-5, -0.04, vx=0.4))
        places.append(engine.positions_m())
        rebuilds.append(engine.state("r", 0, 0).rebuild_count)
    assert rebuilds[0] > 10 * rebuilds[1]
    # sums are taken in another order, and round-off grows a little in 15 ms of contact
    assert_allclose(places[0], places[1], atol=1e-12)


def test_tools_move_on_a_cubic_within_a_tick():
    """A cubic in x, z and phi is met exactly, with its velocity, anywhere in the interval."""
    x, z, phi = (np.polynomial.Polynomial(c) for c in ((0.1, 0.5, -3.0, 40.0), (0, -1, 9, 2), (1, 4, 5, -60)))

    def motion(t):
        return ToolMotion("tool", x(t), 0.2, z(t), phi(t), x.deriv()(t), z.deriv()(t), phi.deriv()(t))

    for part in (0.1, 0.5, 0.9, 1.0):
        between = motion_within(motion(0.02), motion(0.03), 0.01, part)
        exact = motion(0.02 + 0.01 * part)
        for name in (
            "x_m",
            "z_m",
            "angle_rad",
            "velocity_x_m_per_s",
            "velocity_z_m_per_s",
            "angular_velocity_rad_per_s",
        ):
            assert_allclose(getattr(between, name), getattr(exact, name), rtol=1e-12)


def test_a_sphere_that_moves_with_the_tool_as_one_body_feels_its_spring_only(soil, at, one):
    """Velocity V + w x r and the tool's spin: no slip, no approach, no rolling, wherever it touches."""
    step, turn, rate, centre = 5e-5, 0.4, 3.0, np.array([0.2, 0.0, -0.12])
    along, up = (
        np.array([math.cos(turn), 0.0, math.sin(turn)]),
        np.array([-math.sin(turn), 0.0, math.cos(turn)]),
    )
    engine = soil.engine(
        "gravity_m_per_s2=0", "soil.bin.length_m=0.4", "soil.bin.width_m=0.3", "soil.bin.depth_m=0.3",
        tools=one(soil.box(0.08, 0.05, 0.06)),
    )  # fmt: skip
    arm = 0.02 * along + np.array([0.0, 0.013, 0.0]) + (0.03 + 0.0079) * up
    spin = np.array([0.0, -rate, 0.0])
    velocity = np.array([0.1, 0.0, -0.2]) + np.cross(spin, arm)
    engine.place([centre + arm - step * velocity], [velocity], [spin])
    engine.start(at(*(centre + 1.0)[[0, 2]]))  # far away: no force before the step
    engine.advance(0, at(centre[0], centre[2], turn, vx=0.1, vz=-0.2, rate=rate))
    # corners of the mesh are float32, 1e-9 m, times the stiffness
    assert_allclose(engine.forces_newton()[0], 1e-4 * 10_000.0 * 16_000.0 / 26_000.0 * up, atol=2e-5)
    assert_allclose(engine.angular_velocities_rad_per_s()[0], spin, atol=1e-6)
