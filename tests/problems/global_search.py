"""A second way to the best gains: SciPy's differential evolution on plain numpy marches, for comparison.

It shares the equations of motion with the program, but neither its sensitivities, its samples, nor its way of search.
"""

import math
from dataclasses import replace

import numpy as np
from scipy.optimize import differential_evolution

from design.analysis.many import extremes
from design.analysis.survival import step_slope
from design.analysis.verdict import judge
from design.model.body import Biped
from design.model.environment import profile, slope
from design.model.laws import Gains
from design.model.limits import Required
from design.model.margins import loop_margins
from design.model.uncertainty import Tolerances
from design.spec.load import load
from design.spec.setting import setting
from problems import gains as question

LOST = -1e3
STEP = 0.004
"""Of the marches [s]: at the coarse step of the program, what happens between the samples costs 1e-4 of a force."""


def posed(name, objective, **levels):
    """A built-in spec, or one of the two written here, with another objective and hard ``levels``."""
    base = WRITTEN[name]() if name in WRITTEN else setting(load(name).spec)
    required = {**base.required, **{id.replace("_", "-"): Required(level=level) for id, level in levels.items()}}
    return replace(base, objective=objective, required=required)


def _lean():
    """Law (20) on a slope that tilts to 15 degrees in 2 s."""
    base = setting(load("slope").spec)
    hill = slope(base.biped, name="hill", angle=math.radians(15.0), ramp=2.0, duration=8.0)
    return replace(base, law="cop", scenarios=(hill,))


def _gust():
    """A heavy body in a gust that comes and goes."""
    biped = Biped(M=80.0, L=0.95, I=4 / 3 * 80.0 * 0.95**2, m=1.5, ell=0.12)
    points = np.array([[0.5, 0.0, 0.0], [0.7, 35.0, 0.0], [1.2, 35.0, -20.0], [1.5, 0.0, 0.0]])
    gust = profile(name="gust", points=points, duration=6.0)
    bounds = np.array([[0.0, 6000.0], [0.0, 3000.0], [0.0, 6.0]])
    return replace(setting(load("slope").spec), biped=biped, scenarios=(gust,), bounds=bounds, gains=None)


WRITTEN = {"lean": _lean, "gust": _gust}


class Rival:
    """The objective and the requirements of a problem at many gains at once."""

    def __init__(self, problem):
        self.problem, self.asked = problem, question.Question(problem)
        self.calls = 0

    def merit(self, K):
        """What is to be made large, for gains K (3, n); where a requirement is broken, less than ``LOST``."""
        problem, asked = self.problem, self.asked
        self.calls += K.shape[1]
        p = np.array([np.broadcast_arrays(*each.coefficients(K)) for each in asked.environments])  # (e, degree, n)
        decay = np.array([min(-np.roots([1.0, *one]).real.max() for one in p[:, :, k]) for k in range(K.shape[1])])
        missing = np.minimum(0.0, decay - asked.decay)
        runs = [
            extremes(
                problem.biped, problem.law, Gains(*K), scenario, Tolerances(), np.zeros((K.shape[1], 7)),
                step=STEP, theta_d=problem.theta_d, target=problem.target, adapt=problem.adapt,
            )
            for scenario in problem.scenarios
        ]  # fmt: skip
        contact = np.min([np.minimum(run.toe, run.heel) for run in runs], axis=0)
        cop = np.min([run.cop for run in runs], axis=0)
        missing += np.minimum(0.0, (contact - (asked.level("contact-force") or 0.0)) / problem.biped.weight)
        if (level := asked.level("cop-margin")) is not None:
            missing += np.minimum(0.0, (cop - level) / problem.biped.ell)
        kept = np.flatnonzero(missing >= 0)
        found = LOST + np.maximum(missing, LOST)
        known = {"contact-force": contact, "cop-margin": cop, "decay-rate": decay}.get(problem.objective)
        found[kept] = known[kept] if known is not None else [self._slow(Gains(*map(float, K[:, k]))) for k in kept]
        return np.nan_to_num(found, nan=2 * LOST, neginf=2 * LOST)

    def _slow(self, gains):
        problem = self.problem
        if problem.objective == "step-slope":
            return math.degrees(step_slope(problem.loop(), gains, self.asked.coarse_step).survived)
        margins = [
            loop_margins(problem.biped, problem.law, gains, each.place.A, each.place.load, problem.adapt)
            for each in self.asked.environments
        ]
        name = {"disk-margin": "disk", "delay-margin": "delay"}[problem.objective]
        return min(getattr(each, name) for each in margins)

    def search(self, maxiter, popsize, seed=1):
        """The best gains that it finds, and their merit."""
        box = list(zip(np.maximum(self.asked.lower, 1e-9 * self.asked.upper), self.asked.upper, strict=True))
        found = differential_evolution(
            lambda K: -self.merit(K), box, maxiter=maxiter, popsize=popsize, rng=seed, tol=1e-10, polish=False,
            vectorized=True, updating="deferred",
        )  # fmt: skip
        return Gains(*map(float, found.x)), -float(found.fun)

    def judged(self, gains):
        """The objective at ``gains`` by the verdict at full resolution, and the problem of whose answers they are one.

        Between the samples of the search a requirement may just be missed: then as much is asked as these gains keep.
        """
        problem, asked = self.problem, self.asked
        verdict = judge(problem, gains, also=(problem.objective,))
        required = dict(problem.required)
        for row in verdict.rows:
            if row.counts and row.status != "met":
                id = "contact-force" if row.id in ("toe-force", "heel-force") else row.id
                assert -row.margin < 1e-4 * asked.scale_of(id)
                required[id] = Required(level=min(required[id].level, row.value - 1e-9))
        return asked.score(asked.goal(problem.objective), gains, verdict), replace(problem, required=required)
