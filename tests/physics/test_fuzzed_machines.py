"""Random machines: energy, closed joints, and the same motion in another order, another place and turned."""

from dev import fuzz_machines
from dev.fuzz import run


def test_random_machines_keep_what_a_machine_must() -> None:
    """Trees and closed chains with all joints and forces; `make fuzz` draws 20,000."""
    found = run(fuzz_machines, 100)
    assert min(found["smooth"], found["with kinks"]) > 20
