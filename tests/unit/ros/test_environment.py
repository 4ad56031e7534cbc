"""The environment of ROS: what would end or hang a run later is one line before it starts."""

from pathlib import Path

import pytest

from dev import fuzz_environments
from dev.fuzz import run
from subsoil_ros.cli.main import main
from subsoil_ros.ros.transport.environment import check_environment

BAD = [
    ("ROS_DOMAIN_ID", "300"),
    ("ROS_DOMAIN_ID", "abc"),
    ("ROS_DOMAIN_ID", "-1"),
    ("ROS_DOMAIN_ID", " 5"),
    ("ROS_DOMAIN_ID", "010"),
    ("ROS_DOMAIN_ID", "٣"),
    ("ROS_STATIC_PEERS", "127.0.0.1;a..b"),
    ("NUMBA_NUM_THREADS", "0"),
    ("NUMBA_CACHE_DIR", "/dev/null/kernels"),
    ("RMW_IMPLEMENTATION", "rmw_nothing_cpp"),
    ("RMW_IMPLEMENTATION", "rmw" * 100),
    ("ROS_AUTOMATIC_DISCOVERY_RANGE", "OFF"),
    ("ROS_AUTOMATIC_DISCOVERY_RANGE", "localhost"),
    ("ROS_LOCALHOST_ONLY", "yes"),
    ("FASTDDS_DEFAULT_PROFILES_FILE", "/nowhere/profiles.xml"),
]


@pytest.mark.parametrize(("name", "value"), BAD)
def test_a_run_with_a_bad_environment_is_refused(
    name: str,
    value: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Status 2, one line that names the variable and the value, and nothing is left."""
    monkeypatch.setenv(name, value)
    for mode in ("nodes", "composed"):
        assert main(["run", "mechanism_only", "--out", str(tmp_path / "run"), "--mode", mode]) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert f"environment: {name} is '{value}'; it must be" in line
    assert list(tmp_path.iterdir()) == []


def test_a_random_environment_passes_or_is_refused_by_name() -> None:
    """`make fuzz` draws 20,000. Both ends are met often."""
    assert min(run(fuzz_environments, 300).values()) > 50


def test_what_ros_accepts_passes(monkeypatch: pytest.MonkeyPatch) -> None:
    """Values in use, and variables that are set to nothing."""
    for name, value in (
        ("ROS_DOMAIN_ID", ""),
        ("ROS_DOMAIN_ID", "232"),
        ("RMW_IMPLEMENTATION", "rmw_fastrtps_cpp"),
        ("ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNET"),
    ):
        monkeypatch.setenv(name, value)
        check_environment()


@pytest.mark.parametrize("name", ["left-tine", "1a", " ", "", "a.b", "blé", "a" * 65, "world"])
def test_a_name_that_no_topic_can_have_is_refused(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The same in all modes, by `check` too."""
    scene = tmp_path / "scene.yaml"
    scene.write_text(
        "name: named\nduration_s: 0.01\nsoil: {model: external, bin: {length_m: 1, width_m: 1, depth_m: 1}}\n"
        f"tools: {{'{name}': {{path: {{external: true}}, groups: {{foot: {{mesh: foot.stl}}}}}}}}\n"
    )
    for words in (["check", str(scene)], ["run", str(scene), "--out", str(tmp_path / "run")]):
        assert main(words) == 2
        assert f"given the name '{name}'" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == [scene]
