"""The figure of a sweep with a quantity that some runs do not have."""

import math
from pathlib import Path

import pandas as pd

from subsoil_ros.figures.sweep_figures import draw_response


def test_a_value_without_the_quantity_has_no_line(tmp_path: Path) -> None:
    """A spring that is swept away has no force."""
    table = pd.DataFrame(
        {"k": [1, 2, 1, 2], "kind": ["a", "a", "b", "b"], "force": [3.0, 4.0] + [math.nan] * 2}
    )
    assert draw_response(table, ["k", "kind"], ["force"], tmp_path / "response.png") is not None
