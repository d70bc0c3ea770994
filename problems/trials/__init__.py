"""The next trial: how much better it stands for what the last one read off, and where that is a wrong start."""

from problems.trials.facts import Found, conduct

__all__ = ["Found", "conduct"]
