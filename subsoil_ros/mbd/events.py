"""Location of the instant inside a step at which a force leaves its mode (forces/evaluation.py)."""

from .forces.evaluation import evaluate_modes, held_in
from .geometry import evaluate_turns
from .kernel_options import inner_kernel

NEAREST = 1e-12
"""Width of the bracket around the instant at its end, as a part of the step."""


@inner_kernel
def differs(modes, others):
    """Whether any force is in another mode."""
    found = False
    for i in range(modes.shape[0]):
        found = found or modes[i] != others[i]
    return found


@inner_kernel
def _interpolate(state, work, span, part):
    """Position and velocity at `part` of the step into trial_q and trial_v.

    The polynomial of degree 5 with the position, velocity and acceleration of both ends.
    """
    s, rest = part, 1.0 - part
    for i in range(state.wrench.shape[0]):
        v0, v1 = span * state.v[i], span * work.v[i]
        a0, a1 = 0.5 * span * span * state.a[i], 0.5 * span * span * work.a[i]
        way = work.q[i] - state.q[i] - v0 - a0
        turn = v1 - v0 - 2.0 * a0 - 3.0 * way
        bend = a1 - a0 - 3.0 * turn - 3.0 * way
        # q0 + v0 s + a0 s^2 + s^3 (way + (s - 1) (turn + (s - 1) bend))
        inner = way - rest * (turn - rest * bend)
        slope = turn - 2.0 * rest * bend
        work.trial_q[i] = state.q[i] + s * (v0 + s * (a0 + s * inner))
        work.trial_v[i] = (v0 + s * (2.0 * a0 + s * (3.0 * inner + s * slope))) / span


@inner_kernel
def locate_switch(model, state, work, start, span, select):
    """The part of the step, from 0 to 1, at which the first force leaves its mode.

    `work` holds the end of a step whose modes differ from those of the state; its `modes` become those right
    after the switch.
    """
    before, after = 0.0, 1.0
    while after - before > NEAREST:
        part = 0.5 * (before + after)
        _interpolate(state, work, span, part)
        evaluate_turns(work.trial_q, work.turns)
        time = start + part * span
        evaluate_modes(
            model, held_in(state), time, select, work.trial_q, work.turns, work.trial_v, work.modes
        )
        if differs(work.modes, state.modes):
            after = part
        else:
            before = part
    _interpolate(state, work, span, after)
    evaluate_turns(work.trial_q, work.turns)
    time = start + after * span
    evaluate_modes(model, held_in(state), time, select, work.trial_q, work.turns, work.trial_v, work.modes)
    return after
