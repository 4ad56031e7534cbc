"""Coulomb friction with sticking: a spring and damper up to the limit, sliding at the limit beyond.

The spring is unstrained at the anchor, which follows the sliding. Modes: it sticks; it slides, forward
(rate > 0) or backward; or it gives, forward or backward: the limit falls below the force of the spring,
although the contact does not slide that way. Source: Cundall and Strack 1979, Coulomb slider behind a spring.
"""

from ..kernel_options import inner_kernel

STICKS, FORWARD, BACKWARD, GIVES_FORWARD, GIVES_BACKWARD = 0, 1, 2, 3, 4

HELD = 1.0 - 1e-9
"""Part of the limit that holds a contact as it comes to rest: below the limit in spite of round-off."""


@inner_kernel
def stick_push(force, mode, anchor, limit, value, rate):
    """Push against the rate, its elastic part and the energy stored."""
    if mode == STICKS:
        elastic = -force.stick_stiffness * (value - anchor)
        return elastic - force.stick_damping * rate, elastic, -0.5 * elastic * (value - anchor)
    side = 1.0 if mode in (FORWARD, GIVES_FORWARD) else -1.0
    return -side * limit, 0.0, 0.0


@inner_kernel
def stick_mode(force, mode, anchor, limit, value, rate):
    """The mode after `mode`."""
    if mode in (FORWARD, BACKWARD):
        on = rate > 0.0 if mode == FORWARD else rate < 0.0
        return mode if on else STICKS
    pull = force.stick_stiffness * (value - anchor) + force.stick_damping * rate
    if abs(pull) <= limit:
        return STICKS
    if pull > 0.0:
        return FORWARD if rate > 0.0 else GIVES_FORWARD
    return BACKWARD if rate < 0.0 else GIVES_BACKWARD


@inner_kernel
def stick_anchor(force, before, after, anchor, limit, value):
    """Return the anchor after a change of mode; a contact that comes to rest keeps its force of sliding."""
    if after != STICKS or before not in (FORWARD, BACKWARD):
        return anchor
    strain = HELD * limit / force.stick_stiffness
    return value - strain if before == FORWARD else value + strain
