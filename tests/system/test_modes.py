"""The same scene run in every way: the same bits."""

import json
from pathlib import Path

import pytest
from mcap.reader import make_reader

from subsoil_ros.cli.main import main
from subsoil_ros.dem.build import build_engine
from subsoil_ros.loading.loader import load_scene
from subsoil_ros.mbd.mechanism_engine import MechanismEngine
from subsoil_ros.ticks import tick_end_ns
from tests.system.conftest import lockstep_ticks, messages, run_arguments

DURATION_S = 0.02
WAYS = {
    "direct": ("direct", "1"),
    "direct_two_threads": ("direct", "2"),
    "composed": ("composed", "1"),
    "nodes": ("nodes", "1"),
    "nodes_two_threads": ("nodes", "2"),
}


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Result folders, by way."""
    folders = {}
    for name, (mode, threads) in WAYS.items():
        folders[name] = tmp_path_factory.mktemp(name) / "out"
        assert main(run_arguments(folders[name], mode, DURATION_S, "--threads", threads)) == 0
    return folders


def without_wall_time(out: Path) -> list[tuple[str, int, bytes]]:
    """All messages of a bag without the wall time, and without the zeros DDS pads with."""
    return [
        (topic, time_ns, data[: -8 if "report" in topic else None].rstrip(b"\0"))
        for topic, time_ns, data in messages(out / "bag")
    ]


def test_the_share_meets_soil_while_the_machine_moves(results: dict[str, Path]) -> None:
    """The comparison below is not one of zeros."""
    head, *rows = (results["direct"] / "series.csv").read_text().splitlines()
    last = dict(zip(head.split(","), rows[-1].split(","), strict=True))
    first = dict(zip(head.split(","), rows[0].split(","), strict=True))
    assert float(last["tool.shank.force_x_newton"]) < -1.0
    assert float(last["tool.shank.x_m"]) > float(first["tool.shank.x_m"])


@pytest.mark.parametrize("way", [name for name in WAYS if name != "direct"])
def test_series_are_equal_byte_for_byte(results: dict[str, Path], way: str) -> None:
    """series.csv does not depend on the way of running, nor on the number of threads."""
    assert (results[way] / "series.csv").read_bytes() == (results["direct"] / "series.csv").read_bytes()


@pytest.mark.parametrize("way", [name for name in WAYS if name != "direct"])
def test_bags_are_equal_message_for_message(results: dict[str, Path], way: str) -> None:
    """Every message of the bag, clouds and the run's name included, in the same order with the same bytes."""
    assert without_wall_time(results[way]) == without_wall_time(results["direct"])


def attached(out: Path) -> dict[str, bytes]:
    """Files in a bag by name."""
    (path,) = out.glob("bag/*.mcap")
    with path.open("rb") as stream:
        return {item.name: item.data for item in make_reader(stream).iter_attachments()}


@pytest.mark.parametrize("way", [name for name in WAYS if name != "direct"])
def test_bags_hold_the_same_scene(results: dict[str, Path], way: str) -> None:
    """Scene and meshes, byte for byte: nothing in them depends on who wrote the bag, or where."""
    assert len(attached(results[way])) > 1
    assert attached(results[way]) == attached(results["direct"])


@pytest.mark.parametrize("way", [name for name in WAYS if name != "direct"])
def test_full_states_are_equal_bit_for_bit(results: dict[str, Path], way: str) -> None:
    """Particles, contact histories, lists, mechanism with its history, exchange: digests at the end."""
    states = json.loads((results["direct"] / "summary.json").read_text())["run"]["state_sha256"]
    assert sorted(states) == ["coupling", "mechanism", "soil"]
    assert json.loads((results[way] / "summary.json").read_text())["run"]["state_sha256"] == states


@pytest.mark.parametrize("way", list(WAYS))
def test_every_tick_is_recorded_once_in_order(results: dict[str, Path], way: str) -> None:
    """The bag has each lockstep message of each tick exactly once."""
    timing = load_scene(results[way] / "scene.yaml").timing
    ticks = lockstep_ticks(results[way] / "bag", timing.communication_step_ns)
    assert ticks == {name: list(range(timing.tick_count)) for name in ticks}


def test_the_series_is_what_the_engines_produced(results: dict[str, Path]) -> None:
    """series.csv, made by reading the bag, has the engines' own numbers, bit for bit, in every row."""
    out = results["nodes"]
    resolved = load_scene(out / "scene.yaml")
    head, *rows = (out / "series.csv").read_text().splitlines()
    mechanism = MechanismEngine(resolved.scene, resolved.timing)
    soil = build_engine(resolved, 1)
    wrenches = soil.start(mechanism.initial_motions())
    start = mechanism.initial_state("run", wrenches)
    row = dict(zip(head.split(","), rows[0].split(","), strict=True))
    assert float(row["time_s"]) == 0.0
    assert float(row["draft_newton"]) == start.draft_newton
    assert float(row["tool.shank.force_z_newton"]) == wrenches[0].force_z_newton
    compared = 1
    for tick in range(resolved.timing.tick_count):
        wrenches = soil.advance(tick, mechanism.advance(tick, wrenches))
        if (tick + 1) % resolved.scene.record.series_ticks and tick + 1 != resolved.timing.tick_count:
            continue
        row = dict(zip(head.split(","), rows[compared].split(","), strict=True))
        end_ns = tick_end_ns(tick, resolved.timing.communication_step_ns)
        machine, bed = mechanism.state("run", tick, end_ns), soil.state("run", tick, end_ns)
        shank = next(body for body in machine.bodies if body.name == "shank")
        spring = next(force for force in machine.forces if force.name == "H9_spring")
        assert float(row["draft_newton"]) == machine.draft_newton
        assert float(row["body.shank.angle_rad"]) == shank.angle_rad
        assert float(row["spring.H9_spring.force_newton"]) == spring.load
        assert float(row["tool.shank.force_x_newton"]) == wrenches[0].force_x_newton
        assert float(row["soil.kinetic_energy_joule"]) == bed.kinetic_energy_joule
        compared += 1
    assert compared == len(rows)
