"""Tools: triangle meshes that touch the soil, carried by a body or along a prescribed path."""

from typing import Literal

from pydantic import Field, model_validator

from ..strict_model import Finite, Positive, StrictModel
from .time_functions import Law


class MeshPart(StrictModel):
    """One watertight STL, its facets forming one group.

    A mesh vertex v [file units] stands at `position_m + scale * v` in the reference pose of the
    mechanism (world axes), or in the path's frame for a tool without a body.
    """

    mesh: str = Field(description="relative to the scene file.")
    scale: Positive = 1.0
    position_m: tuple[Finite, Finite, Finite] = (0.0, 0.0, 0.0)


class Path(StrictModel):
    """A prescribed path for a tool without a mechanism: start pose and speeds as time functions."""

    start_x_m: Finite = 0.0
    start_z_m: Finite = 0.0
    start_angle_rad: Finite = 0.0
    speed_x_m_per_s: Law | None = None
    speed_z_m_per_s: Law | None = None
    angular_speed_rad_per_s: Law | None = None


class Tool(StrictModel):
    """What one body puts into the soil. `groups` names its mesh parts (share, blade, ...)."""

    body: str | None = None
    path: Path | None = None
    lateral_m: Finite = Field(0.0, description="y of the body the tool belongs to.")
    groups: dict[str, MeshPart] = Field(min_length=1)
    density_kg_per_m3: Positive | None = Field(
        None, description="of the solid: `subsoil check` prints mass and inertia from it."
    )
    role: Literal["tillage", "wheel"] = Field(
        "tillage", description="wheel: carries the machine, and counts apart in the split of the draft."
    )

    @property
    def is_tillage(self) -> bool:
        """Whether it works the soil; a wheel only rolls on it."""
        return self.role == "tillage"

    @model_validator(mode="after")
    def _carried(self) -> "Tool":
        if (self.body is None) == (self.path is None):
            raise ValueError("give either 'body' (carried by the mechanism) or 'path', not both")
        return self
