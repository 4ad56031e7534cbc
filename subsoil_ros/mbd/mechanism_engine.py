"""The mechanism engine: a scene's machine, advanced tick by tick under the soil's wrenches."""

import math
from collections.abc import Mapping
from dataclasses import astuple
from typing import TYPE_CHECKING

import numpy as np

from ..errors import PhysicsError, ProtocolError, RunError, SceneError, SingularMechanismError
from ..messages import DriverCommand, MechanismState, ToolMotion, ToolWrench
from ..scene.scene import Scene
from ..ticks import INITIAL_TICK, tick_end_s
from .accuracy import LARGEST_RESIDUAL, MOST_HALVINGS
from .advance import advance_tick
from .assembly import Start, Topology, assemble, weakest_joints
from .driving import Ramp, first_ramp, next_ramp, refuse_jumps, write_ramp
from .geometry import turns_of
from .joints.constraints import evaluate_residual
from .machine_arrays import (
    CONTRADICTION,
    GENERALIZED_ALPHA,
    INACCURATE,
    JAMMED,
    LARGEST,
    NOT_CLOSED,
    NOT_SOLVED,
    OK,
    PAST_COUNT,
    RESIDUAL,
    RESTART_COUNT,
    SINGULAR,
    UNBALANCED,
    State,
    make_state,
    make_workspace,
)
from .machine_state import mechanism_state
from .projection import Closure
from .stability import USUAL_TOLERANCE, copied, in_parts, passes, refuse_unstable_step

if TYPE_CHECKING:
    from ..limits.stable_steps import Timing


FINER = 16
"""Factor by which steps are refined for a trial where Newton's method fails. A larger one would advise runs
that take as many times longer."""

NEARLY_SINGULAR = 0.1
"""Ratio of the smallest pivot to the best one seen below which a singular pose is named as the cause of a
failed step. Only the kind and the words of the error depend on it."""


class MechanismEngine:
    """Advances the machine of a scene. One tick is one call; the state is in one place.

    Where the scene predicts motions, that is the state at the start of the tick: its end awaits the wrenches.
    """

    keeps_state = True

    def __init__(self, scene: Scene, timing: "Timing") -> None:
        """Assemble the machine and bring it to its initial state.

        Raises:
            SceneError: no mechanism in the scene, one that cannot be assembled, a step too large for it, or
                a driver that jumps in speed.
        """
        if scene.mechanism is None:
            raise SceneError("mechanism: is missing, and this run needs one")
        self._interval_ns = timing.communication_step_ns
        self._steps = max(1, timing.mechanism_steps)
        self._predicts = scene.predicts_motion
        step_s = timing.communication_step_ns * 1e-9 / self._steps
        refuse_jumps(scene.mechanism, step_s)
        start = assemble(scene.mechanism, scene.gravity_m_per_s2, step_s)
        refuse_unstable_step(start, timing.communication_step_ns * 1e-9)
        self._machine, self._redundant = start.machine, start.redundant
        self._draft_driver = scene.mechanism.draft_driver
        self._tools = [(name, tool.lateral_m) for name, tool in scene.tools.items()]
        self._tool_bodies = [self._machine.bodies.index(str(tool.body)) for tool in scene.tools.values()]
        self._tick = INITIAL_TICK
        self._controller = scene.controller
        self.ramp: Ramp | None = None
        if scene.controller is not None:
            driver = self._machine.joints.index(scene.controller.driver)
            self._commanded_function = int(self._machine.model.joints[driver]["function"])
            self.ramp = first_ramp(scene)
        self._due: Ramp | None = None  # commanded for the tick that comes
        self.topology = Topology.of(start)
        self._begin(start)

    def _begin(self, start: Start) -> None:
        """State and accelerations at time 0, without wrenches."""
        model = self._machine.model
        coordinates, rows, forces = len(model.mass), len(model.row_scale), len(model.forces)
        order = model.weights.shape[1]
        self._state = make_state(coordinates, rows, start.rank, forces, order)
        self._work = make_workspace(coordinates, rows, start.rank, forces)
        self._before = self._state  # at the start of a tick of generalized_alpha, see _what_solves
        state, work = self._state, self._work
        state.q[:], state.v[:] = start.q, start.v
        status = advance_tick(model, state, work, 0.0, 0)
        if status != OK:
            raise self._fault(int(status), 0.0)

    def initial_motions(self) -> tuple[ToolMotion, ...]:
        """Motions of the tools before the first tick, in scene order."""
        return self._motions()

    def initial_state(self, run_id: str, wrenches: tuple[ToolWrench, ...]) -> MechanismState:
        """The state at time 0 with the wrenches held (none: empty); the engine is left as it is.

        Raises:
            ProtocolError, PhysicsError, SingularMechanismError: as advance.
        """
        kept = {name: array.copy() for name, array in self._state._asdict().items()}
        self._hold(INITIAL_TICK, wrenches)
        status = advance_tick(self._machine.model, self._state, self._work, 0.0, 0)
        if status != OK:
            raise self._fault(int(status), 0.0)
        state = self.state(run_id, INITIAL_TICK, 0)
        for name, array in kept.items():
            getattr(self._state, name)[...] = array
        return state

    def advance(self, tick: int, wrenches: tuple[ToolWrench, ...]) -> tuple[ToolMotion, ...]:
        """Motions at the end of `tick`; wrenches: of the tick before (none: empty).

        They are held constant through `tick`, or, where the scene predicts motions, through the tick before,
        whose motions were a prediction; those of `tick` are one by the velocities at its start.

        Raises:
            ProtocolError: not the next tick, or a wrench of an unknown tool.
            PhysicsError: a wrench or an acceleration that is not finite, or contradicting constraints.
            SingularMechanismError: the motion is not determined any more, or cannot continue.
        """
        if tick != self._tick + 1:
            raise ProtocolError(
                f"mechanism: asked to advance tick {tick}, but the next one is {self._tick + 1}"
            )
        self._hold(tick, wrenches)
        if self._predicts and self._tick > INITIAL_TICK:
            self._solve(self._tick)
        if self._due is not None:
            self._drive(self._due)
            self._due = None
        if not self._predicts:
            self._solve(tick)
        self._tick = tick
        return self._motions(self._interval_ns * 1e-9 if self._predicts else 0.0)

    def _solve(self, tick: int) -> None:
        """Take the state from the start of a tick to its end. Raises RunError."""
        start = tick_end_s(tick - 1, self._interval_ns)
        if self._machine.model.integrator == GENERALIZED_ALPHA:
            self._before = copied(self._state)
        status = advance_tick(self._machine.model, self._state, self._work, start, self._steps)
        if status != OK:
            raise self._fault(int(status), start)

    def command(self, command: DriverCommand) -> None:
        """Apply a controller's command from the start of the next tick on.

        The driver's speed changes linearly and reaches the commanded one at the end of the control interval.

        Raises:
            ProtocolError: the scene has no controller, or the command is for another tick or driver.
            PhysicsError: the speed is not finite, beyond the controller's limits, or a jump.
        """
        if self._controller is None or self.ramp is None:
            raise ProtocolError(f"driver_command: tick {command.tick} came, but the scene has no controller")
        if command.tick != self._tick + 1:
            raise ProtocolError(
                f"driver_command: tick {command.tick} came where tick {self._tick + 1} is due"
            )
        start_s = tick_end_s(self._tick, self._interval_ns)
        interval_s = self._controller.interval_ticks * self._interval_ns * 1e-9
        self._due = next_ramp(self.ramp, command, self._controller, start_s, interval_s)

    def _drive(self, ramp: Ramp) -> None:
        """Follow a command from the state on."""
        assert self.ramp is not None
        if ramp.acceleration != self.ramp.acceleration:  # a breakpoint: history does not reach across
            self._state.counters[PAST_COUNT] = 0
            self._state.counters[RESTART_COUNT] += 1
        self._follow(ramp)

    def _follow(self, ramp: Ramp) -> None:
        self.ramp = ramp
        write_ramp(self._machine.model.functions, self._commanded_function, ramp)

    def state(self, run_id: str, tick: int, end_time_ns: int) -> MechanismState:
        """State of the whole machine now, with the stamp that the caller gives.

        Where the scene predicts motions, it is what the wrenches of the tick before would make of the last
        tick; if they make no step, the state at its start: `advance` reports what the true ones do.
        """
        time, state = end_time_ns * 1e-9, self._state
        if self._predicts and self._tick > INITIAL_TICK:
            trial, start = copied(state), tick_end_s(self._tick - 1, self._interval_ns)
            if advance_tick(self._machine.model, trial, self._work, start, self._steps) == OK:
                state = trial
        behind = -0.5 if self._tick > INITIAL_TICK else 0.5
        return mechanism_state(
            self._machine,
            state,
            self._redundant,
            self._draft_driver,
            (run_id, tick, end_time_ns),
            time + behind * self._machine.model.step,
        )

    @property
    def arrays(self) -> State:
        """All that changes during a run, in the arrays that the kernels write (not a copy)."""
        return self._state

    def state_arrays(self) -> dict[str, np.ndarray]:
        """All that later ticks depend on, by name; not a copy. The workspace carries nothing over."""
        ramp = {} if self.ramp is None else {"ramp": np.array(astuple(self.ramp))}
        return {**self._state._asdict(), "tick": np.array(self._tick), **ramp}

    def restore(self, arrays: Mapping[str, np.ndarray]) -> None:
        """Restore a state that `state_arrays` returned.

        Raises:
            KeyError, ValueError: the state is of another machine.
        """
        for name, array in self._state._asdict().items():
            if array.shape != arrays[name].shape:
                raise ValueError(f"{name} has shape {arrays[name].shape}, this machine needs {array.shape}")
            array[...] = arrays[name]
        self._tick = int(arrays["tick"])
        if self.ramp is not None:
            self._follow(Ramp(*arrays["ramp"].tolist()))

    def _hold(self, tick: int, wrenches: tuple[ToolWrench, ...]) -> None:
        """The wrenches as generalised forces; the planar moment is -torque_y (a turn about -y)."""
        self._state.wrench[:] = 0.0
        if not wrenches:
            return
        names = [name for name, _ in self._tools]
        if [wrench.tool for wrench in wrenches] != names:
            raise ProtocolError(
                f"mechanism: tick {tick}: wrenches of {', '.join(w.tool for w in wrenches)}, but the tools "
                f"are {', '.join(names)}"
            )
        for body, wrench in zip(self._tool_bodies, wrenches, strict=True):
            planar = (wrench.force_x_newton, wrench.force_z_newton, -wrench.torque_y_newton_m)
            if not all(math.isfinite(part) for part in planar):
                raise PhysicsError(
                    f"mechanism: tick {tick}: the wrench on tool '{wrench.tool}' is not finite: force x "
                    f"{planar[0]:g} N, z {planar[1]:g} N, torque y {-planar[2]:g} N m"
                )
            self._state.wrench[3 * body : 3 * body + 3] += planar

    def _motions(self, ahead_s: float = 0.0) -> tuple[ToolMotion, ...]:
        """Motions of the tools so long after the state, velocities staying."""
        q, v = self._state.q + ahead_s * self._state.v, self._state.v
        motions = []
        for (name, lateral), body in zip(self._tools, self._tool_bodies, strict=True):
            x, z, phi = (float(value) for value in q[3 * body : 3 * body + 3])
            motions.append(
                ToolMotion(name, x, lateral, z, phi, *(float(value) for value in v[3 * body : 3 * body + 3]))
            )
        return tuple(motions)

    def _fault(self, status: int, time: float) -> RunError:
        """The error for a status of a kernel, naming joints."""
        model, q = self._machine.model, self._state.q
        where = f"mechanism: after {time:.6f} s"
        joints = ", ".join(weakest_joints(self._machine, q))
        if status == SINGULAR:
            return SingularMechanismError(
                f"{where}: joints {joints} have come into a singular position (a dead centre or a stretched "
                "linkage), where they do not determine the motion. Keep the machine away from it: limit the "
                "drivers, or change the geometry."
            )
        if status == NOT_CLOSED:
            return SingularMechanismError(
                f"{where}: the joints cannot be closed any more; nearest to a singular position are "
                f"{joints}. The drivers require a position out of reach, or the motion is too fast for the "
                "step: change the drivers' time functions, or raise coupling.mechanism_steps."
            )
        if status == CONTRADICTION:
            phi = np.zeros(len(model.row_scale))
            evaluate_residual(model, time + model.step, time + model.step, q, turns_of(q), phi)
            worst = int(np.abs(phi).argmax())
            name = Closure(self._machine).names()[worst]
            return PhysicsError(
                f"{where}: redundant constraints contradict each other: {name} is open by "
                f"{abs(phi[worst]):.3g} m. Remove one of {', '.join(self._redundant)}."
            )
        if status == JAMMED:
            return PhysicsError(
                f"{where}: the friction of the joints does not converge: it needs larger reactions than it "
                "leaves (the machine jams). Lower the coefficients, or give a preload instead."
            )
        if status == NOT_SOLVED:
            return PhysicsError(
                f"{where}: generalized_alpha: Newton's method does not converge at a step of "
                f"{model.step:.3g} s.{self._what_solves(time)}"
            )
        if status in (INACCURATE, UNBALANCED):
            return self._inexact(status, time, joints)
        return PhysicsError(
            f"{where}: an acceleration is not finite or above 1e300: a spring of zero length, or a force "
            "that grows without end. Correct the forces of the machine."
        )

    def _what_solves(self, time: float) -> str:
        """Settings with which the tick that failed is solved, in words; empty if no tried ones do."""
        model = self._machine.model
        finer = model._replace(step=model.step / FINER)
        if passes(finer, self._before, time, FINER * self._steps):
            return f" With {FINER} times as many coupling.mechanism_steps this step is solved."
        if passes(in_parts(model), self._before, time, self._steps):
            return (
                " With mechanism.integrator: adams_moulton and a mechanism.tolerance of "
                f"{USUAL_TOLERANCE:g} this step is solved."
            )
        return ""

    def _inexact(self, status: int, time: float, joints: str) -> RunError:
        """The error for steps that do not follow the motion; a singular pose nearby is named as the cause."""
        model = self._machine.model
        residual, turned = self._state.balance[RESIDUAL], self._state.balance[LARGEST]
        if status == INACCURATE:
            what = (
                f"mechanism: after {time:.6f} s: the error of a step stays above mechanism.tolerance "
                f"{model.tolerance:g}, even in parts of {model.step / 2**MOST_HALVINGS:.3g} s"
            )
        else:
            what = (
                f"mechanism: at {time + self._steps * model.step:.6f} s: the balance of energy is open by "
                f"{residual:.3g} J, {100.0 * abs(residual) / turned:.3g} % of {turned:.3g} J turned over; "
                f"allowed is {100.0 * LARGEST_RESIDUAL:g} %"
            )
        pivots = np.abs(np.diag(self._work.factor))
        if len(pivots) and pivots.min() < NEARLY_SINGULAR * pivots.max() * self._state.condition[2]:
            return SingularMechanismError(
                f"{what}: joints {joints} have come near a singular position (a dead centre or a stretched "
                "linkage), where they do not determine the motion. Keep the machine away from it: limit the "
                "drivers, or change the geometry."
            )
        if model.integrator == GENERALIZED_ALPHA:
            return PhysicsError(f"{what}. The steps do not follow the motion.{self._what_solves(time)}")
        if math.isinf(model.tolerance):
            return PhysicsError(
                f"{what}. The steps, fixed by mechanism.tolerance: null, do not follow the motion."
            )
        return PhysicsError(
            f"{what}. Either a force is too stiff or changes too fast for these steps, or small errors of "
            "many steps have added up, which a lower mechanism.tolerance prevents."
        )
