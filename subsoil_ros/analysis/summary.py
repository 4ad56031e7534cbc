"""summary.json: the metrics of a run as a typed model, from which config/summary.schema.json is generated.

A field that has a default is left out of the file where the run has no such quantity.
"""

import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BeforeValidator, Field, WithJsonSchema
from pydantic_core import core_schema

from ..loading.scene_schema import SchemaWithUnits
from ..strict_model import StrictModel
from ..whole_files import write_whole
from ..yaml_document import Document
from .columns import DRAFT

SCHEMA_VERSION = 2
"""Version of config/summary.schema.json; raised when a quantity moves or changes its meaning."""


def _finite(value: object) -> object:
    return None if isinstance(value, float) and not math.isfinite(value) else value


Number = Annotated[int | float | None, BeforeValidator(_finite), WithJsonSchema({"type": ["number", "null"]})]
"""A number; None in place of one that is not finite, which JSON cannot represent."""

Verdict = Literal["drifts", "no drift seen", "too short"]


class Scene(StrictModel):
    """What was simulated."""

    name: str
    hash: str = Field(description="sha256 of the resolved scene with its meshes.")
    allow: list[str] = Field(description="Refusals that the scene overrides.")
    note: str = Field(description="A warning of the scene's own.")


class ResumedFrom(StrictModel):
    """The checkpoint that the run went on from."""

    checkpoint: str
    tick: int
    run_id: str


class NewestCheckpoint(StrictModel):
    """The newest checkpoint of the run."""

    path: str
    tick: int
    time_s: Number
    size_bytes: int
    write_s: Number


class KnownMean(StrictModel):
    """Of a scene with stop_when: what the last check found."""

    metric: str = Field(description="Column of series.csv.")
    relative_interval: float = Field(description="Asked for.")
    confidence: float = Field(description="Of the interval.")
    at_most_m: Number = Field(description="Travel after which the run ends in any case.")
    reached: bool = Field(description="Whether the mean is known as the scene asks.")
    mean: Number = Field(description="Null: too few values.")
    half_width: Number = Field(description="Of the interval of the mean.")
    verdict: Verdict = Field(description="On the trend.")
    travel_m: float = Field(description="Of the share tip up to the check.")


class Followed(StrictModel):
    """How the soil followed a machine that does not wait."""

    start_ns: int = Field(description="Stamp of the machine at the end of the first tick.")
    end_ns: int = Field(description="Stamp of the machine at the end of the run.")
    skipped_s: Number = Field(description="Time of the machine that the soil left out.")
    skips: int
    refused: dict[str, int] = Field(description="Poses that were not used, by cause.")
    leaps: int | None = Field(None, description="Of tools, which then entered the soil anew.")
    removed_particles: int | None = Field(None, description="Particles that these tools overlapped.")


class RunFacts(StrictModel):
    """Facts of a run that no bag holds; a later report copies them from the earlier summary."""

    mode: Literal["nodes", "composed", "direct"] | None = Field(
        None, description="Processes over DDS, the same nodes in one process, or no nodes."
    )
    threads: int | None = Field(None, description="Of the soil engine.")
    soil: str | None = Field(None, description="Name in the file that soil.material names.")
    whole_wall_s: Number = Field(None, description="With start-up and compilation.")
    stop_when: KnownMean | None = None
    followed: Followed | None = None
    versions: dict[str, str] | None = None
    resumed_from: ResumedFrom | None = None
    checkpoint: NewestCheckpoint | None = None
    state_sha256: dict[str, str] | None = Field(
        None, description="Digests of the full state at the end, by part."
    )
    failure: str | None = Field(None, description="Why the run ended early.")


class Run(RunFacts):
    """How it was run, and how it ended."""

    recorded: bool = Field(description="Whether there is a bag; without one only scene and run are here.")
    complete: bool = Field(
        description="Whether the last tick was reached, or that with which stop_when ended the run."
    )


class _Identified(StrictModel):
    id: str


class RecordedRun(Run, _Identified):
    """How it was run, and how it ended."""

    simulated_s: float
    ticks: int
    steps: int = Field(description="Of the soil, or of the mechanism without soil.")
    wall_s: float = Field(description="Of the ticks alone.")
    real_time_factor: float = Field(description="Simulated time over wall_s.")


class LostParticle(StrictModel):
    """A particle that left the domain."""

    identity: int = Field(description="Number in the bed.")
    position_m: list[float] = Field(description="Where it was first seen outside.")
    time_s: float = Field(description="When it was first seen outside.")


class Particles(StrictModel):
    """The particles of the soil."""

    count: int = Field(description="At the end; 0 without particles.")
    lost_count: int = Field(description="Left the domain.")
    first_lost_s: Number
    first_lost: list[LostParticle] = Field(description="The first three of them.")


class Energy(StrictModel):
    """Account of the interface between mechanism and soil."""

    residual_joule: Number = Field(description="Interface work, mechanism minus soil, at the end.")
    residual_ratio: Number = Field(description="Its magnitude over the absolute work.")


class MetricsWindow(StrictModel):
    """The metrics window, rows of series.csv."""

    rule: str
    whole_run: bool = Field(description="No row follows the rule, so all count.")
    start_s: Number
    end_s: Number
    rows: int


class Statistics(StrictModel):
    """Over the metrics window."""

    mean: Number
    min: Number
    max: Number


class Extremes(StrictModel):
    """Extremes of the centred 10 ms moving mean."""

    min: Number
    max: Number
    range: Number


class RunColumn(Statistics):
    """The same over the whole run."""

    std: Number
    moving_10ms: Extremes | None = None


class StationarityMetrics(StrictModel):
    """Mean and trend over the metrics window; half-widths are of 95 % intervals."""

    mean_half_width: Number = Field(description="Of the mean of correlated samples.")
    correlation_s: Number = Field(description="Integrated autocorrelation time.")
    effective_count: Number = Field(description="Independent samples.")
    slope_per_s: Number = Field(description="Of the trend; the unit of the column is a factor of it.")
    slope_half_width_per_s: Number
    drift: Number = Field(description="Trend over the window relative to the mean.")
    drift_half_width: Number
    deviation: Number = Field(description="Standard deviation about the trend.")
    deviation_half_width: Number
    verdict: Verdict
    block_means: list[Number] = Field(description="Of four blocks.")


class SpectrumMetrics(StrictModel):
    """The strongest frequency over the metrics window."""

    dominant_hz: Number
    resolution_hz: Number
    degrees_of_freedom: Number
    significant: bool = Field(description="Stands out of red noise (95 % for all frequencies together).")


class Column(RunColumn):
    """Over the metrics window; draft, spring force, shank angle and height have the groups beside it."""

    run: RunColumn
    stationarity: StationarityMetrics | None = None
    spectrum: SpectrumMetrics | None = None


class Vertical(StrictModel):
    """What carries the machine, up positive: the weight is the sum of the others."""

    share_newton: Statistics | None = Field(None, description="Soil on tillage tools.")
    wheels_newton: Statistics | None = None
    hitch_newton: Statistics | None = Field(None, description="Joints and drivers to the ground.")
    tethers_newton: Statistics | None = Field(None, description="Springs to the ground.")
    loads_newton: Statistics | None = Field(None, description="Prescribed.")
    inertia_newton: Statistics | None = Field(None, description="Minus mass times acceleration.")
    weight_newton: Number = None
    rest_newton: Number = Field(None, description="Change of the soil's force over a tick.")


class Specific(StrictModel):
    """Draft per width of share and loosened section; work of the draft per distance and loosened volume."""

    share_width_m: Number = Field(None, description="Of the shares of all tillage tools together.")
    draft_newton_per_m: Number = None
    energy_joule_per_m: Number = Field(None, description="Where all tools travel alike.")
    energy_joule_per_m3: Number = None
    draft_pa: Number = None


class LoadCycleMetrics(StrictModel):
    """Load cycles of the spring (ASTM E1049)."""

    cycle_count: Number
    max_range_newton: Number
    equivalent_range_newton: Number = Field(
        description="Does the same damage once a second, Woehler exponent 5."
    )


class Extrapolated(StrictModel):
    """A quantity that left the range in which a wedge model was fitted, and the part of the window."""

    least: Number
    largest: Number
    fitted_from: Number
    fitted_to: Number
    part: Number


class Loads(StrictModel):
    """Over the window."""

    vertical: Vertical
    power: dict[Annotated[str, Field(pattern="_watt$")], Statistics] = Field(
        description="draft_watt: draft times speed, on paths tool by tool; TOOL_watt: taken by the soil.",
        json_schema_extra={"additionalProperties": False},
    )
    tip_depth_m: Statistics | None = Field(None, description="Of the share's tip below z = 0.")
    specific: Specific
    past_dead_centre_s: Number = Field(
        None, description="When the soil folded the shank past the dead centre of its spring."
    )
    extrapolated: dict[str, dict[str, Extrapolated]] | None = Field(
        None, description="By tool and depth_m, speed_m_per_s or rake_rad: the force there is extrapolated."
    )
    rainflow: LoadCycleMetrics | None = None


class CycleTravel(StrictModel):
    """Travel of the tip [m]; half-width of a 95 % interval of the mean."""

    mean: Number
    half_width: Number
    deviation: Number


class CycleTime(StrictModel):
    """Time [s]."""

    mean: Number
    deviation: Number


class FailureCycleMetrics(StrictModel):
    """From failure to failure of the soil: peaks of the draft (20 ms mean) that stand out by threshold_newton
    or more."""

    count: int
    threshold_newton: Number
    travel_m: CycleTravel
    time_s: CycleTime
    loading_fraction: Number
    unloading_over_loading: Number


class DisturbanceMetrics(StrictModel):
    """What the tool did to the bed of particles."""

    slab_start_m: Number
    slab_end_m: Number
    moved_fraction: Number
    area_m2: Number
    surface_width_m: Number
    lift_max_m: Number
    lifted_area_m2: Number
    area_half_width_m2: Number = Field(
        None, description="95 % interval of the loosened section, from its slices along the slab."
    )
    tip_speed_m_per_s: Number = None
    blade_speed_m_per_s: Number = None
    ahead_0_speed_m_per_s: Number = None
    aside_0_speed_m_per_s: Number = None
    ahead_1_speed_m_per_s: Number = None
    aside_1_speed_m_per_s: Number = None
    ahead_2_speed_m_per_s: Number = None
    aside_2_speed_m_per_s: Number = None
    ahead_3_speed_m_per_s: Number = None
    aside_3_speed_m_per_s: Number = None


class UnrecordedSummary(StrictModel):
    """Summary of a run without a bag."""

    schema_version: Literal[2] = Field(
        description="Of this schema; raised when a quantity moves or changes its meaning."
    )
    scene: Scene
    run: Run

    def document(self) -> Document:
        """Return the content of summary.json."""
        return self.model_dump(exclude_unset=True)

    def write(self, path: Path) -> None:
        """Write summary.json, whole or not at all; numbers with all their digits."""
        text = json.dumps(self.document(), indent=1, allow_nan=False)
        write_whole(path, lambda part: part.write_text(f"{text}\n", encoding="utf-8"))


class Summary(UnrecordedSummary):
    """Summary of a recorded run."""

    run: RecordedRun
    particles: Particles
    energy: Energy
    window: MetricsWindow
    series: dict[str, Column] = Field(description="Every column of series.csv but time_s, by its name.")
    loads: Loads
    failure_cycles: FailureCycleMetrics | None = None
    disturbance: DisturbanceMetrics | None = None


def run_facts(document: Document) -> Document:
    """Return the part of a summary's `run` that no bag holds.

    Raises:
        ValueError: it is no part of a summary.
    """
    run = document.get("run", {})
    facts = RunFacts.model_validate({key: run[key] for key in RunFacts.model_fields if key in run})
    return facts.model_dump(exclude_unset=True)


class _SummarySchema(SchemaWithUnits):
    """Generator for fields that are left out, not null, where there is no value."""

    def nullable_schema(self, schema: core_schema.NullableSchema) -> Document:
        return self.generate_inner(schema["schema"])

    def default_schema(self, schema: core_schema.WithDefaultSchema) -> Document:
        return self.generate_inner(schema["schema"])


def summary_schema() -> Document:
    """JSON Schema of summary.json, draft 2020-12."""
    whole = Summary.model_json_schema(schema_generator=_SummarySchema)
    other = UnrecordedSummary.model_json_schema(schema_generator=_SummarySchema)
    definitions = whole.pop("$defs") | other.pop("$defs") | {"Summary": whole, "UnrecordedSummary": other}
    recorded = {"required": ["recorded"], "properties": {"recorded": {"const": True}}}
    return {
        "$schema": SchemaWithUnits.schema_dialect,
        "title": "summary.json",
        "description": "Metrics of one run. The unit stands in a key, or in the name of the column above it; "
        "null is a number that is not finite. A path through it, keys joined by dots, names a quantity in "
        "reference files and in tables of sweeps.",
        "if": {"required": ["run"], "properties": {"run": recorded}},
        "then": {"$ref": "#/$defs/Summary"},
        "else": {"$ref": "#/$defs/UnrecordedSummary"},
        "$defs": dict(sorted(definitions.items())),
    }


def flattened(summary: Document) -> Document:
    """Return every value of a summary by its path, keys joined by dots: `series.draft_newton.run.max`."""
    return dict(_leaves(summary, ""))


def _leaves(group: Document, prefix: str) -> Iterator[tuple[str, object]]:
    for key, value in group.items():
        if isinstance(value, dict):
            yield from _leaves(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value


def path_of(column: str, *statistic: str) -> str:
    """Path of a statistic of a column of the series: path_of(DRAFT, "run", "max")."""
    return ".".join(("series", column, *statistic))


MEAN_DRAFT = path_of(DRAFT, "mean")


def short_name(path: str) -> str:
    """Return the last word of a dotted path; where that is `value`, the one before."""
    words = path.split(".")
    return words[-2] if words[-1] == "value" and len(words) > 1 else words[-1]
