"""Parallel computation of a study's fits: this process and worker processes take fits from one iterator.

A fit that contains smaller ones waits for them, since it also starts from their optima; all others are independent, so
that the results do not depend on the process. A study that takes less than 2 s starts no worker. If a worker ends
early, this process computes its fit.
"""

from __future__ import annotations

import pickle
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from functools import cache, partial
from itertools import chain, repeat
from threading import Event
from time import process_time

from pliant.failures import FAILED, fit_failure
from pliant.identification import Experiment, FitResult
from pliant.model import Model
from pliant.parallel import POLL, WorkerProcesses, compute, cores
from pliant.study.fits import run_fit, smaller_fits
from pliant.study.schema import Study
from pliant.validation.outcome import FitOutcome

Notify = Callable[[str], None]
Common = tuple[Study, Mapping[str, Experiment], Model, Mapping[str, Mapping[str, FitResult]]]  # what all fits share
Reply = tuple[list[str], FitOutcome | Exception | None]  # of a worker: its messages, and how the fit ended
HEAD_START = 2.0  # s of processor time before workers start, not of wall time, so that a busy machine gets no more load


def run_fits(
    study: Study, experiments: Mapping[str, Experiment], model: Model, notify: Notify, workers: int | None = None,
) -> list[tuple[str, FitOutcome | Exception]]:
    """Compute all fits of a study with up to `workers` processes, this one included; default: one for each core.

    Returns
    -------
    list of (str, FitOutcome or Exception)
        Name and outcome of each fit in the study's order. The outcome of a fit that could not be computed is its error,
        one of `pliant.failures.FAILED`. Any other error is raised, and no further fit is started.
    """
    inside, ends = smaller_fits(study, model), dict[str, FitOutcome | Exception]()
    while waiting := [n for n in study.fits if n not in ends and all(smaller in ends for smaller in inside[n])]:
        done = {name: end.result for name, end in ends.items() if isinstance(end, FitOutcome)}
        nested = {name: {smaller: done[smaller] for smaller in inside[name] if smaller in done} for name in waiting}
        ends |= run_together((study, experiments, model, nested), waiting, notify, workers)
    return [(name, ends[name]) for name in study.fits]


def run_together(
    common: Common, names: Sequence[str], notify: Notify, workers: int | None,
) -> dict[str, FitOutcome | Exception]:
    """Compute the named fits, none of which waits for another, and return their outcomes by name."""
    waiting, over = iter(names), Event()
    ends: dict[str, FitOutcome | Exception] = {}

    def keep(name: str, reply: Reply) -> None:
        messages, end = reply
        for message in messages:
            notify(message)
        if end is not None:
            ends[name] = end

    count = min(workers or cores(), len(names)) - 1
    packed = pickle.dumps(common) if count else b""  # before any fit begins: fits fill caches of the model
    with ThreadPoolExecutor(1) as thread:
        try:
            helper = thread.submit(help_with, waiting, packed, count, keep, over, notify)
            for name in waiting:
                ends[name] = fit_or_error(common, name, notify)
            while len(ends) < len(names) and not wait([helper], POLL).done:
                pass
            for name in names:
                if name not in ends:  # of a worker that ended early, unless the fit raised an error there
                    helper.result()
                    ends[name] = fit_or_error(common, name, notify)
        finally:
            over.set()
    return ends


def fit_or_error(common: Common, name: str, notify: Notify) -> FitOutcome | Exception:
    """Compute a fit and return its outcome, or the error of `pliant.failures.FAILED` in which it ended."""
    study, experiments, model, nested = common
    try:
        return run_fit(study, name, experiments, model, notify, nested[name])
    except FAILED as error:
        notify(f"warning: {fit_failure(name, error).sentence}")
        return error


def help_with(
    waiting: Iterator[str], packed: bytes, workers: int, keep: Callable[[str, Reply], None], over: Event,
    notify: Notify,
) -> None:
    """Compute waiting fits in worker processes, from the moment at which this process has used 2 s of processor time
    until `over` is set or no fit is waiting. A worker takes its first fit when it has loaded all modules.
    """
    began = process_time()
    while not workers or process_time() - began < HEAD_START:
        if over.wait(POLL):
            return
    jobs = chain(repeat("", workers), waiting)
    try:
        with WorkerProcesses(workers) as pool:
            failure = compute(partial(fit_in_worker, packed), jobs, pool, keep, workers, over.is_set)
    except (OSError, NotImplementedError) as error:  # of a system that starts no worker
        failure = type(error).__name__
    except BaseException:
        list(waiting)  # no further fit is started
        raise
    if failure and not over.is_set():
        notify(f"a worker process ended early ({failure}): the main process computes the fit in its place")


def fit_in_worker(packed: bytes, name: str) -> Reply:
    """Compute a fit of a study, pickled with its recordings and model. Without a name, only load the modules."""
    common, messages = unpacked(packed), list[str]()
    return messages, fit_or_error(common, name, messages.append) if name else None


@cache
def unpacked(packed: bytes) -> Common:
    """Return what all fits share, from its pickle."""
    common: Common = pickle.loads(packed)  # noqa: S301  from the process that started this one
    return common
