"""How good is the optimum? No gains within the bounds do better than ``bound``; a value and its bound bracket the best.

::

    find        v_bound >= v(K) for every K in its bounds that keeps
    (26)-(29)   poles of (24) at -sigma or left of it, for every A of every scenario
    contact     F_T(t), F_H(t) >= required, and the other limits along the trajectories of every scenario

by branch and bound over boxes of gains, the most promising first, until the gap between the value and the bound is
small enough or the time is over (Horst and Tuy, Global Optimization, 1996).

*Poles* give exact bounds: every coefficient of the characteristic polynomial is affine in the gains (``poles``). A
bound that needs nothing else is ``rigorous``.

*Trajectories* give quadratics in the gains, exact at the centre of a box; what they miss elsewhere in it is measured at
four corners and doubled, not enclosed (``course``). A bound that needs them is a ``sampled relaxation``: strong
evidence that the search for gains missed nothing, no proof. They are looked at on the coarse time grid of that search.

*Together*: what excludes a box is mostly no single row but a mixture of several, as the multipliers of an optimum mix
the rows that hold it (``relax``). Near an optimum what such a mixture overestimates shrinks with the square of the box.

Requirements that are neither poles nor limits along trajectories, such as a delay margin, are left out, which makes the
bound larger, never wrong; they are named. Points that the search comes across are tried as it goes, so that it is a
second search for gains, too: what is better than the value found is polished by ``problems.gains``.
"""

from problems.bound.bracket import COVERED, Bracket, facts, lines
from problems.bound.search import bracket, check

__all__ = ["COVERED", "Bracket", "bracket", "check", "facts", "lines"]
