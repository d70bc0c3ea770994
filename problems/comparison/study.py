"""Every controller through every scenario, trial by trial, wherever an executor runs them.

A ``Task`` is plain data; the worker rebuilds the problem from the spec's text. Its row depends on the task alone, not
on which worker ran it, on the order, or on what ran before. A trial that fails is a row that says so. One whose worker
ends, stops or exceeds its limit is tried once more alone, and is a row then. What befalls the infrastructure, a lost
scheduler, a cancelled task, no memory, is never a row: it raises ``Infrastructure``, and the study can be continued.
"""

from __future__ import annotations

import math
import threading
import time
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, CancelledError, Executor, Future, wait
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from design import workers
from design.errors import BadInput, Infrastructure
from design.model.environment import varied
from design.model.laws import Gains
from design.present.store import gains_json
from design.spec.load import parse
from design.spec.setting import Setting, setting
from problems.comparison.controllers import actuator, controller
from problems.comparison.measures import measures, trace
from problems.comparison.survival import DISTURBANCES, survived
from problems.comparison.trial import World, run
from problems.comparison.weights import Weights, weighted

Row = dict[str, Any]

_ONE_AT_A_TIME = threading.Lock()
"""A worker may have threads, as dask's do; solvers and buffers are built for one."""
TRIAL_LIMIT_S = 600.0
"""Time within which a trial must end [s]; a longer one counts as hung."""
WATCH_S = 1.0
"""Time between two looks at whether the workers still work [s]."""
Alive = Callable[[], None]
"""Raises ``Infrastructure`` if what runs the trials is gone."""
COLUMNS_VERSION = 2
"""Of a row's keys: since 2 it holds the world that was drawn, and the gains and weights of its controller."""


@dataclass(frozen=True, kw_only=True)
class Case:
    """All that a worker needs to know of a study; plain data.

    ``gains`` by controller, where it is a law, and ``weights`` where it has a model.
    """

    text: str
    seed: int
    gains: tuple[tuple[str, Gains], ...]
    weights: tuple[tuple[str, Weights], ...] = ()


@dataclass(frozen=True, kw_only=True)
class Task:
    """One row to be: a ``trial`` of a controller in a scenario, or (``trial`` None) the disturbance it survives."""

    controller: str
    scenario: str
    trial: int | None

    @property
    def key(self) -> tuple[str, str, int]:
        """What tells rows apart, and orders them."""
        return (self.controller, self.scenario, -1 if self.trial is None else self.trial)


def tasks(problem: Setting, controllers: Iterable[str], trials: int) -> list[Task]:
    """All rows of a study; trial by trial, so that every controller has as many when it is interrupted."""
    names = list(controllers)
    return [Task(controller=name, scenario=what, trial=None) for what in DISTURBANCES for name in names] + [
        Task(controller=name, scenario=scenario.name, trial=k)
        for k in range(trials)
        for scenario in problem.scenarios
        for name in names
    ]


HEAD = {"controller", "scenario", "trial", "status"}
"""What every row has."""


def key_of(row: Row) -> tuple[str, str, int]:
    """The key of the task that a row came from."""
    return (row["controller"], row["scenario"], -1 if row["trial"] is None else row["trial"])


def check(problem: Setting) -> None:
    """Raise ``BadInput`` for what a study cannot do."""
    period = problem.study.control_period_s
    periods = problem.sensors.delay / period
    if abs(periods - round(periods)) > 1e-6:
        message = f"is {problem.sensors.delay:g}; needs a multiple of study.control_period_s = {period:g}"
        raise BadInput(message, key="noise.delay_s")
    for scenario in problem.scenarios:
        if scenario.duration < period:
            message = (
                f"lasts {scenario.duration:g} s, less than study.control_period_s = {period:g}; shorten the period"
            )
            raise BadInput(message, key=f"scenario {scenario.name}")


def world(problem: Setting, scenario: str, trial: int, seed: int) -> World:
    """The body, the world and the noise of a ``trial``; the same for every controller."""
    return world_of(problem, drawn(problem, scenario, trial, seed))


def drawn(problem: Setting, scenario: str, trial: int, seed: int) -> Row:
    """What is drawn for a trial, and the seed of its noise: the columns from which ``world_of`` makes its world.

    ``slope_rad`` [rad] and ``ramp_s`` [s] are None where the scenario has none.
    """
    shares = np.random.default_rng([seed, zlib.crc32(scenario.encode()), trial, 0]).uniform(-1.0, 1.0, 7).tolist()
    body, tolerances, nominal = problem.biped, problem.tolerances, problem.scenario(scenario)
    names = {"mass_kg": "M", "com_height_m": "L", "inertia_kgm2": "I", "foot_mass_kg": "m", "half_length_m": "ell"}
    numbers = {
        key: getattr(tolerances, name).around(getattr(body, name), share)
        for (key, name), share in zip(names.items(), shares[:5], strict=True)
    }
    final, ramp = float(nominal.signal[0, -1]), float(nominal.times[-1])
    tilts, grows = nominal.kind == "slope", nominal.kind in ("slope", "force") and ramp > 0
    return {
        "scenario": scenario, "trial": trial, "seed": seed, **numbers,
        "slope_rad": tolerances.slope.around(final, shares[5]) if tilts else None,
        "ramp_s": tolerances.ramp.around(ramp, shares[6]) if grows else None,
    }  # fmt: skip


def world_of(problem: Setting, row: Mapping[str, Any]) -> World:
    """The world of a trial, from the columns of its ``row``; ``problem`` is that of the study's spec."""
    biped, real = problem.biped, problem.scenario(row["scenario"])
    if not problem.tolerances.none:
        biped = replace(
            biped, M=row["mass_kg"], L=row["com_height_m"], I=row["inertia_kgm2"], m=row["foot_mass_kg"],
            ell=row["half_length_m"],
        )  # fmt: skip
        real = varied(real, biped, slope=lambda _: float(row["slope_rad"]), ramp=lambda _: float(row["ramp_s"]))
    noise = None
    if not problem.sensors.exact:
        periods = max(1, math.ceil(real.duration / problem.study.control_period_s - 1e-6))
        stream = [row["seed"], zlib.crc32(row["scenario"].encode()), row["trial"], 1]
        noise = np.random.default_rng(stream).standard_normal((periods, 4))
    return World(biped=biped, scenario=real, sensors=problem.sensors, draws=noise, target=problem.target)


@lru_cache(maxsize=4)
def _problem(text: str) -> Setting:
    return setting(parse(text, origin="study").spec).throughout("a study")


@lru_cache(maxsize=16)
def _weighted(text: str, controller: str, weights: Weights | None) -> Setting:
    """The problem with a controller's weights; the same object each time, since predictions are kept by it."""
    return weighted(_problem(text), controller, weights)


@lru_cache(maxsize=8)
def _world(text: str, scenario: str, trial: int, seed: int) -> World:
    """The world of a trial, and with it what is known by it, for all controllers that a worker puts into it."""
    return world(_problem(text), scenario, trial, seed)


def perform(case: Case, task: Task) -> Row:
    """The row of ``task``; runs in a worker. Never raises for what a controller does."""
    with _ONE_AT_A_TIME:
        return _perform(case, task)


def _perform(case: Case, task: Task) -> Row:
    weights = dict(case.weights).get(task.controller)
    problem = _weighted(case.text, task.controller, weights)
    gains = dict(case.gains).get(task.controller)
    head = {
        "controller": task.controller, "scenario": task.scenario, "trial": task.trial,
        **(gains_json(gains) if gains else {}), **(weights._asdict() if weights else {}),
    }  # fmt: skip
    if task.trial is None:
        return {**head, **survived(task.scenario, task.controller, problem, gains)}
    real = _world(case.text, task.scenario, task.trial, case.seed)
    head |= drawn(problem, task.scenario, task.trial, case.seed)
    control = controller(task.controller, problem, gains, real.scenario)
    happened = run(real, control, actuator(problem), problem.step)
    row = {**head, **measures(real, happened)}
    return {**row, "trace": trace(happened)} if task.trial == 0 else row


def study(
    case: Case,
    todo: Iterable[Task],
    executor: Callable[[], Executor],
    window: int,
    *,
    limit: float = TRIAL_LIMIT_S,
    alive: Alive = lambda: None,
) -> Iterator[Row]:
    """The rows of ``todo`` as they end; ``window`` tasks are with the ``executor`` at a time.

    A trial may take ``limit`` [s]. ``alive`` is called while there is nothing to do but wait. Raises
    ``Infrastructure``.
    """
    waiting = list(reversed(list(todo)))
    pool = executor()
    running: dict[Future[Row], tuple[Task, float]] = {}
    try:
        while waiting or running:
            # keep the window full
            while waiting and len(running) < window:
                task = waiting.pop()
                running[pool.submit(perform, case, task)] = (task, time.monotonic())
            # collect what has ended
            done = _ended(pool, running, 2 * limit, alive)  # a task may wait for one before it
            broken: list[Task] = []
            for future in done:
                task, _ = running.pop(future)
                row = _row(future, task)
                if row is None:
                    broken.append(task)
                else:
                    yield row
            # the pool is gone, and with it all that was under way: once more, each alone
            if broken:
                broken += [task for task, _ in running.values()]
                workers.end(pool, running)
                running.clear()
                for task in broken:
                    yield _alone(case, task, executor, limit, alive)
                pool = executor()
    finally:
        workers.end(pool, running)


def _ended(
    pool: Executor, running: dict[Future[Row], tuple[Task, float]], limit: float, alive: Alive
) -> set[Future[Row]]:
    """The futures that have ended, once there are some; workers that are silent or late are killed first."""
    while True:
        done, _ = wait(running, timeout=WATCH_S, return_when=FIRST_COMPLETED)
        late = time.monotonic() - min(since for _, since in running.values()) > limit
        if isinstance(pool, workers.Workers) and (late or pool.silent()):
            pool.end()
        elif not done:
            alive()
        if done:
            return done


def _alone(case: Case, task: Task, executor: Callable[[], Executor], limit: float, alive: Alive) -> Row:
    pool = executor()
    future = pool.submit(perform, case, task)
    try:
        _ended(pool, {future: (task, time.monotonic())}, limit, alive)
        row = _row(future, task)
    finally:
        workers.end(pool, [future])
    return row or _no_row(task, "crashed", f"its worker ended, stopped, or took longer than {limit:g} s, twice")


def _row(future: Future[Row], task: Task) -> Row | None:
    """What came of a task; None if its worker is gone. Raises ``Infrastructure`` for what is not the trial's doing."""
    try:
        return future.result()
    except BrokenExecutor:
        return None
    except (CancelledError, MemoryError, OSError) as error:
        message = f"a task was not run: {type(error).__name__}: {error}"[:200]
        raise Infrastructure(message) from None
    except Exception as error:
        return _no_row(task, "failed", f"{type(error).__name__}: {error}"[:200])


def _no_row(task: Task, status: str, why: str) -> Row:
    return {
        "controller": task.controller,
        "scenario": task.scenario,
        "trial": task.trial,
        "status": status,
        "why": why,
    }


def with_options(
    problem: Setting, *, trials: int | None, seed: int | None, controllers: list[str] | None
) -> tuple[Setting, list[str] | None]:
    """The study of the spec with what the command line changes, and the controllers that are asked for."""
    changed = {name: value for name, value in (("trials", trials), ("seed", seed)) if value is not None}
    table = problem.study.model_copy(update=changed)
    return replace(problem, study=table), controllers or (list(table.controllers) if table.controllers else None)
