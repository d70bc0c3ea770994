"""What a controller is told of the truth: white noise, resolution, and a delay."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from design.model.laws import Measurement


@dataclass(frozen=True, kw_only=True)
class Sensors:
    """Standard deviations and resolutions of angle [rad], rate [rad/s], and toe and heel force [N]; ``delay`` [s]."""

    angle: float = 0.0
    rate: float = 0.0
    force: float = 0.0
    angle_step: float = 0.0
    rate_step: float = 0.0
    force_step: float = 0.0
    delay: float = 0.0

    @property
    def exact(self) -> bool:
        """Whether they tell the truth, though perhaps late."""
        return not any((self.angle, self.rate, self.force, self.angle_step, self.rate_step, self.force_step))

    def reading(self, truth: Measurement, draw: Sequence[float]) -> Measurement:
        """The ``truth`` as they tell it; ``draw`` are four standard normal numbers."""
        return Measurement(
            _rounded(truth.theta + self.angle * draw[0], self.angle_step),
            _rounded(truth.omega + self.rate * draw[1], self.rate_step),
            _rounded(truth.F_T + self.force * draw[2], self.force_step),
            _rounded(truth.F_H + self.force * draw[3], self.force_step),
        )


def _rounded(value: float, step: float) -> float:
    return step * round(value / step) if step > 0 else value
