"""Gains that settle: where the spec asks no decay rate, a design must come to rest within its scenarios all the same.

Without such a requirement the best contact force may belong to a loop whose slowest pole is on the imaginary axis but
for rounding: it keeps every row and never settles. Then gains are sought again with the decay rate

    sigma = 3/T,  T the longest time from the last corner of the force to the end of a scenario

at which 5 % of a deviation are left when that scenario ends. If no design keeps that beside the rest, the first one
stays, with a warning. A design that decays so fast anyway is not touched.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace

from design.analysis.synthesis import Answer, Settling
from design.analysis.verdict import worst
from design.model.laws import Gains
from design.model.limits import Required
from design.spec.setting import Setting
from problems import robust

Say = Callable[[str], None]

TIME_CONSTANTS = 3.0


def default_decay(setting: Setting) -> float:
    """The decay rate [1/s] that is required where the spec asks none."""
    tails = [each.duration - each.steady_from for each in setting.scenarios]
    longest = max(tails)
    return TIME_CONSTANTS / (longest if longest > 0 else max(each.duration for each in setting.scenarios))


def solve(
    setting: Setting,
    *,
    starts: int | None = None,
    seconds: float = 600.0,
    say: Say = lambda _: None,
    known: Sequence[Gains] = (),
) -> tuple[Setting, Answer]:
    """Gains as ``robust.solve`` seeks them, that settle where that is possible; and the setting that they answer.

    The setting has the default decay rate where that was required.
    """
    end = time.monotonic() + seconds
    first = robust.solve(setting, starts=starts, seconds=seconds, say=say, known=known)
    design = first.outcome.found or first.best
    if setting.decay_asked or design is None or setting.objective == "decay-rate":
        return setting, first
    rate, reached = default_decay(setting), worst(design.verdict.rows, "decay-rate").value
    if reached is not None and reached >= rate:
        return setting, first
    say(f"the best design decays with {reached or 0.0:.2g} 1/s; again with at least {rate:.3g} 1/s")
    settles = replace(setting, required={**setting.required, "decay-rate": Required(level=rate)})
    met = [design.gains, *known]
    again = robust.solve(settles, starts=starts, seconds=max(end - time.monotonic(), 0.0), say=say, known=met)
    without = Settling(required=rate, value=design.value, decay=reached or 0.0, kept=False)
    if again.outcome.found is None and again.best is None:
        return setting, replace(first, settling=without)
    return settles, replace(again, settling=replace(without, kept=True))
