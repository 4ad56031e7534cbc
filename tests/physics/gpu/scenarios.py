"""Small soils that both engines run: `python tests/physics/gpu/scenarios.py FOLDER` runs all on the GPU or in
numba's simulator, and writes what came out to FOLDER; with NUMBA_ENABLE_CUDASIM=1 give NUMBA_DISABLE_JIT=1
too.
"""

import dataclasses
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
import yaml

from subsoil_ros.dem.bed import Bed
from subsoil_ros.dem.build import build_engine
from subsoil_ros.dem.engine import SoilEngine
from subsoil_ros.dem.field import Contacts, Field, FieldSample
from subsoil_ros.dem.window import Window
from subsoil_ros.errors import PhysicsError
from subsoil_ros.loading.loader import ResolvedScene, load_scene
from subsoil_ros.messages import SpatialMotion, ToolMotion
from subsoil_ros.rotations import quaternion_of
from tests.physics import plain_vectors

ROW = {
    "stiffness_newton_per_m": 1e4, "tangential_stiffness_newton_per_m": 8e3,
    "damping_newton_s_per_m": 10.0, "tangential_damping_newton_s_per_m": 5.0,
    "static_friction": 0.5, "sliding_friction": 0.4, "rolling_friction": 0.3,
}  # fmt: skip
WET = {
    **ROW,
    "cohesive_stiffness_newton_per_m": 7e3,
    "equilibrium_overlap_m": 0.002,
    "cohesion_range_m": 0.002,
}
HERTZ = {
    "youngs_modulus_pa": 2e6, "poisson_ratio": 0.3, "restitution": 0.5,
    "static_friction": 0.5, "sliding_friction": 0.4, "rolling_friction": 0.2,
}  # fmt: skip
PLASTIC = {
    "youngs_modulus_pa": 2e6, "poisson_ratio": 0.3, "contact_plasticity": 0.6, "restitution": 0.5,
    "surface_energy_joule_per_m2": 20.0,
    "static_friction": 0.5, "sliding_friction": 0.4, "rolling_friction": 0.2,
}  # fmt: skip
LAWS = {"cohesive_linear": WET, "linear": ROW, "hertz_mindlin": HERTZ, "elasto_plastic_adhesive": PLASTIC}
BONDS = {
    "youngs_modulus_pa": 1e6, "stiffness_ratio": 2.5, "tensile_strength_pa": 100.0, "cohesion_pa": 100.0,
    "friction_angle_deg": 30.0, "damping_ratio": 0.1,
}  # fmt: skip
TICKS, STEPS = 2, 4
SPEED_M_PER_S = 5.0  # the tool leaves a list of 0.1 mm every second step
SIZE_M = (0.08, 0.06, 0.06)
SKIN_M = 0.0005
FIELD_M = 0.4
SPACING_M, LATTICE = 0.0195, 4  # of a block
WINDOW_START_M = 9 * 0.0194759 - 0.06 - 0.012 - 0.0006
"""From here the window, which ends 0.06 m before the tool, enters its next strip in the second tick."""

WIDE_M = (0.1, 0.12, 0.04)  # three cells of the search fit between periodic sides

SCENARIOS: dict[str, dict[str, Any]] = {
    "linear": {"law": "linear", "stirred": True, "crossing": True, "soil": {"skin_m": SKIN_M}},
    "hertz": {"law": "hertz_mindlin", "stirred": True, "bed": {"kind": "grid", "spacing_m": 0.0199}},
    "cohesive linear with a tool": {"law": "cohesive_linear", "tool": True, "soil": {"skin_m": 1e-4}},
    "cohesive linear in mixed precision": {
        "law": "cohesive_linear", "tool": True, "soil": {"precision": "mixed", "skin_m": 1e-4}
    },
    "sizes, layers, periodic sides": {"law": "cohesive_linear", "stirred": True, "unequal": True},
    "elasto-plastic with a tool": {
        "law": "elasto_plastic_adhesive", "tool": True, "soil": {"skin_m": 1e-4}
    },
    "tool in space": {"law": "linear", "tool": True, "spatial": True, "soil": {"skin_m": 1e-4}},
    "bonds": {
        "law": "linear", "tool": True, "bed": {"kind": "grid", "spacing_m": 0.02, "jitter_m": 0.0003},
        "soil": {"skin_m": 1e-3, "bonds": BONDS},
    },
    "bonds of unequal particles": {
        "law": "cohesive_linear", "stirred": True, "unequal": True, "soil": {"skin_m": 1e-3, "bonds": BONDS}
    },
    "window": {"law": "linear", "tool": True, "window": True, "soil": {"skin_m": 1e-4}},
    "lost particle": {"law": "linear", "stirred": True, "thrown": True},
}  # fmt: skip

RESUMED = (
    "cohesive linear with a tool", "sizes, layers, periodic sides", "elasto-plastic with a tool",
    "tool in space", "bonds", "bonds of unequal particles", "window",
)  # fmt: skip
"""Those that go on from the other engine's checkpoint: all kinds of lists are in them."""


def document(folder: Path, scenario: dict[str, Any]) -> dict[str, Any]:
    """The scene of a scenario; its mesh goes into `folder`."""
    row, unequal = LAWS[scenario["law"]], scenario.get("unequal", False)
    size = WIDE_M if unequal else SIZE_M
    names = ("length_m", "width_m", "depth_m")
    particles: dict[str, Any] = {"radius_m": 0.01, "density_kg_per_m3": 1800.0}
    soil: dict[str, Any] = {
        "bin": dict(zip(names, size, strict=True)) | ({"sides": "periodic"} if unequal else {}),
        "particles": particles,
        "bed": scenario.get("bed", {"kind": "grid", "spacing_m": 0.0185, "jitter_m": 0.0003}),
        "law": {"kind": scenario["law"], "particle": row, "boundary": row},
        "time_step_s": 2e-5,
        "monitors": {"every_steps": 4},
    }
    if unequal:
        soil["particles"] = {"density_kg_per_m3": 1800.0} | {
            "sizes": {
                "kind": "listed", "radii_m": [0.008, 0.01], "shares": [1.0, 1.0], "shares_are": "number"
            }
        }  # fmt: skip
        soil["bed"] = {"kind": "dense_random"}  # named, never prepared: the bed is given
        firmer = {"stiffness_newton_per_m": 2e4}
        lower = {"kind": scenario["law"], "particle": firmer}
        soil["layers"] = [
            {"name": "top", "thickness_m": 0.02},
            {"name": "pan", "density_kg_per_m3": 2000.0, "law": lower},
        ]
    if scenario.get("thrown"):
        soil["max_lost_particles"] = 0
    soil.update(scenario.get("soil", {}))
    if scenario.get("window"):
        soil["bin"]["length_m"] = FIELD_M
        soil["bed"] = {"kind": "tiled"}  # named, never prepared: the block is given
        soil["window"] = {"ahead_m": size[2], "behind_m": size[2]}
    scene: dict[str, Any] = {
        "name": "gpu",
        "duration_s": 1.0,
        "allow": ["unstable_time_step"],
        "coupling": {"communication_step_ns": 20_000 * STEPS},
        "soil": soil,
    }
    if scenario.get("tool"):
        share = trimesh.creation.box((0.02, 0.04, 0.06))
        share.export(folder / "share.stl")
        trimesh.creation.icosphere(1, 0.012).apply_translation((0.0, 0.0, -0.05)).export(folder / "tip.stl")
        groups = {"share": {"mesh": "share.stl"}, "tip": {"mesh": "tip.stl"}}
        scene["tools"] = {"tool": {"path": {}, "groups": groups}}
    return scene


def given_bed() -> Bed:
    """Spheres of two sizes in two layers between periodic sides, some held, at any places."""
    random = np.random.default_rng(3)
    axes = [np.arange(0.01, length - 0.005, 0.0185) for length in WIDE_M]
    axes[1] = WIDE_M[1] * (np.arange(6) / 6 - 0.5)
    places = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
    places[:, 2] -= WIDE_M[2]
    places += random.uniform(-5e-4, 5e-4, places.shape)
    radii = np.where(random.random(len(places)) < 0.5, 0.008, 0.01)
    return Bed(
        places,
        (0.0, -0.5 * WIDE_M[1], -WIDE_M[2]),
        (WIDE_M[0], 0.5 * WIDE_M[1]),
        radii_m=radii,
        materials=(places[:, 2] < -0.02).astype(np.int64),
        sides="periodic",
        held=random.random(len(places)) < 0.2,
    )


def crossing_bed() -> Bed:
    """Touching spheres on the borders of the search's cells: they cross, and partners change order."""
    random = np.random.default_rng(5)
    axes = 0.02 * np.arange(1, 4) + SKIN_M * np.arange(1, 4), 0.0195 * np.arange(-1, 2), 0.0195 * np.arange(3)
    places = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
    places[:, 2] += 0.01 - SIZE_M[2]
    places += random.uniform(-2e-4, 2e-4, places.shape)
    return Bed(places, (0.0, -0.5 * SIZE_M[1], -SIZE_M[2]), (SIZE_M[0], 0.5 * SIZE_M[1]))


def window(resolved: ResolvedScene) -> Window:
    """Over a field of a block of layers, the lowest of them held, whose contacts have no springs yet."""
    edge, headroom = LATTICE * SPACING_M, 0.04
    axes = [SPACING_M * (np.arange(count) + 0.5) for count in (LATTICE, LATTICE, 3)]
    places = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
    places[:, 2] -= SIZE_M[2] + headroom
    lower, upper = (0.0, 0.0, -SIZE_M[2] - headroom), (edge, edge)
    held = places[:, 2] < lower[2] + SPACING_M
    bed = Bed(places, lower, upper, sides="endless", held=held)
    soil = resolved.scene.particle_soil
    assert soil is not None
    none = Contacts(np.empty((0, 2), np.int64), np.empty((0, 6)))
    return Window(Field(FieldSample(bed, none), soil))


def motions(scenario: dict[str, Any], tick: int) -> tuple[ToolMotion, ...]:
    """The tool at the end of `tick`: it drives and turns."""
    if not scenario.get("tool"):
        return ()
    t = 2e-5 * STEPS * (tick + 1)
    x = (WINDOW_START_M if scenario.get("window") else 0.03) + SPEED_M_PER_S * t
    if scenario.get("spatial"):
        turning = np.array((2.0, 1.0, -1.5))
        at = quaternion_of(tuple((t * turning).tolist()))
        speed = (SPEED_M_PER_S, 0.3, 0.0)
        return (SpatialMotion.of("tool", (x, 0.3 * t, 0.0), at, speed, tuple(turning.tolist())),)
    return (ToolMotion("tool", x, 0.0, 0.0, 2.0 * t, SPEED_M_PER_S, 0.0, 2.0),)


def build(device: str, folder: Path, scenario: dict[str, Any]) -> SoilEngine:
    """The engine before its start."""
    path = folder / "scene.yaml"
    path.write_text(yaml.safe_dump(document(folder, scenario), sort_keys=False))
    bed = given_bed() if scenario.get("unequal") else crossing_bed() if scenario.get("crossing") else None
    resolved = load_scene(path, [f"soil.device={device}"])
    book = scenario["law"] != "cohesive_linear" or resolved.scene.particle_soil.precision == "mixed"
    if scenario.get("window"):
        over = window(resolved)
        return SoilEngine(resolved, over.field.bed(*over.field.first_window), book=book, window=over)
    return build_engine(resolved, book=book) if bed is None else SoilEngine(resolved, bed, book=book)


def start(engine: Any, scenario: dict[str, Any]) -> None:
    """Puts it at its first state."""
    if scenario.get("stirred"):
        n = len(engine.bed.positions_m)
        random = np.random.default_rng(1)
        speed = 6.0 if scenario.get("crossing") else 0.4
        velocity, spin = random.normal(0.0, speed, (n, 3)), random.normal(0.0, 20.0, (n, 3))
        if scenario.get("thrown"):
            velocity[n // 2] = 0.0, 0.0, 3000.0
        engine.place(engine.bed.positions_m, velocity, spin, engine.bed.radii_m)
    engine.start(motions(scenario, -1))


def _numbers(record: Any) -> Iterator[float]:
    """Every number of a message, those of its groups too."""
    for field in dataclasses.fields(record):
        value = getattr(record, field.name)
        if isinstance(value, tuple):
            for part in value:
                yield from _numbers(part)
        elif not isinstance(value, str):
            yield value


def run(engine: Any, scenario: dict[str, Any], first: int, ticks: int) -> dict[str, np.ndarray]:
    """What such an engine says after so many ticks, and all its numbers."""
    wrenches, error = [], ""
    for tick in range(first, first + ticks):
        try:
            answers = engine.advance(tick, motions(scenario, tick))
        except PhysicsError as refusal:
            error = str(refusal)
            break
        wrenches += [list(_numbers(answer)) for answer in answers]
    state = engine.state("", 0, 0)
    energy = engine.energy()
    books = [energy.kinetic_joule, energy.gravity_joule, energy.stored_joule, energy.tool_work_joule]
    return {
        "error": np.array(error),
        "window": engine.state_arrays().get("window", np.zeros(3)),
        "wrenches": np.array(wrenches, np.float64),
        "positions": engine.positions_m(),
        "displacements": engine.displacements_m(),
        "velocities": engine.velocities_m_per_s(),
        "spins": engine.angular_velocities_rad_per_s(),
        "forces": engine.forces_newton(),
        "energy": np.array([*books, *energy.sinks_joule.values()]),
        "momentum": engine.momentum_kg_m_per_s,
        "wall force": engine.wall_force_newton,
        "overlaps": np.array([state.max_overlap_m, state.max_tool_overlap_m]),
        "rms": np.array(
            [state.rms_speed_m_per_s, state.rms_angular_velocity_rad_per_s, state.kinetic_energy_joule]
        ),
        "counts": np.array(
            [
                state.particle_count,
                state.contact_count,
                state.rebuild_count,
                engine.listed_pair_count,
                *engine.bond_counts(),
            ]
        ),
    }


def results(device: str, name: str) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """What a scenario gives after TICKS, and a checkpoint half way."""
    scenario = SCENARIOS[name]
    with tempfile.TemporaryDirectory() as folder:
        engine = build(device, Path(folder), scenario)
        start(engine, scenario)
        half = run(engine, scenario, 0, TICKS // 2)
        kept = {key: np.array(array) for key, array in engine.state_arrays().items()}
        whole = run(engine, scenario, TICKS // 2, TICKS - TICKS // 2) if not half["error"] else half
        return whole, kept


def resumed(device: str, name: str, kept: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """What the second half gives from a checkpoint."""
    scenario = SCENARIOS[name]
    with tempfile.TemporaryDirectory() as folder:
        engine = build(device, Path(folder), scenario)
        engine.restore(kept)
        return run(engine, scenario, TICKS // 2, TICKS - TICKS // 2)


def use_plain_python() -> None:
    """Replace what works on bits or vectors of the processor, which plain Python has not."""
    import subsoil_ros.contact_laws.springs
    import subsoil_ros.dem.bonds.kernel
    import subsoil_ros.dem.pairs

    def inverse_root(x: Any) -> Any:
        return type(x)(1.0) / np.sqrt(x)

    modules: Any = subsoil_ros.contact_laws.springs, subsoil_ros.dem.pairs, subsoil_ros.dem.bonds.kernel
    for module in modules:
        module.inverse_root = inverse_root
    for name, function in plain_vectors.FUNCTIONS.items():
        setattr(subsoil_ros.dem.pairs, name, function)


def main(folder: Path, names: Sequence[str]) -> None:
    """Everything that needs a GPU, of some scenarios; FOLDER holds checkpoints of the CPU."""
    from subsoil_ros.dem.gpu.device import SIMULATED

    if SIMULATED:
        use_plain_python()
    for name in names:
        whole, kept = results("gpu", name)
        np.savez(folder / f"gpu {name}.npz", **whole)
        np.savez(folder / f"gpu kept {name}.npz", **kept)
        if name in RESUMED:
            with np.load(folder / f"cpu kept {name}.npz") as arrays:
                taken = resumed("gpu", name, dict(arrays))
            np.savez(folder / f"gpu resumed {name}.npz", **taken)
    if not SIMULATED:
        again, _ = results("gpu", names[0])
        np.savez(folder / "gpu again.npz", **again)


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2:])
