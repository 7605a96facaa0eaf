"""Execution of a parameter sweep in chunks of samples, in this process, on its cores or on a cluster.

An executor may fail at any time, when a worker is killed or a scheduler restarts. Chunks that it had not delivered are
submitted to a new one; delivered chunks are on disk.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Any, Protocol

from pliant.errors import InputError, PliantError
from pliant.heavy import show_heavy
from pliant.parallel import WorkerProcesses, compute, cores
from pliant.sweep.store import Arrays, Store

Notify = Callable[[str], None]
Count = Callable[[float], None]
PATIENCE = 3  # consecutive executors without a delivered chunk before the sweep stops
CONNECT_S = 30.0  # s, to wait for a Dask scheduler


class Chunked(Protocol):
    """Interface of a computation in independent chunks of samples, which a worker process can unpickle and run."""

    @property
    def bounds(self) -> Sequence[tuple[int, int]]:
        """Return, for each chunk, the index of its first sample and the index after its last sample."""

    def work(self, chunk: int) -> Arrays:
        """Compute one chunk of samples; return its result arrays by name, with the samples along the first axis."""


def work(task: Chunked, chunk: int) -> Arrays:
    """Compute one chunk of a sweep; return its result arrays by name."""
    return task.work(chunk)


@dataclass
class Account:
    """Counts of a sweep's chunks: computed, already on disk, and submitted again after a failure of workers."""

    chunks: int
    found: int = 0  # complete on disk before the start
    made: int = 0  # computed
    restarts: int = 0  # executors that failed
    repeated: int = 0  # chunks submitted again

    def sentence(self) -> str:
        """Return a one-line summary: how many chunks were computed, were already on disk, and were submitted again."""
        parts = [f"{self.chunks} chunks: {self.made} computed, {self.found} already on disk"]
        if self.restarts:
            parts.append(
                f"workers failed {self.restarts} time{'s' * (self.restarts > 1)} and {self.repeated} chunks were "
                "submitted again"
            )
        return "; ".join(parts) + "; every sample is present exactly once"


def executor_of(scheduler: str, workers: int | None = None) -> Callable[[], Any] | None:
    """Return a function that creates executors, None for this process alone. `scheduler` is ``local``, ``processes``,
    or ``tcp://host:port`` of a Dask scheduler.

    Raises
    ------
    InputError
        When the scheduler is none of these, or Dask is not installed.
    """
    if scheduler == "local":
        return None
    if scheduler == "processes":
        return lambda: WorkerProcesses(workers or cores())
    if not scheduler.startswith(("tcp://", "tls://")):
        raise InputError("scheduler must be local, processes or tcp://host:port, or device gpu or jax, "
                         f"got {scheduler!r}")  # fmt: skip
    show_heavy()  # the command line hides Dask, and a hidden package looks as if it were not installed
    try:
        import distributed  # noqa: F401
    except ImportError:
        raise InputError("a Dask scheduler needs the extra 'scale': pip install 'pliant[scale]'") from None
    return lambda: dask_executor(scheduler)


@contextmanager
def dask_executor(address: str) -> Iterator[Any]:
    """Yield an executor on the Dask cluster at `address`, after waiting up to 30 s for its scheduler."""
    from distributed import Client

    try:
        client = Client(address, timeout=CONNECT_S, set_as_default=False)
    except (OSError, TimeoutError) as error:
        raise PliantError(
            f"no Dask scheduler answers at {address}: {error}. Start it, or use scheduler='processes'"
        ) from None
    pool = client.get_executor(pure=False)
    pool.gone = lambda: client.status != "running"  # Dask would wait for ever for a scheduler that is lost
    try:
        yield pool
    finally:
        pool.shutdown(wait=False)  # to wait for a scheduler that is gone would be to wait for ever
        client.close(timeout=2)


def run_chunks(
    task: Chunked, store: Store, make_executor: Callable[[], Any] | None = None,
    notify: Notify = lambda _line: None, count: Count | None = None,
) -> Account:
    """Compute all chunks of a sweep that are not on disk yet, by default in this process, and return the counts.
    Chunks that are finished stay on disk in any case.

    `notify` is called with one line of text for each failure of an executor and, without `count`, for each chunk.
    `count` is called with the fraction of finished chunks.

    Raises
    ------
    PliantError
        When the disk is full, a chunk raises an error, or executors fail repeatedly.
    """
    bounds = task.bounds
    todo = {c for c, samples in enumerate(bounds) if store.load(c, *samples) is None}
    account = Account(len(bounds), found=len(bounds) - len(todo))
    if account.found:
        notify(f"{account.found} of {account.chunks} chunks are already on disk")

    def keep(chunk: int, arrays: Arrays) -> None:
        store.save(chunk, bounds[chunk][0], arrays)
        todo.discard(chunk)
        account.made += 1
        if count is None:
            notify(f"chunk {chunk} written, {len(todo)} to go")
        else:
            count(1.0 - len(todo) / account.chunks)

    if make_executor is None:
        for chunk in sorted(todo):
            keep(chunk, work(task, chunk))
    idle = 0  # executors since the last chunk
    while todo and make_executor is not None:
        before = len(todo)
        with make_executor() as pool:
            gone = getattr(pool, "gone", lambda: False)
            failure = compute(partial(work, task), iter(sorted(todo)), pool, keep, gone=gone)
        if not todo:
            break
        idle = 0 if len(todo) < before else idle + 1
        account.restarts += 1
        account.repeated += len(todo)
        notify(f"workers failed ({failure}); {len(todo)} chunks are submitted again")
        if idle >= PATIENCE:
            raise PliantError(
                f"workers failed {idle} times without delivering a chunk ({failure}); {account.chunks - len(todo)} of "
                f"{account.chunks} chunks are written: start the same sweep again to continue where it stopped"
            )
    return account
