"""Layers of depth and the values that differ between them."""

from typing import TYPE_CHECKING, Any

from pydantic import Field

from ..contact_laws.base import layer_law, one_of_kinds
from ..contact_laws.registry import contact_laws
from ..strict_model import Positive, StrictModel

if TYPE_CHECKING:

    class LayerLaw(StrictModel):
        """What a layer changes of the law."""

        kind: str
        particle: Any
        boundary: Any
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
