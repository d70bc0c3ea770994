"""What is proved, as a certificate that ``design.checking`` confirms: trajectories, norms, and how the box is cut.

The trajectories and the norm are the prover's (``design.proof.tube``). Nothing here needs to be right: the checker
takes none of it on trust, and what it does not confirm is not written.
"""

from __future__ import annotations

import hashlib
import json
import math
import time
from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from design import checking
from design.checking import verdict, world
from design.checking.balls import ONE
from design.checking.linear import check_decay
from design.checking.tube import STORED, Found, walk
from design.errors import BadInput
from design.model.environment import varied
from design.model.laws import Gains
from design.proof.box import Proof, levels
from design.proof.case import NAMES, Case, NotProved, OutOfTime
from design.proof.jacobian import ranges
from design.proof.norm import contracting
from design.proof.taylor import restrictions
from design.proof.trajectory import Trajectory
from design.proof.tube import Tube
from design.spec.load import Source
from design.spec.setting import Setting

Array = NDArray[np.float64]

CUTS = 4
"""Pieces that each of the prover's becomes until the scenario ends: the checker bounds one less sharply."""
GIVEN = 0.3
"""By what part of itself the range of the stiffness may be more than the prover's."""
REACH = 4.0
"""How many times the prover's reach is assumed: it costs little, and the checker's tube is wider."""
MARGIN = Fraction(1, 10**5)
"""What is given away of the proved CoP margin [m], and a thousandth of it of the proved decay rate."""
SHARES = ("1", "0.999", "0.99", "0.95", "0.9", "0.8", "0.65", "0.5", "0.2", "0")
"""Parts of the proved decay rate that a certificate may claim."""
DEEP = 3
"""After so many cuts a box is not cut for the CoP margin alone."""
ROUNDS = 6


def write(
    source: Source, problem: Setting, gains: Gains, proofs: list[Proof], scale: float = 1.0,
    say: Callable[[str], None] = lambda _: None,
) -> str:  # fmt: skip
    """The text of a certificate for the proved scenarios of ``proofs``; raises ``BadInput`` where it cannot be made."""
    proved = [proof for proof in proofs if proof.answer == "proved"]
    if not proved:
        message = "nothing is proved, so there is nothing to certify"
        raise BadInput(message, key="--certificate")
    entries = []
    for proof in proved:
        try:
            entries.append(confirmed(source, problem, gains, proof, scale, say=say)[0])
        except Unconfirmed as error:
            message = f"{proof.scenario}: is proved, but could not be certified: {error}"
            raise BadInput(message, key="--certificate") from None
    return document(source, problem, gains, entries, scale)


class Unconfirmed(Exception):
    """No certificate of a scenario could be written that the checker confirms; the text says why."""


def confirmed(
    source: Source, problem: Setting, gains: Gains, proof: Proof, scale: float = 1.0, *,
    seconds: float = math.inf, say: Callable[[str], None] = lambda _: None,
) -> tuple[dict[str, Any], verdict.Answer]:  # fmt: skip
    """A certificate's entry for one proved scenario, and the checker's answer, which is that it is confirmed.

    Both within so many ``seconds``. Raises ``Unconfirmed``.
    """
    scenario = _Scenario(world.read(_text(source)), problem, gains, proof, scale, time.monotonic() + seconds, say)
    try:
        entry = scenario.entry()
        scenario.look()
    except (checking.Refused, NotProved) as error:
        raise Unconfirmed(str(error)) from None
    except OutOfTime:
        message = "the time limit came before the independent checker had confirmed it"
        raise Unconfirmed(message) from None
    answer = verdict.check(document(source, problem, gains, [entry], scale).encode())
    if not answer.confirmed:
        raise Unconfirmed(answer.why)
    return entry, answer


def _text(source: Source) -> str:
    """The spec's text as its digest has it."""
    same = hashlib.sha256(source.text.encode()).hexdigest() == source.sha256
    return source.text if same else "\ufeff" + source.text


def document(source: Source, problem: Setting, gains: Gains, entries: list[dict[str, Any]], scale: float = 1.0) -> str:
    """The text of a certificate with these entries."""
    text = _text(source)
    facts = {
        "format": verdict.FORMAT,
        "spec": {"name": source.spec.name, "sha256": hashlib.sha256(text.encode()).hexdigest(), "text": text},
        "law": {"kind": problem.law, "kp": gains.K_p, "kd": gains.K_d, "kf": gains.K_f},
        "scale": scale,
        "scenarios": entries,
    }
    return json.dumps(facts, separators=(",", ":"), ensure_ascii=False, allow_nan=False) + "\n"


class _Scenario:
    """The entry of one scenario, and what is needed on the way to it."""

    def __init__(
        self, exact: dict[str, Any], problem: Setting, gains: Gains, proof: Proof, scale: float, deadline: float,
        say: Callable[[str], None],
    ) -> None:  # fmt: skip
        self.exact, self.problem, self.its, self.proof, self.say = exact, problem, gains, proof, say
        self.table = next(each for each in exact["scenarios"] if each["name"] == proof.scenario)
        self.box = world.whole_box(exact, self.table, Fraction(repr(scale)))
        law = {"kind": problem.law, "kp": _decimal(gains.K_p), "kd": _decimal(gains.K_d), "kf": _decimal(gains.K_f)}
        self.gains = verdict.law(law)[1]
        self.g = world.gravity(exact)
        self.needs = levels(problem)
        found = proof.value
        self.margin = self._claimed("cop-margin", _decimal(found["cop-margin"]) - MARGIN)
        self.decay = self._decay(_decimal(found["decay-rate"]) - MARGIN / 1000)
        self.found: list[Found] = []
        self.deadline = deadline
        self.walked = 0.0  # seconds that the checker took for what is kept, and will take again

    def _claimed(self, row: str, value: Fraction) -> Fraction:
        return max(_decimal(self.needs[row]), Fraction(math.floor(value * 10**9), 10**9))

    def _decay(self, most: Fraction) -> Fraction:
        """The largest decay rate that the checker sees of the whole box, which it does not cut for it."""
        for share in SHARES:
            claimed = self._claimed("decay-rate", most * Fraction(share))
            try:
                check_decay(claimed, self.gains, verdict.linear_ranges(self.table, self.box, self.g))
            except checking.Refused:
                continue
            return claimed
        return self._claimed("decay-rate", Fraction(0))

    def entry(self) -> dict[str, Any]:
        """Name, claims and tree."""
        tree = self._tree(self.box, 0)
        claims = {
            "toe-force": _below(min(min(each.toe) for each in self.found)),
            "heel-force": _below(min(min(each.heel) for each in self.found)),
            "cop-margin": float(self.margin),
            "decay-rate": float(self.decay),
        }
        if "torque" in self.needs:
            claims["torque"] = -_below(-max(max(each.torque) for each in self.found))
        return {"name": self.proof.scenario, "claims": claims, "tree": tree}

    def _tree(self, box: world.Box, depth: int) -> dict[str, Any]:
        why = ""
        try:
            part, found = self._part(box)
        except (checking.Refused, NotProved) as error:
            why = str(error)
        else:
            self._lower(found, depth)
            why = self._broken(found)
            if not why:
                self.found.append(found)
                self.say(f"{self.proof.scenario}: {len(self.found)} parts certified")
                return {"part": part}
        moving = [name for name, (_, half) in box.items() if half]
        if not moving or depth >= 12:
            raise checking.Refused(why)
        name = max(moving, key=lambda name: box[name][1] / (abs(box[name][0]) or 1))
        return {"cut": name, "halves": [self._tree(half, depth + 1) for half in verdict.halves(box, name)]}

    def _lower(self, found: Found, depth: int) -> None:
        """Claim no more of the CoP margin than the checker sees, where that is most of what is proved.

        A margin smaller by d leaves d (F_T + F_H) more.
        """
        loads = [toe + heel for toe, heel in zip(found.toe, found.heel, strict=True)]
        if min(found.cop) >= 0 or min(loads) <= 0:
            return
        least = [min(pair) for pair in zip(found.cop[::2], found.cop[1::2], strict=True)]
        lacking = max(Fraction(-left, load) for left, load in zip(least, loads, strict=True))
        lower = self._claimed("cop-margin", self.margin - Fraction(101, 100) * lacking - MARGIN / 10)
        if lower < self.margin and (lower > Fraction(9, 10) * self.margin or depth >= DEEP):
            gained = self.margin - lower
            found.cop = [math.floor(left + gained * load) for left, load in zip(least, loads, strict=True)]
            self.margin = lower

    def _broken(self, found: Found) -> str:
        for row, values in (("toe-force", found.toe), ("heel-force", found.heel)):
            if min(values) < _decimal(self.needs[row]) * ONE:
                return f"{row} is shown to be at least {min(values) / ONE:.6g} only"
        if min(found.cop) < 0:
            return f"cop-margin: {float(self.margin):.6g} is not shown"
        if "torque" in self.needs and max(found.torque) > _decimal(self.needs["torque"]) * ONE:
            return f"torque is shown to be at most {max(found.torque) / ONE:.6g} only"
        return ""

    # ---- a part

    def look(self) -> None:
        """Raise ``OutOfTime`` where the checker could not read again, by the deadline, what is kept."""
        if time.monotonic() + self.walked > self.deadline:
            raise OutOfTime

    def _part(self, box: world.Box) -> tuple[dict[str, Any], Found]:
        check_decay(self.decay, self.gains, verdict.linear_ranges(self.table, box, self.g))
        tube = Tube(self._case(box), self.deadline)
        reach, G = tube.ranges()
        segments = self._segments(tube.trajectory)
        after = _decimal(tube.case.scenario.duration) - self.table["duration_s"]
        wide = GIVEN * (G[1] - G[0]) + 1e-6 * max(map(abs, G))
        for _ in range(ROUNDS):
            over = ranges(tube.case, (G[0] - wide, G[1] + wide))
            norm = contracting(tube.case, over, tube.defects, tube.h, self.deadline)
            part = {
                "frame": norm.S.tolist(), "blocks": list(norm.blocks), "rates": (0.999 * norm.rates).tolist(),
                "couplings": (1.001 * norm.couplings).tolist(), "reach": REACH * reach + 1e-9,
                "after_s": float(after), "segments": segments,
            }  # fmt: skip
            self.look()
            began = time.monotonic()
            try:
                shown = walk(
                    self.exact, self.table, self.gains, self.g, box, _exactly(part), self.margin, self.look
                )  # fmt: skip
                self.walked += time.monotonic() - began
                return part, shown
            except checking.Refused as refusal:
                if "reach" not in str(refusal):
                    raise
                reach, wide = float(str(refusal).split()[-2]), 2 * wide
            if reach > 0.5:
                break
        message = "the tube grows beyond what can be assumed of it"
        raise NotProved(message)

    def _case(self, box: world.Box) -> Case:
        """The part as the prover has it."""
        middle = {name: float(value) for name, (value, _) in box.items()}
        scenario = self.problem.scenario(self.proof.scenario)
        M, L, I, m, ell = (middle[name] for name in NAMES[:5])
        biped = replace(self.problem.under(scenario).biped, M=M, L=L, I=I, m=m, ell=ell)
        radii = [float(half) for _, half in box.values()]
        radii[5] = math.radians(radii[5])
        scenario = varied(
            self.problem.scenario(self.proof.scenario), biped, slope=lambda _: math.radians(middle["slope"]),
            ramp=lambda _: middle["ramp"],
        )  # fmt: skip
        return Case(
            biped=biped, kind=self.problem.law, gains=self.its, theta_d=self.problem.theta_d,
            scenario=scenario, radii=tuple(radii), step=self.problem.step,
        )  # fmt: skip

    def _segments(self, found: Trajectory) -> list[list[Any]]:
        """The pieces of each segment: a weight, and rows of coefficients by state; each of the prover's is cut."""
        segments, number = [], 0
        for weights in found.weights:
            pieces: list[Any] = []
            for weight in weights:
                cuts = CUTS if found.edges[number] < self.table["duration_s"] else 1
                parts = np.einsum("wsd,jde->jsew", found.c[number], restrictions(cuts))
                pieces += [[CUTS // cuts * weight, *_rows(part)] for part in parts]
                number += 1
            segments.append(pieces)
        return segments


def _rows(c: Array) -> list[list[list[int]]]:
    """By state, rows of integers, nominal and half the difference for each parameter; ``c`` (size, degree, worlds)."""
    found = []
    for state in c:
        rows = [state[:, 0], *(0.5 * (state[:, j] - state[:, j + 1]) for j in range(1, state.shape[1], 2))]
        found.append([_trimmed([round(float(value) * 2.0**STORED) for value in row]) for row in rows])
    return found


def _trimmed(row: list[int]) -> list[int]:
    while row and not row[-1]:
        row = row[:-1]
    return row


def _decimal(value: float) -> Fraction:
    return Fraction(repr(float(value)))


def uncovered(source: Source) -> str:
    """What of a spec a certificate does not cover, in words; empty where it covers all."""
    try:
        world.read(source.text)
    except (checking.Refused, checking.Malformed, ValueError, ArithmeticError) as error:
        return str(error)
    return ""


def _below(units: int) -> float:
    """A number of seven digits that is not above so many 2^-64."""
    value = units / ONE
    return math.floor(value * 1e4) / 1e4


def _exactly(part: dict[str, Any]) -> dict[str, Any]:
    """The numbers as the checker will read them."""
    return {
        **part, **{key: _decimal(part[key]) for key in ("reach", "after_s")},
        "rates": list(map(_decimal, part["rates"])),
        **{key: [list(map(_decimal, row)) for row in part[key]] for key in ("frame", "couplings")},
    }  # fmt: skip
