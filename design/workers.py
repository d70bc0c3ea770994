"""Where work runs: in this process, or in worker processes; both are ``concurrent.futures`` executors."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
from collections.abc import Callable
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from typing import Any, Literal, ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""Read by the linear algebra libraries when they load: one thread a worker, or workers would fight for the cores."""


class Here(Executor):
    """Runs what is submitted at once, in this process."""

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        """A future that is done."""
        future: Future[T] = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:
            future.set_exception(error)
        return future


def processes(
    count: int, *, start: Literal["spawn", "quick"] = "spawn", ready: Callable[[], Any] | None = None
) -> Executor:
    """``count`` worker processes, each of which calls ``ready`` first; ``Here`` where the system allows none.

    Workers leave Ctrl-C to their parent and end with it. ``quick`` forks where that is the usual way, which is safe
    only while this process has one thread.
    """
    method = "fork" if start == "quick" and sys.platform == "linux" else "spawn"
    before = {name: os.environ.get(name) for name in THREADS}
    os.environ.update(dict.fromkeys(THREADS, "1"))
    try:
        pool = ProcessPoolExecutor(
            count, mp_context=multiprocessing.get_context(method), initializer=_prepare, initargs=(ready,)
        )
        # workers start with the first task, not with the pool
        for future in [pool.submit(_awake) for _ in range(count)]:
            if start == "spawn":
                future.result()
    except (OSError, ImportError, NotImplementedError):
        return Here()
    finally:
        for name, value in before.items():
            os.environ.pop(name, None) if value is None else os.environ.update({name: value})
    return pool


def _prepare(ready: Callable[[], Any] | None) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if ready is not None:
        ready()


def _awake() -> None:
    """The task with which a worker starts."""
