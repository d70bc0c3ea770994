"""Where work runs: in this process, or in worker processes; both are ``concurrent.futures`` executors.

Worker processes never outlive this process: a thread of each watches it, and ends the worker when it is gone, however
it ended. The same thread leaves a heartbeat, by which a worker that was stopped is told from one that is busy.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import BrokenExecutor, Executor, Future, ProcessPoolExecutor
from contextlib import contextmanager
from typing import Any, Literal, ParamSpec, TypeVar

from design.errors import Infrastructure

P = ParamSpec("P")
T = TypeVar("T")

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""Read by the linear algebra libraries when they load: one thread a worker, or workers would fight for the cores."""
HEARTBEAT_S = 0.5
"""Time between two heartbeats of a worker [s]; also the time within which it ends after its parent."""
SILENCE_S = 30.0
"""Time without a heartbeat after which a worker counts as stopped [s]; calls of a solver can delay heartbeats."""


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


class Workers(ProcessPoolExecutor):
    """Worker processes with heartbeats, which can be ended at once."""

    def __init__(self, count: int, method: str, ready: Callable[[], Any] | None) -> None:
        context = multiprocessing.get_context(method)
        self._heartbeats = context.RawArray("d", count)  # [s] of time.monotonic, which all processes share; 0: none yet
        slots = context.Value("i", 0)
        super().__init__(
            count, mp_context=context, initializer=_prepare, initargs=(ready, self._heartbeats, slots)
        )  # fmt: skip

    def silent(self) -> bool:
        """Whether a worker has been without a heartbeat for ``SILENCE_S``."""
        now = time.monotonic()
        return any(beat and now - beat > SILENCE_S for beat in self._heartbeats)

    def end(self) -> None:
        """Kill the workers, whatever they do; futures that wait for them raise ``BrokenExecutor``."""
        for process in list((self._processes or {}).values()):
            process.kill()
        self.shutdown(wait=False, cancel_futures=True)

    def __exit__(self, kind: type[BaseException] | None, *rest: Any) -> bool | None:
        """Wait for the workers, or after an interrupt end them."""
        if kind is not None and not issubclass(kind, Exception):
            self.end()
        return super().__exit__(kind, *rest)


def processes(
    count: int, *, start: Literal["spawn", "quick"] = "spawn", ready: Callable[[], Any] | None = None
) -> Executor:
    """``count`` worker processes, each of which calls ``ready`` first; ``Here`` where the system allows none.

    Workers leave Ctrl-C to their parent and end with it. ``quick`` forks where that is the usual way, which is safe
    only while this process has one thread. Raises ``Infrastructure`` where workers end before they have begun.
    """
    method = "fork" if start == "quick" and sys.platform == "linux" else "spawn"
    before = {name: os.environ.get(name) for name in THREADS}
    os.environ.update(dict.fromkeys(THREADS, "1"))
    pool = None
    try:
        with _interrupts_deferred():
            pool = Workers(count, method, ready)
            # workers start with the first task, not with the pool
            begun = [pool.submit(_awake) for _ in range(count)]
        for future in begun if start == "spawn" else ():
            future.result()
    except (OSError, ImportError, NotImplementedError):
        return Here()
    except BrokenExecutor as error:
        message = f"worker processes end before they have begun ({error}); free memory, or use fewer with --jobs"
        raise Infrastructure(message) from None
    except BaseException:
        end(pool)
        raise
    finally:
        for name, value in before.items():
            os.environ.pop(name, None) if value is None else os.environ.update({name: value})
    return pool


@contextmanager
def _interrupts_deferred() -> Iterator[None]:
    """Let Ctrl-C wait: a process that starts meanwhile never sees it, not even before it can say so itself."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT, signal.SIGALRM])
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def end(pool: Executor | None, futures: Iterable[Future[Any]] = ()) -> None:
    """End ``pool`` without waiting for what it does, and cancel ``futures``."""
    for future in futures:
        future.cancel()
    if isinstance(pool, Workers):
        pool.end()
    elif pool is not None:
        pool.shutdown(wait=False)


def _prepare(ready: Callable[[], Any] | None, heartbeats: Any, slots: Any) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with slots.get_lock():
        slot = slots.value % len(heartbeats)
        slots.value += 1
    threading.Thread(target=_attend, args=(heartbeats, slot), daemon=True).start()
    if ready is not None:
        ready()


def _attend(heartbeats: Any, slot: int) -> None:
    """Leave heartbeats as long as the parent lives; then end this process."""
    parent = multiprocessing.parent_process()
    while parent is not None and parent.is_alive():
        heartbeats[slot] = time.monotonic()
        parent.join(HEARTBEAT_S)
    os._exit(1)


def _awake() -> None:
    """The task with which a worker starts."""
