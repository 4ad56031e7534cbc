"""Bayesian sampling of parameters by GrainLearning, where it is installed.

Source: H. Cheng et al., Comput. Methods Appl. Mech. Eng. 350 (2019) 268-294.
"""

import importlib
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError

SAMPLES_PER_PARAMETER = 5
"""Of one iteration (chosen: so that few parameters get a second and a third iteration)."""


def sample(
    evaluate: Callable[[NDArray[np.float64]], NDArray[np.float64]],
    low: NDArray[np.float64],
    high: NDArray[np.float64],
    keys: tuple[str, ...],
    wanted: NDArray[np.float64],
    tolerance: NDArray[np.float64],
    largest_runs: int,
) -> None:
    """Lets GrainLearning choose sets of parameters within their bounds and test each by `evaluate`.

    Raises:
        InputError: it is not installed.
    """
    try:
        grainlearning = importlib.import_module("grainlearning")
    except ImportError as error:
        raise InputError(
            f"method: grainlearning is asked for, but cannot be imported ({error}); install it (pip install "
            "grainlearning), or use method: least_squares"
        ) from error
    count = min(max(2, SAMPLES_PER_PARAMETER * len(keys)), largest_runs)

    def test_all(calibration: object) -> None:
        system = calibration.system  # type: ignore[attr-defined]
        system.set_sim_data([(evaluate(np.array(row)) / wanted)[None, :] for row in system.param_data])

    calibration = grainlearning.BayesianCalibration.from_dict(
        {
            "num_iter": max(1, largest_runs // count),
            "callback": test_all,
            "system": {
                "system_type": grainlearning.DynamicSystem,
                "model_name": "law",
                "param_names": list(keys),
                "param_min": low.tolist(),
                "param_max": high.tolist(),
                "num_samples": count,
                "obs_data": np.ones((1, len(wanted))).tolist(),
                "ctrl_data": list(range(len(wanted))),
                "obs_names": ["result"],
                "ctrl_name": "number",
                "sigma_tol": float(tolerance.min()),
            },
            "inference": {
                "Bayes_filter": {"ess_target": 0.3},
                "sampling": {"max_num_components": 1, "seed": 0},
            },
            "save_fig": -1,
        }
    )
    calibration.run()
