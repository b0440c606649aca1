"""Many small tasks on any `concurrent.futures.Executor`: bundled, streamed, repeated where a worker was lost.

A task of a tenth of a second would wait longer for the executor than it takes, so tasks are sent in bundles of about a
second, whose size follows from the time that tasks took so far. Only a few bundles are under way at a time, so memory
does not grow with the fleet. If a worker is lost, the bundles that were under way are repeated task by task, one at a
time, so that a task that ends its worker is found and fails alone.
"""

from __future__ import annotations

import os
import signal
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    ProcessPoolExecutor,
    wait,
)
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass, field
from logging import CRITICAL, getLogger
from multiprocessing import get_context
from typing import Any, Generic, TypeVar

from emsid.errors import DataError
from emsid.estimation.nonlinear.control import FREE, Control
from emsid.estimation.threads import LONGEST_WAIT, cores, sharing_cores

Task = TypeVar("Task")
Result = TypeVar("Result")

SECONDS = 1.0
"""The time that a bundle should take: 2,000 empty tasks cost 5 s one by one, and nothing in bundles of a second."""
AHEAD = 2
"""Bundles under way for each worker: one runs, one waits, so that no worker is idle."""
LARGEST = 256
"""Tasks of a bundle at most: what a lost worker has to repeat one by one."""
ENOUGH = 2
"""Workers that a task ends alone before it is given up: one of them may have been ended from outside."""
ANSWER = 5.0
"""Seconds in which a scheduler has to answer."""
WATCHED = 1.0
"""Seconds between two looks of a worker at the process that started it."""


@dataclass(frozen=True)
class _Bundle(Generic[Task]):
    """Tasks that are sent together; a suspect, which was under way when a worker was lost, is sent alone.

    Attributes:
        tasks: in order.
        losses: how many workers a suspect has ended alone; None for tasks that are no suspects.
    """

    tasks: list[Task]
    losses: int | None = None


@dataclass
class Engine(Generic[Task, Result]):
    """Runs tasks and hands out their results as they come.

    Args:
        run: the results of a bundle of tasks, in order; a function of a module, so that other processes find it.
        lost: the result of a task that is given up, as it ended several workers alone.
        executor: where they run; by default processes of this machine, which are started again if one is lost.
        workers: how many tasks run at a time.
        control: when to stop.
    """

    run: Callable[[Sequence[Task]], Sequence[Result]]
    lost: Callable[[Task], Result]
    executor: Executor | None = None
    workers: int | None = None
    control: Control = FREE
    _each: float = field(default=SECONDS, init=False)
    _pool: ProcessPoolExecutor | None = field(default=None, init=False)
    _under_way: dict[Future[Any], _Bundle[Task]] = field(default_factory=dict, init=False)

    def __call__(self, tasks: Sequence[Task]) -> Iterator[tuple[Task, Result]]:
        """Every task with its result, in the order in which they end; an interruption ends it early.

        Raises:
            DataError: where a given executor has ended; what was handed out by then is complete.
        """
        waiting, suspects = deque(tasks), deque[_Bundle[Task]]()
        try:
            while (waiting or suspects or self._under_way) and not self.control.ending:
                self._send(waiting, suspects)
                done, _ = wait(self._under_way, LONGEST_WAIT, return_when=FIRST_COMPLETED)
                for future in done:
                    bundle = self._under_way.pop(future, None)
                    if bundle is None:  # of a pool that was left meanwhile
                        continue
                    try:
                        seconds, results = future.result()
                    except Exception as problem:
                        for task in self._after_loss(bundle, problem, suspects):
                            yield task, self.lost(task)
                    else:
                        self._each += 0.5 * (seconds / len(bundle.tasks) - self._each)
                        yield from zip(bundle.tasks, results, strict=True)
        finally:
            self._leave()

    def _send(self, waiting: deque[Task], suspects: deque[_Bundle[Task]]) -> None:
        """Send bundles until enough are under way; a suspect only where nothing else is."""
        if suspects:
            if not self._under_way:
                self._submit(suspects.popleft())
            return
        most = AHEAD * (self.workers or getattr(self.executor, "_max_workers", None) or cores())
        while waiting and len(self._under_way) < most:
            fair = max(len(waiting) // most, 1)  # the last bundles are small, so that all workers end together
            size = min(max(round(SECONDS / max(self._each, 1e-6)), 1), LARGEST, fair)
            self._submit(_Bundle([waiting.popleft() for _ in range(size)]))

    def _submit(self, bundle: _Bundle[Task]) -> None:
        executor = self.executor
        if executor is None:
            executor = self._pool = self._pool or own_pool(self.workers or cores())
        self._under_way[executor.submit(_timed, self.run, bundle.tasks)] = bundle

    def _after_loss(self, bundle: _Bundle[Task], problem: Exception, suspects: deque[_Bundle[Task]]) -> Sequence[Task]:
        """The tasks that are given up; the others that a lost worker concerns become suspects.

        Raises:
            DataError: where a given executor has ended.
            Exception: the problem itself, where it is no loss of a worker.
        """
        given_up = type(problem).__name__ == "KilledWorker"  # Dask has lost several workers to these tasks
        if not given_up:
            if not isinstance(problem, BrokenExecutor | CancelledError):
                raise problem
            if self.executor is not None:
                raise DataError(
                    f"the executor ended ({type(problem).__name__}); finished rows are kept, so run the same again"
                ) from None
            others = [task for other in self._under_way.values() for task in other.tasks]
            suspects.extend(_Bundle([task], losses=0) for task in others)
            self._leave()
        if bundle.losses == ENOUGH - 1:
            return bundle.tasks
        losses = 0 if bundle.losses is None else bundle.losses + 1
        suspects.extend(_Bundle([task], losses) for task in bundle.tasks)
        return ()

    def _leave(self) -> None:
        """Leave everything that is under way, and the pool, whose processes end with what they are doing."""
        finished = not self._under_way
        for future in self._under_way:
            future.cancel()
        self._under_way.clear()
        if self._pool is not None:
            processes = [] if finished else list((self._pool._processes or {}).values())
            for process in processes:  # which write nothing
                process.terminate()
            self._pool.shutdown(cancel_futures=True)
            self._pool = None


def _timed(run: Callable[[Sequence[Task]], Sequence[Result]], tasks: Sequence[Task]) -> tuple[float, Sequence[Result]]:
    """The results of a bundle with the seconds that it took in its worker."""
    begun = time.monotonic()
    results = run(tasks)
    return time.monotonic() - begun, results


def own_pool(workers: int) -> ProcessPoolExecutor:
    """Processes of this machine, each new: a copy of this one could inherit locks that other threads hold."""
    return ProcessPoolExecutor(
        workers, mp_context=get_context("spawn"), initializer=_begin_worker, initargs=(workers, os.getpid())
    )


def _begin_worker(workers: int, parent: int) -> None:
    """Leave Ctrl-C to the main process, end with it, and take a share of the cores."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with, args=(parent,), name="watching", daemon=True).start()
    _SHARES.append(sharing_cores(workers))
    _SHARES[-1].__enter__()


_SHARES: list[AbstractContextManager[None]] = []  # kept, as the share lasts as long as the process


def _end_with(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(WATCHED)
    os._exit(1)


@contextmanager
def connected(address: str) -> Iterator[Executor]:
    """An executor of a Dask cluster.

    Args:
        address: of its scheduler, ``tcp://host:8786``.

    Raises:
        DataError: where Dask is not installed or the scheduler does not answer.
    """
    try:
        from distributed import Client
    except ImportError:
        raise DataError("a scheduler needs Dask; install it with: pip install 'emsid[dask]'") from None
    try:
        client: Any = Client(address, timeout=ANSWER)  # type: ignore[no-untyped-call]
    except (OSError, TimeoutError, ValueError) as problem:
        raise DataError(
            f"{address}: no scheduler answers ({type(problem).__name__}); start one with: dask scheduler",
            arguments=("scheduler",),
        ) from None
    logger = getLogger("distributed.client")
    level = logger.level
    logger.setLevel(CRITICAL)  # a lost scheduler is one line of ours, and not its traceback
    try:
        with suppress(OSError, TimeoutError), client:
            yield client.get_executor(pure=False)
    finally:
        logger.setLevel(level)
