"""Integer simulation time: tick k covers [k H, (k + 1) H), H a whole number of nanoseconds."""

NANOSECONDS_PER_SECOND = 1_000_000_000
LONGEST_S = 2**31 - 1
"""Longest simulated time: stamps of messages count seconds in 32 bits."""

INITIAL_TICK = -1
"""Tick of the initial state: its end time is 0."""


def tick_end_ns(tick: int, communication_step_ns: int) -> int:
    """Simulated time at the end of `tick` [ns]; 0 for INITIAL_TICK."""
    return (tick + 1) * communication_step_ns


def tick_end_s(tick: int, communication_step_ns: int) -> float:
    """Simulated time at the end of `tick` [s], derived from the integer, never accumulated."""
    return tick_end_ns(tick, communication_step_ns) * 1e-9


def tick_count(duration_s: float, communication_step_ns: int) -> int:
    """Number of whole ticks that cover `duration_s`; at least one."""
    duration_ns = round(duration_s * NANOSECONDS_PER_SECOND)
    return max(1, -(-duration_ns // communication_step_ns))
