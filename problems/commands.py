"""From the arguments of `poise synthesize` and `poise study` to what they print: open, ask, keep what is asked for.

Each imports its own question: that of a study takes half a second.
"""

from __future__ import annotations

from dataclasses import replace

from design.analysis.objectives import OBJECTIVES
from design.errors import BadInput
from design.model.laws import LawKind
from design.present import opening, store, synthesis, terminal
from design.spec.setting import Setting


def synthesize(
    spec: str,
    wish: tuple[str | None, str | None],
    law: LawKind | None,
    starts: int | None,
    time_limit: float,
    form: str,
    output: str | None,
    *,
    strict: bool,
) -> tuple[str, str]:
    """What to print of the gains that are found, and the word of the status; the design is written to ``output``."""
    from problems import gains

    source, problem = opening.opened(spec, law, strict=strict)
    problem = with_objective(problem, *wish)
    with terminal.progress() as say:
        answer = gains.solve(problem, starts=starts, seconds=time_limit, say=say)
    stored = store.dumps(synthesis.document(source, problem, answer))
    if output:
        store.write(output, stored)
    printed = stored if form == "json" else synthesis.text(source, problem, answer, terminal.painter_for_output())
    return printed, answer.outcome.status.word


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
    strict: bool,
) -> tuple[str, bool]:
    """What to print of a comparison, and whether it is complete; its trials are kept in the folder ``output``."""
    from design.present import study_folder, study_text
    from problems.comparison import conduct

    source, problem = opening.opened(spec, strict=strict)
    names = [name.strip() for name in controllers.split(",")] if controllers else None
    problem, names = conduct.with_options(problem, trials=trials, seed=seed, controllers=names)
    study_folder.check(output, resume=resume)
    with terminal.progress() as say, terminal.terminated_like_interrupted(), study_folder.kept(output):
        found = conduct.conduct(
            source, problem, names, folder=output, resume=resume, jobs=jobs or terminal.cores(), dask=dask, say=say
        )
    document = store.document("study", source, **conduct.facts(found, problem))
    if output:
        study_folder.write(output, document, found.rows)
    paint = terminal.painter_for_output()
    return store.dumps(document) if form == "json" else study_text.as_text(document, paint), document[
        "status"
    ] == "complete"
