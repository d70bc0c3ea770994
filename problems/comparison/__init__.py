"""MPC versus PD: is a constrained MPC worth it over three well-chosen gains, and where.

compare   the paper's laws, with given and with synthesized gains, and predictive controllers that know as much or more
over      trials: drawn bodies, scenarios and noise, the same for all (common random numbers)
by        contact kept, smallest contact force, end and effort of the run, computing time; the largest sudden slope
          and push survived, as a share of what any ankle can
assuming  the foot turns at the first negative force: the trial ends there; torque limits, period and delay are the same

A difference is paired, trial by trial, and never said without its interval.
"""
