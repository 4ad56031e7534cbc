"""A scene pays only for what it names: engines, code and records."""

import itertools
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from numba import njit

from subsoil_ros.contact_laws.base import NO, YES, ContactMotion, ContactState
from subsoil_ros.contact_laws.cohesive_linear.law import CohesiveLinearFeatures, CohesiveLinearLaw
from subsoil_ros.coupling.engines import build_mechanism, build_soil
from subsoil_ros.coupling.protocol import participants
from subsoil_ros.dem.contact import contact, law_features
from subsoil_ros.dem.engine import SoilEngine
from subsoil_ros.loading.loader import load_scene

SCENES = Path(__file__).parents[2] / "config" / "scenes"
SMALL_TINE = ["duration_s=0.002", "soil.bin.length_m=0.1", "soil.bin.width_m=0.1", "soil.bin.depth_m=0.06"]
NAMED = {
    "mechanism_only.yaml": ["duration_s=0.01"],
    "tine.yaml": SMALL_TINE,
    "subsoiler_1s300_wedge.yaml": ["duration_s=0.01"],
}
PROGRAM = """
import json, sys
from subsoil_ros.cli.main import main
status = main(["run", sys.argv[1], "--mode", "direct", "--out", sys.argv[2], *sys.argv[3:]])
modules = sorted(name for name in sys.modules if name.startswith("subsoil_ros."))
kernels = {}
if "subsoil_ros.dem" in sys.modules:
    from subsoil_ros.contact_laws.cohesive_linear.law import CohesiveLinearFeatures as Features
    from subsoil_ros.dem.step import drift_and_contacts
    for motion, pairs, *others in drift_and_contacts.overloads:
        features = next(kind for kind in pairs if getattr(kind, "instance_class", None) is Features)
        names = [name for name, kind in zip(Features._fields, features.types) if kind.ndim == 2]
        kernels.setdefault("drift_and_contacts", []).append(names)
found = {"status": status, "modules": modules, "kernels": kernels, "rclpy": "rclpy" in sys.modules}
print(json.dumps(found))
"""


@pytest.mark.parametrize(
    ("scene", "overrides", "expected"),
    [
        ("mechanism_only.yaml", [], ("mechanism", "recorder")),
        ("mechanism_only.yaml", ["record.bag=false"], ("mechanism",)),
        ("tine.yaml", [], ("soil", "recorder")),
        ("tine.yaml", ["record.bag=false"], ("soil",)),
        ("subsoiler_1s300_quick.yaml", [], ("mechanism", "soil", "recorder")),
        ("subsoiler_1s300_draft_limit.yaml", [], ("mechanism", "soil", "controller", "recorder")),
    ],
)
def test_nodes_are_those_that_the_scene_names(
    scene: str, overrides: list[str], expected: tuple[str, ...]
) -> None:
    """No soil, no soil node; no mechanism, likewise; no bag, no recorder; no controller unless named."""
    assert participants(load_scene(SCENES / scene, overrides).scene) == expected


def test_no_soil_is_no_soil_engine_and_no_mechanism_none() -> None:
    """The engines of a run are None where the scene names nothing."""
    assert build_soil(load_scene(SCENES / "mechanism_only.yaml"), 1) is None
    assert build_mechanism(load_scene(SCENES / "tine.yaml", SMALL_TINE)) is None


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> dict[str, dict]:
    """What runs of the scenes have imported and compiled, each in a fresh process."""
    answers = {}
    for scene, overrides in NAMED.items():
        sets = [part for change in overrides for part in ("--set", change)]
        out = str(tmp_path_factory.mktemp("run") / "out")
        done = subprocess.run(
            [sys.executable, "-c", PROGRAM, str(SCENES / scene), out, *sets],
            capture_output=True, text=True, check=True,
        )  # fmt: skip
        answers[scene] = json.loads(done.stdout.splitlines()[-1])
        assert answers[scene]["status"] == 0
    return answers


@pytest.mark.full
@pytest.mark.parametrize(
    ("scene", "named", "absent"),
    [
        ("mechanism_only.yaml", "mbd.mechanism_engine", ("dem", "wedge", "mbd.tool_paths")),
        ("tine.yaml", "dem.engine", ("wedge", "mbd.mechanism_engine", "mbd.advance", "mbd.dynamics")),
        ("subsoiler_1s300_wedge.yaml", "wedge.wedge_engine", ("dem", "mbd.tool_paths")),
    ],
)
def test_only_the_engines_named_are_imported(
    found: dict[str, dict], scene: str, named: str, absent: tuple[str, ...]
) -> None:
    """Nothing of another engine, so none of its kernels either; a direct run has no ROS."""
    modules = found[scene]["modules"]
    assert f"subsoil_ros.{named}" in modules
    for part in absent:
        assert not [name for name in modules if f"{name}.".startswith(f"subsoil_ros.{part}.")]
    assert not found[scene]["rclpy"]


def test_a_run_compiles_its_kernels_once_for_its_own_features(found: dict[str, dict]) -> None:
    """The tine's soil: cohesion, tangential and rolling springs, no other feature."""
    assert found["tine.yaml"]["kernels"] == {"drift_and_contacts": [["tangential", "rolling", "cohesion"]]}


WET = [*SMALL_TINE, "soil.bed.spacing_m=rest"]
OFF = {
    "cohesion": ["soil.law.{row}.cohesive_stiffness_newton_per_m=0"],
    "rolling": ["soil.law.{row}.rolling_friction=0"],
    "tangential": [
        "soil.law.{row}.tangential_stiffness_newton_per_m=0",
        "soil.law.{row}.tangential_damping_newton_s_per_m=0",
    ],
}  # fmt: skip


def features_of(*overrides: str) -> set[str]:
    """Features that the law of the tine's soil is compiled with."""
    soil = load_scene(SCENES / "tine.yaml", [*WET, *overrides]).scene.particle_soil
    assert soil is not None
    features = law_features(soil)
    return {name for name in features._fields if getattr(features, name).ndim == 2}


@pytest.mark.parametrize("feature", list(OFF))
def test_what_both_rows_leave_out_is_no_feature(feature: str) -> None:
    """Zero in particle and boundary: gone. Without a tangential spring there is no rolling one either."""
    off = [text.format(row=row) for row in ("particle", "boundary") for text in OFF[feature]]
    gone = {"tangential", "rolling"} if feature == "tangential" else {feature}
    assert features_of() - features_of(*off) == gone


def test_what_is_named_is_a_feature() -> None:
    """Sizes, layers, and the options of the law are compiled in by name only."""
    assert features_of() == {"cohesion", "tangential", "rolling"}
    assert features_of("soil.law.damped_zones=all") - features_of() == {"damp_all_zones"}
    assert features_of("soil.law.friction_normal=absolute") - features_of() == {"friction_absolute"}
    sizes = "{kind: uniform, min_radius_m: 0.008, max_radius_m: 0.012}"
    sized = ("soil.particles.radius_m=null", f"soil.particles.sizes={sizes}", "soil.bed={kind: dense_random}")
    assert features_of(*sized) - features_of() == {"sizes"}
    layers = "soil.layers=[{name: a, thickness_m: 0.02}, {name: b}]"
    assert features_of(layers) - features_of() == {"materials"}


def test_what_is_no_part_of_the_law_is_named_too() -> None:
    """Energy books come with their monitor, the period with periodic sides."""

    def engine_of(*overrides: str) -> set[str]:
        soil = build_soil(load_scene(SCENES / "tine.yaml", [*WET, *overrides]), 1)
        assert isinstance(soil, SoilEngine)
        features = soil._model.features
        return {name for name in features._fields if getattr(features, name).ndim == 2}

    assert engine_of() == features_of()
    assert engine_of("soil.monitors={max_energy_defect: 0.5}") - engine_of() == {"book"}
    assert engine_of("soil.bin.sides=periodic") - engine_of() == {"periodic"}
    assert features_of("soil.law.friction_normal=repulsive") - features_of() == {"friction_repulsive"}


def instructions(features: CohesiveLinearFeatures) -> int:
    """Lines of machine code of one contact."""
    numbers = CohesiveLinearLaw.numbers
    law = numbers(*np.linspace(1.0, 2.0, len(numbers._fields)))

    @njit(error_model="numpy")
    def one(overlap, law, features):
        vector = (overlap, 0.5 * overlap, 0.25 * overlap)
        motion, state = ContactMotion((1.0, 0.0, 0.0), vector, vector), ContactState(vector, vector, ())
        return contact(overlap, motion, state, 1e-5, law, features)

    one(0.001, law, features)
    (code,) = one.inspect_asm().values()
    return len(code.splitlines())


@pytest.mark.full
def test_the_code_of_absent_features_is_not_there() -> None:
    """Every feature taken away leaves fewer instructions of a contact."""
    all_there = CohesiveLinearFeatures(YES, YES, YES, cohesion=YES)
    counts = [instructions(all_there)]
    for name in ("book", "rolling", "tangential", "cohesion"):
        all_there = all_there._replace(**{name: NO})
        counts.append(instructions(all_there))
    assert all(after < before for before, after in itertools.pairwise(counts)), counts
