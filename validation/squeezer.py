"""Andrews' squeezer: seven bodies of one freedom that turn fast under a constant moment."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from .laboratory import Document


def _pin(body_a: str, body_b: str, point: Sequence[float]) -> Document:
    return {"kind": "revolute", "body_a": body_a, "body_b": body_b, "point_m": list(point)}


# Geometry, masses, start and solution at 0.03 s: Mazzia & Magherini, Test Set for IVP Solvers, release 2.4,
# problem "Andrews' squeezing mechanism" (reference by PSIDE at a tolerance of 1e-14); the same problem is in
# Hairer & Wanner, Solving Ordinary Differential Equations II, VII.7.
MASSES = (0.04325, 0.00365, 0.02373, 0.00706, 0.07050, 0.00706, 0.05498)
INERTIAS = (2.194e-6, 4.410e-7, 5.255e-6, 5.667e-7, 1.169e-5, 5.667e-7, 1.912e-5)
BETA, GAMMA = -0.0617138900142764496, 0.455279819163070380
PHI, DELTA, EPSILON = 0.222668390165885885, 0.487364979543842550, 1.23054744454982119
REFERENCE = np.array([15.81077119629904, -15.75637105984298, 0.04082224013073101, -0.5347301163226948,
                      0.5244099658805304, 0.5347301163226948, 1.048080741042263])  # fmt: skip
REFERENCE_RATES = np.array([1139.920302151208, -1424.379294994111, 11.03291221937134, 19.29337464421385,
                            0.5735699284790808, -19.29337464421385, 0.3231791658026955])  # fmt: skip
REFERENCE_MULTIPLIERS = (199.1753333731910, -29.75531228015052)  # of the loop over K3


def _local(origin: Sequence[float], angle: float, along: float, across: float) -> list[float]:
    """A point given along the direction `angle` and 90 degrees to its left."""
    c, s = math.cos(angle), math.sin(angle)
    return [origin[0] + along * c - across * s, origin[1] + along * s + across * c]


def squeezer(**more: object) -> Document:
    """The machine in its start; `more` are keys of the mechanism."""
    a, b, c = (-0.06934, -0.00227), (-0.03635, 0.03273), (0.014, 0.072)
    crank = _local((0.0, 0.0), BETA, 7e-3, 0.0)
    meeting = _local(crank, BETA, -28e-3, 0.0)
    joint_e = _local(a, DELTA, 4e-2, 0.0)
    joint_h = _local(a, EPSILON, 0.0, -4e-2)
    centres = {
        "K1": (_local((0.0, 0.0), BETA, 92e-5, 0.0), BETA),
        "K2": (_local(crank, BETA, -115e-4, 0.0), BETA),
        "K3": (_local(b, GAMMA, 1043e-5, -1874e-5), GAMMA),
        "K4": (_local(joint_e, PHI + DELTA, 0.0, -(2e-2 - 1421e-5)), PHI + DELTA),
        "K5": (_local(a, DELTA, 2308e-5, 916e-5), DELTA),
        "K6": (_local(joint_h, EPSILON - PHI, 2e-2 - 1421e-5, 0.0), EPSILON - PHI),
        "K7": (_local(a, EPSILON, -449e-5, -1228e-5), EPSILON),
    }
    bodies = {
        name: {"mass_kg": m, "inertia_kg_m2": i, "position_m": centre, "angle_rad": angle}
        for (name, (centre, angle)), m, i in zip(centres.items(), MASSES, INERTIAS, strict=True)
    }
    joints = {
        "O": _pin("ground", "K1", (0.0, 0.0)), "crank": _pin("K1", "K2", crank),
        "F3": _pin("K2", "K3", meeting), "F4": _pin("K2", "K4", meeting), "F6": _pin("K2", "K6", meeting),
        "B": _pin("ground", "K3", b), "A5": _pin("ground", "K5", a), "A7": _pin("ground", "K7", a),
        "E": _pin("K4", "K5", joint_e), "H": _pin("K6", "K7", joint_h),
    }  # fmt: skip
    forces = {
        "spring": {"kind": "spring_damper", "body_a": "ground", "point_a_m": c, "body_b": "K3",
                   "point_b_m": _local(b, GAMMA, 2e-2, -18e-3), "stiffness_newton_per_m": 4530.0,
                   "free_length_m": 0.07785},
        "motor": {"kind": "point_load", "body": "K1", "point_m": centres["K1"][0],
                  "moment_newton_m": {"kind": "constant", "value": 0.033}},
    }  # fmt: skip
    return {"bodies": bodies, "joints": joints, "forces": forces, **more}


def relative(values: Sequence[float]) -> NDArray[np.float64]:
    """beta, Theta, gamma, Phi, delta, Omega, epsilon from the absolute angles of K1 to K7."""
    k1, k2, k3, k4, k5, k6, k7 = values
    return np.array([k1, k2 - k1, k3, k4 - k5, k5, k6 - k7, k7])
