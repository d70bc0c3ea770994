"""A whole study: which controllers with which gains, the trials still to do, where they run, and what is kept."""

from __future__ import annotations

import json
import socket
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from design.errors import BadInput
from design.model.laws import Gains
from design.present.journal import Journal
from design.present.store import gains_json, provenance
from design.solvers.outcome import Status
from design.spec.load import Source
from design.spec.setting import Setting
from design.workers import processes
from problems.comparison.controllers import LAWS, NAMES, PREDICTIVE, SYNTHESIZED, eased
from problems.comparison.study import Case, Row, check, key_of, study, tasks, with_options
from problems.comparison.summary import summary

__all__ = ["Study", "conduct", "facts", "with_options"]

Say = Callable[[str], None]

SAME = "The spec has neither noise nor uncertainty: all trials of a scenario are the same, and count once."


@dataclass(frozen=True, eq=False, kw_only=True)
class Study:
    """What was asked and what came of it: ``rows``, the ``gains`` of laws, who was ``left_out`` and why.

    ``resumed`` counts the rows that were there before; ``wanted`` those of the whole study.
    """

    controllers: tuple[str, ...]
    reference: str
    trials: int
    seed: int
    gains: dict[str, Gains]
    left_out: dict[str, str]
    rows: list[Row]
    resumed: int
    wanted: int
    torn: int


def conduct(
    source: Source,
    problem: Setting,
    controllers: Sequence[str] | None,
    *,
    folder: str | None = None,
    resume: bool = False,
    jobs: int = 1,
    dask: str | None = None,
    say: Say = lambda _: None,
) -> Study:
    """Run the study of ``problem``, or what is still to do of the one in ``folder``; raises ``BadInput``."""
    check(problem)
    unknown = [name for name in controllers or () if name not in NAMES]
    if unknown:
        message = f"is {unknown[0]!r}; allowed: {', '.join(NAMES)}"
        raise BadInput(message, key="--controllers")
    gains, left_out = _gains(problem, list(dict.fromkeys(controllers or NAMES)), say)
    names = tuple(name for name in dict.fromkeys(controllers or NAMES) if name not in left_out)
    if not names:
        message = "none can be built: " + "; ".join(f"{name}: {why}" for name, why in left_out.items())
        raise BadInput(message, key="--controllers")
    todo = tasks(problem, names, problem.study.trials)
    case = Case(text=source.text, seed=problem.study.seed, gains=tuple(gains.items()))
    identity = {
        "spec": {"name": source.spec.name, "sha256": source.sha256},
        "controllers": list(names),
        "gains": {name: gains_json(its) for name, its in gains.items()},
        "seed": problem.study.seed,
        "versions": {name: version for name, version in provenance().items() if name != "python"},
    }
    with _executor(jobs, dask, identity["versions"]) as (executor, window):
        if folder is None:
            rows: list[Row] = []
            rows += _followed(study(case, todo, executor, window), len(todo), 0, say)
            kept, torn = 0, 0
        else:
            with Journal.open(folder, identity, resume=resume) as journal:
                kept, torn = len(journal.rows), journal.torn
                there = {key_of(row) for row in journal.rows}
                rest = [task for task in todo if task.key not in there]
                for row in _followed(study(case, rest, executor, window), len(todo), len(todo) - len(rest), say):
                    journal.append(row)
                rows = list(journal.rows)
    asked = {task.key: place for place, task in enumerate(todo)}
    rows = sorted((row for row in rows if key_of(row) in asked), key=lambda row: asked[key_of(row)])
    return Study(
        controllers=names,
        reference="force" if "force" in names else names[0],
        trials=problem.study.trials,
        seed=problem.study.seed,
        gains=gains,
        left_out=left_out,
        rows=[json.loads(json.dumps(row)) for row in rows],
        resumed=kept,
        wanted=len(todo),
        torn=torn,
    )


def _gains(problem: Setting, names: Sequence[str], say: Say) -> tuple[dict[str, Gains], dict[str, str]]:
    """Gains of the laws among ``names``, and why others have none."""
    gains: dict[str, Gains] = {}
    left_out: dict[str, str] = {}
    for name in names:
        if name in LAWS:
            own = problem.with_law(LAWS[name]).gains
            if own is None:
                left_out[name] = "the spec gives no gains for this law"
            else:
                gains[name] = own
        elif name in SYNTHESIZED:
            say(f"synthesizing gains for {name} ...")
            its, why = _synthesized(problem.with_law(SYNTHESIZED[name]))
            if its is None:
                left_out[name] = why
            else:
                gains[name] = its
    return gains, left_out


def _synthesized(problem: Setting) -> tuple[Gains | None, str]:
    from problems.settling import solve

    if problem.bounds is None:
        return None, "the spec has no [synthesis.bounds]"
    outcome = solve(problem)[1].outcome
    if outcome.status is not Status.SOLVED:
        return None, f"synthesis: {outcome.status.value}"
    return outcome.value.gains, ""


def _followed(rows: Iterator[Row], wanted: int, there: int, say: Say) -> Iterator[Row]:
    """``rows`` as they come, with the rate and the time left."""
    began = time.monotonic()
    for count, row in enumerate(rows, 1):
        yield row
        rate = count / max(time.monotonic() - began, 1e-9)
        left = (wanted - there - count) / rate
        say(f"{there + count} of {wanted} runs, {rate:.1f} a second, {left:.0f} s left")


@contextmanager
def _executor(jobs: int, dask: str | None, versions: Any) -> Iterator[tuple[Callable[[], Executor], int]]:
    """A maker of executors, and how many tasks to have with one at a time."""
    if dask is None:
        yield (lambda: processes(jobs)), 2 * jobs
        return
    try:
        from distributed import Client
        from distributed.comm import parse_address, parse_host_port
    except ImportError:
        message = "needs the package distributed; pip install 'poise[cluster]'"
        raise BadInput(message, key="--dask") from None
    try:  # a client that finds no scheduler complains long after it was given up
        socket.create_connection(parse_host_port(parse_address(dask)[1], 8786), timeout=5).close()
    except (OSError, ValueError) as error:
        message = f"no scheduler answers at {dask!r} ({error}); start one with `dask scheduler`"
        raise BadInput(message, key="--dask") from None
    with Client(dask, timeout=10, set_as_default=False) as client:
        workers = client.nthreads()
        if not workers:
            message = f"the scheduler at {dask!r} has no workers; start some with `dask worker {dask}`"
            raise BadInput(message, key="--dask")
        _same_versions(client, versions, dask)
        yield client.get_executor, 2 * sum(workers.values())


def _same_versions(client: Any, versions: Any, address: str) -> None:
    """Raise ``BadInput`` if a worker would compute with other versions than this process."""
    for worker, found in client.run(_versions, on_error="return").items():
        if not isinstance(found, dict):
            message = f"worker {worker} cannot import Poise ({found}); install it there"
            raise BadInput(message, key="--dask")
        differing = [name for name, version in versions.items() if found.get(name) != version]
        if differing:
            name = differing[0]
            message = f"worker {worker} has {name} {found.get(name)}, this process {versions[name]}; make them the same"
            raise BadInput(message, key="--dask")


def _versions() -> dict[str, str]:
    return provenance()


def _eased(problem: Setting, study: Study) -> str:
    """What the predictions plan for instead of levels that leave a standing body no room to move."""
    if not any(name in PREDICTIVE for name in study.controllers):
        return ""
    units = {"contact-force": " N", "cop-margin": " m", "friction": ""}
    parts = [
        f"{row} {problem.required[row].level:g}{units[row]} leaves no room to move; mpc and nmpc plan for"
        f" {level.level:.4g}{units[row]}"
        for row, level in eased(problem).items()
    ]
    return "; ".join(parts) + "." if parts else ""


def facts(study: Study, problem: Setting) -> dict[str, Any]:
    """What a study's JSON says beside the common part."""
    repeated = problem.sensors.exact and problem.tolerances.none
    done = len(study.rows)
    through = sum(row["trial"] is not None and row["status"] not in ("failed", "crashed") for row in study.rows)
    return {
        "status": "complete" if done == study.wanted and through else "undecided",
        "trials": study.trials,
        "seed": study.seed,
        "control_period_s": problem.study.control_period_s,
        "scenarios": [scenario.name for scenario in problem.scenarios],
        "reference": study.reference,
        "gains": {name: gains_json(its) for name, its in study.gains.items()},
        "left_out": study.left_out,
        "remark": " ".join(filter(None, [SAME if repeated and study.trials > 1 else "", _eased(problem, study)])),
        "controllers": summary(study.rows, study.reference, repeated=repeated),
    }
