"""The scene: one frozen tree of everything a run needs."""

from typing import Annotated, Literal

from pydantic import Discriminator, Field, Tag, model_validator

from ..strict_model import Finite, Name, NonNegative, Positive, StrictModel, WithinReach
from ..ticks import LONGEST_S, NANOSECONDS_PER_SECOND
from .controller import Controller, DraftLimit, External
from .mechanism import Driver, Mechanism, WheelContact
from .record import Record
from .soil import Auto, Soil
from .terrain_soil import TerrainSoil
from .time_laws import ConstantLaw
from .tools import LARGEST_SETBACK, Tool
from .wedge_soil import ExternalSoil, WedgeSoil


def _soil_model(soil: object) -> object:
    """Name of the soil model of a description; `dem` if it has no `model`."""
    return soil.get("model", "dem") if isinstance(soil, dict) else getattr(soil, "model", "dem")


AnySoil = Annotated[
    Annotated[Soil, Tag("dem")]
    | Annotated[WedgeSoil, Tag("wedge")]
    | Annotated[TerrainSoil, Tag("terrain")]
    | Annotated[ExternalSoil, Tag("external")],
    Discriminator(_soil_model),
]


class Coupling(StrictModel):
    """Exchange between soil and mechanism."""

    communication_step_ns: (
        Annotated[int, Field(gt=0, le=LONGEST_S * NANOSECONDS_PER_SECOND)] | Auto | Literal["soil_step"]
    ) = Field(
        "auto",
        description="between two exchanges. auto: with particles one soil step, as soil_step; with "
        "soil.material and a mechanism as many as leave a fifth of the contact damping; with "
        "the wedge model 2 ms, or 1 ms with a controller or a held force; without soil 0.5 ms.",
    )
    mechanism_steps: int = Field(1, ge=1, le=1000, description="steps of the mechanism per exchange.")
    force: Auto | Literal["predicted", "tick_mean", "tick_end"] = Field(
        "auto",
        description="by which the mechanism moves. predicted: the mean over the same tick, of a soil that "
        "answers to the motion that constant velocities give; tick_mean, tick_end: that of the tick before, "
        "its mean, or that of its last soil step. auto: predicted for a mechanism with particles or "
        "the wedge model, otherwise tick_end.",
    )
    grant_window: int = Field(32, ge=1, le=64, description="ticks the coupler grants ahead.")
    residual_bound: Positive = Field(
        0.02, description="energy residual over the interface work, beyond which the run stops."
    )
    residual_grace_joule: NonNegative = Field(
        1.0, description="the bound is not applied to less work than this."
    )


class Report(StrictModel):
    """Parts of the machine that summary and figures refer to, and where metrics are taken."""

    shank: str | None = Field(None, description="body whose angle and height are shown.")
    spring: str | None = Field(None, description="force element whose load is shown.")
    tip_m: tuple[Finite, Finite] | None = Field(
        None, description="(x, z) of the share tip in the reference pose."
    )
    window_inside_m: NonNegative = Field(
        0.3, description="metrics are taken while all tips are this far inside both ends of the bin."
    )
    settle_s: NonNegative = Field(0.0, description="metrics start after this.")
    reference: str | None = Field(
        None,
        description="reference file, or name of a shipped one, whose values a report shows too.",
    )
    note: str = Field("", description="a warning that is copied into the summary.")


StopMetric = Literal["draft_newton", "draft.share_newton"]
"""Columns of series.csv that follow from the forces on the tools alone."""


class StopWhen(StrictModel):
    """The run ends when the interval of the mean of `metric` is narrow enough, or after `at_most_m`."""

    metric: StopMetric = Field(
        "draft_newton",
        description="column of series.csv; with mechanism.draft_driver draft.share_newton.",
    )
    relative_interval: Annotated[float, Field(gt=0.0, lt=1.0)] = Field(
        description="half-width of the interval, relative to the mean."
    )
    confidence: Annotated[float, Field(gt=0.5, lt=1.0)] = Field(0.95, description="of the interval.")
    at_most_m: Positive | None = Field(
        None, description="travel of the tool after which the run ends in any case."
    )


Allowance = Literal["unstable_time_step", "other_contact_law", "beyond_fitted_range"]
"""A refusal that a scene may override, for studies: `soil.time_step_s` above its stable limit, a `soil.file`
fitted to other particles than those of `soil.fitted_to`, work beyond 1.2 times the range of `soil.file`."""


class Scene(StrictModel):
    """A scene needs `soil`, `mechanism`, or both."""

    name: str = Field(min_length=1, description="of the scene, in results.")
    description: str = Field("", description="free text.")
    duration_s: Annotated[float, Field(gt=0.0, le=LONGEST_S, allow_inf_nan=False), WithinReach] = Field(
        description="simulated time."
    )
    travel_m: Positive | None = Field(
        None, exclude=True, description="in short, for duration_s: way of the tools at their speed_m_per_s."
    )
    gravity_m_per_s2: NonNegative = Field(9.81, description="downwards, along -z.")
    allow: tuple[Allowance, ...] = Field((), description="refusals that this scene overrides, for studies.")
    soil: AnySoil | None = Field(None, description="left out: no soil engine.")
    mechanism: Mechanism | None = Field(None, description="left out: every tool follows its `path`.")
    tools: dict[Name, Tool] = Field({}, description="need `soil`.")
    controller: Controller | None = Field(None, description="commands one driver during the run.")
    coupling: Coupling = Field(Coupling(), description="of soil and mechanism.")
    record: Record = Field(Record(), description="what the bag has, and how often.")
    report: Report = Field(Report(), description="what summary and figures refer to.")
    stop_when: StopWhen | None = Field(None, description="ends the run once its mean draft is known.")

    @property
    def particle_soil(self) -> Soil | None:
        """The soil if it is made of particles."""
        return self.soil if isinstance(self.soil, Soil) else None

    @property
    def wedge_soil(self) -> WedgeSoil | None:
        """The soil if it is a wedge model, without particles."""
        return self.soil if isinstance(self.soil, WedgeSoil) else None

    @property
    def terrain_soil(self) -> TerrainSoil | None:
        """The soil if it is a height field."""
        return self.soil if isinstance(self.soil, TerrainSoil) else None

    @property
    def checkpoint_s(self) -> float:
        """Simulated time between checkpoints; 0: none. Each default takes some seconds of wall time or more,
        against the milliseconds in which a checkpoint is written."""
        if self.record.checkpoint_s is not None:
            return self.record.checkpoint_s
        return 0.5 if self.particle_soil is not None else 10.0

    @property
    def has_clouds(self) -> bool:
        """Whether the soil is shown by points."""
        return self.particle_soil is not None or self.terrain_soil is not None

    @property
    def external_soil(self) -> bool:
        """Whether another program answers the motions."""
        return isinstance(self.soil, ExternalSoil)

    @property
    def external_machine(self) -> bool:
        """Whether another program moves the tools."""
        return any(tool.path is not None and tool.path.external for tool in self.tools.values())

    @property
    def may_leap(self) -> bool:
        """Whether a tool that leaps enters the soil anew."""
        return any(tool.may_leap for tool in self.tools.values())

    @property
    def moved_by_participant(self) -> bool:
        """Whether a participant of its own moves the tools, a mechanism or an external machine."""
        return self.mechanism is not None or self.external_machine

    @property
    def exchanged_force(self) -> Literal["predicted", "tick_mean", "tick_end"]:
        """`coupling.force`, whose `auto` follows from mechanism and soil."""
        if self.coupling.force != "auto":
            return self.coupling.force
        return "predicted" if self._can_predict else "tick_end"

    @property
    def _can_predict(self) -> bool:
        soil = self.particle_soil or self.wedge_soil
        return self.mechanism is not None and soil is not None

    @property
    def predicts_motion(self) -> bool:
        """Whether a tick's motions are a prediction, which the mechanism corrects by the tick's wrenches."""
        return self.exchanged_force == "predicted"

    @model_validator(mode="after")
    def _consistent(self) -> "Scene":
        if self.soil is None and self.mechanism is None:
            raise ValueError("give 'soil', 'mechanism' or both: there is nothing to simulate")
        _check_allow(self)
        if self.predicts_motion and not self._can_predict:
            raise ValueError(
                "coupling.force: given 'predicted', which takes a mechanism, and particles or the wedge "
                "model; leave it out"
            )
        if self.soil is None and self.tools:
            raise ValueError("tools: given without 'soil'; tools act on soil only")
        bodies = self.mechanism.bodies if self.mechanism else {}
        carried = set()
        for name, tool in self.tools.items():
            if tool.body is None:
                continue
            if tool.body not in bodies:
                raise ValueError(
                    f"tools.{name}.body: no body '{tool.body}'; bodies are {', '.join(bodies) or 'none'}"
                )
            if tool.body in carried:
                raise ValueError(f"tools.{name}.body: '{tool.body}' already carries a tool; use groups")
            carried.add(tool.body)
        if self.mechanism and self.tools and any(t.body is None for t in self.tools.values()):
            raise ValueError("tools: with a mechanism every tool needs a 'body'")
        if self.terrain_soil is not None and self.gravity_m_per_s2 == 0.0:
            raise ValueError("gravity_m_per_s2: given 0, and a terrain is held by its weight; give more")
        _check_external(self)
        _check_spatial(self)
        _check_setback(self)
        for name, force in (self.mechanism.forces if self.mechanism else {}).items():
            if isinstance(force, WheelContact) and force.body in carried:
                raise ValueError(
                    f"mechanism.forces.{name}: body '{force.body}' touches the soil twice, as a tool "
                    "and through wheel_contact; keep one of them"
                )
        if self.controller is not None:
            _check_controller(self.controller, self.mechanism, self.record.series_ticks)
        if self.stop_when is not None:
            _check_stop_when(self, self.stop_when)
        report = self.report
        if report.shank is not None and report.shank not in bodies:
            raise ValueError(f"report.shank: no body '{report.shank}'")
        forces = self.mechanism.forces if self.mechanism else {}
        if report.spring is not None and report.spring not in forces:
            raise ValueError(f"report.spring: no force '{report.spring}'")
        return self


def _check_allow(scene: Scene) -> None:
    """Raises ValueError for an entry of `allow` that cannot apply to the scene."""
    soil, wedge = scene.particle_soil, scene.wedge_soil
    stepped = soil is not None and soil.time_step_s != "auto"
    fitted = wedge is not None and wedge.file is not None
    for name in scene.allow:
        step = name == "unstable_time_step"
        if not (stepped if step else fitted):
            needed = "a number in soil.time_step_s" if step else "a soil.file of a wedge model"
            raise ValueError(f"allow: '{name}' is about {needed}, and there is none; remove it from the list")


def _check_external(scene: Scene) -> None:
    """Raises ValueError where only some of the tools have an external machine."""
    own = [name for name, tool in scene.tools.items() if tool.path is None or not tool.path.external]
    if scene.external_machine and own:
        raise ValueError(
            f"tools: {', '.join(own)} without path.external: true, which others have; one machine moves all "
            "tools of a scene"
        )
    soil = scene.particle_soil
    if scene.may_leap and soil is not None and soil.engine == "lammps":
        raise ValueError("tools.*.path.may_leap: is not there with soil.engine 'lammps'; use 'own'")


def _check_spatial(scene: Scene) -> None:
    """Raises ValueError for a path in space that this scene's soil cannot follow, or that ends too early."""
    for name, tool in scene.tools.items():
        if not tool.is_spatial:
            continue
        assert tool.path is not None
        where, poses = f"tools.{name}.path", tool.path.poses
        if poses is not None and poses.times_s[-1] < scene.duration_s:
            raise ValueError(
                f"{where}.poses.times_s: ends at {poses.times_s[-1]:g} s, before duration_s "
                f"{scene.duration_s:g}; give poses up to the end"
            )
        if poses is not None and tool.lateral_m != 0.0:
            raise ValueError(
                f"tools.{name}.lateral_m: given {tool.lateral_m:g} with path.poses, which have a y of their "
                "own; leave it out"
            )
        turned = tool.path.turn is not None and tool.path.turn.axis is not None
        if scene.wedge_soil is not None and (turned or not tool.is_tillage):
            found = "turn.axis: turns the tool" if turned else "role 'wheel' with a path in space"
            raise ValueError(
                f"{where}: {found}, and soil.model 'wedge' has theory for plates with a level edge only; use "
                "soil.model: dem, or leave it out"
            )


def _check_setback(scene: Scene) -> None:
    """Raises ValueError for a setback that particles cannot have, or without particles."""
    soil = scene.particle_soil
    allowed_m = LARGEST_SETBACK * soil.particles.bounds_m[0] if soil is not None else 0.0
    for name, tool in scene.tools.items():
        if soil is None and tool.setback_m > 0.0:
            raise ValueError(
                f"tools.{name}.setback_m: given without particles, which alone need it; leave it out"
            )
        if tool.setback_m > allowed_m:
            raise ValueError(
                f"tools.{name}.setback_m: given {tool.setback_m:g}; it must be at most {allowed_m:g}, "
                f"{LARGEST_SETBACK:g} of the radius of the smallest particle"
            )


def _check_stop_when(scene: Scene, stop_when: StopWhen) -> None:
    """Raises ValueError where a scene cannot end by the mean of `stop_when`."""
    if scene.soil is None:
        raise ValueError("stop_when: given without 'soil'; it is about the soil's forces on the tools")
    if not any(tool.is_tillage for tool in scene.tools.values()):
        found = ", ".join(f"{name} ({tool.role})" for name, tool in scene.tools.items()) or "none"
        raise ValueError(f"stop_when: tools are {found}; one must be of role 'tillage'")
    driven = scene.mechanism is not None and scene.mechanism.draft_driver is not None
    if driven and stop_when.metric == "draft_newton":
        raise ValueError(
            "stop_when.metric: given 'draft_newton', which with mechanism.draft_driver is the force of a "
            "driver; give 'draft.share_newton', the draft of the tillage tools"
        )
    if scene.controller is not None:
        raise ValueError(
            "stop_when: given with 'controller', which is not supported; leave out one of them, and end a "
            "controlled run by duration_s"
        )
    if not scene.record.bag:
        raise ValueError(
            "stop_when: given with record.bag: false, which leaves no result to report; set record.bag: true"
        )


def _check_controller(controller: Controller, mechanism: Mechanism | None, series_ticks: int) -> None:
    joints = mechanism.joints if mechanism else {}
    drivers = {name: joint for name, joint in joints.items() if isinstance(joint, Driver)}
    driver = drivers.get(controller.driver)
    if mechanism is None or driver is None:
        raise ValueError(
            f"controller.driver: no driver '{controller.driver}'; drivers are {', '.join(drivers) or 'none'}"
        )
    if not isinstance(driver.speed, ConstantLaw):
        raise ValueError(
            f"mechanism.joints.{controller.driver}.speed: given a law of kind '{driver.speed.kind}', but the "
            "controller commands this driver; it must be 'constant', the speed at the start"
        )
    lowest, highest = controller.lowest_speed, controller.highest_speed
    if not lowest <= driver.speed.value <= highest:
        raise ValueError(
            f"mechanism.joints.{controller.driver}.speed.value: given {driver.speed.value:g}, outside of the "
            f"controller's speeds, {lowest:g} to {highest:g}"
        )
    if controller.interval_ticks % series_ticks:
        raise ValueError(
            f"controller.interval_ticks: given {controller.interval_ticks}, allowed are multiples of "
            f"record.series_ticks, {series_ticks}: a command answers a recorded state"
        )
    law = controller.law
    if driver.coordinate == "angle" and not isinstance(law, External):
        raise ValueError(
            f"controller.law: '{law.kind}' answers with a speed in m/s, but driver '{controller.driver}' is "
            "one of an angle; command a driver of x or z, or let a node send the commands (kind external)"
        )
    if isinstance(law, DraftLimit) and mechanism.draft_driver is None:
        raise ValueError("controller.law: 'draft_limit' needs mechanism.draft_driver")
