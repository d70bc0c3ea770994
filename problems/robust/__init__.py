"""Gains for every body and world within [uncertainty], not only for the nominal ones.

::

    maximise    v
    over        K in its bounds
    subject to  the requirements of ``problems.gains``, and v, for every point of the box

The box is a continuum; a program sees few of its points (exchange, as over time). The nominal design comes first; then
the point and scenario that break it worst are sought, added as further bodies, and gains sought again, until none is
found. What is then left to chance is only whether the search for the worst point missed one: many random points are
tried, and contact over the whole box is proved where it can be (``design.proof``).
"""

from problems.robust.search import solve
from problems.robust.worst import Weak, weakest

__all__ = ["Weak", "solve", "weakest"]
