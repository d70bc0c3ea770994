"""From which states does a loop recover? An ellipsoid of them, as large as the certificate allows, and proved.

::

    maximise    volume of E = {x: (x - x*)ᵀ P (x - x*) <= 1}
    over        P, a bound e_max of |e|, multipliers lambda of the demands
    subject to  V = (x - x*)ᵀ P (x - x*) falls at least as exp(-2 alpha t), whatever the sine does in its sector
                |e| <= e_max on E
                F_T, F_H >= required on E, and the spec's limits of torque and centre of pressure likewise

x = (theta, omega, w) under a force that rests, x* = (theta_f, 0, 0), law force (8). ``loop`` states the sector of the
sine and how contact depends on the state, ``program`` is the semidefinite program, ``check`` the proof in rational
arithmetic: nothing is returned that it has not seen. E is invariant: from any of its states the nonlinear loop keeps
contact for all times and goes to rest.

Certificate: one quadratic V for all of the sector, and one multiplier a demand. The true recoverable set is larger; it
lies within the capturable strip |e + omega/Omega| <= ell (F_T + F_H)/(A L) (Hof 2005), which no ankle torque can leave.

References: Boyd, El Ghaoui, Feron and Balakrishnan 1994, chapters 5 and 7; Polyak 1998 for the S-procedure.
"""

from problems.region.check import broken
from problems.region.loop import Loop, NoRegion, posed
from problems.region.search import Region, solve

__all__ = ["Loop", "NoRegion", "Region", "broken", "posed", "solve"]
