"""Which gains are best? Gain synthesis for the paper's laws.

::

    maximise    v                                          the chosen row, in its scale
    over        K = (K_p, K_d, K_f) in its bounds
    subject to  poles of (24) at -sigma or left of it, for every A of every scenario, i.e. (26)-(29)
                F_T(t), F_H(t) >= required                 at every sample of every scenario
                the spec's other hard requirements         likewise

for one body, or for several at once. Every row of the report may be the objective or a requirement:

*Sampled* rows (contact, CoP, torque and its rate, friction, and by ``approach`` settling, overshoot and the error at
the end) are taken at samples of the trajectory, ``routh-margin`` and ``decay-rate`` from the polynomial.
``step-slope`` and ``push`` are scenarios of their own, whose disturbance has the required size, or grows with v. The
others (loop margins, sampling) are *modelled*: see ``modelled`` and ``sequential``. ``goals`` is
v <= (value - level)/size of every soft requirement: its largest shortfall is minimised.

*The poles.* The tests q_2 >= 0, q_0 >= 0, q_2 q_1 >= q_0 on the polynomial shifted by sigma are not enough when they
are closed, as constraints of a program are: q_2 = q_0 = 0 with q_1 < 0 passes them, with a pole on the right,
and an optimiser finds that corner. Nor is there a constraint qualification at a triple pole, where the best decay rate
often lies. Therefore the polynomial is factored: (mu + a)(mu² + b mu + c) with a, b, c >= 0 as variables of the program
is every cubic without roots in the open right half-plane, and nothing else (two quadratics, where the law adapts). The
coefficients are affine in A, so that the two ends of its range suffice (law (20), and where the law adapts: every
environment on the way).

*The samples.* The trajectory is a function of K alone (single shooting with exact sensitivities, ``design.analysis.
motion``). Of the samples, which are many thousands, a program sees few; those that its answer violates, or that lie
lowest, are added until none at full resolution is violated (exchange, as in semi-infinite programming: Hettich and
Kortanek, SIAM Review 35, 1993).

*The starts.* A survey of the box gives the starts; all are optimised on a coarse time grid, the best of the distinct
optima at full resolution. The answer is judged by ``design.analysis.verdict`` and by a second integrator that shares
nothing with this program; if they disagree with the solver, they win.

*No feasible point.* Then the smallest margin of all requirements, each in its scale, is maximised instead: the answer
says which requirement stands in the way, and by how much the best point misses it.
"""

from problems.gains.grid import Grid, Point
from problems.gains.program import Read, pose
from problems.gains.question import Question, question_decay
from problems.gains.search import solve

__all__ = ["Grid", "Point", "Question", "Read", "pose", "question_decay", "solve"]
