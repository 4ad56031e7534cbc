"""Comparison of two checkouts, bit for bit: `python dev/same_bits.py BASE [--scenes ...] [--modes ...]`.

BASE, a folder or a git revision, is compared with the checkout that this file is in. Both run short scenes in
direct, composed and nodes mode. Compared are the state at the last checkpoint (type, shape and bytes of each
array), every message of the bag (declared types and values), the columns of series.csv, the values of
summary.json and the limits derived from the scene. same_bits_names.yaml lists names that differ in BASE;
a name that only one side has is a difference. Wall times, versions, paths and digests are left out.

Nodes use the messages that are compiled into their environment: where msg_defs differs, make an environment
in BASE and name its interpreter with --base-python. Exit status: 0 equal, 1 different, 2 not comparable.
"""

import argparse
import csv
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml
from rosbags.highlevel import AnyReader
from rosbags.interfaces import Nodetype

ROOT = Path(__file__).resolve().parents[1]
NAMES = Path(__file__).with_name("same_bits_names.yaml")
MODES = ("direct", "composed", "nodes")
SHOWN = 4
"""Differences listed for each section of a run."""


class Scene(NamedTuple):
    """A short run: what is changed in a scene, in BASE's names; the tool is in the soil before the end."""

    changes: dict[str, Any]
    file: str = ""  # of the checkout, without .yaml; config/scenes/NAME if empty
    resumed: bool = False  # compared is the run from the first of two checkpoints


FIELD = {"soil.particles.radius_m": 0.02, "tools.tine.path.start_x_m": 0.1}
SWING = {"soil.particles.radius_m": 0.02, "mechanism.initial.translate_x_m": 0.2, "duration_s": 0.05}
DOWN = "{kind: constant, value: -0.5}"
SCENES: dict[str, Scene] = {
    "tine": Scene({"duration_s": 0.06, "tools.tine.path.start_x_m": -0.08}),
    "tine_hardpan": Scene({"duration_s": 0.03, "tools.tine.path.start_x_m": -0.08}),
    "tine_elasto_plastic": Scene(
        {"duration_s": 0.1, "soil.material": "loam_plastic", **FIELD}, "config/scenes/field_tine"
    ),
    "subsoiler_1s300_quick": Scene({"duration_s": 0.1, "mechanism.initial.translate_x_m": -0.1}),
    "depth_wheel": Scene({"duration_s": 0.05}),
    "mechanism_only": Scene({"duration_s": 0.7}),
    "three_shanks_wedge": Scene({"duration_s": 0.4}),
    "subsoiler_1s300_draft_limit": Scene(
        {
            "duration_s": 0.05,
            "mechanism.initial.translate_x_m": -0.05,
            "controller.law.draft_limit_newton": 50.0,
        }
    ),
    "field_tine": Scene({"duration_s": 0.3, **FIELD}),
    "field_tine_resumed": Scene({"duration_s": 0.3, **FIELD}, "config/scenes/field_tine", resumed=True),
    "field_swing_brittle": Scene(SWING),
    "field_three_shanks": Scene(SWING),
    "bucket": Scene(
        {
            "duration_s": 0.1,
            "tools.bucket.path.external": False,
            "tools.bucket.path.start_z_m": 0.19,
            "tools.bucket.path.speed_z_m_per_s": DOWN,
            "tools.bucket.path.turn.axis": [0.0, 1.0, 0.0],
            "tools.bucket.path.turn.speed_rad_per_s": "{kind: constant, value: 2.0}",
        },
        "examples/bucket_arm/bucket",
    ),
}

ROS_VARIABLES = ("AMENT_PREFIX_PATH", "CMAKE_PREFIX_PATH", "_ROS_WHEELS_BOOTSTRAP_COMPLETE")
"""What an environment of ROS wheels tells the processes it starts."""

CHECKPOINT_AT = 0.99
"""Fraction of the duration at which the state is kept: a run writes no checkpoint of its last tick."""

PROBE = """
import json, sys
from dataclasses import asdict
from pathlib import Path
import subsoil_ros
from subsoil_ros.recording.types import message_folder
from subsoil_ros.limits.communication_steps import coupling_bounds
from subsoil_ros.limits.stable_steps import step_limits
from subsoil_ros.loading.loader import load_scene
from subsoil_ros.loading.soil_file import soil_of
from subsoil_ros.scene.meshes import load_tool_mesh
resolved = load_scene(sys.argv[1], sys.argv[2:])
scene, soil = resolved.scene, resolved.scene.particle_soil
meshes = {name: load_tool_mesh(resolved.directory, scene, name) for name in scene.tools}
modulus = scene.wedge_soil and soil_of(scene.wedge_soil).values.bed_modulus_newton_per_m3
limits = {
    "timing": asdict(resolved.timing),
    "steps": [asdict(limit) for limit in step_limits(soil)] if soil else [],
    "tools": [asdict(bound) for bound in coupling_bounds(scene, meshes, modulus)],
}
messages = {path.name: path.read_text() for path in Path(message_folder()).glob("*.msg")}
found = {"package": subsoil_ros.__file__, "messages": messages, "limits": limits}
print(json.dumps(found, default=lambda number: number.item()))
"""
"""Program that prints the limits of a scene, and which package and messages it uses, in BASE's names."""

Values = dict[str, Any]
Rules = Mapping[str, str]


@dataclass(frozen=True)
class Side:
    """One of the two checkouts.

    names_in: BASE's names -> this side's, for the scenes, overrides and code it gets; names_out: this side's
    names -> those of the checkout that this file is in, for its results. Both by section.
    """

    title: str
    checkout: Path
    python: str
    work: Path  # caches and runs
    names_in: Mapping[str, Rules]
    names_out: Mapping[str, Rules]

    def scene(self, scene: str) -> list[str]:
        """Scene file and overrides."""
        changes, file, resumed = SCENES[scene]
        kept_s = CHECKPOINT_AT * changes["duration_s"] / (2.0 if resumed else 1.0)
        changes = changes | {"record.checkpoint_s": kept_s}
        texts = [renamed(f"{key}={value}", self.names_in["overrides"]) for key, value in changes.items()]
        return [renamed(file or f"config/scenes/{scene}", self.names_in["files"]) + ".yaml", *texts]

    def execute(self, *arguments: str) -> "subprocess.CompletedProcess[str]":
        """Runs Python on this checkout's package, with caches of its own: each side prepares its beds."""
        environment = dict(os.environ)
        if self.python != sys.executable:  # another environment finds its own ROS
            for key in (*ROS_VARIABLES, "LD_LIBRARY_PATH", "PYTHONPATH"):
                environment.pop(key, None)
        path = os.pathsep.join(filter(None, (str(self.checkout), environment.get("PYTHONPATH"))))
        environment |= {"PYTHONPATH": path, "XDG_CACHE_HOME": str(self.work / "cache")}
        command = [self.python, *arguments]
        return subprocess.run(command, cwd=self.checkout, env=environment, capture_output=True, text=True)

    def probe(self, scene: str) -> Values:
        """Limits of a scene. SystemExit if another package or other messages than the checkout's are used."""
        program = "\n".join(renamed(line, self.names_in["code"]) for line in PROBE.splitlines())
        done = self.execute("-c", program, *self.scene(scene))
        if done.returncode:
            give_up(
                f"{self.checkout}: {scene}: no limits; does PROBE fit this checkout?\n{done.stderr[-2000:]}"
            )
        found = json.loads(done.stdout)
        if not Path(found["package"]).is_relative_to(self.checkout):
            give_up(f"{self.checkout}: {self.python} imports {found['package']} instead")
        folder = self.checkout / "msg_defs/msg"
        if found["messages"] != {path.name: path.read_text() for path in folder.glob("*.msg")}:
            give_up(
                f"{self.checkout}: {self.python} has other messages than {folder}; make an environment there "
                "and use its interpreter (for BASE: --base-python)"
            )
        return dict(flat(found["limits"]))

    def run(self, scene: str, mode: str) -> Path:
        """Folder of a finished run. Raises ValueError with its last words if it failed."""
        out = self.work / f"{scene}_{mode}"
        self._run(scene, mode, out)
        if not SCENES[scene].resumed:
            return out
        first, second = checkpoints(out)
        shutil.rmtree(second)
        resumed = out.with_name(f"{out.name}_from_{first.name}")
        self._run(scene, mode, resumed, "--resume", str(out))
        return resumed

    def _run(self, scene: str, mode: str, out: Path, *words: str) -> None:
        path, *changes = self.scene(scene)
        shutil.rmtree(out, ignore_errors=True)
        options = [word for change in changes for word in ("--set", change)]
        arguments = ["-m", "subsoil_ros.cli.main", "run", path, "--out", str(out), "--mode", mode, *words]
        done = self.execute(*(renamed(word, self.names_in["code"]) for word in arguments), *options)
        if done.returncode:
            raise ValueError(f"the run on {self.title} failed: {done.stderr.strip()[-500:]}")


def give_up(reason: str) -> None:
    """End with status 2."""
    print(reason, file=sys.stderr)
    raise SystemExit(2)


def renamed(name: str, rules: Rules) -> str:
    """A name of BASE as it is here."""
    for pattern, replacement in rules.items():
        name = re.sub(pattern, replacement, name)
    return name


def named_alike(values: Values, rules: Rules, left_out: Sequence[str]) -> Values:
    """`values` by the names they have here, without what is left out. ValueError if two get the same name."""
    kept: Values = {}
    for name, value in values.items():
        new = renamed(name, rules)
        if not any(re.search(pattern, either) for pattern in left_out for either in (name, new)):
            if new in kept:
                raise ValueError(f"{NAMES.name}: two names become '{new}', '{name}' is one of them")
            kept[new] = value
    return kept


def flat(value: Any, name: str = "") -> Iterator[tuple[str, Any]]:
    """Leaves of nested mappings, records and lists of them, by dotted name: a.b[0].c."""
    if is_dataclass(value):
        value = {item.name: getattr(value, item.name) for item in fields(value) if item.name != "__msgtype__"}
    if isinstance(value, Mapping):
        for key, inner in value.items():
            yield from flat(inner, f"{name}.{key}" if name else str(key))
    elif isinstance(value, list) and value and (isinstance(value[0], Mapping) or is_dataclass(value[0])):
        for index, inner in enumerate(value):
            yield from flat(inner, f"{name}[{index}]")
    else:
        yield name, value


def kind(value: Any) -> str:
    """Name of a value's type; of a list, that of its first item."""
    return kind(value[0]) if isinstance(value, list) and value else type(value).__name__


def compare(base: Values, here: Values) -> tuple[list[str], list[str]]:
    """Lines of what differs, and of what is equal but has another type, each with its name."""
    different, retyped = [], []
    for name in sorted(base.keys() | here.keys()):
        if name not in here or name not in base:
            different.append(f"{name}: only in {'BASE' if name in base else 'this checkout'}")
        elif words := contrast(base[name], here[name]):
            different.append(f"{name}: {words}")
        elif kind(base[name]) != kind(here[name]):
            retyped.append(f"{name}: {kind(base[name])} is now {kind(here[name])}")
    return different, retyped


def contrast(one: Any, other: Any) -> str:
    """Words for where two values begin to differ; none if their bits are equal (1 and 1.0: their values)."""
    if isinstance(one, np.ndarray) and isinstance(other, np.ndarray):
        if (one.dtype, one.shape) != (other.dtype, other.shape):
            return f"{one.dtype} {one.shape}, here {other.dtype} {other.shape}"
        if one.tobytes() == other.tobytes():
            return ""
        return contrast(one.ravel().tolist(), other.ravel().tolist()) or "other bytes"
    if isinstance(one, list) and isinstance(other, list):
        if len(one) != len(other):
            return f"{len(one)} values, here {len(other)}"
        found = [(index, contrast(one[index], other[index])) for index in range(len(one))]
        unlike = [f"[{index}]: {words}" for index, words in found if words]
        return f"{len(unlike)} of {len(one)} values, the first {unlike[0]}" if unlike else ""
    floats = isinstance(one, float) and isinstance(other, float)
    equal = one.hex() == other.hex() if floats else one == other
    return "" if equal else f"{one!r}, here {other!r}"[:200]


def checkpoints(out: Path) -> list[Path]:
    """Folders of a run's checkpoints, from the first to the last."""
    return sorted({path.parent for path in out.rglob("*.npz")}, key=lambda path: path.name)


def read_state(out: Path) -> Values:
    """Arrays of the last checkpoint by PART.ARRAY, and what its manifest says of the coupling."""
    folders = checkpoints(out)
    if not folders:
        raise ValueError(f"{out}: no checkpoint there")
    folder, values = folders[-1], Values()
    for path in sorted(folder.glob("*.npz")):
        with np.load(path, allow_pickle=False) as archive:
            values |= {f"{path.stem}.{name}": archive[name] for name in archive.files}
    manifest = json.loads((folder / "manifest.json").read_text(encoding="utf-8"))
    return values | dict(flat(manifest["coupling"], "coupling"))


def read_bag(out: Path, topics: Rules) -> tuple[Values, Values]:
    """All values of each field, in order, and its declared type, by "TOPIC FIELD"."""
    values: defaultdict[str, list[Any]] = defaultdict(list)
    types: Values = {}
    with AnyReader([out / "bag"]) as reader:
        for connection in reader.connections:
            topic = renamed(connection.topic, topics)
            found = declared(reader.typestore.fielddefs, connection.msgtype)
            types |= {f"{topic} {field}": kind for field, kind in found}
        for connection, time_ns, data in reader.messages():
            topic = renamed(connection.topic, topics)
            values[f"{topic} log time"].append(time_ns)
            for field, value in flat(reader.deserialize(data, connection.msgtype)):
                values[f"{topic} {field}"].append(value)
    return dict(values), types


def declared(definitions: Mapping[str, Any], message: str, name: str = "") -> Iterator[tuple[str, str]]:
    """Declared primitive type of each field of a message and its parts; [] stands for any index."""
    for field, (node, detail) in definitions[message][1]:
        array = node in (Nodetype.ARRAY, Nodetype.SEQUENCE)
        inner, what = detail[0] if array else (node, detail)
        whole = f"{name}.{field}" if name else field
        if inner == Nodetype.NAME:
            yield from declared(definitions, what, whole + "[]" * array)
        else:
            yield whole, f"{what[0]}{'[]' * array}"


def read_series(out: Path) -> Values:
    """Columns of series.csv."""
    with (out / "series.csv").open(newline="", encoding="utf-8") as stream:
        names, *rows = csv.reader(stream)
    columns = zip(*rows, strict=True)
    return {name: [_number(cell) for cell in cells] for name, cells in zip(names, columns, strict=True)}


def _number(cell: str) -> int | float:
    return int(cell) if re.fullmatch(r"-?\d+", cell) else float(cell)


def read_run(out: Path, side: Side, left_out: Mapping[str, Sequence[str]]) -> dict[str, Values]:
    """What is compared of a run, by section, in the names used here."""
    summary = dict(flat(json.loads((out / "summary.json").read_text(encoding="utf-8"))))
    found = {"arrays": read_state(out), "columns": read_series(out), "summary": summary}
    found["fields"], types = read_bag(out, side.names_out["topics"])
    alike = {name: named_alike(found[name], side.names_out[name], left_out[name]) for name in found}
    return alike | {"field types": named_alike(types, side.names_out["fields"], left_out["fields"])}


def compare_sections(base: Mapping[str, Values], here: Mapping[str, Values], title: str) -> bool:
    """Prints how two sets of sections compare. Whether they are equal."""
    lines, count = [], 0
    for section, values in base.items():
        different, retyped = compare(values, here[section])
        if section == "field types":  # a field that one side alone has stands among the fields
            different, retyped = [], [line for line in different if ": only in" not in line]
        elif not values:
            different = ["nothing found"]
        count += len(different)
        lines += [f"  {section}: {line}" for line in different[:SHOWN]]
        lines += [f"  {section}: and {len(different) - SHOWN} more"] * (len(different) > SHOWN)
        lines += [f"  {section}, type changed: {line}" for line in retyped]
    counts = ", ".join(f"{len(values)} {section}" for section, values in base.items())
    print(f"{title}: {f'{count} DIFFERENCES' if count else 'equal'} ({counts})", *lines, sep="\n", flush=True)
    return not count


def compare_scene(base: Side, here: Side, scene: str, modes: Sequence[str], left_out: Values) -> bool:
    """Runs a scene on both sides and prints what differs. Whether all is equal."""
    sides = (base, here)
    base_limits, limits = (
        {"limits": named_alike(side.probe(scene), side.names_out["limits"], left_out["limits"])}
        for side in sides
    )
    equal = compare_sections(base_limits, limits, scene)
    for mode in modes:
        # Nodes have two processes that compute, and deadlines: one side at a time.
        with ThreadPoolExecutor(2 if mode == "direct" else 1) as pool:
            runs = [pool.submit(side.run, scene, mode) for side in sides]
        try:
            found = [read_run(run.result(), side, left_out) for run, side in zip(runs, sides, strict=True)]
        except ValueError as error:
            print(f"{scene} {mode}: {error}")
            equal = False
        else:
            equal &= compare_sections(found[0], found[1], f"{scene} {mode}")
    return equal


def main() -> int:
    """Compares as the command line asks."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("base", metavar="BASE", help="folder of another checkout, or a git revision")
    parser.add_argument("--scenes", nargs="+", choices=SCENES, default=list(SCENES), metavar="SCENE")
    parser.add_argument("--modes", nargs="+", choices=MODES, default=list(MODES), metavar="MODE")
    parser.add_argument("--base-python", default=sys.executable, metavar="FILE", help="interpreter for BASE")
    parser.add_argument("--work", type=Path, help="folder where runs and kernels are kept (default: nowhere)")
    args = parser.parse_args()
    names = yaml.safe_load(NAMES.read_text(encoding="utf-8"))
    left_out = names.pop("left_out")
    same_names: dict[str, Rules] = {section: {} for section in names}
    with tempfile.TemporaryDirectory() as temporary:
        work = (args.work or Path(temporary)).resolve()
        for beds in work.glob("*/cache/**/beds"):  # of an earlier comparison
            shutil.rmtree(beds)
        checkout, git = Path(args.base).resolve(), ["git", "-C", str(ROOT), "worktree"]
        revision = not (checkout / "subsoil_ros").is_dir()
        if revision:
            checkout = Path(temporary).resolve() / "checkout"
            if subprocess.run([*git, "add", "--quiet", "--detach", str(checkout), args.base]).returncode:
                give_up(f"'{args.base}' is neither the folder of a checkout nor a git revision")
        try:
            base = Side("BASE", checkout, args.base_python, work / "base", same_names, names)
            here = Side("this checkout", ROOT, sys.executable, work / "here", names, same_names)
            equal = [compare_scene(base, here, scene, args.modes, left_out) for scene in args.scenes]
        finally:
            if revision:
                subprocess.run([*git, "remove", "--force", str(checkout)], check=True)
    print("the same bits" if all(equal) else "DIFFERENT")
    return 0 if all(equal) else 1


if __name__ == "__main__":
    raise SystemExit(main())
