"""The external force, read off the stationary posture, (15)-(17)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from design.model.body import Biped

Array = NDArray[np.float64]


def static_estimate(biped: Biped, theta: Array, F_T: Array, F_H: Array) -> tuple[Array, Array]:
    """(F_x, F_y) [N] by (17) and (16); true at rest in the stationary posture, an approximation elsewhere."""
    load = F_H + F_T
    F_y = biped.weight - load  # (16)
    F_x = -(load - biped.m * biped.g) * np.tan(theta)  # (17)
    return F_x, F_y
