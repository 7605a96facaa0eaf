"""Independent jobs side by side, on executors of `concurrent.futures`: the fits of a study, the chunks of a sweep."""

from __future__ import annotations

import os
import signal
import sys
from asyncio import CancelledError as AsyncCancelledError
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    ProcessPoolExecutor,
    ThreadPoolExecutor,
    wait,
)
from functools import cache
from itertools import islice
from multiprocessing import parent_process
from multiprocessing.context import SpawnContext, SpawnProcess
from threading import Thread
from types import ModuleType
from typing import Any, TypeVar

from pliant.errors import PliantError
from pliant.heavy import hide_heavy

Job = TypeVar("Job")
Result = TypeVar("Result")
IN_FLIGHT = 64  # jobs submitted and not yet finished: limits the memory, and what is lost with an executor
POLL = 0.1  # s


def cores() -> int:
    """Return the number of processor cores that this process may use: the system's limit or, without one, all cores."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def side_by_side(work: Callable[[Job], Result], jobs: Sequence[Job]) -> list[Result]:
    """Return ``work(job)`` for each job, in their order, computed in as many threads as there are cores; in a worker
    process, whose neighbours use the other cores, in one. It pays where most of the work is a kernel that releases
    Python's global lock.
    """
    pool = threads() if len(jobs) > 1 else None
    try:
        results = map(work, jobs) if pool is None else pool.map(work, jobs)
    except RuntimeError:  # when the program ends, a pool takes no job any more
        results = map(work, jobs)
    return list(results)


@cache
def threads() -> ThreadPoolExecutor | None:
    """Return the threads of this process that compute side by side; None in a worker process or on a single core."""
    return None if parent_process() or cores() < 2 else ThreadPoolExecutor(cores())


if hasattr(os, "register_at_fork"):  # a forked process inherits the pool, but none of its threads
    os.register_at_fork(after_in_child=threads.cache_clear)


class Worker(SpawnProcess):
    """A process that does not run the user's script again, so that it needs no guard, and that Ctrl-C does not reach:
    the process that started it ends it.
    """

    def start(self) -> None:
        """Start the process while SIGINT is blocked, which it inherits, and while __main__ is an empty module, because
        multiprocessing imports __main__ in the new process.
        """
        script, mask = sys.modules["__main__"], getattr(signal, "pthread_sigmask", None)
        before = mask(signal.SIG_BLOCK, {signal.SIGINT}) if mask else None
        sys.modules["__main__"] = ModuleType("__main__")
        try:
            super().start()
        finally:
            sys.modules["__main__"] = script
            if mask:
                mask(signal.SIG_SETMASK, before)


class WorkerContext(SpawnContext):
    """The context of multiprocessing that starts a `Worker` for each process."""

    Process = Worker


class WorkerProcesses(ProcessPoolExecutor):
    """A ProcessPoolExecutor whose `with` statement ends all jobs that still run, for example after Ctrl-C."""

    def __init__(self, workers: int) -> None:
        most = 61 if sys.platform == "win32" else workers  # Windows cannot wait for more
        super().__init__(min(workers, most), mp_context=WorkerContext(), initializer=prepare_worker)

    def __exit__(self, *_: object) -> None:
        """Cancel waiting jobs and end all worker processes."""
        processes = list((self._processes or {}).values())
        self.shutdown(wait=False, cancel_futures=True)
        for process in processes:
            process.kill()


def prepare_worker() -> None:
    """Prepare this worker process before its first job. It ends with the process that started it."""
    hide_heavy()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # where signals cannot be blocked: Windows
    os.dup2(2, 1)  # a library's prints must not mix with the result that a command prints

    def end_with_parent() -> None:
        if parent := parent_process():
            parent.join()
            os._exit(1)

    Thread(target=end_with_parent, daemon=True).start()


def compute(
    work: Callable[[Job], Result], jobs: Iterator[Job], pool: Executor, keep: Callable[[Job, Result], None],
    in_flight: int = IN_FLIGHT, gone: Callable[[], bool] = lambda: False,
) -> str:
    """Compute jobs with an executor and call ``keep(job, work(job))`` here for each, in the order in which they finish.

    Parameters
    ----------
    work : callable
        Picklable function of one job.
    jobs : iterator
        Jobs, taken only as they are submitted, so that others may take from the same iterator.
    in_flight : int
        Largest number of jobs that the executor has at a time.
    gone : callable
        Asked every 0.1 s; once it returns True, the remaining jobs are given up.

    Returns
    -------
    str
        Empty if every job that was taken is kept; otherwise why some are not, because workers failed. An error of a job
        itself is raised.
    """
    running: dict[Any, Job] = {}
    failure = ""
    try:
        while True:
            try:
                for job in islice(jobs, in_flight - len(running)):
                    running[pool.submit(work, job)] = job
            except (BrokenExecutor, OSError, RuntimeError) as error:  # the executor accepts no job any more
                jobs, failure = iter(()), type(error).__name__
            if not running:
                return failure
            done = wait(running, POLL, FIRST_COMPLETED).done
            if not done and gone():
                return failure or "the connection was lost"
            for future in done:
                job = running.pop(future)
                if lost := breakage(future):
                    failure = lost
                else:
                    keep(job, future.result())
    finally:
        for future in running:
            future.cancel()


def breakage(future: Future[Any]) -> str:
    """Return the error of a finished job if its worker process or connection failed; empty for a result. Any other
    error, one of the computation itself, is raised.
    """
    broken = (BrokenExecutor, CancelledError, AsyncCancelledError, ConnectionError, TimeoutError)
    try:
        future.result()
    except PliantError:
        raise
    except (Exception, AsyncCancelledError) as error:
        if isinstance(error, broken) or type(error).__module__.startswith("distributed"):
            return type(error).__name__
        raise
    return ""
