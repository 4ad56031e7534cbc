"""Soil: bin, particles, bed and contact law."""

from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field, model_validator

from ..contact_laws.base import ContactLaw, one_of_kinds
from ..contact_laws.registry import contact_laws
from ..strict_model import Positive, StrictModel
from .beds import Bed, DenseRandomBed, GridBed, SavedBed, SurfaceProfile, TiledBed
from .bin import Bin
from .bonds import Bonds
from .layers import Layer
from .monitors import Monitors
from .sizes import Sizes, mean_power
from .window import SoilWindow


class Particles(StrictModel):
    """Spheres: equal ones of `radius_m`, or of several `sizes`."""

    radius_m: Positive | None = Field(None, description="of equal spheres; or give sizes.")
    sizes: Sizes | None = Field(None, description="in place of radius_m; not for a grid.")
    density_kg_per_m3: Positive = Field(description="of a particle.")
    reference_radius_m: Positive | None = Field(
        None,
        description="radius at which the law was found; it is scaled from there.",
    )

    @model_validator(mode="after")
    def _one_form(self) -> "Particles":
        if (self.radius_m is None) == (self.sizes is None):
            given = "neither is given" if self.sizes is None else "both are given"
            raise ValueError(f"radius_m: {given}; give 'radius_m' for equal spheres or 'sizes' for several")
        return self

    @property
    def bounds_m(self) -> tuple[float, float]:
        """Smallest and largest radius."""
        if self.radius_m is not None:
            return self.radius_m, self.radius_m
        assert self.sizes is not None
        return self.sizes.bounds_m

    @property
    def mean_volume_radius_m(self) -> float:
        """Radius of the sphere of mean volume; that of every sphere where they are equal."""
        if self.radius_m is not None:
            return self.radius_m
        assert self.sizes is not None
        return float(mean_power(self.sizes, 3) ** (1.0 / 3.0))


if TYPE_CHECKING:
    SoilLaw = ContactLaw
else:
    SoilLaw = one_of_kinds(contact_laws().values())

Auto = Literal["auto"]


class Soil(StrictModel):
    """Soil of particles (discrete elements)."""

    model: Literal["dem"] = "dem"
    bin: Bin
    particles: Particles
    bed: Bed
    law: SoilLaw = Field(description="contact law.")
    bonds: Bonds | None = Field(None, description="cement that breaks for good; left out: none.")
    time_step_s: Annotated[Positive | Auto, Field(union_mode="left_to_right")] = Field(
        "auto", description="of the soil; auto: 0.6 of the stable limit. Above the limit it is refused."
    )
    precision: Literal["float64", "mixed"] = Field(
        "float64", description="mixed: all but positions and boundaries in float32."
    )
    device: Literal["cpu", "gpu"] = Field("cpu", description="gpu: an NVIDIA one, with subsoil_ros[gpu].")
    skin_m: Positive = Field(0.003, description="of the neighbour lists; results do not depend on it.")
    tool_stiffness_factor: Positive = Field(
        1.0, description="on the boundary's normal stiffness, at tools only."
    )
    max_tool_overlap_m: Positive | None = Field(
        None, description="the run stops beyond it; default: two radii of the sphere of mean volume."
    )
    window: SoilWindow | None = Field(
        None, description="soil exists near the tools only; left out: in the whole bin."
    )
    surface: SurfaceProfile | None = Field(None, description="height of the surface over x; trims the bed.")
    layers: tuple[Layer, ...] | None = Field(
        None, min_length=2, description="from top to bottom; by depth below z = 0."
    )
    monitors: Monitors | None = Field(Monitors(), description="the run stops beyond them; null: none.")
    max_lost_particles: Annotated[int, Field(ge=0)] | None = Field(
        None, description="that left the bin; the run stops beyond it; default: one in a thousand."
    )

    @model_validator(mode="after")
    def _bed_of_linear_springs(self) -> "Soil":
        if isinstance(self.bed, DenseRandomBed) and not self.law.linear_springs:
            linear = [f"'{kind}'" for kind, law in contact_laws().items() if law.linear_springs]
            raise ValueError(
                "bed.kind: 'dense_random' settles under linear springs and cannot be prepared under law "
                f"'{self.law.kind}'; use 'tiled' or 'grid', or law {' or '.join(linear)}"
            )
        return self

    @model_validator(mode="after")
    def _windowed_field(self) -> "Soil":
        """Check that a window has a tiled bed over a held floor, and held sides a window."""
        if self.window is None:
            if self.bin.sides == "held":
                raise ValueError("bin.sides: 'held' needs soil.window; use 'walls' or 'periodic', or add it")
            return self
        if not isinstance(self.bed, TiledBed) or self.bed.floor != "held":
            raise ValueError(
                f"window: is laid out from a tiled bed over a held floor, not from '{self.bed.kind}'"
                f"{', floor plane' if isinstance(self.bed, TiledBed) else ''}; use bed: {{kind: tiled}}"
            )
        for key in ("ahead_m", "behind_m"):
            if getattr(self.window, key) < self.bin.depth_m:
                raise ValueError(
                    f"window.{key}: {getattr(self.window, key):g} m is less than the bed is deep; allowed is "
                    f"at least {self.bin.depth_m:g} m, the rupture distance is longer still"
                )
        return self

    @model_validator(mode="after")
    def _bonds_within_lists(self) -> "Soil":
        """Check that bonded particles stay in the neighbour lists until their bond breaks."""
        if self.bonds is None:
            return self
        needed = (self.bonds.longest - 2.0) * self.particles.bounds_m[1]
        if needed > self.skin_m:
            raise ValueError(
                f"skin_m: {self.skin_m:g} m given; bonds reach over gaps of up to {needed:.3g} m before they "
                "break, and the skin must be as wide: make it so, or give bonds.gap_over_radius or "
                "bonds.tensile_strength_pa a smaller value"
            )
        return self

    @model_validator(mode="after")
    def _no_grid_of_sizes(self) -> "Soil":
        if isinstance(self.bed, GridBed) and self.particles.sizes is not None:
            raise ValueError(
                "bed.kind: 'grid' has one spacing, at which spheres of several sizes do not touch and would "
                "fall; use 'tiled' or 'dense_random', or particles.radius_m"
            )
        return self

    @model_validator(mode="after")
    def _layers_fill_the_bin(self) -> "Soil":
        """Check that names differ, and that layers but the last are thick enough and end above the floor."""
        above, seen = 0.0, set()
        for k, layer in enumerate(self.layers or ()):
            last = k == len(self.layers or ()) - 1
            where, thickness = f"layers.{k}", layer.thickness_m
            if layer.name in seen:
                raise ValueError(f"{where}.name: '{layer.name}' is the name of a layer above; give another")
            seen.add(layer.name)
            if layer.law is not None and layer.law.kind != self.law.kind:
                raise ValueError(
                    f"{where}.law.kind: '{layer.law.kind}' differs from soil.law.kind, '{self.law.kind}'; "
                    "all layers need the same"
                )
            if layer.law is not None and (refused := self.law.refused(layer.law)):
                raise ValueError(f"{where}.law.{refused}")
            if last and thickness is not None:
                raise ValueError(f"{where}.thickness_m: the last layer goes on to the floor; leave it out")
            if last:
                break
            if thickness is None:
                raise ValueError(f"{where}.thickness_m: is missing; every layer but the last needs it")
            smallest = 2.0 * self.particles.bounds_m[1]
            if thickness < smallest:
                raise ValueError(
                    f"{where}.thickness_m: {thickness:g} m is less than a particle; allowed is at least "
                    f"{smallest:g} m"
                )
            above += thickness
            if above >= self.bin.depth_m:
                raise ValueError(
                    f"{where}.thickness_m: the layers down to this one are {above:g} m thick and leave "
                    f"nothing to the next in a bed {self.bin.depth_m:g} m deep; make them thinner"
                )
        return self

    @model_validator(mode="after")
    def _rest_overlaps(self) -> "Soil":
        """Check that rest overlaps are below the smallest radius, and equal in all layers of a grid."""
        rows = [("law", *self.law.rest_overlaps_m())]
        for k, layer in enumerate(self.layers or ()):
            if layer.law is not None and layer.law.kind == self.law.kind:
                rows.append((f"layers.{k}.law", *self.law.changed_by(layer.law).rest_overlaps_m()))
        mean = self.particles.mean_volume_radius_m
        ratio = mean / (self.particles.reference_radius_m or mean)
        for where, particle, boundary in rows:
            for row, overlap in (("particle", particle), ("boundary", boundary)):
                if ratio * overlap >= self.particles.bounds_m[0]:
                    raise ValueError(
                        f"{where}.{row}.equilibrium_overlap_m: {ratio * overlap:g} m is not below the radius "
                        f"of the smallest particle, {self.particles.bounds_m[0]:g} m; make it smaller"
                    )
            if isinstance(self.bed, GridBed) and (particle, boundary) != rows[0][1:]:
                raise ValueError(
                    f"{where}: has another equilibrium_overlap_m than soil.law, but a grid has one spacing "
                    "and one distance to its walls; give all layers the same, or use bed.kind 'dense_random'"
                )
        return self

    @model_validator(mode="after")
    def _surface_above_floor(self) -> "Soil":
        if self.surface is None:
            return self
        if isinstance(self.bed, SavedBed):
            raise ValueError("surface: a saved bed has its surface already; leave out 'surface'")
        lowest = 2.0 * self.particles.bounds_m[1] - self.bin.depth_m
        if min(self.surface.z_m) < lowest:
            raise ValueError(
                f"surface.z_m: {min(self.surface.z_m):g} m leaves less than a particle on the floor of the "
                f"bin, {self.bin.depth_m:g} m deep; allowed is at least {lowest:g} m"
            )
        return self
