"""The working box: the part of the spec's gain bounds whose gains are of a sensible size for this body.

Bounds may be many decades too wide. The search scales its variables by the box that it works in and samples it, so
that a wide one would hide the designs; where the best design lies on an artificial side of the box, ``problems.gains.
search`` widens it. Sizes, from stability (27)-(29) and the fall's own time scale:

- K_p up to ``STIFF`` A L, where (27) asks for one A L;
- K_d up to ``DAMPED`` sqrt(I K_p), where critical damping asks for two;
- K_f up to ell K_d/(I + beta), beyond which (28) is broken for every K_d in the box. Law (20) acts (M + m) g/load times
  as strongly.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from design.spec.setting import Setting

if TYPE_CHECKING:
    from problems.gains.question import Environment

Array = NDArray[np.float64]

STIFF = 100.0
DAMPED = 10.0
WIDER = 4.0
"""Factor by which an artificial side moves out."""


def working_upper(
    setting: Setting, environments: Sequence[Environment], lower: Array, widest: Array, reach: float
) -> Array:
    """The upper sides (3,) of the working box, within ``widest`` (3,).

    ``reach`` multiplies the sensible sizes; infinite, the box is the spec's bounds. The spec's own gains, where they
    are within its bounds, are inside, and so is ten times every lower bound.
    """
    if not math.isfinite(reach):
        return widest.copy()
    own = np.zeros(3) if setting.gains is None else np.array(setting.gains)
    own = np.maximum(2.0 * np.where(own <= widest, own, 0.0), 10.0 * lower)
    biped = setting.biped
    heaviest = max(each.place.A for each in environments)
    stiffness = STIFF * (heaviest if heaviest > 0 else biped.M * biped.g) * biped.L
    K_p = min(widest[0], max(reach * stiffness, own[0]))
    K_d = min(widest[1], max(reach * DAMPED * math.sqrt(biped.I * max(stiffness, own[0])), own[1]))
    return np.array([K_p, K_d, min(widest[2], max(steepest(environments, K_d), own[2]))])


def steepest(environments: Sequence[Environment], K_d: float) -> float:
    """The largest K_f that (28) allows beside ``K_d`` in some of the ``environments``."""
    found = 0.0
    for each in environments:
        biped = each.world.biped
        strong = biped.weight / each.place.load if each.world.law == "cop" else 1.0
        found = max(found, biped.ell * K_d / (max(biped.I + each.place.beta, 0.1 * biped.I) * max(strong, 1e-3)))
    return found
