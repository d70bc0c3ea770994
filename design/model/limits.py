"""A Limit: one constraint along a trajectory, defined once for synthesis, report, MPC and proof.

It is a CasADi function of (x, tau, F) with one or several components, and a required level; it is met at an instant
if and only if every component of its margin is >= 0 there. Smooth components instead of an absolute value: the same
functions are differentiated by the optimisers.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from design.model.plant import Plant

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Required:
    """What a spec asks of one row: the ``level`` in the row's unit, and whether it is only wished (``soft``)."""

    level: float
    soft: bool = False


@dataclass(frozen=True, eq=False, kw_only=True)
class Limit:
    """One constraint along a trajectory.

    ``quantity``: CasADi function (x (2), tau, F (2)) -> components (c), in ``unit``. ``sense``: the quantity must be
    ``at least`` or ``at most`` the level. ``scale``: a typical size of the quantity [unit]. ``required``: None if the
    spec asks nothing. ``why``: what happens if it is broken. ``floor``: a level that is required even where the spec's
    own wish is soft.
    """

    id: str
    equation: str
    unit: str
    scale: float
    sense: Literal["at least", "at most"]
    quantity: ca.Function
    required: Required | None
    why: str
    floor: float | None = None

    @property
    def hard_level(self) -> float | None:
        """The level that must be kept: the required one, or below a soft one the ``floor`` that nature sets."""
        if self.required is None or self.required.soft:
            return self.floor
        return self.required.level

    def margin(self, quantity: Any, level: Any) -> Any:
        """Margin of the ``quantity`` (numbers or CasADi expressions) against ``level``; met where >= 0."""
        return quantity - level if self.sense == "at least" else level - quantity

    def value(self, quantity: Array) -> Array:
        """The component that is nearest to breaking the limit: (c, n) -> (n,)."""
        return np.asarray(quantity.min(axis=0) if self.sense == "at least" else quantity.max(axis=0))


def limits(plant: Plant, required: Mapping[str, Required], *, field: bool = False) -> list[Limit]:
    """The limits along a trajectory.

    ``required``: ``contact-force``, ``cop-margin``, ``torque``, ``friction`` -> level. ``field``: the force is that of
    an acceleration field (``Scenario.field``); m/M times it acts on the foot, which friction must hold too.
    """
    x, tau, F = ca.SX.sym("x", 2), ca.SX.sym("tau"), ca.SX.sym("F", 2)
    reaction = plant.forces(x, tau, F)
    along, load = plant.friction(x, tau, F), reaction[0] + reaction[1]
    if field:
        share = plant.biped.foot_share
        along, load = along - share * F[0], load - (share - plant.biped.kappa) * F[1]
    slip = along / load
    P, ell, toe, heel = plant.cop(x, tau, F), plant.biped.ell, plant.biped.toe, plant.biped.heel

    def function(name: str, *components: ca.SX) -> ca.Function:
        return ca.Function(name, [x, tau, F], [ca.vertcat(*components)], ["x", "tau", "F"], ["quantity"])

    contact = required.get("contact-force")
    tips = "the foot turns about its {} and the biped falls"
    weight = plant.biped.weight
    return [
        Limit(id="toe-force", equation="(5)", unit="N", scale=weight, sense="at least",
              quantity=function("toe_force", reaction[0]), required=contact, why=tips.format("heel"), floor=0.0),
        Limit(id="heel-force", equation="(6)", unit="N", scale=weight, sense="at least",
              quantity=function("heel_force", reaction[1]), required=contact, why=tips.format("toe"), floor=0.0),
        Limit(id="cop-margin", equation="(18)", unit="m", scale=ell, sense="at least",
              quantity=function("cop_margin", toe - P, heel + P), required=required.get("cop-margin"),
              why="the centre of pressure comes near the end of the foot, where it turns", floor=0.0),
        Limit(id="torque", equation="(8)", unit="N m", scale=weight * ell, sense="at most",
              quantity=function("torque", tau, -tau), required=required.get("torque"),
              why="the actuator cannot give the torque"),
        Limit(id="friction", equation="(7)", unit="1", scale=1.0, sense="at most",
              quantity=function("friction", slip, -slip), required=required.get("friction"),
              why="the foot slides"),
    ]  # fmt: skip
