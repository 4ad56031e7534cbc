"""Runs of a sweep: combinations of values of scene keys, each with every bed seed."""

import itertools
import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from ..analysis.summary import short_name
from ..errors import InputError
from ..loading.loader import ResolvedScene, load_scene
from ..scene.bed_kinds import is_random
from ..scene.soil import Soil
from ..scene.wedge_soil import WedgeSoil
from ..yaml_document import parse_yaml

LARGEST_COUNT = 100_000
"""Most runs of a sweep; more are refused as a probable typing error, before memory is used for their list."""


@dataclass(frozen=True)
class Variation:
    """A key of the scene and the values it takes."""

    key: str  # dotted path, as in --set
    values: tuple[object, ...]


@dataclass(frozen=True)
class Point:
    """One combination of values; with a seed, one run."""

    values: dict[str, object]  # by key, in the order they were asked for
    seed: int | None = None  # None: the scene's own
    name: str = ""
    overrides: tuple[str, ...] = field(default=(), compare=False)

    @property
    def label(self) -> str:
        """Label for progress and messages."""
        words = [self.name] if self.name else []
        words += [f"{short_name(key)}={as_text(value)}" for key, value in self.values.items()]
        words += [] if self.seed is None else [f"seed {self.seed}"]
        return ", ".join(words) or "as written"


def as_text(value: object) -> str:
    """Text of a value, as on the command line and in tables."""
    return value if isinstance(value, str) else json.dumps(value)


def parse_variations(texts: Sequence[str], flag: str) -> tuple[Variation, ...]:
    """Parse "a.b.c=1,2,3" texts; the values are YAML, so {kind: constant, value: 0.5} is one of them.

    Raises:
        InputError: no key, no value, or a key given twice.
    """
    found: list[Variation] = []
    for text in texts:
        key, equals, values = text.partition("=")
        key = key.strip()
        if not equals or not key or not values.strip():
            raise InputError(
                f"{flag} {text}: must be KEY=VALUE,VALUE..., for example {flag} soil.bed.seed=0,1,2"
            )
        listed = parse_yaml(f"[{values}]", f"{flag} {key}")
        assert isinstance(listed, list)
        if any(other.key == key for other in found):
            raise InputError(f"{flag} {key}: given twice; give all its values at once")
        if not listed or len({as_text(value) for value in listed}) < len(listed):
            raise InputError(f"{flag} {key}: given {values!r}; it must be a list of different values")
        found.append(Variation(key, tuple(listed)))
    return tuple(found)


def combinations(product: Sequence[Variation], paired: Sequence[Variation] = ()) -> tuple[Point, ...]:
    """Every combination of `product` with every step of `paired`, whose values go together.

    Raises:
        InputError: paired lists of unequal length, a key in both, or too many runs.
    """
    lengths = {len(item.values) for item in paired}
    if len(lengths) > 1:
        given = ", ".join(f"{item.key} has {len(item.values)}" for item in paired)
        raise InputError(f"--pair: values go together, so their lists must be equally long; {given}")
    both = {item.key for item in product} & {item.key for item in paired}
    if both:
        raise InputError(f"--vary and --pair: {', '.join(sorted(both))} stands in both; keep one")
    steps = [{item.key: item.values[k] for item in paired} for k in range(lengths.pop() if lengths else 1)]
    count = len(steps) * math.prod(len(item.values) for item in product)
    if count > LARGEST_COUNT:
        raise InputError(f"--vary: {count:,} combinations, allowed are {LARGEST_COUNT:,}; give fewer values")
    return tuple(
        Point({**dict(zip((item.key for item in product), values, strict=True)), **step})
        for values in itertools.product(*(item.values for item in product))
        for step in steps
    )


@dataclass(frozen=True)
class Job:
    """One run: a point and its scene."""

    point: Point
    scene: ResolvedScene


def one_soil(scenes: Sequence[ResolvedScene]) -> list[str]:
    """Changes that give scenes the finest particles that their one preset, and the widest and deepest field
    that a scene in short, derives from one of the tools: both change the draft."""
    soils = [scene.scene.particle_soil for scene in scenes]
    radii = {0.5 * sum(soil.particles.bounds_m) for soil in soils if soil is not None}
    changes = []
    if None not in (presets := {scene.preset for scene in scenes}) and len(presets) == 1 and len(radii) > 1:
        changes += [f"preset={scenes[0].preset}", f"soil.particles.radius_m={min(radii):g}"]
    for name in ("width_m", "depth_m"):
        key, sizes = f"soil.bin.{name}", {getattr(soil.bin, name) for soil in soils if soil is not None}
        if len(sizes) > 1 and all(key in {item.key for item in scene.derived} for scene in scenes):
            changes.append(f"{key}={max(sizes):g}")
    return changes


def jobs_of(
    path: str, common: Sequence[str], points: Sequence[Point], seeds: Sequence[int] = ()
) -> tuple[Job, ...]:
    """Every point with every seed, its scene loaded; a wrong value shows before anything runs.

    common: KEY=VALUE in every run; a point's own overrides and values come after.

    Raises:
        SceneError: a scene is wrong; the message names the point.
        InputError: as seed_key.
    """
    jobs = []
    for point in points:
        own = [f"{key}={json.dumps(value)}" for key, value in point.values.items()]  # JSON is YAML
        changes = [*common, *point.overrides, *own]
        if not seeds:
            jobs.append(Job(point, load_scene(path, changes)))
            continue
        key = seed_key(load_scene(path, changes))
        if key in point.values:
            raise InputError(f"--seeds: {key} is varied too; keep --seeds or the variation, not both")
        for seed in seeds:
            seeded = Point(point.values, seed, point.name, point.overrides)
            jobs.append(Job(seeded, load_scene(path, [*changes, f"{key}={seed}"])))
    return tuple(jobs)


def seed_key(scene: ResolvedScene) -> str:
    """Return the key of the seed of the bed.

    Raises:
        InputError: nothing in the scene's soil is random, so that seeds would change nothing.
    """
    soil = scene.scene.soil
    if isinstance(soil, WedgeSoil):
        return "soil.seed"
    bed = soil.bed if isinstance(soil, Soil) else None
    if bed is not None and is_random(bed):
        return "soil.bed.seed"
    if bed is None:
        raise InputError(f"{scene.path}: seeds would change nothing: nothing in its soil is random")
    what = f"soil.bed is of kind '{bed.kind}' without jitter"
    if bed.kind == "saved":
        what = "soil.bed is a saved one"
    raise InputError(
        f"{scene.path}: seeds would change nothing: {what}. Use a tiled or a dense_random bed, or a grid "
        "with soil.bed.jitter_m, for instance a hundredth of a radius"
    )
