"""Soil on one host, mechanism, coupler and recorder on another: python -m dev.two_hosts (needs root)

Two network namespaces joined by a veth pair stand for the hosts; each has its own processes and its own
shared memory too, so nothing but the network joins them. The record must be, message for message, that of a
run without ROS. The test runs once with discovery over the subnet, once with only the peer's address.
Exit status 0: the same; 1: not the same; 77: not possible here, with a message why.
"""

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from mcap.reader import make_reader

from subsoil_ros.api.run_frame import simulate
from subsoil_ros.coupling.run_settings import RunSettings
from subsoil_ros.loading.loader import load_scene

SCENE = Path(__file__).parents[1] / "config/scenes/subsoiler_1s300_quick.yaml"
CHANGES = (
    "duration_s=0.1",
    "soil.bin.length_m=0.4",
    "soil.bin.width_m=0.15",
    "soil.bin.depth_m=0.25",
    "mechanism.initial.translate_x_m=0.05",
    "record.series_ticks=5",
    "record.cloud_hz=200",
)
ADDRESSES = {"subsoil_a": "10.77.0.1", "subsoil_b": "10.77.0.2"}
NODES_OF = {"subsoil_a": ("mechanism", "recorder", "coupler"), "subsoil_b": ("soil",)}
RUN_ID, LIMIT_S, SKIPPED = "twohosts", 120.0, 77


def why_not() -> str:
    """What is missing here; empty if nothing is."""
    if os.geteuid() != 0:
        return "needs root: it makes network namespaces"
    for tool in ("ip", "unshare"):
        if shutil.which(tool) is None:
            return f"needs the program '{tool}'"
    return ""


def _ip(*words: str) -> None:
    subprocess.run(["ip", *words], check=True)


@contextmanager
def hosts() -> Iterator[None]:
    """The two namespaces and the cable between them."""
    made = []
    try:
        for host in ADDRESSES:
            _ip("netns", "add", host)
            made.append(host)
        first, second = ADDRESSES
        _ip("link", "add", "cable", "netns", first, "type", "veth", "peer", "name", "cable", "netns", second)
        for host, address in ADDRESSES.items():
            _ip("-n", host, "address", "add", f"{address}/24", "dev", "cable")
            _ip("-n", host, "link", "set", "cable", "up")
            _ip("-n", host, "link", "set", "lo", "up")
        yield
    finally:
        for host in made:
            _ip("netns", "del", host)


def run_hosts(scene: Path, folder: Path, discovery: dict[str, dict[str, str]]) -> None:
    """Both hosts with their nodes.

    Raises:
        RuntimeError: a node failed, or they did not end.
    """
    command = [sys.executable, "-m", "dev.two_hosts", str(scene), str(folder)]
    isolate = ["unshare", "--mount", "--pid", "--fork", "--kill-child", "--mount-proc"]
    with_own_memory = ["sh", "-c", 'mount -t tmpfs none /dev/shm && exec "$@"', "sh"]
    processes = [
        subprocess.Popen(
            ["ip", "netns", "exec", host, *isolate, *with_own_memory, *command, *nodes],
            env={**os.environ, "ROS_DOMAIN_ID": "7", **discovery[host]},
        )
        for host, nodes in NODES_OF.items()
    ]
    try:
        if any([process.wait(LIMIT_S) for process in processes]):
            raise RuntimeError(_words(folder))
    except subprocess.TimeoutExpired:
        raise RuntimeError(f"the nodes did not end within {LIMIT_S:g} s: {_words(folder)}") from None
    finally:
        for process in processes:
            process.kill()
            process.wait()


def be_a_host(scene: str, folder: Path, names: list[str]) -> int:
    """Starts nodes by hand. Returns the worst exit status."""
    processes = []
    for name in names:
        parameters = {"scene": scene, "run_id": RUN_ID, "bag": folder / "bag"}
        options = [item for key, value in parameters.items() for item in ("-p", f"{key}:={value}")]
        program = [sys.executable, "-m", f"subsoil_ros.ros.nodes.{name}_node", "--ros-args", *options]
        with (folder / f"{name}.log").open("w") as log:
            processes.append(subprocess.Popen(program, stdin=subprocess.DEVNULL, stdout=log, stderr=log))
    return max([process.wait() for process in processes])


def _words(folder: Path) -> str:
    return " | ".join(f"{path.stem}: {path.read_text().strip()[-300:]}" for path in folder.glob("*.log"))


def messages(bag: Path) -> list[tuple[str, int, bytes]]:
    """All of a bag, without the wall time that ends a coupling report, and without padding."""
    (path,) = bag.glob("*.mcap")
    with path.open("rb") as stream:
        return [
            (
                channel.topic,
                message.log_time,
                message.data[: -8 if "report" in channel.topic else None].rstrip(b"\0"),
            )
            for _, channel, message in make_reader(stream).iter_messages(log_time_order=False)
        ]


def main() -> int:
    """Runs it both ways; with arguments it is one of the hosts."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("host", nargs="*", help="internal: names one of the two hosts")
    host = parser.parse_args().host
    if host:
        scene, place, *names = host
        return be_a_host(scene, Path(place), names)
    reason = why_not()
    if reason:
        print(f"skipped: {reason}")
        return SKIPPED
    subnet = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET"}
    first, second = ADDRESSES
    peers = {
        host: {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST", "ROS_STATIC_PEERS": ADDRESSES[other]}
        for host, other in ((first, second), (second, first))
    }
    same = True
    with tempfile.TemporaryDirectory(prefix="subsoil_two_hosts_") as name:
        folder = Path(name)
        resolved = load_scene(SCENE, CHANGES)
        resolved.write(folder / "scene.yaml")
        simulate(RunSettings(resolved, RUN_ID, bag=folder / "direct"))
        expected = messages(folder / "direct")
        for way, discovery in (("subnet", dict.fromkeys(ADDRESSES, subnet)), ("peers", peers)):
            place = folder / way
            place.mkdir()
            try:
                with hosts():
                    run_hosts(folder / "scene.yaml", place, discovery)
            except subprocess.CalledProcessError as error:
                print(f"skipped: no network namespaces here ({error})")
                return SKIPPED
            alike = messages(place / "bag") == expected
            same = same and alike
            verdict = "the same bits" if alike else "NOT the same"
            print(f"{way}: {len(expected)} messages, {verdict} as without ROS")
    return 0 if same else 1


if __name__ == "__main__":
    raise SystemExit(main())
