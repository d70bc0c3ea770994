"""MPC versus PD: is a constrained MPC worth it over three well-chosen gains, and where.

compare   the paper's laws, with the spec's and with synthesized gains, clipped LQR, and predictive controllers that
          know as much or more; gains and weights are chosen by one objective (``problems.comparison.weights``)
over      trials: drawn bodies, scenarios and noise, the same for all (common random numbers)
by        contact kept, smallest contact force, end and effort of the run, computing time; the largest sudden slope
          and push survived, as a share of what any ankle can
assuming  the foot turns at the first negative force: the trial ends there; torque limits, period and delay are the same

A difference is paired: one draw in one scenario, of which scenarios are strata; it is never said without its interval.
"""
