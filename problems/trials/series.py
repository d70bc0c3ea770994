"""Trials in a row: each begins where the last one's estimate says, if the world still is what it was."""

from __future__ import annotations

import math
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from design.analysis.contraction import true_gains
from design.analysis.simulate import Trajectory, simulate
from design.analysis.transient import BAND, Transient, transient
from design.analysis.verdict import coarse_step
from design.errors import BadInput
from design.model.body import Biped
from design.model.closed_loop import ClosedLoop
from design.model.environment import Scenario
from design.model.laws import Gains
from design.spec.setting import Setting
from problems.trials.start import Reading, Start, begun, decide, from_reading, read

LEAST_BAND = math.radians(0.01)
"""A posture this near to theta_f has settled however small the first trial's transient was [rad]."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Trial:
    """One trial: its number in the series, the real ``biped`` and ``scenario``, and what came of it.

    ``reading`` is None where contact was lost or the body fell. ``refused``: what a start from the estimate that was
    not used would have come to.
    """

    number: int
    biped: Biped
    scenario: Scenario
    start: Start
    run: Trajectory
    approach: Transient
    reading: Reading | None
    refused: tuple[Start, Trajectory] | None
    distrust: str

    @property
    def kept(self) -> bool:
        """Whether toe and heel stayed on the ground and the body upright."""
        return self.run.lost_contact is None and self.run.fallen is None

    @property
    def theta_f(self) -> float:
        """The stationary posture (4) at the end of the real run [rad]."""
        return posture(self.run.F[:, -1], self.biped)


@dataclass(frozen=True, eq=False, kw_only=True)
class Series:
    """Trials in a row with the same real ``biped``; ``band`` [rad] is what settling is measured by in all of them."""

    trials: tuple[Trial, ...]
    biped: Biped
    gains: Gains
    band: float


def posture(F: np.ndarray, biped: Biped) -> float:
    """theta_f (4) [rad]."""
    return math.atan2(-float(F[0]), biped.M * biped.g - float(F[1]))


def plans(
    setting: Setting, trials: int | None, scenario: str | None, sequence: str | None
) -> list[tuple[Scenario, ...]]:
    """The scenario of each trial of each series; raises ``BadInput``."""
    if sequence is None:
        chosen = setting.scenarios if scenario is None else (setting.scenario(scenario),)
        return [(each,) * (trials or 3) for each in chosen]
    if scenario is not None:
        message = "names every trial's scenario; leave out --scenario"
        raise BadInput(message, key="--sequence")
    names = [name.strip() for name in sequence.split(",")]
    known = [each.name for each in setting.scenarios]
    for name in names:
        if name not in known:
            message = f"names {name[:60]!r}; the spec has: {', '.join(known)}"
            raise BadInput(message, key="--sequence")
    if trials is not None and trials != len(names):
        message = f"has {len(names)} trials, but --trials is {trials}; leave one of them out"
        raise BadInput(message, key="--sequence")
    return [tuple(setting.scenario(name) for name in names)]


def run(setting: Setting, gains: Gains, scenarios: Sequence[Scenario], *, seed: int, blind: bool = False) -> Series:
    """Trials through ``scenarios``, in order, with one real body drawn by ``seed``."""
    shares = np.random.default_rng([seed, 0]).uniform(-1.0, 1.0, 7).tolist()
    real = setting.tolerances.drawn(setting.biped, scenarios[0], shares)[0]
    its = true_gains(setting, gains, real)
    done: list[Trial] = []
    reading: Reading | None = None
    why_not = "the first trial"
    band = LEAST_BAND
    for number, nominal in enumerate(scenarios, 1):
        scenario = setting.tolerances.drawn(setting.biped, nominal, shares)[1]
        noise = np.random.default_rng([seed, zlib.crc32(nominal.name.encode()), number])
        start = decide(setting, real, scenario, reading, why_not, noise, blind=blind)
        happened = once(setting, real, its, scenario, start)
        if number == 1:
            first = np.abs(happened.theta - posture(happened.F[:, -1], real)).max()
            band = max(BAND * float(first), LEAST_BAND)
        refused = None
        if reading is not None and not start.estimated:
            wrong = from_reading(reading, "used in spite of that", start.away or 0.0)
            refused = wrong, once(setting, real, its, scenario, wrong)
        loop = looped(setting, real, start.theta_d)
        kept = happened.lost_contact is None and happened.fallen is None
        trial = Trial(
            number=number, biped=real, scenario=scenario, start=start, run=happened, refused=refused,
            approach=transient(loop, scenario, happened, band),
            reading=read(setting, happened, noise) if kept else None,
            distrust=coarse_step(loop, scenario, its, setting.step),
        )  # fmt: skip
        done.append(trial)
        reading, why_not = trial.reading, _why_not(trial)
    return Series(trials=tuple(done), biped=real, gains=its, band=band)


def once(setting: Setting, real: Biped, gains: Gains, scenario: Scenario, start: Start) -> Trajectory:
    """One closed-loop run of the ``real`` body from ``start``."""
    loop = looped(setting, real, start.theta_d)
    return simulate(loop, begun(scenario, start), gains, setting.step, start.s0)


def looped(setting: Setting, real: Biped, theta_d: float) -> ClosedLoop:
    """The law of ``setting``, which knows the nominal body, with another theta_d [rad] around the ``real`` one."""
    known = setting.biped if math.isfinite(setting.adapt) else None
    return replace(setting, biped=real, known=known, theta_d=theta_d).loop()


def _why_not(trial: Trial) -> str:
    if trial.run.lost_contact is not None:
        when, end = trial.run.lost_contact
        return f"trial {trial.number} lost contact at the {end} at {when:.3f} s, so its end says nothing"
    return f"trial {trial.number} fell at {trial.run.fallen:.3f} s" if trial.run.fallen is not None else ""
