"""Soil of particles: bin, bed and contact law; layers, bonds, a window, monitors."""

import math
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import Field, model_validator

from ..contact_laws.base import ContactLaw, layer_law, one_of_kinds
from ..contact_laws.registry import contact_laws
from ..strict_model import Fraction, NonNegative, Positive, StrictModel
from .bed_kinds import Bed, DenseRandomBed, GridBed, SavedBed, SurfaceProfile, TiledBed
from .sizes import Particles


class Bin(StrictModel):
    """Open box: x in [0, length], y in [-width/2, width/2]; soil only, tools may cross it.

    z = 0 is the mean top of the prepared bed; the floor follows from the bed. Periodic sides: what leaves at
    y = width/2 comes in at -width/2, as if the bin were a slice of an endless one; tools keep off them, or go
    through both. Held: the outermost soil stays where it is, a diameter of the largest particles thick.
    With soil.window, the bin is the whole field, of which soil exists near the tools only.
    """

    length_m: Positive = Field(description="along x, the direction of travel.")
    width_m: Positive = Field(description="along y.")
    depth_m: Positive = Field(description="of the bed.")
    sides: Literal["walls", "periodic", "held"] = Field(
        "walls", description="at y = +-width/2; held: only with soil.window."
    )

    @property
    def bed_sides(self) -> Literal["walls", "periodic"]:
        """Of the bed: held soil stands before walls."""
        return "walls" if self.sides == "held" else self.sides


if TYPE_CHECKING:

    class LayerLaw(StrictModel):
        """What a layer changes of the law."""

        kind: str
        particle: StrictModel | None
        boundary: StrictModel | None
else:
    LayerLaw = one_of_kinds(map(layer_law, contact_laws().values()))


class Layer(StrictModel):
    """A layer of the bed. What it does not give comes from `soil.particles` and `soil.law`."""

    name: str = Field(min_length=1, description="different in every layer.")
    thickness_m: Positive | None = Field(
        None, description="the last layer, and only that one, goes on to the floor."
    )
    density_kg_per_m3: Positive | None = Field(None, description="of its particles.")
    law: LayerLaw | None = Field(None, description="values that differ from soil.law; the kind is the same.")


class Bonds(StrictModel):
    """Elastic beams between neighbours, made once where soil is laid out; one that breaks is gone for good.

    They act beside the contact law (D.O. Potyondy, P.A. Cundall, Int. J. Rock Mech. Min. Sci. 41 (2004)
    1329-1364). Moduli and strengths are those of the cement, so they hold for particles of every size.
    """

    youngs_modulus_pa: Positive = Field(
        description="normal stiffness of a bond: modulus over its length, times its section."
    )
    stiffness_ratio: Positive = Field(2.5, description="normal over shear stiffness.")
    tensile_strength_pa: Positive = Field(description="normal stress at which a bond breaks.")
    cohesion_pa: Positive = Field(description="shear strength without normal stress.")
    friction_angle_deg: Annotated[float, Field(ge=0.0, lt=90.0)] = Field(
        0.0, description="growth of the shear strength with pressure."
    )
    radius_over_particle: Fraction = Field(1.0, description="of a bond, over that of the smaller particle.")
    gap_over_radius: NonNegative = Field(
        0.05, description="neighbours farther apart, over the smaller radius, are not bonded."
    )
    damping_ratio: Annotated[float, Field(ge=0.0, lt=1.0)] = Field(
        0.1,
        description="part of critical damping of two equal particles; of turns, times radius_over_particle.",
    )

    @model_validator(mode="after")
    def _tension_within_the_line_of_coulomb(self) -> "Bonds":
        slope = math.tan(math.radians(self.friction_angle_deg))
        if self.tensile_strength_pa * slope > self.cohesion_pa:
            raise ValueError(
                f"tensile_strength_pa: given {self.tensile_strength_pa:g} Pa, allowed is up to cohesion_pa / "
                f"tan(friction_angle_deg) = {self.cohesion_pa / slope:.4g} Pa, where the shear strength ends"
            )
        return self

    @property
    def longest(self) -> float:
        """Distance of two bonded particles at most, over the radius of equal ones."""
        return (2.0 + self.gap_over_radius) * (1.0 + self.tensile_strength_pa / self.youngs_modulus_pa)


class SoilWindow(StrictModel):
    """Soil exists from `behind_m` behind the rearmost to `ahead_m` ahead of the foremost point of all tools.

    It is laid out and taken away in strips while the tools drive. A soil.material gives both: the rupture
    distance of a cut as deep as the bed.
    """

    ahead_m: Positive = Field(description="at least the depth of the bed.")
    behind_m: Positive = Field(description="at least the depth of the bed.")


def rupture_distance_m(depth_m: float, friction_angle_deg: float) -> float:
    """How far ahead of an upright cut the soil fails at the surface: Rankine's passive wedge."""
    return depth_m * math.tan(math.radians(45.0 + 0.5 * friction_angle_deg))


class Monitors(StrictModel):
    """Bounds that the soil is checked against every so many steps; null switches a bound off."""

    every_steps: Annotated[int, Field(ge=1)] = Field(100, description="soil steps between two checks.")
    max_velocity_reversal: Fraction | None = Field(
        0.2, description="1: every velocity reverses sign from one step to the next; the step is too large."
    )
    max_pair_overlap_radii: Positive | None = Field(
        1.9, description="of two particles; at tools: soil.max_tool_overlap_m."
    )
    max_energy_defect: Positive | None = Field(
        None,
        description="of the energy book, over the energy exchanged; left out: no book.",
    )


if TYPE_CHECKING:
    SoilLaw = ContactLaw
else:
    SoilLaw = one_of_kinds(contact_laws().values())

Auto = Literal["auto"]

_LAMMPS_LAWS = ("linear", "hertz_mindlin")


def _lone_damper(row: Any) -> str:
    """Key of a linear law that is 0 although there is a tangential damper; empty if there is none."""
    keys = ("damping_newton_s_per_m", "tangential_stiffness_newton_per_m")
    return next((key for key in keys if row.tangential_damping_newton_s_per_m and not getattr(row, key)), "")


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
    engine: Literal["own", "lammps"] = Field(
        "own", description="lammps: many ranks under MPI, with subsoil_ros[cluster] (docs/cluster.md)."
    )
    device: Literal["cpu", "gpu"] = Field("cpu", description="gpu: an NVIDIA one, with subsoil_ros[gpu].")
    skin_m: Positive = Field(0.003, description="of the neighbour lists; results do not depend on it.")
    tool_stiffness_factor: Positive = Field(
        1.0, description="on the boundary's normal stiffness, at tools only."
    )
    max_tool_overlap_m: Positive | None = Field(
        None,
        description="the run stops beyond it; default: two radii of the sphere of mean volume, less the "
        "setback.",
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

    @property
    def moving_window(self) -> SoilWindow | None:
        """The window, if it moves: LAMMPS gets the whole field at once."""
        return self.window if self.engine == "own" else None

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
    def _said_by_lammps(self) -> "Soil":
        """Check that LAMMPS can compute the soil (docs/cluster.md)."""
        if self.engine != "lammps":
            return self
        given = {
            "device": (self.device, "cpu"),
            "precision": (self.precision, "float64"),
            "bonds": (self.bonds and "bonds", None),
            "monitors.max_energy_defect": (self.monitors and self.monitors.max_energy_defect, None),
        }
        for key, (value, allowed) in given.items():
            if value != allowed:
                words = "none: leave it out" if allowed is None else f"'{allowed}'"
                raise ValueError(
                    f"{key}: given {value}; under engine 'lammps' allowed is {words}, or use 'own'"
                )
        laws = [one.law for one in self.layers or () if one.law is not None]
        for law in (self.law, *map(self.law.changed_by, laws)):
            self._refuse_law_not_in_lammps(law)
        return self

    def _refuse_law_not_in_lammps(self, law: Any) -> None:
        if law.kind not in _LAMMPS_LAWS:
            raise ValueError(
                f"law.kind: given '{law.kind}'; LAMMPS has {' and '.join(_LAMMPS_LAWS)}, and would need a "
                "style of its own for cohesion across a gap or plastic contacts; use one of these, or engine "
                "'own'"
            )
        for name in ("particle", "boundary"):
            row = getattr(law, name)
            if row.static_friction != row.sliding_friction:
                raise ValueError(
                    f"law.{name}.static_friction: given {row.static_friction:g} beside a sliding friction of "
                    f"{row.sliding_friction:g}; LAMMPS has one number for both: make them equal, or use "
                    "engine 'own'"
                )
            lone = "" if law.kind == "hertz_mindlin" else _lone_damper(row)
            if lone:
                raise ValueError(
                    f"law.{name}.tangential_damping_newton_s_per_m: given "
                    f"{row.tangential_damping_newton_s_per_m:g} beside a {lone} of 0, of which LAMMPS takes "
                    "it as a part: make it 0 too, or use engine 'own'"
                )
            if law.kind == "hertz_mindlin" and row.rolling_friction > 0.0:
                raise ValueError(
                    f"law.{name}.rolling_friction: given {row.rolling_friction:g}; LAMMPS's rolling spring "
                    "does not grow with a Hertz contact: make it 0, use law 'linear', or engine 'own'"
                )

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
