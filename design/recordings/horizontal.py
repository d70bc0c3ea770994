"""The sign of a measured horizontal force, by the CoP: of a standing body the ground's force moves against it.

M x'' = f_x, and of an inverted pendulum x'' = -(g/h) (p - x), so f_x ~ -(M g/h) (p - x): above the body's slow sway,
in which x follows p, the force on the foot is minus the CoP, and the force on the plate is plus it.
"""

from __future__ import annotations

import numpy as np

from design.recordings.table import Array

BAND = (0.5, 5.0)
"""The frequencies [Hz] in which both are compared."""
CYCLES = 4.0
"""How many periods of the slowest of them a recording must hold."""
CLEAR = 0.5
"""The correlation from which on the sign is told."""


def against_cop(force: Array, cop: Array, rate: float) -> float | None:
    """Correlation of ``force`` and ``cop`` (n,), sampled at ``rate`` [Hz], in ``BAND``; None if too little is known."""
    every = max(1, int(rate / (10 * BAND[1])))  # means of so many samples hold all that is in the band
    n = len(force) // every
    rate /= every
    if n / rate < CYCLES / BAND[0] or rate < 4 * BAND[0]:
        return None
    frequencies = np.fft.rfftfreq(n, 1 / rate)
    inside = (frequencies >= BAND[0]) & (frequencies <= BAND[1])
    ramp, window = np.linspace(-1.0, 1.0, n), np.hanning(n)
    banded = []
    for samples in (force, cop):
        values = samples[: n * every].reshape(n, every).mean(axis=1)
        level = np.polynomial.Polynomial.fit(ramp, values, 1)(ramp)
        moving = values - level
        spectrum = np.fft.rfft(moving * window)
        if float(np.abs(moving).max()) <= 1e-9 * max(float(np.abs(values).max()), 1e-6):
            return None
        banded.append(spectrum[inside])
    size = float(np.linalg.norm(banded[0]) * np.linalg.norm(banded[1]))
    return float(np.vdot(banded[0], banded[1]).real) / size if size > 0 else None
