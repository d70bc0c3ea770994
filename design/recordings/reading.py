"""How a recording is to be read: what the user states on the command line."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Reading:
    """What is left at None is detected where the file leaves no doubt, and demanded where it does.

    ``columns``: ``fz=Fz:N,cop=COPx:cm,...``. ``delimiter``, ``decimal``, ``skip_rows``: the form of a text file.
    ``rate`` [Hz] where there is no time column; ``resample`` [Hz] for irregular time stamps. ``up``, ``forward``: axes
    of the file. ``ankle``: forward position of the ankle in the file's frame, as ``0.21`` or ``21:cm``. ``origins``:
    those of the points about which the plates' moments are, as ``0.25,-0.25`` or ``25,-25:cm``. ``allow_gaps``:
    unreadable cells are masked instead of refused.
    """

    columns: str | None = None
    delimiter: str | None = None
    decimal: str | None = None
    skip_rows: int | None = None
    rate: float | None = None
    resample: float | None = None
    up: str | None = None
    forward: str | None = None
    ankle: str | None = None
    origins: str | None = None
    allow_gaps: bool = False
