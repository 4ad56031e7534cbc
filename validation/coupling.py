"""C1 to C6: the exchange between soil and machine, inside, near and beyond its limits."""

import math
import re
from dataclasses import dataclass, replace
from typing import Any

from subsoil_ros.api.run_frame import simulate
from subsoil_ros.coupling.run_settings import RunSettings
from subsoil_ros.dem.build import build_engine
from subsoil_ros.errors import RunError
from subsoil_ros.limits.communication_steps import DAMPER_SHARE, PREDICTED_SHARE, force_age_ticks
from subsoil_ros.loading.loader import ResolvedScene
from subsoil_ros.messages import CouplingReport, MechanismState, ToolMotion, ToolMotions, ToolWrench

from .cases import RIGHT, STOPPED, Cases, Outcome, WrongEndError, must, right
from .laboratory import Document, Laboratory

CASES = Cases()

CAUSES = "residual|overlaps a particle|not finite|moves at up to"
"""What an exchange beyond its limits may be stopped by."""

SMALL_RESIDUAL = 0.02
"""Of the interface over its work: the default bound of scenes."""

SOFT, STIFF = 1e4, 1e7  # N/m, of the soil under the block
RADIUS, PRESSED, LIFTED = 0.05, 1e-3, 1e-4
HALF_HEIGHT = 0.03125
REST_M = -0.25 + RADIUS + HALF_HEIGHT - PRESSED
"""z of a block that rests on the sphere under its load [m]."""


@dataclass(frozen=True)
class Press:
    """A block on a rail, under a load of k x 1 mm, let go 0.1 mm above its rest on a sphere that stays."""

    mass: float
    damping: float
    interval_s: float
    soil_steps: int = 1
    force: str = "tick_end"
    stiffness: float = SOFT

    @property
    def limits(self) -> tuple[float, float]:
        """Smallest and largest damper of a stable exchange [N s/m] (docs/coupling.md)."""
        unit = self.mass / self.interval_s
        if self.force == "predicted":
            reach = self.stiffness * self.interval_s / unit
            return reach**2 * unit / 3.0, PREDICTED_SHARE * unit
        age_s = force_age_ticks(self.force, self.soil_steps) * self.interval_s
        return age_s * self.stiffness, DAMPER_SHARE * unit

    @property
    def settling_ticks(self) -> int:
        """Until 0.1 mm has become 0.1 um, by the slower of the two rates of a damped mass on a spring; of the
        damper only what the age of the force leaves."""
        left = self.damping - self.limits[0]
        slow = min(0.5 * left / self.mass, self.stiffness / self.damping)
        return math.ceil(10.0 / (slow * self.interval_s)) + 100


class _PressedSoil:
    """The soil engine with one sphere; the block is set onto it, where a start would remove the sphere."""

    def __init__(self, resolved: ResolvedScene) -> None:
        self._engine = build_engine(resolved)
        self._engine.place([[0.25, 0.0, -0.25]])  # type: ignore[arg-type]

    def start(self, motions: tuple[ToolMotion, ...]) -> tuple[ToolWrench, ...]:
        (motion,) = motions
        self._engine.start((replace(motion, z_m=motion.z_m + 2.0 * PRESSED),))
        self._engine.advance(0, motions)
        return self._engine.advance(1, motions)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._engine, name)


class _Kept(list[Any]):
    """A sink that keeps the records of some kinds."""

    def __init__(self, *kinds: type) -> None:
        super().__init__()
        self._kinds = kinds

    def write(self, record: Any) -> None:
        if isinstance(record, self._kinds):
            self.append(record)


def pressed(laboratory: Laboratory, case: Press, ticks: int) -> tuple[float, float]:
    """Runs it; distance from rest at the end [m], and the residual over the work."""
    row = {
        "stiffness_newton_per_m": case.stiffness, "damping_newton_s_per_m": case.damping,
        "tangential_stiffness_newton_per_m": 0.0, "tangential_damping_newton_s_per_m": 0.0,
        "static_friction": 0.0, "sliding_friction": 0.0,
    }  # fmt: skip
    point = [0.25, REST_M + LIFTED]
    load = {"kind": "constant", "value": -case.stiffness * PRESSED}
    communication_step_ns = round(case.interval_s * 1e9 / case.soil_steps) * case.soil_steps
    mesh = {"mesh": laboratory.box(0.125, 0.125, 2.0 * HALF_HEIGHT), "position_m": [0.25, 0.0, point[1]]}
    resolved = laboratory.resolve(
        {
            "name": "press", "duration_s": ticks * communication_step_ns * 1e-9, "gravity_m_per_s2": 0.0,
            "soil": {
                "bin": {"length_m": 0.5, "width_m": 0.5, "depth_m": 0.5},
                "particles": {"radius_m": RADIUS, "density_kg_per_m3": 1e20},
                "bed": {"kind": "grid", "spacing_m": 0.1},
                "law": {"kind": "linear", "particle": row, "boundary": row},
                "time_step_s": communication_step_ns * 1e-9 / case.soil_steps,
            },
            "mechanism": {
                "bodies": {"block": {"mass_kg": case.mass, "inertia_kg_m2": case.mass, "position_m": point}},
                "joints": {
                    "rail": {
                        "kind": "prismatic", "body_a": "ground", "body_b": "block", "point_m": point,
                        "axis": [0, 1],
                    },
                },
                "forces": {
                    "load": {
                        "kind": "point_load", "body": "block", "point_m": point, "force_z_newton": load,
                    },
                },
            },
            "tools": {"block": {"body": "block", "groups": {"all": mesh}}},
            "coupling": {"communication_step_ns": communication_step_ns, "force": case.force},
        }
    )  # fmt: skip
    kept = _Kept(ToolMotions, CouplingReport)
    simulate(RunSettings(resolved), soil=_PressedSoil(resolved), sink=kept)
    last = [next(record for record in reversed(kept) if isinstance(record, kind))
            for kind in (ToolMotions, CouplingReport)]  # fmt: skip
    return abs(last[0].tools[0].z_m - REST_M), last[1].residual_ratio


def comes_to_rest(laboratory: Laboratory, case: Press) -> tuple[float, float]:
    """The block must end within a hundredth of the way that it was lifted; what is left, and the residual."""
    low, high = case.limits
    must(low < case.damping < high, f"{case}: damper outside {low} to {high}")
    left, residual = pressed(laboratory, case, case.settling_ticks)
    must(left < 0.01 * LIFTED, f"{case}: {left} m from rest after {case.settling_ticks} ticks")
    return left / LIFTED, residual


def inside(case: Press) -> Press:
    """The case with a damper in the middle of its limits."""
    low, high = case.limits
    if case.force == "predicted":  # without a lower limit at short intervals
        low = 0.5 * case.stiffness * case.interval_s
    return replace(case, damping=math.sqrt(low * high))


def interval(mass: float, stiffness: float = SOFT) -> float:
    """One at which k H^2 / m is 0.1."""
    return math.sqrt(0.1 * mass / stiffness)


FORCES = ("tick_end", "tick_mean", "predicted")


def words_of(found: dict[str, tuple[float, float]]) -> Outcome:
    """What is left and the residual, case by case."""
    cells = (f"{name}: {left:.1g}, {100.0 * residual:.2g} %" for name, (left, residual) in found.items())
    return right(f"part of the first distance left, residual; {'; '.join(cells)}")


@CASES.add("C1", RIGHT)
def inside_the_limits(laboratory: Laboratory) -> Outcome:
    """1 kg, interval of 1, 10 and 100 soil steps of 32 us, every force, damper inside the limits."""
    found = {}
    for force in FORCES:
        residuals = []
        for steps in (1, 10, 100):
            case = inside(Press(1.0, 0.0, interval(1.0) * steps / 100, steps, force))
            name = f"{force} {steps}"
            found[name] = comes_to_rest(laboratory, case)
            residuals.append(found[name][1])
        must(residuals == sorted(residuals), f"{force}: residuals {residuals} do not grow with H")
        must(residuals[0] < SMALL_RESIDUAL, f"{force}: residual {residuals[0]} at one step")
    return words_of(found)


@CASES.add("C1", RIGHT, long=True)
def inside_the_limits_of_long_intervals(laboratory: Laboratory) -> Outcome:
    """1 kg, interval of 1000 soil steps, every force, damper inside the limits."""
    found = {}
    for force in FORCES:
        case = inside(Press(1.0, 0.0, interval(1.0), 1000, force))
        found[force] = comes_to_rest(laboratory, case)
    return words_of(found)


@CASES.add("C1", RIGHT)
def near_the_limits(laboratory: Laboratory) -> Outcome:
    """1 kg, interval of 1 soil step, every force, damper a fifth inside each of its limits."""
    found = {}
    for force in FORCES:
        case = Press(1.0, 0.0, interval(1.0), 1, force)
        low, high = case.limits
        for damping in (1.2 * low, 0.8 * high):
            found[f"{force}, {damping:.3g} N s/m"] = comes_to_rest(laboratory, replace(case, damping=damping))
    return words_of(found)


def must_stop(laboratory: Laboratory, case: Press, ticks: int) -> str:
    """The run must be stopped by the residual or by the tool's overlap."""
    try:
        left, _ = pressed(laboratory, case, ticks)
    except RunError as error:
        return cause(error).split(";")[0].split(", above")[0]
    raise WrongEndError(f"{case}: went on for {ticks} ticks, {left} m from rest")


def cause(error: RunError) -> str:
    """Why the run was stopped, if it is one of CAUSES."""
    must(re.search(CAUSES, str(error)), f"stopped with another cause: {error}")
    return str(error)


@CASES.add("C2", STOPPED)
def outside_the_limits(laboratory: Laboratory) -> Outcome:
    """1 kg, damper outside the limits: no damper at all, and twice the largest."""
    found = []
    case = Press(1.0, 0.0, interval(1.0))
    for damping in (0.0, 2.0 * case.limits[1]):
        words = must_stop(laboratory, replace(case, damping=damping), 4000)
        found.append(f"{damping:.3g} N s/m: {words}")
    return Outcome(STOPPED, "; ".join(found))


@CASES.add("C3", RIGHT)
def masses(laboratory: Laboratory) -> Outcome:
    """1 g to 100 t on soil of 1e4 and 1e7 N/m, k H^2 / m of 0.001 and 0.1, damper inside the limits."""
    found = {}
    for mass in (1e-3, 1.0, 1e3, 1e5):
        for stiffness in (SOFT, STIFF):
            for part in (0.1, 1.0):
                case = inside(Press(mass, 0.0, part * interval(mass, stiffness), stiffness=stiffness))
                name = f"{mass:g} kg on {stiffness:g} N/m, {1e3 * case.interval_s:.3g} ms"
                found[name] = comes_to_rest(laboratory, case)
    return words_of(found)


@CASES.add("C4", STOPPED)
def light_tool_or_stiff_soil(laboratory: Laboratory) -> Outcome:
    """At an interval and a damper that are right for 1 kg on 1e4 N/m: 1 g, soil of 1e7 N/m, and both."""
    case = inside(Press(1.0, 0.0, interval(1.0)))
    found = []
    for mass, stiffness in ((1e-3, SOFT), (1.0, STIFF), (1e-3, STIFF)):
        words = must_stop(laboratory, replace(case, mass=mass, stiffness=stiffness), 4000)
        found.append(f"{mass:g} kg on {stiffness:g} N/m: {words}")
    return Outcome(STOPPED, "; ".join(found))


def block_machine(mesh: str) -> Document:
    """A block of 6 kg on a spring behind a driven trolley, dragged through the upper 60 mm of a bed."""
    return {
        "mechanism": {
            "bodies": {
                "trolley": {"mass_kg": 20.0, "inertia_kg_m2": 1.0, "position_m": [0.3, 0.2]},
                "block": {"mass_kg": 6.0, "inertia_kg_m2": 0.05, "position_m": [0.05, -0.03]},
            },
            "joints": {
                "rail": {
                    "kind": "prismatic", "body_a": "ground", "body_b": "trolley", "point_m": [0.3, 0.2],
                    "axis": [1, 0],
                },
                "drive": {
                    "kind": "driver", "body": "trolley", "coordinate": "x",
                    "speed": {"kind": "constant", "value": 0.4},
                },
                "hinge": {"kind": "revolute", "body_a": "trolley", "body_b": "block", "point_m": [0.05, 0.2]},
            },
            "forces": {
                "spring": {
                    "kind": "spring_damper", "body_a": "trolley", "point_a_m": [0.3, 0.05], "body_b": "block",
                    "point_b_m": [0.05, 0.05], "stiffness_newton_per_m": 4000.0,
                    "damping_newton_s_per_m": 20.0, "free_length_m": 0.25,
                },
            },
            "draft_driver": "drive",
        },
        "tools": {
            "block": {"body": "block", "groups": {"body": {"mesh": mesh, "position_m": [0.05, 0.0, -0.03]}}},
        },
    }  # fmt: skip


def dragged(laboratory: Laboratory, steps: int, force: str) -> tuple[float, float]:
    """Mean draft of the last 0.2 s [N] and residual of the whole, exchanging every `steps` soil steps."""
    plain = laboratory.soil(
        size_m=(0.4, 0.12, 0.1), bed={"kind": "grid", "spacing_m": "rest", "jitter_m": 3e-4}
    )
    communication_step_ns = 40_000 * steps
    document = {
        **plain.document, **block_machine(laboratory.box(0.03, 0.05, 0.06)), "duration_s": 0.4,
        "coupling": {
            "communication_step_ns": communication_step_ns,
            "force": force,
            "mechanism_steps": min(steps, 100),
        },
        "record": {"series_ticks": max(1, 20 // steps), "cloud_hz": 0.0},
    }  # fmt: skip
    document["soil"]["time_step_s"] = 4e-5
    resolved = laboratory.resolve(document)
    kept = _Kept(MechanismState, CouplingReport)
    simulate(RunSettings(resolved), sink=kept)
    drafts = [record.draft_newton for record in kept if isinstance(record, MechanismState)]
    residual = [record for record in kept if isinstance(record, CouplingReport)][-1].residual_ratio
    return sum(drafts[len(drafts) // 2 :]) / (len(drafts) - len(drafts) // 2), residual


def exchanged(laboratory: Laboratory, steps: int, force: str, reference: float) -> tuple[str, bool]:
    """Draft against the reference and residual, or the cause of the stop; and whether it was stopped."""
    try:
        draft, residual = dragged(laboratory, steps, force)
    except RunError as error:
        return cause(error).split(". ")[0], True
    must(residual < 0.02, f"{steps} {force}: residual {residual}, not stopped")
    must(
        abs(draft / reference - 1.0) < 0.05,
        f"{steps} {force}: draft {draft} N, {reference} N with 1",
    )
    return f"{draft:.1f} N, residual {100.0 * residual:.2g} %", False


@CASES.add("C5", RIGHT, STOPPED)
def machine_intervals(laboratory: Laboratory) -> Outcome:
    """A block dragged through the bed, exchange every 1, 10 and 100 soil steps."""
    reference, residual = dragged(laboratory, 1, "tick_end")
    found = [f"1: {reference:.1f} N, residual {100.0 * residual:.2g} %"]
    for steps, force in ((10, "tick_end"), (10, "tick_mean"), (100, "tick_mean"), (100, "predicted")):
        words, was_stopped = exchanged(laboratory, steps, force, reference)
        goes_on = (steps, force) == (10, "tick_end")
        must(not (goes_on and was_stopped), f"{steps} {force}: stopped: {words}")
        found.append(f"{steps} {force}: {words}")
    return right("; ".join(found))


@CASES.add("C6", STOPPED)
def machine_at_a_thousand_steps(laboratory: Laboratory) -> Outcome:
    """The same, exchange every 1000 steps (40 ms)."""
    words, was_stopped = exchanged(laboratory, 1000, "tick_end", math.nan)
    must(was_stopped, f"went on: {words}")
    return Outcome(STOPPED, words)
