"""How far the real body and world may be from the nominal ones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

from design.model.body import Biped
from design.model.environment import Scenario, varied


@dataclass(frozen=True, kw_only=True)
class Spread:
    """A half-width: ``absolute``, in the unit of the quantity, and ``part`` of its nominal value."""

    absolute: float = 0.0
    part: float = 0.0

    def around(self, nominal: float, share: float) -> float:
        """The value at ``share``, from -1 to 1, of the half-width from the ``nominal`` one."""
        return nominal + share * (self.absolute + self.part * abs(nominal))


@dataclass(frozen=True, kw_only=True)
class Tolerances:
    """Spreads of the body's M, L, I, m, ell, and of the world: ``slope`` [rad] and ``ramp`` [s]."""

    M: Spread = Spread()
    L: Spread = Spread()
    I: Spread = Spread()
    m: Spread = Spread()
    ell: Spread = Spread()
    slope: Spread = Spread()
    ramp: Spread = Spread()

    def scaled(self, factor: float) -> Tolerances:
        """The same box, ``factor`` times as wide."""
        spreads = {field.name: getattr(self, field.name) for field in fields(self)}
        return Tolerances(
            **{name: Spread(absolute=factor * its.absolute, part=factor * its.part) for name, its in spreads.items()}
        )

    @property
    def moving(self) -> list[int]:
        """Which of the seven numbers are uncertain."""
        return [k for k, field in enumerate(fields(self)) if getattr(self, field.name) != Spread()]

    @property
    def none(self) -> bool:
        """Whether everything is as the nominal numbers say."""
        return not self.moving

    def drawn(self, biped: Biped, scenario: Scenario, shares: Sequence[float]) -> tuple[Biped, Scenario]:
        """The body and the world at ``shares`` (7), each from -1 to 1, of the half-widths."""
        if self.none:
            return biped, scenario
        body = ("M", "L", "I", "m", "ell")
        real = replace(
            biped,
            **{
                name: getattr(self, name).around(getattr(biped, name), share)
                for name, share in zip(body, shares[:5], strict=True)
            },
        )
        return real, varied(
            scenario,
            real,
            slope=lambda angle: self.slope.around(angle, shares[5]),
            ramp=lambda time: self.ramp.around(time, shares[6]),
        )
