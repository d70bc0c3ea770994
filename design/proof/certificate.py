"""What is proved, as a certificate that ``design.checking`` confirms: trajectories, norms, and how the box is cut.

The trajectories are Taylor series of degree ``DEGREE`` of the loop, one piece after another, for the middle of a part
and the ends of each parameter that moves; their pieces are as long as the last term of the series allows. Nothing here
needs to be right: the checker takes none of it on trust, and what it does not confirm is not written.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from design import checking
from design.checking import verdict, world
from design.checking.balls import ONE
from design.checking.tube import STORED, Found, walk
from design.errors import BadInput
from design.model.laws import Gains
from design.model.stability import closed_loop_matrix
from design.proof.box import Proof, levels
from design.proof.case import NAMES, Case, NotProved
from design.proof.jacobian import ranges
from design.proof.norm import contracting
from design.spec.load import Source
from design.spec.setting import Setting

Array = NDArray[np.float64]

DEGREE = 7
TERM = 1e-7
"""The largest last term of a series, in what it does to the torque [N m]."""
LONGEST = 0.05
"""Of a piece [s]."""
CALM = 12.0
"""Time constants of the slowest pole for which the loop is watched after the end."""
UNITS = 1 << 24
"""The shortest piece is one of so many of its segment."""
MARGIN = Fraction(1, 10**5)
"""What is given away of the proved CoP margin [m], and a thousandth of it of the proved decay rate."""
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
    text = source.text
    if hashlib.sha256(text.encode()).hexdigest() != source.sha256:
        text = "\ufeff" + text
    document: dict[str, Any] = {
        "format": verdict.FORMAT,
        "spec": {"name": source.spec.name, "sha256": hashlib.sha256(text.encode()).hexdigest(), "text": text},
        "law": {"kind": problem.law, "kp": gains.K_p, "kd": gains.K_d, "kf": gains.K_f},
        "scale": scale,
        "scenarios": [],
    }
    exact = world.read(text)
    for proof in proved:
        try:
            document["scenarios"].append(_Scenario(exact, problem, gains, proof, scale, say).entry())
        except (checking.Refused, NotProved) as error:
            message = f"{proof.scenario}: is proved, but could not be certified: {error}"
            raise BadInput(message, key="--certificate") from None
    written = json.dumps(document, separators=(",", ":"), ensure_ascii=False, allow_nan=False) + "\n"
    answer = verdict.check(written.encode())
    if not answer.confirmed:
        message = f"the certificate is not confirmed: {answer.why}"
        raise BadInput(message, key="--certificate")
    return written


@dataclass(eq=False)
class _Worlds:
    """The loop for several bodies and worlds at once: each number an array (w,); see ``design.checking.tube``."""

    M: Array
    L: Array
    I: Array
    ell: Array
    slope: Array
    g: float
    gains: Gains
    theta_d: float
    kind: str
    size: int

    def series(self, z: Array, h: Array, signal: Array, climb: Array) -> Array:
        """Taylor coefficients (size, DEGREE + 1, w), in shares of ``h`` (w,), from the states ``z`` (size, w).

        ``signal`` and ``climb`` (j,): the signal at the beginning and what it gains within the piece.
        """
        n = DEGREE + 1
        x = np.zeros((self.size, n, len(h)))
        x[:, 0] = z
        linear = np.zeros((2, len(signal), len(h)))
        linear[0], linear[1] = signal[:, None], climb[:, None]
        side, down = np.zeros((2, len(h))), np.zeros((2, len(h)))
        down[0] = self.M * self.g
        phi = x[0].copy()
        if self.kind == "slope":
            tilt = linear[:, 0] * self.slope
            phi[:2] += tilt
        elif self.kind == "platform":
            side = -self.M * linear[:, 0]
        else:
            side, down = linear[:, 0], down - linear[:, 1]
        S, C = np.zeros((n, len(h))), np.zeros((n, len(h)))
        S[0], C[0] = np.sin(phi[0]), np.cos(phi[0])
        K = self.gains
        for k in range(n - 1):
            if k:
                turns = np.arange(1.0, k + 1)[:, None] * phi[1 : k + 1]
                S[k] = (turns * C[k - 1 :: -1][:k]).sum(axis=0) / k
                C[k] = -(turns * S[k - 1 :: -1][:k]).sum(axis=0) / k
            tau = -K.K_p * x[0, k] - K.K_d * x[1, k] + (K.K_f * x[2, k] if self.size == 3 else 0.0)
            if k == 0:
                tau = tau + K.K_p * self.theta_d
            moment = down[0] * S[k] + side[0] * C[k]
            if k:
                moment = moment + down[1] * S[k - 1] + side[1] * C[k - 1]
            share = h / (k + 1)
            x[0, k + 1] = share * x[1, k]
            x[1, k + 1] = share * (self.L * moment + tau) / self.I
            if self.size == 3:
                x[2, k + 1] = share * tau / self.ell
            phi[k + 1] = x[0, k + 1] + (tilt[1] if self.kind == "slope" and k == 0 else 0.0)
        return x


class _Scenario:
    """The entry of one scenario, and what is needed on the way to it."""

    def __init__(
        self, exact: dict[str, Any], problem: Setting, gains: Gains, proof: Proof, scale: float,
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
        self.decay = self._claimed("decay-rate", _decimal(found["decay-rate"]) - MARGIN / 1000)
        self.found: list[Found] = []

    def _claimed(self, row: str, value: Fraction) -> Fraction:
        return max(_decimal(self.needs[row]), Fraction(math.floor(value * 10**9), 10**9))

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

    def _part(self, box: world.Box) -> tuple[dict[str, Any], Found]:
        case = self._case(box)
        after = self._after(case, box)
        pieces, G, defect = self._trajectory(case, box, after)
        reach = 1e-6
        for _ in range(ROUNDS):
            wide = 1.1 * reach * max(map(abs, G)) + 1e-9
            P, rate = contracting(case, ranges(case, (G[0] - wide, G[1] + wide)), defect)
            P /= np.trace(P)
            part = {
                "norm": [[float(P[i, j]) for j in range(i + 1)] for i in range(len(P))],
                "rate": 0.999 * rate, "reach": reach, "after_s": after, "segments": pieces,
            }  # fmt: skip
            try:
                return part, walk(self.exact, self.table, self.gains, self.g, box, _exactly(part), self.margin)
            except checking.Refused as refusal:
                if "reach" not in str(refusal):
                    raise
                reach = 1.3 * float(str(refusal).split()[-2])
            if reach > 0.5:
                break
        message = "the tube grows beyond what can be assumed of it"
        raise NotProved(message)

    def _case(self, box: world.Box) -> Case:
        """The part as the prover has it, for its norm."""
        middle = {name: float(value) for name, (value, _) in box.items()}
        scenario = self.problem.scenario(self.proof.scenario)
        M, L, I, m, ell = (middle[name] for name in NAMES[:5])
        biped = replace(self.problem.under(scenario).biped, M=M, L=L, I=I, m=m, ell=ell)
        radii = [float(half) for _, half in box.values()]
        radii[5] = math.radians(radii[5])
        return Case(
            biped=biped, kind=self.problem.law, gains=self.its, theta_d=self.problem.theta_d,
            scenario=scenario, radii=tuple(radii), step=self.problem.step,
        )  # fmt: skip

    def _after(self, case: Case, box: world.Box) -> float:
        if world.segments(self.table, box)[1] is None:
            return 0.0
        biped = case.biped
        matrix = closed_loop_matrix(biped, case.kind, case.gains, biped.M * biped.g, biped.weight)
        return round(CALM / max(-float(np.linalg.eigvals(matrix).real.max()), 0.1), 3)

    def _trajectory(
        self, case: Case, box: world.Box, after: float
    ) -> tuple[list[list[Any]], tuple[float, float], Array]:
        """The pieces of each segment, about the range of G, and about the sizes of the defect (n,) [1/s]."""
        moving = [name for name, (_, half) in box.items() if half]
        ends = [{}, *({name: sign * float(box[name][1])} for name in moving for sign in (1.0, -1.0))]
        number = {
            name: np.array([float(box[name][0]) + end.get(name, 0.0) for end in ends]) for name in NAMES
        }  # fmt: skip
        size = len(self.gains)
        loops = _Worlds(
            M=number["M"], L=number["L"], I=number["I"], ell=number["ell"], slope=np.radians(number["slope"]),
            g=float(self.g), gains=self.its, theta_d=self.problem.theta_d, kind=self.table["kind"], size=size,
        )  # fmt: skip
        stretch = number["ramp"] / number["ramp"][0] if number["ramp"][0] else np.ones(len(ends))
        scenario = case.scenario
        z = np.zeros((size, len(ends)))
        z[0], z[1] = scenario.theta0, scenario.omega0
        felt = np.array([self.its.K_p, self.its.K_d, self.its.K_f])[:size]
        centre = _recentring()
        segments, _ = world.segments(self.table, box)
        found: list[list[Any]] = []
        low, high = math.inf, -math.inf
        square = sum(float(half / middle) ** 2 for middle, half in box.values() if middle)
        defect = np.zeros(size)
        h = 1e-3
        for k, segment in enumerate(segments):
            length = float(segment.length) + (after if k + 1 == len(segments) else 0.0)
            first = np.array([float(value) for value in segment.first])
            gain = np.array([float(value) for value in segment.last]) - first
            grows = stretch if segment.grows else np.ones(len(ends))
            done, pieces = 0, []
            h = min(h, 1e-3)
            while done < UNITS:
                weight = min(max(int(h / length * UNITS), 1), UNITS - done)
                real = weight / UNITS * length
                x = loops.series(z, real * grows, first + gain * (done / UNITS), gain * (weight / UNITS))
                term = float((np.abs(x[:, -1]) * felt[:, None]).max())
                better = real * min(max(0.9 * (TERM / max(term, 1e-300)) ** (1 / DEGREE), 0.2), 2.0)
                h = min(better, LONGEST)
                if term > 4 * TERM and weight > 1:
                    continue
                done += weight
                defect = np.maximum(defect, (np.abs(x[:, -1]) + square * np.abs(x[:, 1])).max(axis=1) / real)
                z = x.sum(axis=1)
                if not (np.isfinite(z).all() and (np.abs(z[0]) < 1.5).all()):
                    message = "the body falls"
                    raise NotProved(message)
                pieces.append([weight, *_rows(np.einsum("sdw,ed->sew", x, centre))])
                G = self._stiffness(loops, z, first + gain * (done / UNITS))
                low, high = min(low, float(G.min())), max(high, float(G.max()))
            found.append(pieces)
        spare = 0.002 * max(abs(low), abs(high))
        if moving:  # corners of the box
            spare += sum(float(box[name][1] / box[name][0]) for name in ("M", "L")) * high
        return found, (low - spare, high + spare), defect

    @staticmethod
    def _stiffness(loops: _Worlds, z: Array, signal: Array) -> Array:
        if loops.kind == "slope":
            return np.asarray(loops.M * loops.g * loops.L * np.cos(z[0] + signal[0] * loops.slope))
        side = -loops.M * signal[0] if loops.kind == "platform" else signal[0]
        down = loops.M * loops.g - (0.0 if loops.kind == "platform" else signal[1])
        return np.asarray(loops.L * (down * np.cos(z[0]) - side * np.sin(z[0])))


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


def _recentring() -> Array:
    """From shares of a piece, 0 to 1, to v from -1 to 1: (degree, degree)."""
    n = DEGREE + 1
    return np.array([[math.comb(d, e) * 0.5**d if e <= d else 0.0 for d in range(n)] for e in range(n)])


def _decimal(value: float) -> Fraction:
    return Fraction(repr(float(value)))


def _below(units: int) -> float:
    """A number of seven digits that is not above so many 2^-64."""
    value = units / ONE
    return math.floor(value * 1e4) / 1e4


def _exactly(part: dict[str, Any]) -> dict[str, Any]:
    """The numbers as the checker will read them."""
    return {
        **part, "norm": [[_decimal(entry) for entry in row] for row in part["norm"]],
        **{key: _decimal(part[key]) for key in ("rate", "reach", "after_s")},
    }  # fmt: skip
