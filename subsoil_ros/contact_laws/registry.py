"""The contact laws that a scene may name: those of this package, and those found by entry point."""

import functools
from collections.abc import Set
from typing import get_args

from ..installed_laws import installed_laws
from .base import ContactLaw, Features
from .cohesive_linear.law import CohesiveLinearLaw
from .elasto_plastic_adhesive.law import ElastoPlasticAdhesiveLaw
from .hertz.law import HertzMindlinLaw
from .linear.law import LinearLaw

BUILT_IN: dict[str, type[ContactLaw]] = {
    "cohesive_linear": CohesiveLinearLaw,
    "linear": LinearLaw,
    "hertz_mindlin": HertzMindlinLaw,
    "elasto_plastic_adhesive": ElastoPlasticAdhesiveLaw,
}


@functools.cache
def contact_laws() -> dict[str, type[ContactLaw]]:
    """Laws by their kind; outside ones that cannot be used are left out: see unusable_laws."""
    return {**BUILT_IN, **{kind: law for kind, law in _outside().items() if isinstance(law, type)}}


@functools.cache
def unusable_laws() -> dict[str, str]:
    """Why an outside law cannot be used, by its kind."""
    return {kind: why for kind, why in _outside().items() if isinstance(why, str)}


@functools.cache
def _outside() -> dict[str, type[ContactLaw] | str]:
    """Each outside law, or why it cannot be used: a broken one must not stop scenes that do not name it."""
    found: dict[str, type[ContactLaw] | str] = {}
    taken = {name for law in BUILT_IN.values() for name in _compiled_names(law)}
    for kind, entry in installed_laws().items():
        try:
            law = entry.load()
        except Exception as error:
            found[kind] = f"'{entry.value}' cannot be imported: {error or type(error).__name__}"
        else:
            found[kind] = _fault(kind, law, taken) or law
            taken |= _compiled_names(law) if isinstance(found[kind], type) else set()
    return found


def _compiled_names(law: type[ContactLaw]) -> set[str]:
    """Names of the law's own classes that compiled kernels bear."""
    return {law.numbers.__name__} | ({law.features.__name__} - {Features.__name__})


def _fault(kind: str, law: object, taken: Set[str]) -> str:
    """What is wrong with the class of an outside law; empty: nothing. taken: names of other laws' classes."""
    if kind in BUILT_IN:
        return "its kind is that of a law of subsoil_ros; give it another"
    if not (isinstance(law, type) and issubclass(law, ContactLaw)):
        return "its entry point is no subclass of subsoil_ros.contact_laws.base.ContactLaw"
    named = law.model_fields.get("kind")
    if named is None or get_args(named.annotation) != (kind,):
        return f'its field must be `kind: Literal["{kind}"]`, as its entry point is named'
    if missing := {"particle", "boundary"} - law.model_fields.keys():
        return f"its class has no field '{min(missing)}'"
    if not hasattr(law, "numbers"):
        return "its class has no `numbers`, the NamedTuple that its kernels take"
    if not law.numbers.__module__.endswith(".law"):
        return "the class of its `numbers` must stand in a module law.py, beside kernel.py"
    if missing := set(Features._fields) - set(getattr(law.features, "_fields", ())):
        return f"the class of its `features` has no '{min(missing)}'; it begins with the fields of Features"
    if twice := taken & _compiled_names(law):
        return f"another law has a class '{min(twice)}' too, and numba needs distinct names; rename it"
    return ""
