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


def every_ticks(rate_hz: float, communication_step_ns: int) -> int:
    """Ticks between events of a rate, the nearest whole number from 1; 0 where the rate is 0."""
    return max(1, round(NANOSECONDS_PER_SECOND / (rate_hz * communication_step_ns))) if rate_hz > 0.0 else 0


def tick_count(duration_s: float, communication_step_ns: int) -> int:
    """Number of whole ticks that cover `duration_s`; at least one."""
    duration_ns = round(duration_s * NANOSECONDS_PER_SECOND)
    return max(1, -(-duration_ns // communication_step_ns))


def is_early_end(tick: int, check_ticks: int) -> bool:
    """Whether a run may end with `tick` before its last one; `check_ticks` 0: never.

    This is decided at the end of the tick before it, a check tick.
    """
    return check_ticks > 0 and tick > 0 and (tick + 1) % check_ticks == 0


def is_control_tick(tick: int, control_ticks: int) -> bool:
    """Whether a controller commands `tick`: every `control_ticks` ticks, not the first; 0: never."""
    return control_ticks > 0 and tick > 0 and tick % control_ticks == 0
