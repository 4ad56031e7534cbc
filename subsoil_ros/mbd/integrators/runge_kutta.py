"""The classical Runge-Kutta method of order 4: an integrator of its own, and the start of Adams-Moulton."""

from ..compiled import inner_kernel


@inner_kernel
def guess_runge_kutta(state, work, step, stage):
    """The point of stage 1 to 3 from the slopes of the stage before; at stage 4 the end of the step."""
    count = state.wrench.shape[0]
    weight = 1.0 if stage == 1 or stage == 4 else 2.0
    if stage == 1:
        work.sums[:] = 0.0
        work.power_sums[:] = 0.0
    for i in range(count):
        work.sums[0, i] += weight * work.v[i]
        work.sums[1, i] += weight * work.a[i]
    for i in range(state.powers.shape[0]):
        work.power_sums[i] += weight * work.powers[i]
    reach = step if stage == 3 else 0.5 * step
    for i in range(count):
        rate_q = work.sums[0, i] / 6.0 if stage == 4 else work.v[i]
        rate_v = work.sums[1, i] / 6.0 if stage == 4 else work.a[i]
        span = step if stage == 4 else reach
        work.q[i] = state.q[i] + span * rate_q
        work.v[i] = state.v[i] + span * rate_v
