"""What one per cent more would buy: gains sought again, near the design, with each level, bound and tolerance moved.

The multipliers say it for an infinitely small change (``problems.gains.prices``); this is the change itself, and where
the two differ the optimum has a kink there.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

from design.analysis.synthesis import Answer, Price, Synthesis
from design.model.limits import Required
from design.solvers.outcome import Outcome
from design.spec.setting import Setting
from problems import gains
from problems.gains.goal import GAINS
from problems.gains.question import Question
from problems.robust.worst import world

Say = Callable[[str], None]


def checked(setting: Setting, answer: Answer, *, seconds: float = 120.0, say: Say = lambda _: None) -> Answer:
    """The answer with its prices solved, and with that of the tolerances where there is a box."""
    found = answer.outcome.value
    deadline = time.monotonic() + seconds
    prices = []
    for price in found.prices:
        say(f"one per cent more of {price.id}")
        prices.append(replace(price, solved=_change(_moved(setting, price), setting, found, deadline)))
    if found.box is not None:
        say("one per cent more of the tolerances")
        wider = replace(setting, tolerances=setting.tolerances.scaled(1.01))
        prices.append(
            Price(id="uncertainty", kind="tolerances", given=1.0, unit="of the box", change=None,
                  solved=_change(wider, setting, found, deadline))
        )  # fmt: skip
    return replace(answer, outcome=Outcome(status=answer.outcome.status, found=replace(found, prices=tuple(prices))))


def _moved(setting: Setting, price: Price) -> Setting:
    """The setting with one per cent more of what is priced."""
    if price.kind == "requirement":
        wish = setting.required[price.id]
        return replace(
            setting, required={**setting.required, price.id: Required(level=1.01 * wish.level, soft=wish.soft)}
        )
    assert setting.bounds is not None
    bounds = setting.bounds.copy()
    bounds[GAINS.index(price.id), int(price.kind == "upper bound")] *= 1.01
    return replace(setting, bounds=bounds)


def _change(moved: Setting, setting: Setting, found: Synthesis, deadline: float) -> float | None:
    """The new optimum less the old one; None where none is found."""
    goal = Question(setting).goal(setting.objective)
    points = () if found.box is None else found.box.points
    beside = [world(moved, point.shares, point.scenario) for point in points]
    near = gains.Point(gains=found.gains, v=goal.v(found.value))
    left = deadline - time.monotonic()
    answer = gains.solve(moved, seconds=left, beside=beside, near=near) if left > 0 else None
    return None if answer is None or answer.outcome.found is None else answer.outcome.found.value - found.value
