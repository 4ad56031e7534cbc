"""docs/mechanism.md names all that a mechanism can have, and its numbers are those of the code."""

import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any, get_args

import numpy as np
import pytest
from numpy.testing import assert_allclose

from subsoil_ros.mbd import explicit_integrators
from subsoil_ros.mbd.machine_arrays import ADAMS_MOULTON, RUNGE_KUTTA_4
from subsoil_ros.mbd.modes import Mode
from subsoil_ros.mbd.stability import RESOLVED, stable_step
from subsoil_ros.scene import mechanism
from subsoil_ros.scene import time_laws as laws

TEXT = (Path(__file__).parents[3] / "docs/mechanism.md").read_text(encoding="utf-8")
WEIGHTS = {
    "predictor, v": explicit_integrators.PREDICT_V,
    "predictor, q": explicit_integrators.PREDICT_Q,
    "corrector, v": explicit_integrators.CORRECT_V,
    "corrector, q": explicit_integrators.CORRECT_Q,
}


def test_every_kind_has_its_equation() -> None:
    """Joints, forces, time functions and integrators, by the names that scenes give them."""
    parts = [part for module in (laws, mechanism) for part in vars(module).values()]
    fields = [part.model_fields["kind"] for part in parts if "kind" in getattr(part, "model_fields", ())]
    kinds = {word for field in fields for word in get_args(field.annotation)}
    assert {"revolute", "wheel_contact", "half_sine"} <= kinds
    kinds |= set(get_args(mechanism.Mechanism.model_fields["integrator"].annotation))
    assert {kind for kind in kinds if f"`{kind}`" not in TEXT} == set()


@pytest.mark.parametrize("name", WEIGHTS)
def test_weights_are_those_of_order_4(name: str) -> None:
    """The fractions in the table, to round-off of the code's."""
    row = re.search(rf"^\| {name} \| (.+) \|$", TEXT, re.MULTILINE)
    assert row is not None
    divisor, *numbers = (float(cell) for cell in row[1].split("|"))
    used = explicit_integrators.multistep_weights(4)[WEIGHTS[name]]
    assert_allclose(np.array(numbers) / divisor, used, atol=1e-14)


def test_bounds_of_the_decision_are_those_of_the_code() -> None:
    """The steps in which an undamped mode of 1 rad/s is allowed, three digits of each."""
    decision = (Path(__file__).parents[3] / "docs/decisions/0002-mechanism-integrator.md").read_text("utf-8")
    found = re.search(
        r"h w = ([\d.]+), ([\d.]+) and ([\d.]+) for orders 2, 3 and 4, and ([\d.]+) for", decision
    )
    assert found is not None
    models: list[Any] = [
        SimpleNamespace(integrator=ADAMS_MOULTON, weights=explicit_integrators.multistep_weights(order))
        for order in (2, 3, 4)
    ]
    models.append(SimpleNamespace(integrator=RUNGE_KUTTA_4))
    bounds = [max(RESOLVED, stable_step(model, Mode(1j, np.zeros(0), ""))) for model in models]
    assert_allclose([float(number) for number in found.groups()], bounds, rtol=5e-3)
