"""The same exchange in HELICS, where that is installed: two federates, 18 doubles each way per step."""

import importlib.util
import itertools
import json
import socket
import subprocess
import sys
import time

CORE = "zmqss"
VALUES = 18
"""Motion or wrench of three tools: six numbers each."""

LIMIT_S = 120.0


def helics_cost(steps: int, warm_up: int) -> dict[str, float] | None:
    """Median wall and CPU time of one step [us]; None where HELICS is not installed.

    Both federates publish, request the next time and read what the other one published: the exchange of
    HELICS' own examples. A step is granted when both have requested it, so each reads the other's last step.
    """
    if importlib.util.find_spec("helics") is None:
        return None
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    numbers = [str(number) for number in (port, steps, warm_up)]
    processes = [
        subprocess.Popen([sys.executable, "-m", __name__, role, *numbers], stdout=subprocess.PIPE, text=True)
        for role in ("broker", "first", "second")
    ]
    try:
        words = [process.communicate(timeout=LIMIT_S)[0] for process in processes]
    finally:
        for process in processes:
            process.kill()
            process.wait()
    first, second = (json.loads(word.splitlines()[-1]) for word in words[1:])
    return {
        "wall_us_median": first["wall_us_median"],
        "cpu_us_per_exchange": first["cpu_us"] + second["cpu_us"],
    }


def _broker(port: int) -> None:
    import helics

    broker = helics.helicsCreateBroker(CORE, "", f"-f 2 --port={port} --loglevel=error")
    while helics.helicsBrokerIsConnected(broker):
        time.sleep(0.05)


def _federate(name: str, other: str, port: int, steps: int, warm_up: int) -> dict[str, float]:
    import helics

    settings = helics.helicsCreateFederateInfo()
    helics.helicsFederateInfoSetCoreTypeFromString(settings, CORE)
    helics.helicsFederateInfoSetCoreInitString(settings, f"--brokerport={port} --loglevel=error")
    helics.helicsFederateInfoSetTimeProperty(settings, helics.HELICS_PROPERTY_TIME_DELTA, 1.0)
    federate = helics.helicsCreateValueFederate(name, settings)
    out = helics.helicsFederateRegisterGlobalPublication(federate, name, helics.HELICS_DATA_TYPE_VECTOR, "")
    into = helics.helicsFederateRegisterSubscription(federate, other, "")
    helics.helicsFederateEnterExecutingMode(federate)
    values, times_ns, cpu_s = [0.5] * VALUES, [], 0.0
    for step in range(steps):
        if step == warm_up:
            cpu_s = time.process_time()
        times_ns.append(time.monotonic_ns())
        helics.helicsPublicationPublishVector(out, values)
        helics.helicsFederateRequestTime(federate, step + 1.0)
        values = helics.helicsInputGetVector(into) or values
    cpu_s = time.process_time() - cpu_s
    if len(values) != VALUES:
        raise RuntimeError(f"HELICS gave {len(values)} values where {VALUES} were published")
    helics.helicsFederateDisconnect(federate)
    helics.helicsCloseLibrary()
    laps = sorted(later - sooner for sooner, later in itertools.pairwise(times_ns[warm_up:]))
    return {"wall_us_median": 1e-3 * laps[len(laps) // 2], "cpu_us": 1e6 * cpu_s / (steps - warm_up)}


def main() -> int:
    """Run the broker or one federate; a federate prints its times."""
    role, port, steps, warm_up = sys.argv[1], *(int(word) for word in sys.argv[2:])
    if role == "broker":
        _broker(port)
    else:
        other = {"first": "second", "second": "first"}[role]
        print(json.dumps(_federate(role, other, port, steps, warm_up)))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
