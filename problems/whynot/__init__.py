"""Why not? Which requirements of a specification no design was found to meet together, and what would be enough.

With R the hard requirements (contact >= 0 and stability always stay):

*Conflict*: a subset of R that no design was found to meet together, while one was without any one of its members
(deletion filter: Chinneck, Feasibility and Infeasibility in Optimization, 2008, section 6). Whether a subset can be met
is sought by maximising the smallest margin from several starts and, if that fails, without derivatives: "was not found"
is what a search says, never a proof. A proof is an obstacle (``design.analysis.obstacles``), and the outcome holds it.

*Relaxations*: for each member r of the conflict the best value that r can have while all the rest of R is met, and for
each bound of a gain where it would have to be for all of R: each is one synthesis with that as the objective, and its
checked design is kept.

*Feasible after all*: a relaxation that asks no less than the specification does, or a design met on the way that keeps
all of R, shows that R can be met. It is handed back, to start from.
"""

from problems.whynot.conflict import feasible, solve

__all__ = ["feasible", "solve"]
