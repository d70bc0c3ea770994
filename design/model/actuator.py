"""What the ankle can give: a torque within limits, held for a control period."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Actuator:
    """An ankle that holds its torque for a ``period`` [s]: |tau| <= ``torque`` [N m], |dtau/dt| <= ``rate`` [N m/s]."""

    period: float
    torque: float = math.inf
    rate: float = math.inf

    def given(self, wanted: float, before: float) -> float:
        """The torque [N m] that comes of the ``wanted`` one after ``before``; within the rate's limit first."""
        change = self.rate * self.period
        near = min(max(wanted, before - change), before + change)
        return min(max(near, -self.torque), self.torque)
