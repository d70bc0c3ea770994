"""From the arguments of `poise synthesize` and `poise study` to what they print: open, ask, keep what is asked for.

Each imports its own question: that of a study takes half a second.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

from design.analysis.objectives import OBJECTIVES
from design.analysis.synthesis import Answer
from design.errors import BadInput
from design.model.laws import LawKind
from design.present import opening, store, synthesis, terminal
from design.solvers.outcome import Status
from design.spec.setting import Setting

if TYPE_CHECKING:
    from problems.bound import Bracket

BRACKET = 60.0
"""Seconds for the bracket of the global optimum."""


class Search(NamedTuple):
    """How `poise synthesize` is to search: what the command line says beside the spec."""

    maximise: str | None = None
    minimise: str | None = None
    starts: int | None = None
    nominal: bool = False
    bracket: bool = False
    sensitivities: bool = False
    why_not: bool = True
    time_limit: float = 600.0


def synthesize(
    spec: str, law: LawKind | None, search: Search, form: str, output: str | None, *, strict: bool
) -> tuple[str, str]:
    """What to print of the gains that are found, and the word of the status; the design is written to ``output``."""
    store.check_writable(output)
    source, problem = opening.opened(spec, law, strict=strict)
    problem = with_objective(problem, search.maximise, search.minimise)
    if search.nominal:
        problem = replace(problem, robust=False)
    if search.bracket:
        from problems import bound

        bound.check(problem)
    with terminal.progress() as say:
        problem, answer, bracket = _sought(problem, search, say)
    facts, lines = _told(bracket)
    stored = store.dumps(synthesis.document(source, problem, answer, facts))
    if output:
        store.write(output, stored)
    printed = (
        stored if form == "json" else synthesis.text(source, problem, answer, terminal.painter_for_output(), lines)
    )
    return printed, answer.outcome.status.word


def _told(bracket: Bracket | None) -> tuple[dict[str, Any] | None, list[str] | None]:
    """The bracket as stored and as words."""
    if bracket is None:
        return None, None
    from problems import bound

    return bound.facts(bracket), bound.lines(bracket)


def _sought(problem: Setting, search: Search, say: Callable[[str], None]) -> tuple[Setting, Answer, Bracket | None]:
    """The gains, and what else was asked of them: a bracket of the optimum; or why not, where there are none.

    First the problem that they answer: see ``problems.settling``.
    """
    from problems import settling

    began = time.monotonic()
    problem, answer = settling.solve(problem, starts=search.starts, seconds=search.time_limit, say=say)
    left = search.time_limit - (time.monotonic() - began)
    found = None
    if answer.outcome.found is not None and search.bracket:
        from problems import bound

        found = bound.bracket(problem, answer.outcome.found, seconds=min(left, BRACKET), say=say)
        if found.better is not None:
            answer = replace(answer, outcome=replace(answer.outcome, found=found.better))
    if answer.outcome.found is not None and search.sensitivities:
        from problems import sensitivity

        answer = sensitivity.checked(problem, answer, seconds=left, say=say)
    proof = answer.outcome.proof
    physical = proof is not None and proof.physical  # no requirement or bound is to blame
    unmet = answer.outcome.status in (Status.NOT_FOUND, Status.INFEASIBLE) and not physical
    if search.why_not and unmet and problem.bounds is not None:
        problem, answer = _explained(problem, answer, search, began + search.time_limit, say)
    return problem, answer, found


def _explained(
    problem: Setting, answer: Answer, search: Search, end: float, say: Callable[[str], None]
) -> tuple[Setting, Answer]:
    """The answer with why not; or a better one, where looking for that met a design that keeps every requirement."""
    from problems import robust, settling, whynot

    beside = [robust.world(problem, point.shares, point.scenario) for point in answer.points]
    why = whynot.solve(problem, beside=beside, seconds=max(end - time.monotonic(), 0.0), say=say)
    if why.feasible and answer.outcome.proof is None:
        say("starting from a design that meets the specification")
        seconds = max(end - time.monotonic(), 0.0)
        settled, again = settling.solve(problem, starts=search.starts, seconds=seconds, say=say, known=why.feasible)
        if again.outcome.found is not None or again.best is not None:
            return settled, again
    return problem, replace(answer, why=why)


def with_objective(problem: Setting, maximise: str | None, minimise: str | None) -> Setting:
    """The problem with what the command line asks for; raises ``BadInput`` for a row that is no objective."""
    if maximise is not None and minimise is not None:
        message = "and --maximise exclude each other; give one"
        raise BadInput(message, key="--minimise")
    for key, name, sense in (("--maximise", maximise, "at least"), ("--minimise", minimise, "at most")):
        if name is None:
            continue
        known = [id for id, row in OBJECTIVES.items() if row.sense == sense]
        if name not in known:
            other = OBJECTIVES.get(name)
            hint = f"; {other.verb} it: --{other.verb} {name}" if other else f"; needs one of {', '.join(known)}"
            message = f"is {name[:60]!r}{hint}"
            raise BadInput(message, key=key)
        problem = replace(problem, objective=name)
    return problem


def study(
    spec: str,
    controllers: str | None,
    trials: int | None,
    seed: int | None,
    jobs: int | None,
    dask: str | None,
    form: str,
    output: str | None,
    *,
    resume: bool,
    repair: bool,
    force_new: bool,
    tune: bool,
    strict: bool,
) -> tuple[str, bool]:
    """What to print of a comparison, and whether it is complete; its trials are kept in the folder ``output``."""
    from design.present import study_folder, study_text
    from problems.comparison import conduct

    source, problem = opening.opened(spec, strict=strict)
    problem = problem.throughout("a study")
    names = [name.strip() for name in controllers.split(",")] if controllers else None
    problem, names = conduct.with_options(problem, trials=trials, seed=seed, controllers=names)
    study_folder.check(output, resume=resume or repair or force_new)
    with terminal.progress() as say, terminal.terminated_like_interrupted(), study_folder.kept(output):
        found = conduct.conduct(
            source,
            problem,
            names,
            folder=output,
            resume=resume,
            repair=repair,
            force_new=force_new,
            jobs=jobs or terminal.cores(),
            dask=dask,
            tune=tune,
            say=say,
        )
    document = store.document("study", source, **conduct.facts(found, problem))
    if output:
        study_folder.write(output, document, found.rows)
    paint = terminal.painter_for_output()
    return store.dumps(document) if form == "json" else study_text.as_text(document, paint), document[
        "status"
    ] == "complete"
