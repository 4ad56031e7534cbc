"""The thread of a node that ends by what is no Exception."""

from types import SimpleNamespace
from typing import Any, cast

from subsoil_ros.ros.process.node_process import Service


class Leaving:
    """A node whose code leaves the program."""

    def spin(self) -> None:
        raise SystemExit("by hand")


def test_the_end_of_a_thread_is_a_fault() -> None:
    """Else no one hears of it, and who waits for `ended` waits for ever."""
    said: list[Any] = []
    logger = SimpleNamespace(fatal=said.append, error=said.append, info=said.append, warning=said.append)
    heartbeat = SimpleNamespace(
        node=SimpleNamespace(get_logger=lambda: logger),
        say=lambda *words, **keys: said.append((words, keys)),
        flush=lambda seconds: None,
    )
    service = Service("soil", cast(Any, Leaving), cast(Any, heartbeat))
    service.run()
    assert service.ended.is_set()
    assert (service.status.code, service.status.reason) == (3, "SystemExit: by hand")
    assert any(isinstance(item, tuple) and item[1]["exit_status"] == 3 for item in said)
