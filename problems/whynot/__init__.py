"""Why not? Which requirements of an infeasible specification exclude each other, and what would be enough.

With R the hard requirements (contact >= 0 and stability always stay):

*Conflict*: a subset of R that cannot be met together, while it can without any one of its members (deletion filter:
Chinneck, Feasibility and Infeasibility in Optimization, 2008, section 6). Whether a subset can be met is found by
maximising the smallest margin from several starts: a "cannot" is what the search says, not a proof. Where a
necessary condition fails (``design.analysis.obstacles``), it is one.

*Relaxations*: for each member r of the conflict the best value that r can have while all the rest of R is met, and for
each bound of a gain where it would have to be for all of R: each is one synthesis with that as the objective.
"""

from problems.whynot.conflict import feasible, solve

__all__ = ["feasible", "solve"]
