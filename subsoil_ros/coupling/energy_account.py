"""Energy account of the interface between soil and mechanism.

The mechanism moves through tick k under the wrench of tick k-1, or, where motions are predicted, through tick
k - 1 itself; the soil works against it with the forces of its own steps. Both works would be equal in an
exchange without delay; their difference is energy that the exchange creates or loses. A tick whose motion was
predicted is booked with the next one, so the last of a run is not.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

from ..errors import PhysicsError
from ..leaps import entry
from ..messages import CouplingReport, ToolMotion, ToolWrench, work_joule
from ..scene.scene import Scene
from ..ticks import tick_end_ns


def held_work_joule(wrench: ToolWrench, before: ToolMotion, after: ToolMotion) -> float:
    """Work of a wrench held constant while its tool moves [J]."""
    force = (wrench.force_x_newton, wrench.force_y_newton, wrench.force_z_newton)
    torque = (wrench.torque_x_newton_m, wrench.torque_y_newton_m, wrench.torque_z_newton_m)
    return work_joule(force, torque, before, after)


@dataclass(frozen=True)
class InterfaceWork:
    """The account after a tick [J]."""

    mechanism_work_joule: float = 0.0  # in the tick booked last, as the mechanism took it
    soil_work_joule: float = 0.0  # in the same, as the soil summed it
    residual_joule: float = 0.0  # since the start, mechanism less soil
    absolute_work_joule: float = 0.0  # since the start, sum of |soil work| of each tool and tick

    @property
    def residual_ratio(self) -> float:
        """|residual| over the work done; 0 while there is none."""
        if self.absolute_work_joule == 0.0:
            return 0.0
        return abs(self.residual_joule) / self.absolute_work_joule

    def report(
        self, run_id: str, tick: int, communication_step_ns: int, wall_time_s: float
    ) -> CouplingReport:
        """The account as the record of `tick`."""
        return CouplingReport(
            run_id=run_id,
            tick=tick,
            end_time_ns=tick_end_ns(tick, communication_step_ns),
            mechanism_work_joule=self.mechanism_work_joule,
            soil_work_joule=self.soil_work_joule,
            residual_joule=self.residual_joule,
            absolute_work_joule=self.absolute_work_joule,
            residual_ratio=self.residual_ratio,
            wall_time_s=wall_time_s,
        )


class InterfaceAccount:
    """Sums the interface work tick by tick, and checks the residual.

    Args:
        motions: those of the tools before tick 0, in scene order.
        wrenches: the soil's wrenches for them; empty without soil.
        bound: largest residual, as a part of the absolute work; None: no check.
        grace_joule: absolute work below which the bound is not applied.
        work: the account so far, in a resumed run.
        leaps_within_s: duration of a tick by tool that may leap, which no force does.
        predicted_s: of a tick whose motions are a prediction; None: they are what the wrenches give. Its
            work is then known one tick later.
        begun: the motions are those of a tick, in a resumed run.
    """

    def __init__(
        self,
        motions: tuple[ToolMotion, ...],
        wrenches: tuple[ToolWrench, ...],
        bound: float | None,
        grace_joule: float,
        work: InterfaceWork | None = None,
        leaps_within_s: Mapping[str, float] | None = None,
        predicted_s: float | None = None,
        begun: bool = False,
    ) -> None:
        self._leaps_within_s = leaps_within_s or {}
        self._predicted_s = predicted_s
        self.work = work or InterfaceWork()
        self._motions = self._corrected(motions) if begun else motions  # the initial ones are no prediction
        self._wrenches = wrenches
        self._bound = bound
        self._grace_joule = grace_joule

    def add(self, motions: tuple[ToolMotion, ...], wrenches: tuple[ToolWrench, ...]) -> InterfaceWork:
        """Add a finished tick, its motions and wrenches; return the account."""
        held = soil = absolute = 0.0
        motions = self._corrected(motions)
        for wrench, before, after in zip(self._wrenches, self._motions, motions, strict=True):
            interval_s = self._leaps_within_s.get(after.tool)
            start = entry(before, after, interval_s) if interval_s is not None else None
            held += held_work_joule(wrench, start or before, after)
        for wrench in wrenches if self._predicted_s is None else self._wrenches:
            soil += wrench.work_joule
            absolute += abs(wrench.work_joule)
        self._motions, self._wrenches = motions, wrenches
        self.work = InterfaceWork(
            held,
            soil,
            self.work.residual_joule + (held - soil),
            self.work.absolute_work_joule + absolute,
        )
        return self.work

    def _corrected(self, motions: tuple[ToolMotion, ...]) -> tuple[ToolMotion, ...]:
        """Where the mechanism truly was when it predicted these motions, by constant velocities."""
        back_s = self._predicted_s
        if back_s is None:
            return motions
        return tuple(
            replace(
                motion,
                x_m=motion.x_m - back_s * motion.velocity_x_m_per_s,
                z_m=motion.z_m - back_s * motion.velocity_z_m_per_s,
                angle_rad=motion.angle_rad - back_s * motion.angular_velocity_rad_per_s,
            )
            for motion in motions
        )

    def nears_bound(self, part: float) -> bool:
        """Whether the residual is above this part of its bound, where the bound applies."""
        judged = self._bound is not None and self.work.absolute_work_joule > self._grace_joule
        return judged and self.work.residual_ratio > part * (self._bound or 0.0)

    def check(self, tick: int) -> None:
        """Check the account after `tick`.

        Raises:
            PhysicsError: the residual is above its bound, or a number is not finite.
        """
        work = self.work
        if not abs(work.residual_joule) < float("inf"):
            raise PhysicsError(
                f"tick {tick}: interface energy residual {work.residual_joule} J; motion or force of a tool "
                "is not finite. Look at the last recorded ticks; a smaller step is the usual cure"
            )
        if self._bound is None or work.absolute_work_joule <= self._grace_joule:
            return
        if work.residual_ratio > self._bound:
            does = "invents" if work.residual_joule > 0.0 else "loses"
            raise PhysicsError(
                f"tick {tick}: interface energy residual {work.residual_joule:.3g} J is "
                f"{100.0 * work.residual_ratio:.3g} % of {work.absolute_work_joule:.3g} J interface work, "
                f"above coupling.residual_bound {100.0 * self._bound:.3g} %. The exchange {does} energy: "
                "lower coupling.communication_step_ns to what `subsoil check` calls stable, or set "
                "coupling.force: predicted if the scene can have it"
            )


def account_of(
    scene: Scene,
    motions: tuple[ToolMotion, ...],
    wrenches: tuple[ToolWrench, ...],
    step_s: float,
    work: InterfaceWork | None = None,
    *,
    begun: bool = False,
) -> InterfaceAccount:
    """The interface account of a scene, from the initial exchange, or from a checkpoint of a run that has
    begun; step_s: of a tick.

    The bound applies where forces change the motion: not to tools on prescribed paths, nor to those that may
    leap, which follow a machine that waits for no force.
    """
    coupling = scene.coupling
    free = any(tool.inertia_kg_m2 is not None for tool in scene.tools.values())
    leaps = {name: step_s for name, tool in scene.tools.items() if tool.may_leap}
    bound = coupling.residual_bound if (scene.moved_by_participant and not leaps) or free else None
    predicted_s = step_s if scene.predicts_motion else None
    return InterfaceAccount(
        motions, wrenches, bound, coupling.residual_grace_joule, work, leaps, predicted_s, begun
    )
