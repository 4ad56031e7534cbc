"""What a sweep runs: values as they are written, combinations, pairs, seeds."""

from pathlib import Path

import pytest

from subsoil_ros.errors import InputError, SceneError
from subsoil_ros.experiments.sweep_points import Point, combinations, jobs_of, parse_variations, seed_key
from subsoil_ros.loading.loader import load_scene
from subsoil_ros.loading.scene_bundle import pack, unpack

SCENES = Path(__file__).parents[3] / "config" / "scenes"
TINE = str(SCENES / "tine.yaml")


def test_values_are_yaml() -> None:
    """Numbers, words, lists and mappings; a comma inside brackets parts nothing."""
    found = parse_variations(
        ["a.b=1,2.5,auto", "c={kind: constant, value: 0.5},{kind: constant, value: 1}"], "--vary"
    )
    assert [(item.key, item.values) for item in found] == [
        ("a.b", (1, 2.5, "auto")),
        ("c", ({"kind": "constant", "value": 0.5}, {"kind": "constant", "value": 1})),
    ]


def test_combinations_are_a_product_with_pairs_in_step() -> None:
    """Two keys times one list of pairs: 2 x 3 x 2 runs, each once."""
    varied = parse_variations(["a=1,2", "b=3,4,5"], "--vary")
    paired = parse_variations(["c=6,7", "d=8,9"], "--pair")
    points = combinations(varied, paired)
    assert len(points) == 12
    assert {(p.values["c"], p.values["d"]) for p in points} == {(6, 8), (7, 9)}
    assert len({tuple(p.values.values()) for p in points}) == 12


@pytest.mark.parametrize(
    ("vary", "pair", "words"),
    [
        (["a"], [], "--vary a: must be KEY=VALUE"),
        (["a="], [], "must be KEY=VALUE"),
        (["a=1,1.0"], [], None),  # 1 and 1.0 are different texts, the scene says what it makes of them
        (["a=1,1"], [], "different values"),
        (["a=1", "a=2"], [], "given twice"),
        (["a=1,[2"], [], "not valid YAML"),
        ([], ["a=1,2", "b=1,2,3"], "a has 2, b has 3"),
        (["a=1"], ["a=2"], "stands in both"),
        ([f"k{k}=1,2,3,4,5,6,7,8,9,10" for k in range(6)], [], "1,000,000 combinations"),
    ],
)
def test_bad_values(vary: list[str], pair: list[str], words: str | None) -> None:
    """Refused with what was given and what is needed."""
    if words is None:
        assert len(combinations(parse_variations(vary, "--vary"))) == 2
        return
    with pytest.raises(InputError) as caught:
        combinations(parse_variations(vary, "--vary"), parse_variations(pair, "--pair"))
    assert words in str(caught.value)


def test_seeds_are_those_of_the_bed_that_is_random() -> None:
    """Of a jittered grid, a dense bed, a wedge model; where nothing is random they are refused."""
    wedge = str(SCENES / "subsoiler_1s300_wedge.yaml")
    assert seed_key(load_scene(TINE, ["soil.bed.jitter_m=1e-4"])) == "soil.bed.seed"
    assert seed_key(load_scene(TINE, ["soil.bed={kind: dense_random}"])) == "soil.bed.seed"
    assert seed_key(load_scene(wedge)) == "soil.seed"
    with pytest.raises(InputError, match=r"seeds would change nothing: soil.bed is of kind 'grid' without"):
        jobs_of(TINE, (), [Point({})], (0, 1))


def test_jobs_have_their_values_and_seeds() -> None:
    """Each job's scene has the values of its point over the common ones, and its seed."""
    key = "soil.tool_stiffness_factor"
    points = combinations(parse_variations([f"{key}=1.0,10.0"], "--vary"))
    jobs = jobs_of(TINE, [f"{key}=3.0", "soil.bed.jitter_m=1e-4"], points, (4, 7))
    found = [
        (j.scene.scene.particle_soil.tool_stiffness_factor, j.scene.scene.particle_soil.bed.seed)
        for j in jobs
    ]
    assert found == [(1.0, 4), (1.0, 7), (10.0, 4), (10.0, 7)]
    assert len({job.scene.scene_hash for job in jobs}) == 4
    with pytest.raises(SceneError, match="did you mean 'tool_stiffness_factor'"):
        jobs_of(TINE, (), [Point({"soil.tool_stifness_factor": 1.0})])


@pytest.mark.parametrize("name", ["tine", "subsoiler_1s300_wedge", "three_shanks"])
def test_a_parcel_needs_nothing_of_its_sender(name: str, tmp_path: Path) -> None:
    """Unpacked in an empty folder it is the same scene by hash, and no path of the sender is in it."""
    scene = load_scene(SCENES / f"{name}.yaml")
    bundle = pack(scene)
    assert str(SCENES.parent) not in bundle.text
    assert unpack(bundle, tmp_path).scene_hash == scene.scene_hash
    other = type(bundle)(bundle.text, bundle.files, "0" * 64)
    with pytest.raises(SceneError, match="another version of subsoil_ros"):
        unpack(other, tmp_path)
