"""Running a campaign: chunks through the concurrent.futures protocol, on this process, its cores, or a cluster.

An executor may break at any time: a worker is killed, a scheduler restarts. What it had not delivered is handed to a
new one; what was delivered is on disk.
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

Tell = Callable[[str], None]
Count = Callable[[float], None]
IN_FLIGHT = 64  # chunks handed out and not yet written: bounds what a crash can cost, and the memory
PATIENCE = 3  # new executors in a row that deliver nothing, before the sweep gives up
CONNECT_S = 30.0


class Chunked(Protocol):
    """Work in chunks that know nothing of each other: `Campaign`, or any class that a worker can unpickle."""

    @property
    def chunks(self) -> int:
        """Number of chunks."""

    def bounds(self, chunk: int) -> tuple[int, int]:
        """First sample of a chunk, and the one after its last."""

    def work(self, chunk: int) -> Arrays:
        """The arrays of one chunk, samples first."""


def work(campaign: Chunked, chunk: int) -> Arrays:
    """Return the work order of a worker."""
    return campaign.work(chunk)


@dataclass
class Account:
    """Counts and times of a campaign, for the summary at its end."""

    chunks: int
    found: int = 0  # on disk before, whole
    made: int = 0
    restarts: int = 0  # executors that broke
    repeated: int = 0  # chunks handed out again
    problems: list[str] = field(default_factory=list)

    def sentence(self) -> str:
        """One line for the end."""
        parts = [f"{self.chunks} chunks: {self.made} computed, {self.found} found from before"]
        if self.restarts:
            parts.append(
                f"workers broke {self.restarts} time{'s' * (self.restarts > 1)} and {self.repeated} chunks were handed "
                "out again"
            )
        return "; ".join([*parts, *self.problems]) + "; nothing is missing, nothing is counted twice"


class Local(Executor):
    """One job after the other, here."""

    in_flight = 1

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Do it now."""
        future: Future[Any] = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:  # noqa: BLE001  as every executor: the future carries it
            future.set_exception(error)
        return future


def executor_of(scheduler: str, workers: int | None = None) -> Callable[[], Any]:
    """A maker of executors: ``local``, ``processes`` or ``tcp://host:port`` of a Dask scheduler.

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
        raise InputError(f"scheduler is local, processes or tcp://host:port, got {scheduler!r}")
    try:
        import distributed  # noqa: F401
    except ImportError:
        raise InputError("a Dask scheduler needs the extra 'scale': pip install 'pliant[scale]'") from None
    return lambda: dask_executor(scheduler)


@contextmanager
def dask_executor(address: str) -> Iterator[Any]:
    """An executor on a Dask cluster; a scheduler that is just restarting is waited for."""
    show_heavy()
    from distributed import Client

    began = time.monotonic()
    while True:
        try:
            client = Client(address, timeout=5, set_as_default=False)
            break
        except (OSError, TimeoutError) as error:
            if time.monotonic() - began > CONNECT_S:
                raise PliantError(f"no Dask scheduler answers at {address}: {error}") from None
            time.sleep(0.5)
    pool = client.get_executor(pure=False)
    try:
        yield Watched(pool, client)
    finally:
        pool.shutdown(wait=False)  # to wait for a scheduler that is gone would be to wait for ever
        client.close(timeout=2)


class Watched:
    """A Dask executor that tells when its scheduler is gone, where its futures would wait for ever."""

    def __init__(self, pool: Any, client: Any) -> None:
        self.pool = pool
        self.client = client

    def submit(self, *args: Any) -> Any:
        """As the executor's."""
        return self.pool.submit(*args)

    @property
    def gone(self) -> bool:
        """Whether the connection to the scheduler is lost."""
        return self.client.status != "running"


def run_campaign(
    campaign: Chunked, store: Store, make_executor: Callable[[], Any], tell: Tell = lambda _line: None,
    count: Count | None = None,
) -> Account:
    """Work on every chunk that is not on disk; returns when all are, or raises with all that is done kept.

    `tell` takes a line for each mishap and, unless `count` takes the share that is done, for each chunk.

    Raises
    ------
    PliantError
        When the disk is full, a chunk fails by itself, or executors break again and again.
    """
    account = Account(campaign.chunks)
    todo = {c for c in range(campaign.chunks) if store.load(c, *campaign.bounds(c)) is None}
    account.found = campaign.chunks - len(todo)
    if account.found:
        tell(f"{account.found} of {campaign.chunks} chunks are there from before")
    idle = 0

    def written(chunk: int) -> None:
        if count is None:
            tell(f"chunk {chunk} written, {len(todo)} to go")
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
        tell(f"workers broke ({broke}); {len(todo)} chunks are handed out again")
        if idle >= PATIENCE:
            raise PliantError(
                f"workers broke {idle} times without delivering a chunk ({broke}); {campaign.chunks - len(todo)} of "
                f"{campaign.chunks} chunks are written: start the same sweep again, it goes on where it stopped"
            )
    return account


def one_round(
    campaign: Chunked, store: Store, make_executor: Callable[[], Any], todo: set[int], account: Account,
    written: Callable[[int], None],
) -> str:
    """Hand out `todo` to one executor and write what it delivers; returns what broke, if anything."""
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
    return broke or flow.broke or "the scheduler went away"


def is_breakage(error: BaseException) -> bool:
    """Whether workers or connections broke, and not the work itself: a killed worker, a lost scheduler."""
    if isinstance(error, PliantError):
        return False
    broken = (BrokenExecutor, CancelledError, AsyncCancelledError, ConnectionError, TimeoutError)
    return isinstance(error, broken) or type(error).__module__.startswith("distributed")


class Flow:
    """Chunks handed out a few at a time, and their futures as they are done."""

    def __init__(self, campaign: Chunked, pool: Any, chunks: list[int]) -> None:
        self.campaign = campaign
        self.pool = pool
        self.waiting = chunks[::-1]
        self.running: dict[Any, int] = {}
        self.broke = ""

    def fill(self) -> None:
        """Hand out until enough are on their way; a pool that refuses gets no more."""
        while self.waiting and len(self.running) < getattr(self.pool, "in_flight", IN_FLIGHT):
            try:
                future = self.pool.submit(work, self.campaign, self.waiting[-1])
            except (BrokenExecutor, ConnectionError, RuntimeError) as error:
                self.broke = type(error).__name__
                self.waiting.clear()
                return
            self.running[future] = self.waiting.pop()

    def __iter__(self) -> Iterator[tuple[int, Any]]:
        """(chunk, future) as they are done; ends early where the executor says that it is gone."""
        self.fill()
        while self.running:
            done, _ = wait(self.running, timeout=1.0, return_when=FIRST_COMPLETED)
            if not done and getattr(self.pool, "gone", False):
                return
            for future in done:
                yield self.running.pop(future), future
            self.fill()

    def stop(self) -> None:
        """Let go of what has not begun."""
        self.waiting.clear()
        for future in self.running:
            future.cancel()
