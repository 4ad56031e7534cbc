"""Virtual soil tests: direct shear and sliding on metal at several normal stresses, and tension; without ROS.

Every stress is a force over the section of the specimen that is left: (length - shear displacement) x width.
A plate is longer than the specimen, so over it the section stays whole.
"""

import math
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from pathlib import Path

import numpy as np

from ...analysis.smoothing import running_mean
from ...dem.bed import Bed
from ...errors import InputError
from ...loading.loader import ResolvedScene
from ...scene.beds import TiledBed
from ...scene.pairs import pair_values, tool_values
from .curves import ShearCurve, SoilTests, TensionCurve
from .options import INERTIAL_NUMBER
from .series import RunProgress, run_box
from .shear_box import GLUE, ShearBox, ShearLoading, TensionLoading, shear_machine, tension_machine
from .specimen import TOUCH_M, Size, Specimen, box_around, prepare_specimen, write_scene

BAND_DIAMETERS = 6.0
"""Height that the shear rate refers to: about that of the shear band."""

GAP_DIAMETERS = {True: 1.75, False: 0.75}
"""Gap between the frames by whether the box is glued. Glued: wide enough that no particle is glued to both
after the load has brought them nearer. Not glued: none slips out, as some do from a gap of one diameter."""

PASS_DIAMETERS = 0.1
"""Largest overlap of frames without glue in height: at 0.24, the strength of a dry soil was a third too
high."""

LID_PART = 0.5
"""Mass of upper frame and lid over that of the soil in it: less than a load, yet not too light."""

WAVES_OF_LOADING = 20.0
"""Duration of the loading in travel times of a sound wave through the height: quasi-static."""

GRACE_STRAIN = 0.25
"""The energy residual is checked from the work of the load over this strain on, because glue attaches
suddenly at the start. That work is a few per cent of the work of shear."""

SMOOTHED_ROWS = 5
"""Rows of the moving mean of a series: longer than the noise of single contacts."""

PLATE_DIAMETERS = 2.0
"""Travel over a plate in largest diameters: all contacts slide after a tenth of it."""

SEATING_PA = 20e3
"""Pressure on the column of a tiled bed before tension, the largest default normal stress: its top is rough,
and a lid that only touches it would hold only some particles."""

CAP_DIAMETERS = 2.0
"""Thickness of the cemented ends of such a column in largest diameters: six of ten are left to break."""

TENSION_DIAMETERS = 2.0
"""Travel in tension in largest diameters: ten times delta_c + delta_B, after which attraction ends."""


def rumpf_pa(bonds: float, attraction_newton: float, distance_m: float) -> float:
    """Tensile strength by Rumpf, sigma = solid fraction z F / (pi d^2); `bonds` is solid fraction z.

    F is the largest attraction of a pair, d the distance of two particles, z the number of neighbours of one.
    Source: H. Rumpf, Chem. Ing. Tech. 42 (1970) 538-540, before z is replaced by pi over the porosity.
    """
    return bonds * attraction_newton / (math.pi * distance_m**2)


def rumpf_strength_pa(specimen: Specimen) -> float:
    """Tensile strength of a specimen by Rumpf, with the distance at rest and all neighbours in reach: an
    upper bound, as if all bonds broke at once; friction of bonds across the pull is neglected."""
    pair, _ = pair_values(specimen.soil)
    distance = 2.0 * specimen.soil.particles.mean_volume_radius_m - pair.rest_overlap
    return rumpf_pa(specimen.solid_fraction * specimen.coordination, pair.peak_attraction, distance)


def affine_modulus_pa(specimen: Specimen, stress_pa: float) -> float:
    """Constrained modulus if every particle moved with the mean strain, an upper bound.

    Contacts of stiffness K, K_t in all directions alike, n_c = 3 solid fraction z / (pi d^3) of them per
    volume: M = n_c d^2 (K / 5 + 2 K_t / 15). Source: K. Walton, J. Mech. Phys. Solids 35 (1987) 213-226, its
    contact stiffnesses kept.
    """
    pair, _ = pair_values(specimen.soil)
    distance = 2.0 * specimen.soil.particles.mean_volume_radius_m - pair.rest_overlap
    linear = pair.linear_at(pair.loaded_m(stress_pa * distance**2))
    contacts = 3.0 * specimen.solid_fraction * specimen.coordination / (math.pi * distance**3)
    return contacts * distance**2 * (linear.stiffness / 5.0 + 2.0 * linear.tangential_stiffness / 15.0)


def quasi_static_speed_m_per_s(specimen: Specimen, stress_pa: float, inertial_number: float) -> float:
    """Speed at which soil under `stress_pa` and its own attraction reaches `inertial_number` [m/s]."""
    stress = stress_pa + rumpf_strength_pa(specimen)
    return inertial_number * BAND_DIAMETERS * math.sqrt(stress / specimen.density_kg_per_m3)


def run_shear(
    specimen: Specimen,
    normal_pa: float,
    folder: Path,
    *,
    inertial_number: float = INERTIAL_NUMBER,
    glued: bool | None = None,
    threads: int = 1,
    progress: RunProgress = lambda name, timing: nullcontext(lambda tick: None),
) -> ShearCurve:
    """A direct shear test under `normal_pa` on the plane of shear, over a third of the length.

    The upper frame and its lid are free along z, so that plane carries load, lid and the soil above it
    whatever the walls do. `folder` takes the scene; `glued`: whether the box is, None: as needs_glue says.

    Raises:
        InputError: the load is below the weight of what lies on the plane.
        RunError: the run failed.
    """
    glued = needs_glue(specimen, normal_pa) if glued is None else glued
    diameter = specimen.diameter_m
    travel = float(np.ptp(specimen.bed.positions_m[:, 0])) / 3.0
    box, bed = box_around(specimen, travel + 2.0 * diameter, GAP_DIAMETERS[glued] * diameter)
    curve = _sheared(
        specimen, f"direct shear at {normal_pa:g} Pa", folder, box, bed, normal_pa, inertial_number, travel,
        threads, progress, glued=glued,
    )  # fmt: skip
    _refuse_closed_gap(specimen, normal_pa, box.gap_m, curve.settled * box.height_m, glued=glued)
    return curve


def run_plate(
    specimen: Specimen,
    normal_pa: float,
    folder: Path,
    *,
    inertial_number: float = INERTIAL_NUMBER,
    threads: int = 1,
    progress: RunProgress = lambda name, timing: nullcontext(lambda tick: None),
) -> ShearCurve:
    """The soil of `specimen` in a frame with a lid, loaded and driven over a plate of metal.

    Nothing is glued: the rear wall pushes, and the plate is a tool under the law and the stiffness of the
    scene. `folder` takes the scene of the test.

    Raises:
        InputError: the load is below the weight of lid and soil.
        RunError: the run failed.
    """
    travel = PLATE_DIAMETERS * specimen.diameter_m
    box, bed = box_around(
        specimen, 2.0 * (travel + specimen.diameter_m), None
    )  # the plate: half as far beyond
    return _sheared(
        specimen, f"plate at {normal_pa:g} Pa", folder, box, bed, normal_pa, inertial_number, travel, threads,
        progress, glued=False,
    )  # fmt: skip


def _sheared(
    specimen: Specimen,
    name: str,
    folder: Path,
    box: ShearBox,
    bed: Bed,
    normal_pa: float,
    inertial_number: float,
    travel: float,
    threads: int,
    progress: RunProgress,
    *,
    glued: bool,
) -> ShearCurve:
    gravity = specimen.resolved.scene.gravity_m_per_s2
    loading = _shear_loading(specimen, box, normal_pa, inertial_number, travel, glued=glued)
    grace = GRACE_STRAIN * normal_pa * box.area_m2 * box.height_m
    machine = shear_machine(box, loading, gravity) | {"coupling": {"residual_grace_joule": grace}}
    resolved = write_scene(specimen, name, folder, box, bed, loading.duration_s, machine, glued=glued)
    series, _ = run_box(resolved, specimen, threads, progress(name, resolved.timing))
    moving = np.array(series.times_s) >= loading.start_s
    drive, upper, z = series.column("drive"), series.column("upper_x"), series.column("z")
    displacement = series.column("x") - box.centre_m[0]
    section = box.section_m2(displacement)
    if box.over_plate:
        shear, normal = series.column("lower_x"), -series.column("lower_z")
    else:
        shear, normal = -upper, series.column("upper_z") + box.part_above * specimen.mass_kg * gravity
    first = int(np.argmax(moving))
    return ShearCurve(
        nominal_pa=normal_pa,
        displacement_m=displacement[moving],
        shear_pa=running_mean(shear / section, SMOOTHED_ROWS)[moving],
        normal_pa=running_mean(normal / section, SMOOTHED_ROWS)[moving],
        rise_m=(z - z[first])[moving],
        settled=float((z[0] - z[first]) / box.height_m),
        speed_m_per_s=loading.speed_m_per_s,
        imbalance=float(np.abs((drive + upper)[moving]).mean() / np.abs(drive).max()),
    )


def needs_glue(specimen: Specimen, normal_pa: float) -> bool:
    """Whether a soil would slide out of a plain box as a block under this normal stress.

    So does soil whose tensile strength, by Rumpf, is above the stress. Weaker soil is pressed to the walls by
    the load, and needs no gap as wide as glue does.
    """
    return rumpf_strength_pa(specimen) > normal_pa


def _refuse_closed_gap(
    specimen: Specimen, normal_pa: float, gap_m: float, settled_m: float, *, glued: bool
) -> None:
    """Raise InputError where both frames hold the same particles, which makes a soil appear too strong."""
    _, boundary = pair_values(specimen.soil)
    radius = 0.5 * specimen.diameter_m
    reach = 2.0 * (radius + boundary.reach) if glued else -2.0 * PASS_DIAMETERS * radius
    if gap_m - settled_m < reach:
        raise InputError(
            f"normal stress: under {normal_pa:g} Pa the specimen settles by {settled_m:.3g} m; of the gap of "
            f"{gap_m:.3g} m less than {reach:.3g} m is left, and both frames hold the same particles; give "
            "smaller stresses, or make the specimen lower"
        )


def _waves_s(specimen: Specimen, box: ShearBox, stress_pa: float) -> float:
    sound = math.sqrt(affine_modulus_pa(specimen, stress_pa) / specimen.density_kg_per_m3)
    return WAVES_OF_LOADING * box.height_m / sound


def _shear_loading(
    specimen: Specimen,
    box: ShearBox,
    normal_pa: float,
    inertial_number: float,
    travel_m: float,
    *,
    glued: bool,
) -> ShearLoading:
    gravity = specimen.resolved.scene.gravity_m_per_s2
    soil_above_kg = box.part_above * specimen.mass_kg
    lid_kg = LID_PART * soil_above_kg
    load = normal_pa * box.area_m2 - soil_above_kg * gravity
    if load < lid_kg * gravity:
        least = (soil_above_kg + lid_kg) * gravity / box.area_m2
        raise InputError(
            f"normal stress: {normal_pa:g} Pa is below the weight of lid and soil over the plane of shear, "
            f"{least:.4g} Pa; give more, or make the specimen lower"
        )
    return ShearLoading(
        normal_pa=normal_pa,
        load_newton=load,
        lid_mass_kg=lid_kg,
        lid_damping_newton_s_per_m=_lid_damping_newton_s_per_m(specimen, normal_pa, box.area_m2, glued=glued),
        load_s=_waves_s(specimen, box, normal_pa),
        speed_m_per_s=quasi_static_speed_m_per_s(specimen, normal_pa, inertial_number),
        travel_m=travel_m,
    )


def _lid_damping_newton_s_per_m(
    specimen: Specimen, normal_pa: float, area_m2: float, *, glued: bool
) -> float:
    """Twice what keeps a lid on the contacts of the section stable against a force held for a tick H.

    A contact of stiffness k needs k H / 2 (limits/communication_steps.py), of which its own damper gives a
    part; the glue pulls without a damper. One contact is assumed on each square of a diameter.
    """
    soil = specimen.soil
    pair, _ = pair_values(soil)
    boundary = tool_values(soil)
    diameter = 2.0 * soil.particles.mean_volume_radius_m
    step_s = specimen.resolved.timing.soil_step_s
    pressed = boundary.linear_at(boundary.loaded_m(normal_pa * diameter**2))
    missing = max(0.0, 0.5 * pressed.stiffness * step_s - pressed.damping)
    if glued:
        missing = max(missing, 0.5 * GLUE * pair.peak_attraction / boundary.rest_overlap * step_s)
    return 2.0 * missing * area_m2 / diameter**2


def run_tension(
    specimen: Specimen,
    folder: Path,
    *,
    inertial_number: float = INERTIAL_NUMBER,
    threads: int = 1,
    progress: RunProgress = lambda name, timing: nullcontext(lambda tick: None),
) -> TensionCurve:
    """A tension test along z: the two halves of the box are drawn apart, so the soil breaks between them.

    The walls grip over each half; the specimen must be higher than wide, or it is drawn out of one half,
    which `break_height` shows. That of a tiled bed, whose faces are cut, is gripped by its ends, which are
    cemented. The tension is that where it breaks, without the weight of the soil above. `folder` takes the
    scene.
    """
    diameter = specimen.diameter_m
    travel = TENSION_DIAMETERS * diameter
    box, bed = box_around(specimen, travel + 2.0 * diameter, GAP_DIAMETERS[True] * diameter)
    speed = quasi_static_speed_m_per_s(specimen, 0.0, inertial_number)
    loading = TensionLoading(_waves_s(specimen, box, 0.0), speed, travel)
    cut = isinstance(specimen.soil.bed, TiledBed) and specimen.soil.layers is None
    cap = CAP_DIAMETERS * diameter if cut else 0.0
    resolved = write_scene(
        specimen, "tension", folder, box, bed, loading.duration_s, tension_machine(box, loading), cap_m=cap
    )
    series, ends_m = run_box(resolved, specimen, threads, progress("tension", resolved.timing))
    rise = (ends_m - specimen.bed.positions_m)[:, 2]
    opening = series.column("z") - box.middle_m
    moving = np.array(series.times_s) >= loading.rest_s
    break_height = float((rise < 0.5 * opening[-1]).mean())
    weight_above = (1.0 - break_height) * specimen.mass_kg * specimen.resolved.scene.gravity_m_per_s2
    pull = (-series.column("upper_z") - weight_above) / box.area_m2
    return TensionCurve(
        opening_m=opening[moving],
        tension_pa=running_mean(pull, SMOOTHED_ROWS)[moving],
        break_height=break_height,
        speed_m_per_s=speed,
    )


def seated(specimen: Specimen, folder: Path, threads: int = 1) -> Specimen:
    """The specimen after a lid has pressed it by SEATING_PA and let it go; `folder` takes the scene.

    Raises RunError: the run failed.
    """
    box, bed = box_around(specimen, 2.0 * specimen.diameter_m, None)
    loading = _shear_loading(specimen, box, SEATING_PA, INERTIAL_NUMBER, TOUCH_M, glued=False)
    machine = shear_machine(box, loading, specimen.resolved.scene.gravity_m_per_s2)
    machine["mechanism"]["joints"]["drive"]["speed"] = {"kind": "constant", "value": 0.0}
    machine["mechanism"]["forces"]["load"]["force_z_newton"] = {
        "kind": "table",
        "times_s": [part * loading.load_s for part in (0.0, 1.0, 2.0, 3.0)],
        "values": [0.0, -loading.load_newton, -loading.load_newton, 0.0],
    }
    duration = 4.0 * loading.load_s
    resolved = write_scene(specimen, "seating", folder, box, bed, duration, machine, glued=False)
    _, ends_m = run_box(resolved, specimen, threads, nullcontext(lambda tick: None))
    return replace(specimen, bed=replace(specimen.bed, positions_m=ends_m))


def run_soil_tests(
    resolved: ResolvedScene,
    normal_pa: tuple[float, ...],
    size_m: Size,
    folder: Path,
    *,
    inertial_number: float = INERTIAL_NUMBER,
    plate: bool = True,
    threads: int = 1,
    progress: RunProgress = lambda name, timing: nullcontext(lambda tick: None),
    working: Callable[[str], AbstractContextManager[object]] = nullcontext,
) -> SoilTests:
    """Direct shear at every stress of `normal_pa`, over metal too, and tension if the soil has adhesion.

    plate: whether the tests over metal are run, on a specimen of half the height. The specimen in tension is
    as long as wide, and a quarter higher than wide. `folder` takes a scene with its meshes and bed for each
    test, in a folder of its own. `progress` and `working` show what is going on.
    """

    def subfolder(name: str) -> Path:
        path = folder / name
        path.mkdir(parents=True)
        return path

    with working("preparing the specimen"):
        specimen = prepare_specimen(resolved, size_m, subfolder("specimen"), threads)
    glued = needs_glue(specimen, min(normal_pa))  # one box for all points of a line
    curves = tuple(
        run_shear(
            specimen, stress, subfolder(f"shear_{stress:g}_pa"), inertial_number=inertial_number,
            glued=glued, threads=threads, progress=progress,
        )
        for stress in normal_pa
    )  # fmt: skip
    slid: tuple[ShearCurve, ...] = ()
    if plate:
        half = (size_m[0], size_m[1], 0.5 * size_m[2])
        with working("preparing the specimen over the plate"):
            low = prepare_specimen(resolved, half, subfolder("low"), threads, like=specimen)
        slid = tuple(
            run_plate(
                low, stress, subfolder(f"plate_{stress:g}_pa"), inertial_number=inertial_number,
                threads=threads, progress=progress,
            )
            for stress in normal_pa
        )  # fmt: skip
    tension = None
    if pair_values(specimen.soil)[0].adhesion > 0.0:
        column = (size_m[1], size_m[1], 1.25 * size_m[1])
        with working("preparing the column"):
            pulled = prepare_specimen(resolved, column, subfolder("column"), threads)
            if isinstance(pulled.soil.bed, TiledBed):
                pulled = seated(pulled, subfolder("seating"), threads)
        tension = run_tension(
            pulled, subfolder("tension"), inertial_number=inertial_number, threads=threads, progress=progress
        )
    return SoilTests(specimen, size_m, curves, slid, tension)
