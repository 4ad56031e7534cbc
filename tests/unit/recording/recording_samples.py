"""A made-up run for tests of bags: every kind of record, with numbers that only an exact copy keeps."""

from pathlib import Path

import numpy as np
from mcap.reader import make_reader

from subsoil_ros.limits.stable_steps import Timing
from subsoil_ros.loading.loader import ResolvedScene
from subsoil_ros.messages import (
    BodyState,
    Command,
    CouplingReport,
    FacetGroupForce,
    ForceState,
    Grant,
    JointReaction,
    MechanismState,
    SoilCloud,
    SoilState,
    ToolMotion,
    ToolMotions,
    ToolWrench,
    ToolWrenches,
)
from subsoil_ros.recording.bag_writer import BagWriter
from subsoil_ros.scene.scene import Scene

MESHES = Path(__file__).parents[3] / "config/meshes"
INTERVAL_NS = 48_000
TICKS = 50
SERIES_TICKS = 20
TOOLS = ("shank", "wheel")

WET = {
    "stiffness_newton_per_m": 1e4,
    "tangential_stiffness_newton_per_m": 8e3,
    "damping_newton_s_per_m": 20.0,
    "tangential_damping_newton_s_per_m": 20.0,
    "cohesive_stiffness_newton_per_m": 7e3,
    "static_friction": 0.5,
    "sliding_friction": 0.5,
    "rolling_friction": 0.3,
    "equilibrium_overlap_m": 0.002,
    "cohesion_range_m": 0.002,
}
SCENE = Scene.model_validate(
    {
        "name": "bag",
        "duration_s": TICKS * INTERVAL_NS * 1e-9,
        "soil": {
            "bin": {"length_m": 1.0, "width_m": 0.2, "depth_m": 0.1},
            "particles": {"radius_m": 0.01, "density_kg_per_m3": 1800.0},
            "bed": {"kind": "grid", "spacing_m": 0.018},
            "law": {"kind": "cohesive_linear", "particle": WET, "boundary": WET},
        },
        "mechanism": {
            "bodies": {
                "frame": {"mass_kg": 1.0, "inertia_kg_m2": 1.0, "position_m": [0.0, 0.0]},
                "hub": {"mass_kg": 1.0, "inertia_kg_m2": 1.0, "position_m": [0.5, 0.0]},
            }
        },
        "tools": {
            "shank": {"body": "frame", "groups": {"share": {"mesh": "share.stl"}}},
            "wheel": {"body": "hub", "lateral_m": 0.35, "groups": {"rim": {"mesh": "wheel.stl"}}},
        },
        "record": {"series_ticks": SERIES_TICKS},
    }
)
TIMING = Timing(communication_step_ns=INTERVAL_NS, tick_count=TICKS, soil_steps=1, mechanism_steps=1)
RESOLVED = ResolvedScene(SCENE, MESHES / "scene.yaml", MESHES, {}, "", TIMING)


def end_ns(tick: int) -> int:
    return (tick + 1) * INTERVAL_NS


def is_series(tick: int) -> bool:
    return (tick + 1) % SERIES_TICKS == 0 or tick == TICKS - 1


def awkward(rng: np.random.Generator, count: int) -> list[float]:
    """Doubles over the whole range of exponents: a float32 or a decimal detour cannot keep them."""
    return [float(v) for v in rng.standard_normal(count) * 10.0 ** rng.integers(-300, 300, count)]


def records_of(tick: int) -> list:
    """Every record of a tick, with numbers that only an exact copy keeps."""
    rng = np.random.default_rng(tick + 10)
    motions = tuple(
        ToolMotion(tool, *awkward(rng, 3), float(rng.uniform(-9.0, 9.0)), *awkward(rng, 3)) for tool in TOOLS
    )
    wrenches = tuple(
        ToolWrench(
            tool, *awkward(rng, 7), int(rng.integers(2**32)), (FacetGroupForce("share", *awkward(rng, 3)),)
        )
        for tool in TOOLS
    )
    found = [
        Grant("run", tick, Command.END if tick == TICKS - 1 else Command.RUN, "last" * (tick == TICKS - 1)),
        ToolMotions("run", tick, end_ns(tick), motions),
        ToolWrenches("run", tick, end_ns(tick), wrenches),
    ]
    if is_series(tick):
        bodies = (BodyState("frame", *awkward(rng, 9)), BodyState("hub", *awkward(rng, 9)))
        joints = (JointReaction("pin", *awkward(rng, 3), False),)
        forces = (ForceState("spring", *awkward(rng, 3)),)
        found += [
            MechanismState("run", tick, end_ns(tick), *awkward(rng, 10), 5, bodies, joints, forces),
            SoilState("run", tick, end_ns(tick), 7, 8, 0, 3, 9, *awkward(rng, 5)),
            CouplingReport("run", tick, end_ns(tick), *awkward(rng, 6)),
        ]
    if tick == TICKS - 1:
        positions = rng.standard_normal((100, 3)).astype(np.float32)
        found.append(SoilCloud(tick, end_ns(tick), positions, rng.random(100).astype(np.float32)))
    return found


def write_bag(directory: Path) -> Path:
    """A finished bag of TICKS ticks."""
    writer = BagWriter(directory, SCENE, TIMING)
    for tick in range(TICKS):
        for record in records_of(tick):
            writer.write(record)
    writer.close()
    return directory


def write_long_bag(writer: BagWriter, count: int) -> None:
    """Motions and wrenches of `count` ticks: several chunks."""
    for tick in range(count):
        for record in records_of(tick % TICKS)[1:3]:
            writer.write(type(record)("run", tick, end_ns(tick), record.tools))


def raw_messages(bag: Path) -> list[tuple[str, int, int, int, bytes]]:
    """(topic, log time, publish time, sequence, data) as mcap's own reader gives them in file order."""
    with next(bag.glob("*.mcap")).open("rb") as stream:
        messages = make_reader(stream, validate_crcs=True).iter_messages(log_time_order=False)
        return [(c.topic, m.log_time, m.publish_time, m.sequence, m.data) for _, c, m in messages]
