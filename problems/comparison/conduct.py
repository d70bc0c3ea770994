"""A whole study: which controllers with which gains, the trials still to do, where they run, and what is kept."""

from __future__ import annotations

import json
import logging
import socket
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from design.errors import BadInput, Infrastructure
from design.model.laws import Gains
from design.present.journal import Journal
from design.present.store import code, gains_json, provenance
from design.solvers.outcome import Status
from design.spec.load import Source
from design.spec.setting import Setting
from design.workers import processes
from problems.comparison.controllers import LAWS, NAMES, PREDICTIVE, SYNTHESIZED, eased
from problems.comparison.study import COLUMNS_VERSION, HEAD, Alive, Case, Row, check, key_of, study, tasks, with_options
from problems.comparison.summary import summary
from problems.comparison.weights import SHOWN, Tuned, all_tuned, criterion, merit, value_of

__all__ = ["Study", "conduct", "facts", "with_options"]

Say = Callable[[str], None]

ANSWER_S = 5.0
"""Time within which a scheduler must answer [s]."""
CLUSTER_LIMIT_S = 20.0
"""Time without a scheduler or without workers after which a study stops [s]."""
SAME = "The spec has neither noise nor uncertainty: all trials of a scenario are the same, and count once."


@dataclass(frozen=True, eq=False, kw_only=True)
class Study:
    """What was asked and what came of it: ``rows``, the ``gains`` of laws, who was ``left_out`` and why.

    ``tuned``: the weights of controllers that have a model. ``starts``: of the synthesis of each law's gains, where
    they were sought. ``reached``: the objective in the loops by which weights are tuned, by law. ``wanted`` counts the
    rows of the whole study; ``journal`` the rows that were there before (``resumed``), and the lines that were left out
    because they were torn, damaged, incomplete, or of a trial that was there already.
    """

    controllers: tuple[str, ...]
    reference: str
    trials: int
    seed: int
    gains: dict[str, Gains]
    starts: dict[str, int]
    tuned: dict[str, Tuned]
    reached: dict[str, float | None]
    left_out: dict[str, str]
    rows: list[Row]
    wanted: int
    journal: dict[str, int]


def conduct(
    source: Source,
    problem: Setting,
    controllers: Sequence[str] | None,
    *,
    folder: str | None = None,
    resume: bool = False,
    repair: bool = False,
    force_new: bool = False,
    jobs: int = 1,
    dask: str | None = None,
    tune: bool = True,
    say: Say = lambda _: None,
) -> Study:
    """Run the study of ``problem``, or what is still to do of the one in ``folder``; raises ``BadInput``.

    Unless ``tune`` is false, weights that the spec does not write are tuned first (``problems.comparison.weights``).
    """
    check(problem)
    unknown = [name for name in controllers or () if name not in NAMES]
    if unknown:
        message = f"is {unknown[0]!r}; allowed: {', '.join(NAMES)}"
        raise BadInput(message, key="--controllers")
    gains, starts, left_out = _gains(problem, list(dict.fromkeys(controllers or NAMES)), say)
    tuned, unbuilt = all_tuned(problem, list(dict.fromkeys(controllers or NAMES)), say, tune=tune)
    left_out |= unbuilt
    names = tuple(name for name in dict.fromkeys(controllers or NAMES) if name not in left_out)
    if not names:
        message = "none can be built: " + "; ".join(f"{name}: {why}" for name, why in left_out.items())
        raise BadInput(message, key="--controllers")
    todo = tasks(problem, names, problem.study.trials)
    reached = {name: value_of(problem, merit(problem, name, its, None)) for name, its in gains.items()} if tune else {}
    weights = {name: its.weights for name, its in tuned.items()}
    case = Case(
        text=source.text, seed=problem.study.seed, gains=tuple(gains.items()), weights=tuple(weights.items())
    )  # fmt: skip
    identity = {
        "spec": {"name": source.spec.name, "sha256": source.sha256},
        "controllers": list(names),
        "gains": {name: gains_json(its) for name, its in gains.items()},
        "weights": {name: its._asdict() for name, its in weights.items()},
        "columns": COLUMNS_VERSION,
        "seed": problem.study.seed,
        "versions": {**{name: version for name, version in provenance().items() if name != "python"}, "code": code()},
    }
    with _executor(jobs, dask, identity["versions"]) as (executor, window, alive):
        if folder is None:
            rows: list[Row] = []
            rows += _followed(study(case, todo, executor, window, alive=alive), len(todo), 0, say)
            lines = {}
        else:
            with Journal.open(folder, identity, resume=resume, repair=repair, force_new=force_new) as journal:
                whole = [row for row in journal.rows if HEAD <= row.keys()]
                there = {key_of(row): row for row in reversed(whole)}
                lines = {
                    "resumed": len(there),
                    "torn": journal.torn,
                    "damaged": journal.damaged,
                    "incomplete": len(journal.rows) - len(whole),
                    "duplicated": len(whole) - len(there),
                }
                rest = [task for task in todo if task.key not in there]
                coming = study(case, rest, executor, window, alive=alive)
                for row in _followed(coming, len(todo), len(todo) - len(rest), say):
                    journal.append(row)
                rows = list({key_of(row): row for row in reversed(journal.rows) if HEAD <= row.keys()}.values())
    asked = {task.key: place for place, task in enumerate(todo)}
    rows = sorted((row for row in rows if key_of(row) in asked), key=lambda row: asked[key_of(row)])
    return Study(
        controllers=names,
        reference="force" if "force" in names else names[0],
        trials=problem.study.trials,
        seed=problem.study.seed,
        gains=gains,
        starts=starts,
        tuned=tuned,
        reached=reached,
        left_out=left_out,
        rows=[json.loads(json.dumps(row)) for row in rows],
        wanted=len(todo),
        journal=lines,
    )


def _gains(problem: Setting, names: Sequence[str], say: Say) -> tuple[dict[str, Gains], dict[str, int], dict[str, str]]:
    """Gains of the laws among ``names``, the starts of those that were sought, and why others have none."""
    gains: dict[str, Gains] = {}
    starts: dict[str, int] = {}
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
            its, tried, why = _synthesized(problem.with_law(SYNTHESIZED[name]))
            if its is None:
                left_out[name] = why
            else:
                gains[name], starts[name] = its, tried
    return gains, starts, left_out


def _synthesized(problem: Setting) -> tuple[Gains | None, int, str]:
    """Gains, the starts that were tried, and why there are none."""
    from problems.settling import solve

    if problem.bounds is None:
        return None, 0, "the spec has no [synthesis.bounds]"
    answer = solve(problem)[1]
    if answer.outcome.status is not Status.SOLVED:
        return None, answer.starts, f"synthesis: {answer.outcome.status.value}"
    return answer.outcome.value.gains, answer.starts, ""


def _followed(rows: Iterator[Row], wanted: int, there: int, say: Say) -> Iterator[Row]:
    """``rows`` as they come, with the rate and the time left."""
    began = time.monotonic()
    for count, row in enumerate(rows, 1):
        yield row
        rate = count / max(time.monotonic() - began, 1e-9)
        left = (wanted - there - count) / rate
        say(f"{there + count} of {wanted} runs, {rate:.1f} a second, {left:.0f} s left")


@contextmanager
def _executor(jobs: int, dask: str | None, versions: Any) -> Iterator[tuple[Callable[[], Executor], int, Alive]]:
    """A maker of executors, how many tasks to have with one at a time, and what tells whether it is still there."""
    if dask is None:
        yield (lambda: processes(jobs)), 2 * jobs, lambda: None
        return
    try:
        from distributed import Client
        from distributed.comm import parse_address, parse_host_port
    except ImportError:
        message = "needs the package distributed; pip install 'poise[cluster]'"
        raise BadInput(message, key="--dask") from None
    try:  # a client that finds no scheduler complains long after it was given up, or waits for ever
        with socket.create_connection(parse_host_port(parse_address(dask)[1], 8786), timeout=ANSWER_S) as probe:
            if not dask.startswith("tls:") and not probe.recv(1):  # a scheduler speaks first
                message = "the connection was closed"
                raise OSError(message)
    except (OSError, ValueError) as error:
        message = f"no scheduler answers at {dask!r} ({error}); start one with `dask scheduler`"
        raise BadInput(message, key="--dask") from None
    logging.getLogger("distributed").setLevel(logging.CRITICAL)  # what it logs is said in one line below
    with Client(dask, timeout=10, set_as_default=False) as client:
        workers = client.nthreads()
        if not workers:
            message = f"the scheduler at {dask!r} has no workers; start some with `dask worker {dask}`"
            raise BadInput(message, key="--dask")
        _same_versions(client, versions, dask)
        yield client.get_executor, 2 * sum(workers.values()), _Cluster(client, dask).alive


class _Cluster:
    """Whether a dask cluster still is one: its scheduler answers and has workers."""

    def __init__(self, client: Any, address: str) -> None:
        self.client, self.address, self.last_seen = client, address, time.monotonic()

    def alive(self) -> None:
        """Raise ``Infrastructure`` if there has been no scheduler or no worker for ``CLUSTER_LIMIT_S``."""
        try:
            there = self.client.status == "running" and bool(self.client.nthreads(callback_timeout=ANSWER_S))
        except Exception:  # whatever a connection raises that breaks at this moment
            there = False
        if there:
            self.last_seen = time.monotonic()
        elif time.monotonic() - self.last_seen > CLUSTER_LIMIT_S:
            message = f"the scheduler at {self.address!r}, or its last worker, has been gone for {CLUSTER_LIMIT_S:g} s"
            raise Infrastructure(message)


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
    return {**provenance(), "code": code()}


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


def _left_out(study: Study) -> str:
    """Which lines of the journal did not count."""
    parts = [f"{count} {kind}" for kind, count in study.journal.items() if count and kind != "resumed"]
    return f"Lines of the journal that were left out, their trials run again: {', '.join(parts)}." if parts else ""


def _tuning(study: Study, problem: Setting) -> dict[str, Any]:
    """By which objective, with how many evaluations, and to what value weights were tuned and gains sought."""
    from problems.gains.starts import CANDIDATES

    id = criterion(problem)
    measure, unit, sign = SHOWN[id]
    return {
        "objective": {"id": id, "unit": unit, "sense": "maximise" if sign > 0 else "minimise", "measure": measure},
        "instead_of": problem.objective if id != problem.objective else None,
        "weights": {
            name: {
                **its.weights._asdict(), "fixed": list(its.fixed), "tuned_with": its.of,
                "evaluations": its.evaluations, "value": its.value, "value_before": its.before,
            }
            for name, its in study.tuned.items()
        },
        "gains": {
            name: {
                "value": study.reached.get(name),
                "surveyed": CANDIDATES if name in study.starts else 0,
                "starts": study.starts.get(name, 0),
            }
            for name in study.gains
        },
    }  # fmt: skip


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
        "tuning": _tuning(study, problem),
        "left_out": study.left_out,
        "journal": study.journal,
        "remark": " ".join(
            filter(None, [SAME if repeated and study.trials > 1 else "", _eased(problem, study), _left_out(study)])
        ),
        "controllers": summary(study.rows, study.reference, repeated=repeated),
    }
