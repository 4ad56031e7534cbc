"""Base class of contact laws, and the values of two bodies in contact."""

import functools
import math
import operator
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, NamedTuple, TypeVar, get_args

import numpy as np
from pydantic import Field, create_model

from ..strict_model import StrictModel

SINKS = ("normal_dashpot", "tangential_dashpot", "sliding", "rolling", "separation")
"""Energy sinks that every contact books, in this order, joule. A law may have more:
ContactLaw.more_sinks."""

SHARED_SINKS = len(SINKS)
"""Number of sinks that every law has."""

SPRINGS = 6
"""Numbers that are kept of every contact: tangential spring x, y, z [m], rolling spring x, y, z [rad]; i
against j. Seen from the other side they change their sign. A law may keep more: ContactLaw.kept."""

YES, NO = np.zeros((1, 1)), np.zeros(1)
"""Values in Features of what is present and of what is absent."""

Values = TypeVar("Values", bound="PairValues")
Law = TypeVar("Law", bound="ContactLaw")


class Features(NamedTuple):
    """Parts of a contact that are compiled: an array of one dimension means absent, of more present.

    Number of dimensions is part of numba's type, so the code of an absent feature is not compiled; values
    matter in `periodic` only. (Literals would be plainer, but do not pass into parallel loops.) Kernels ask
    by the functions of contact_laws.features.

    A law with features of its own has a class with these and, after them, its own: ContactLaw.features.
    """

    tangential: np.ndarray
    rolling: np.ndarray
    book: np.ndarray  # book every energy sink
    sizes: np.ndarray = NO  # radii differ: dem.mixture
    materials: np.ndarray = NO  # laws or densities differ: dem.mixture
    periodic: np.ndarray = NO  # sides: (1, 1) period in y; (1, 1, 3) along x, y and z [m]


class ContactMotion(NamedTuple):
    """Motion of body i against body j, in a kernel."""

    normal: tuple[float, float, float]  # unit vector from i to j
    velocity: tuple[float, float, float]  # at the contact point [m/s]
    angular_velocity: tuple[float, float, float]  # [rad/s]


class ContactState(NamedTuple):
    """What is kept of a contact from step to step, in a kernel; i against j."""

    shear: tuple[float, float, float]  # tangential spring, a tangent vector [m]
    rolling: tuple[float, float, float]  # rolling displacement, a tangent vector [rad]
    own: tuple[float, ...]  # the law's own numbers: ContactLaw.kept


@dataclass(frozen=True)
class PairValues:
    """Values of one kind of pair, SI, from which beds, limits and the numbers of the kernels are derived."""

    stiffness: float  # K_X [N/m]
    tangential_stiffness: float  # K_Y = K_Z [N/m]
    damping: float  # C_X [N s/m]
    tangential_damping: float  # C_Y = C_Z [N s/m]
    static_friction: float
    sliding_friction: float
    rolling_friction: float
    adhesion: float = 0.0  # K_B [N/m]
    rest_overlap: float = 0.0  # delta_c [m]
    reach: float = 0.0  # delta_B [m]
    damping_of_restitution: bool = False  # dampers ~ sqrt(K m)

    @property
    def contact_adhesion(self) -> float:
        """K_C = K_B delta_B / delta_c [N/m] (eq. 20)."""
        return self.adhesion * self.reach / self.rest_overlap if self.adhesion > 0.0 else 0.0

    @property
    def peak_attraction(self) -> float:
        """Largest attraction, at touch: K_B delta_B [N]."""
        return self.adhesion * self.reach

    @property
    def sticks(self) -> bool:
        """Whether anything attracts."""
        return self.adhesion > 0.0

    @property
    def max_stiffness(self) -> float:
        """Steepest slope of the normal force [N/m]."""
        return max(self.stiffness, self.contact_adhesion)

    def loaded_m(self, force_newton: float) -> float:
        """Overlap beyond rest at which the elastic part carries `force_newton` [m]."""
        return force_newton / self.stiffness

    def stiffened(self: Values, factor: float) -> Values:
        """Values at `factor` times the normal stiffness; a restitution stays if dampers follow from it."""
        dampers = math.sqrt(factor) if self.damping_of_restitution else 1.0
        return replace(
            self,
            stiffness=factor * self.stiffness,
            damping=dampers * self.damping,
            tangential_damping=dampers * self.tangential_damping,
        )

    def scaled(self: Values, ratio: float) -> Values:
        """Values of spheres `ratio` times as large that make soil of the same strength and modulus.

        A bed of spheres of diameter d and density rho is a continuum of modulus K / d, strength
        K_B delta_B / d^2 and damping ratio C / sqrt(K m), with m ~ rho d^3. They stay what they are for

            K, K_t, K_B ~ ratio    C ~ ratio^2    delta_c, delta_B ~ ratio    friction, rho ~ 1

        and so do stress, strain and density; forces of contacts grow with ratio^2, overlaps and the time
        step (~ sqrt(m / K)) with ratio. What is as small as a particle is lost: the width of a shear band,
        the roughness of a surface, the teeth of a tool.
        """
        return replace(
            self,
            stiffness=ratio * self.stiffness,
            tangential_stiffness=ratio * self.tangential_stiffness,
            damping=ratio**2 * self.damping,
            tangential_damping=ratio**2 * self.tangential_damping,
            adhesion=ratio * self.adhesion,
            rest_overlap=ratio * self.rest_overlap,
            reach=ratio * self.reach,
        )

    def linear_at(self, overlap_m: float) -> "PairValues":
        """Springs and dashpots in N/m and N s/m at this overlap."""
        return self


class ContactLaw(StrictModel):
    """Value of `soil.law` in a scene. A law is a subclass with a `kind` and rows of its own.

    Lengths and masses that the methods take are the reduced ones of a pair, r1 r2 / (r1 + r2) and
    m1 m2 / (m1 + m2), those of the particle at a boundary. `ratio`: the radius of the particles over the one
    that the values hold for.
    """

    if TYPE_CHECKING:  # fields of the laws
        kind: Any
        particle: Any
        boundary: Any

    numbers: ClassVar[Any]
    """Class of the numbers of a pair, a NamedTuple: it selects the `kernel.py` beside its module.

    No other law may have a class of the same name: numba names compiled kernels by it, and the linker would
    confuse the cached kernels of the two laws."""

    features: ClassVar[type] = Features
    """Class of the features: Features, or one with further fields."""

    more_sinks: ClassVar[tuple[str, ...]] = ()
    """Energy sinks of its own; its kernel books them after SINKS."""

    kept: ClassVar[Mapping[str, int]] = {}
    """Numbers kept of a contact beside the SPRINGS: name -> 1, or -1 if it changes its sign seen from the
    other side. All start at zero. None may be part of a vector, as a field lays soil out turned about z."""

    linear_springs: ClassVar[bool] = False
    """Whether the normal force is that of linear springs, which the settling of dense beds rests on."""

    @property
    def sinks(self) -> tuple[str, ...]:
        """Names of all energy sinks."""
        return SINKS + self.more_sinks

    def pair(self, ratio: float, radius_m: float, mass_kg: float) -> PairValues:
        """Two particles under this law."""
        raise NotImplementedError

    def mixed_pair(self: Law, other: Law, ratio: float, radius_m: float, mass_kg: float) -> PairValues:
        """A particle under this law and one under another of the same kind: the combining rule of layers."""
        raise NotImplementedError

    def at_boundary(self, ratio: float, radius_m: float, mass_kg: float) -> PairValues:
        """A particle at a wall or tool."""
        raise NotImplementedError

    @classmethod
    def numbers_of(cls, values: PairValues, radius_m: float) -> Any:
        """`numbers` of a pair for the kernels."""
        raise NotImplementedError

    def own_features(self, values: Sequence[PairValues]) -> Mapping[str, bool]:
        """Whether each of the law's own features is present, by name; `values`: of all pairs."""
        return {}

    def wave_limit(self, radius_m: float, density_kg_per_m3: float) -> tuple[str, float] | None:
        """Cause and length [s] of the largest step, where it follows from waves in the material.

        None: from the springs and dampers of PairValues (limits.stable_steps).
        """
        return None

    def rest_overlaps_m(self) -> tuple[float, float]:
        """Overlap of two particles, and of particle and boundary, without force."""
        return 0.0, 0.0

    def refused(self, change: Any) -> str:
        """Reason why a layer cannot make this change, starting with the row's name; empty if it can."""
        return ""

    def changed_by(self: Law, change: Any) -> Law:
        """This law with the values that a layer has of its own (layer_law)."""
        rows = {
            key: getattr(self, key).model_copy(update=getattr(change, key).model_dump(exclude_none=True))
            for key in ("particle", "boundary")
        }
        return self.model_copy(update=rows)


def one_of_kinds(models: Iterable[type[StrictModel]]) -> Any:
    """Annotation of a value of one of these models, distinguished by their `kind`."""
    return Annotated[functools.reduce(operator.or_, models), Field(discriminator="kind")]


def layer_law(law: type[ContactLaw]) -> type[StrictModel]:
    """Model of the changes that a layer may make to a law: any value of its rows."""

    def changes(row: type[StrictModel]) -> type[StrictModel]:
        optional: dict[str, Any] = {
            name: (Annotated[(field.annotation, *field.metadata, Field())] | None, None)
            for name, field in row.model_fields.items()
        }
        found = create_model(row.__name__.replace("Values", "Change"), __base__=StrictModel, **optional)
        found.__doc__ = f"Values of a row of law '{kind}' that a layer has of its own."
        return found

    (kind,) = get_args(law.model_fields["kind"].annotation)
    rows: dict[str, Any] = {"kind": (Literal[kind], ...)}
    made: dict[Any, Any] = {}
    for key in ("particle", "boundary"):
        row = law.model_fields[key].annotation
        made[row] = made.get(row) or changes(row)  # type: ignore[arg-type]
        rows[key] = (made[row], made[row]())
    name = law.__name__.replace("Law", "LayerLaw")
    found = create_model(name, __base__=StrictModel, **rows)
    found.__doc__ = f"What a layer changes in the rows of law '{kind}'."
    return found


def series(first: float, second: float) -> float:
    """Two springs (or dampers) in series, eq. 15, 16, 18; zero if either is."""
    total = first + second
    return first * second / total if total > 0.0 else 0.0


def doubled(values: Values) -> Values:
    """Pair values from halves in series: two of 2 K in series are twice two of K."""
    return replace(
        values,
        stiffness=2.0 * values.stiffness,
        tangential_stiffness=2.0 * values.tangential_stiffness,
        damping=2.0 * values.damping,
        tangential_damping=2.0 * values.tangential_damping,
        adhesion=2.0 * values.adhesion,
    )


def with_weaker_friction(values: Values, one: Any, other: Any) -> Values:
    """`values` with the smaller friction of two rows: the weaker surface yields first."""
    return replace(
        values,
        static_friction=min(one.static_friction, other.static_friction),
        sliding_friction=min(one.sliding_friction, other.sliding_friction),
        rolling_friction=min(one.rolling_friction, other.rolling_friction),
    )
