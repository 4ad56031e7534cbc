"""The work of `subsoil follow`; separate from its arguments, because it imports all libraries."""

import argparse
import itertools
import math
import os
from pathlib import Path

from ...analysis.summary import Summary
from ...api.run_frame import open_run, simulate
from ...coupling.engines import Soil, build_soil
from ...coupling.exit_status import caught_signals
from ...coupling.follow.follower import Follower, Replay
from ...coupling.observer import RunWatch
from ...coupling.run_settings import RunSettings
from ...errors import InputError, InterruptedRunError
from ...experiments.sweep_points import seed_key
from ...extras import require_ros
from ...loading.loader import ResolvedScene, load_scene
from ...recording.joined import open_record
from ...ros.transport.environment import check_environment
from ...ros.transport.shared_memory import avoid_full_memory
from ...run_results import print_summary
from ...yaml_document import Document
from ..output import say
from ..progress import RunProgress, bed_progress, reading_bag, working
from ..run.simulation import say_opened
from ..sweep import parse_seeds

Topics = tuple[dict[str, str], dict[str, str], dict[str, str]]


def follow(args: argparse.Namespace) -> int:
    """Follow poses until the scene's duration is over, or Ctrl-C; after a reset again, into OUT-2 and on."""
    scenes, topics, out = _scenes(args), None, Path(args.out)
    if args.replay is None:
        require_ros("subsoil follow", "give --replay RUN")
        check_environment()
        topics = _topics(scenes[0], args)
    for episode, resolved in enumerate(itertools.cycle(scenes), 1):
        folder = out if episode == 1 else out.with_name(f"{out.name}-{episode}")
        if not _run(args, resolved, topics, folder):
            break
    return 0


def _run(args: argparse.Namespace, resolved: ResolvedScene, topics: Topics | None, out: Path) -> bool:
    """Run into the folder; return whether it was reset. Raises what the run raises."""
    settings = RunSettings(resolved, threads=args.threads)
    frame = open_run(settings, out, shown=args.scene, bed_progress=bed_progress)
    say_opened(frame)
    bar = RunProgress(resolved.scene.name, resolved.timing)
    watch = RunWatch(bar)
    follower = Follower(resolved, watch.stop_signal, behind_s=args.behind, fastest_m_per_s=args.fastest)

    def work() -> None:
        with caught_signals(watch.signals.append):
            if topics is None:
                source = Replay(resolved, args.replay / "bag")
                with bar:
                    simulate(frame.settings, motion_source=source, observer=watch)
            else:
                _follow(args, topics, frame.settings, follower, watch, bar)

    summary, failure = frame.complete("direct", work, watch, reading=reading_bag, working=working)
    if isinstance(summary, Summary):
        print_summary(summary, resolved.scene, frame.out, reference=resolved.reference)
    if failure is not None and not (follower.is_reset and isinstance(failure, InterruptedRunError)):
        raise failure
    return follower.is_reset


def _scenes(args: argparse.Namespace) -> list[ResolvedScene]:
    """The scene by seed, whose tools may leap; of a replay as long as the record.

    Raises:
        InputError: its tools have no external machine, or an argument is no positive number.
    """
    for name in ("behind", "fastest"):
        if not 0.0 < getattr(args, name) < math.inf:
            raise InputError(f"--{name}: given {getattr(args, name)}; it must be a positive number")
    resolved = load_scene(args.scene, args.overrides)
    if not resolved.scene.external_machine or resolved.scene.external_soil:
        raise InputError(
            f"{args.scene}: `subsoil follow` moves the tools in a soil of the scene; give each tool "
            "path: {external: true, turn: {}}"
        )
    overrides = [f"tools.{tool}.path.may_leap=true" for tool in resolved.scene.tools]
    if args.replay is not None:
        options = ("pose", "odometry", "frame", "joints", "urdf", "seeds")
        if given := [name for name in options if getattr(args, name)]:
            raise InputError(f"--replay: given with --{given[0]}; the run is as recorded: leave one out")
        end_s = 1e-9 * open_record(args.replay / "bag").end_time_ns
        if end_s > 0.0:  # else Replay says that there is no tick
            overrides.append(f"duration_s={min(resolved.scene.duration_s, end_s)!r}")
    seeds = [f"{seed_key(resolved)}={seed}" for seed in parse_seeds(args.seeds)]
    changes = [*args.overrides, *overrides]
    if not seeds:
        return [load_scene(args.scene, changes)]
    return [load_scene(args.scene, [*changes, seed]) for seed in seeds]


def _follow(
    args: argparse.Namespace,
    topics: Topics,
    settings: RunSettings,
    follower: Follower,
    watch: RunWatch,
    bar: RunProgress,
) -> None:
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    if words := avoid_full_memory(1):
        say(words)
    from ...ros.nodes.follow_node import FollowNode, PoseSources

    resolved = settings.resolved
    sources = PoseSources(*topics, args.joints, args.urdf, args.world)
    soil = build_soil(resolved, settings.threads)
    node = FollowNode(resolved, settings.run_id, follower, sources)
    domain = os.environ.get("ROS_DOMAIN_ID", "0")
    say(f"waiting for poses of {', '.join(resolved.scene.tools)} in ROS_DOMAIN_ID={domain}")
    try:
        with bar:
            simulate(settings, motion_source=follower, soil=soil, sink=node, observer=watch)
    finally:
        watch.followed = follower.facts() | _removed(soil)
        node.close()


def _topics(resolved: ResolvedScene, args: argparse.Namespace) -> Topics:
    """Topics of poses and of odometry, and frames, by tool.

    Raises:
        InputError: options contradict each other, or are about no tool.
    """
    poses, odometry, frames = (_by_tool(resolved, args, name) for name in ("pose", "odometry", "frame"))
    for tool in poses.keys() & odometry.keys():
        raise InputError(f"--odometry {tool}: has a --pose too; give one of them")
    for tool in frames.keys() & {*poses, *odometry}:
        raise InputError(f"--frame {tool}: has a topic of its own; give one of them")
    if bool(args.joints) != (args.urdf is not None):
        raise InputError("--joints and --urdf: one is given without the other; give both, or neither")
    framed = [frames.get(tool, tool) for tool in resolved.scene.tools if tool not in {*poses, *odometry}]
    if args.joints and not framed:
        raise InputError("--joints: all tools have a --pose or --odometry; leave out one of them")
    if len(set(framed)) < len(framed):
        raise InputError(f"--frame: two tools have the same, {framed}; give each its own")
    return poses, odometry, frames


def _by_tool(resolved: ResolvedScene, args: argparse.Namespace, option: str) -> dict[str, str]:
    """Values of an option by tool.

    Raises:
        InputError: one is not TOOL=VALUE, or there is no such tool.
    """
    found = {}
    for text in getattr(args, option):
        tool, sign, value = text.partition("=")
        if not sign or not value or tool not in resolved.scene.tools:
            raise InputError(
                f"--{option}: given '{text}'; it must be TOOL={'FRAME' if option == 'frame' else 'TOPIC'}, "
                f"tools are {', '.join(resolved.scene.tools)}"
            )
        if tool in found:
            raise InputError(f"--{option}: given twice for {tool}; give it once")
        found[tool] = value
    return found


def _removed(soil: Soil | None) -> Document:
    """What a soil of particles counts of leaps."""
    return dict(zip(("leaps", "removed_particles"), getattr(soil, "leaps", ()), strict=False))
