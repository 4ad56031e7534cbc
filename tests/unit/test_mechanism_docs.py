"""docs/mechanism.md names all that a mechanism can have, and its numbers are those of the code."""

import re
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
from numpy.testing import assert_allclose

from subsoil_ros.mbd.integrators import adams_moulton
from subsoil_ros.scene import mechanism
from subsoil_ros.scene import time_functions as laws

TEXT = (Path(__file__).parents[2] / "docs/mechanism.md").read_text(encoding="utf-8")
WEIGHTS = {
    "predictor, v": adams_moulton.PREDICT_V,
    "predictor, q": adams_moulton.PREDICT_Q,
    "corrector, v": adams_moulton.CORRECT_V,
    "corrector, q": adams_moulton.CORRECT_Q,
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
    used = adams_moulton.multistep_weights(4)[WEIGHTS[name]]
    assert_allclose(np.array(numbers) / divisor, used, atol=1e-14)
