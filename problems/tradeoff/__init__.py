"""What does one margin cost in another? The front of two or three margins, each point a design.

::

    maximise    v_j                                      one of the margins v_1 .. v_k, k = 2 or 3
    over        K in its bounds
    subject to  the spec's hard requirements             as in ``problems.gains``
                v_i >= e_i                               for the other margins, i != j

for levels e that are chosen one after another (epsilon-constraint: Haimes, Lasdon and Wismer, 1971). What should be
small, such as torque, is a margin with its sign turned.

*The ends* are the best design of each margin alone, from a full search of the box; among equally good ones the best in
the others. *Between them* the largest gap is halved, in the margins divided by their range over the ends: the margins
along which it is wide become requirements at its middle, the one along which it is least so is maximised, from the
gains between its neighbours'. Every point is refined at full resolution and checked as ``problems.gains`` checks its
answer; its values are those of the report's rows. A point that another one beats in everything is sought again from
that one, and left out if it stays beaten.

Where the answer for a level is a neighbour itself, the front *jumps* over that level: no design lies there, and the gap
is halved on its other side. With two margins the front is a line; with three its points are triangulated as they are
seen along (1, 1, 1), and the longest edge is halved.

*The knee* is the point that is farthest outside of the chord (with three margins: the plane) through the ends.

The front is what local optimisation finds from its neighbours; only the ends come from several starts.
"""

from problems.tradeoff.front import Front, solve
from problems.tradeoff.margins import Margins, margins
from problems.tradeoff.point import Design

__all__ = ["Design", "Front", "Margins", "margins", "solve"]
