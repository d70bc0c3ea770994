"""The next trial: how much better it stands for what the last one read off, and where that is a wrong start."""

from problems.trials.facts import facts
from problems.trials.series import Series, Trial, run

__all__ = ["Series", "Trial", "facts", "run"]
