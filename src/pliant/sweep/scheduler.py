"""Execution of a parameter sweep in chunks of samples, in this process, on its cores or on a cluster.

An executor may fail at any time, when a worker is killed or a scheduler restarts. Chunks that it had not delivered are
submitted to a new one; delivered chunks are on disk.
"""

from __future__ import annotations

import time
from asyncio import CancelledError as AsyncCancelledError
from collections.abc import Callable, Iterator
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    ProcessPoolExecutor,
    wait,
)
from contextlib import contextmanager
from dataclasses import dataclass, field
from multiprocessing import get_context
from typing import Any, Protocol

from pliant.cores import cores
from pliant.errors import InputError, PliantError
from pliant.heavy import show_heavy
from pliant.sweep.store import Arrays, Store

Notify = Callable[[str], None]
Count = Callable[[float], None]
IN_FLIGHT = 64  # chunks submitted and not yet written: limits the loss by a crash, and the memory
PATIENCE = 3  # consecutive executors without a delivered chunk before the sweep stops
CONNECT_S = 30.0  # s, to wait for a Dask scheduler


class Chunked(Protocol):
    """Interface of a computation in independent chunks of samples, which a worker process can unpickle and run."""

    @property
    def chunks(self) -> int:
        """Return the number of chunks into which the samples are divided."""

    def bounds(self, chunk: int) -> tuple[int, int]:
        """Return the index of the first sample of a chunk, and the index after its last sample."""

    def work(self, chunk: int) -> Arrays:
        """Compute one chunk of samples; return its result arrays by name, with the samples along the first axis."""


def work(campaign: Chunked, chunk: int) -> Arrays:
    """Compute one chunk of a sweep in a worker process; return its result arrays by name."""
    return campaign.work(chunk)


@dataclass
class Account:
    """Counts of a sweep's chunks: computed, already on disk, and submitted again after a failure of workers."""

    chunks: int
    found: int = 0  # complete on disk before the start
    made: int = 0  # computed
    restarts: int = 0  # executors that failed
    repeated: int = 0  # chunks submitted again
    problems: list[str] = field(default_factory=list)

    def sentence(self) -> str:
        """Return a one-line summary: how many chunks were computed, were already on disk, and were submitted again."""
        parts = [f"{self.chunks} chunks: {self.made} computed, {self.found} already on disk"]
        if self.restarts:
            parts.append(
                f"workers failed {self.restarts} time{'s' * (self.restarts > 1)} and {self.repeated} chunks were "
                "submitted again"
            )
        return "; ".join([*parts, *self.problems]) + "; every sample is present exactly once"


class Local(Executor):
    """An executor like those of `concurrent.futures` that runs each job immediately in this process."""

    in_flight = 1

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Run a job immediately in this process and return its finished future."""
        future: Future[Any] = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:  # noqa: BLE001  as every executor: the future carries it
            future.set_exception(error)
        return future


def executor_of(scheduler: str, workers: int | None = None) -> Callable[[], Any]:
    """Return a function that creates executors. `scheduler` is ``local``, ``processes``, or ``tcp://host:port`` of a
    Dask scheduler.

    Raises
    ------
    InputError
        When the scheduler is none of these, or Dask is not installed.
    """
    if scheduler == "local":
        return Local
    if scheduler == "processes":
        return lambda: ProcessPoolExecutor(workers or cores(), mp_context=get_context("spawn"))
    if not scheduler.startswith(("tcp://", "tls://")):
        raise InputError(f"scheduler must be local, processes or tcp://host:port, got {scheduler!r}")
    try:
        import distributed  # noqa: F401
    except ImportError:
        raise InputError("a Dask scheduler needs the extra 'scale': pip install 'pliant[scale]'") from None
    return lambda: dask_executor(scheduler)


@contextmanager
def dask_executor(address: str) -> Iterator[Any]:
    """Yield an executor on the Dask cluster at `address`, after waiting up to 30 s for its scheduler."""
    show_heavy()
    from distributed import Client

    began = time.monotonic()
    while True:
        try:
            client = Client(address, timeout=5, set_as_default=False)
            break
        except (OSError, TimeoutError) as error:
            if time.monotonic() - began > CONNECT_S:
                raise PliantError(
                    f"no Dask scheduler answers at {address}: {error}. Start it, or use scheduler='processes'"
                ) from None
            time.sleep(0.5)
    pool = client.get_executor(pure=False)
    try:
        yield MonitoredExecutor(pool, client)
    finally:
        pool.shutdown(wait=False)  # to wait for a scheduler that is gone would be to wait for ever
        client.close(timeout=2)


class MonitoredExecutor:
    """A Dask executor that raises an error when its scheduler is lost, instead of waiting for results for ever."""

    def __init__(self, pool: Any, client: Any) -> None:
        self.pool = pool
        self.client = client

    def submit(self, *args: Any) -> Any:
        """Submit a job to the Dask cluster and return its future."""
        return self.pool.submit(*args)

    @property
    def gone(self) -> bool:
        """Return whether the connection to the Dask scheduler is lost."""
        return self.client.status != "running"


def run_campaign(
    campaign: Chunked, store: Store, make_executor: Callable[[], Any], notify: Notify = lambda _line: None,
    count: Count | None = None,
) -> Account:
    """Compute all chunks of a sweep that are not on disk yet, and return the counts.
    Chunks that are finished stay on disk in any case.

    `notify` is called with one line of text for each failure of an executor and, without `count`, for each chunk.
    `count` is called with the fraction of finished chunks.

    Raises
    ------
    PliantError
        When the disk is full, a chunk raises an error, or executors fail repeatedly.
    """
    account = Account(campaign.chunks)
    todo = {c for c in range(campaign.chunks) if store.load(c, *campaign.bounds(c)) is None}
    account.found = campaign.chunks - len(todo)
    if account.found:
        notify(f"{account.found} of {campaign.chunks} chunks are already on disk")
    idle = 0

    def written(chunk: int) -> None:
        if count is None:
            notify(f"chunk {chunk} written, {len(todo)} to go")
        else:
            count(1.0 - len(todo) / campaign.chunks)

    while todo:
        before = len(todo)
        broke = one_round(campaign, store, make_executor, todo, account, written)
        if not todo:
            break
        idle = 0 if len(todo) < before else idle + 1
        account.restarts += 1
        account.repeated += len(todo)
        notify(f"workers failed ({broke}); {len(todo)} chunks are submitted again")
        if idle >= PATIENCE:
            raise PliantError(
                f"workers failed {idle} times without delivering a chunk ({broke}); {campaign.chunks - len(todo)} of "
                f"{campaign.chunks} chunks are written: start the same sweep again to continue where it stopped"
            )
    return account


def one_round(
    campaign: Chunked, store: Store, make_executor: Callable[[], Any], todo: set[int], account: Account,
    written: Callable[[int], None],
) -> str:
    """Submit the chunks `todo` to one executor and store the results; return the cause if the executor failed."""
    broke = ""
    with make_executor() as pool:
        flow = Flow(campaign, pool, sorted(todo))
        for chunk, future in flow:
            try:
                arrays = future.result()
            except (Exception, AsyncCancelledError) as error:
                if not is_breakage(error):
                    flow.stop()
                    raise
                broke = type(error).__name__
                continue
            try:
                store.save(chunk, campaign.bounds(chunk)[0], arrays)
            except PliantError:
                flow.stop()
                raise
            todo.discard(chunk)
            account.made += 1
            written(chunk)
    return broke or flow.broke or "the connection to the scheduler was lost"


def is_breakage(error: BaseException) -> bool:
    """Return whether an error means that a worker process or connection failed, rather than the computation itself."""
    if isinstance(error, PliantError):
        return False
    broken = (BrokenExecutor, CancelledError, AsyncCancelledError, ConnectionError, TimeoutError)
    return isinstance(error, broken) or type(error).__module__.startswith("distributed")


class Flow:
    """Iterator that submits chunks to an executor, a few at a time, and yields their futures as they finish."""

    def __init__(self, campaign: Chunked, pool: Any, chunks: list[int]) -> None:
        self.campaign = campaign
        self.pool = pool
        self.waiting = chunks[::-1]
        self.running: dict[Any, int] = {}
        self.broke = ""

    def fill(self) -> None:
        """Submit chunks until 64, or as many as the executor states, are running. If it refuses one, submit no more."""
        while self.waiting and len(self.running) < getattr(self.pool, "in_flight", IN_FLIGHT):
            try:
                future = self.pool.submit(work, self.campaign, self.waiting[-1])
            except (BrokenExecutor, ConnectionError, RuntimeError) as error:
                self.broke = type(error).__name__
                self.waiting.clear()
                return
            self.running[future] = self.waiting.pop()

    def __iter__(self) -> Iterator[tuple[int, Any]]:
        """Yield (chunk, future) as they finish; stop early if the executor reports that it is gone."""
        self.fill()
        while self.running:
            done, _ = wait(self.running, timeout=1.0, return_when=FIRST_COMPLETED)
            if not done and getattr(self.pool, "gone", False):
                return
            for future in done:
                yield self.running.pop(future), future
            self.fill()

    def stop(self) -> None:
        """Cancel all submitted chunks that have not started."""
        self.waiting.clear()
        for future in self.running:
            future.cancel()
