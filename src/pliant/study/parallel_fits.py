"""Parallel computation of a study's fits: helper processes and this process take fits from one queue.

The fits are independent, so that the results do not depend on the process. A study that takes less than 2 s starts no
helper. If a helper process ends early, this process computes its fit.
"""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
from collections import deque
from collections.abc import Callable, Mapping
from threading import Event, Thread
from time import process_time
from typing import IO, Any

from pliant.cores import cores
from pliant.failures import FAILED, fit_failure
from pliant.identification import Experiment
from pliant.model import Model
from pliant.study.fits import run_fit
from pliant.study.schema import Study
from pliant.validation.outcome import FitOutcome

Notify = Callable[[str], None]
HEAD_START = 2.0  # s of processor time before helpers start, not of wall time, so that a busy machine gets no more load
POLL = 0.2  # s
START = """
import sys
sys.path[:] = {path!r}
from pliant.heavy import hide_heavy
hide_heavy()
from pliant.study.parallel_fits import run_helper
run_helper()
"""


class FitQueue:
    """The fits of a study that have not started, and the outcomes of those that have ended."""

    def __init__(self, study: Study, experiments: Mapping[str, Experiment], model: Model) -> None:
        self.common = (study, experiments, model)
        self.packed = b""  # pickled before any fit begins: fits fill caches of the model while helpers start
        self.waiting = deque(study.fits)
        self.outcomes: dict[str, FitOutcome | Exception] = {}
        self.empty = Event()

    def take(self) -> str | None:
        """Remove the next fit from the queue and return its name; None if the queue is empty."""
        try:
            return self.waiting.popleft()
        except IndexError:
            return None

    def missing(self) -> list[str]:
        """Return the names of the fits that have no outcome. After an unexpected error in any fit the list is empty,
        since no further fit is computed.
        """
        given_up = any(map(is_bug, self.outcomes.values()))
        return [] if given_up else [name for name in self.common[0].fits if name not in self.outcomes]

    def put(self, name: str, end: FitOutcome | Exception) -> None:
        """Store the outcome of a fit; after an unexpected error no further fit is started."""
        self.outcomes[name] = end
        if is_bug(end):
            self.waiting.clear()


def run_fits(
    study: Study, experiments: Mapping[str, Experiment], model: Model, notify: Notify, workers: int | None = None,
) -> list[tuple[str, FitOutcome | Exception]]:
    """Compute all fits of a study with up to `workers` processes; default: one for each core.

    Returns
    -------
    list of (str, FitOutcome or Exception)
        Name and outcome of each fit in the study's order. The outcome of a fit that could not be computed is its error,
        one of `pliant.failures.FAILED`. Any other error is raised.
    """
    queue = FitQueue(study, experiments, model)
    helpers = [Helper(queue, notify) for _ in range(min(workers or cores(), len(study.fits)) - 1)]
    if helpers:
        queue.packed = pickle.dumps(queue.common)
    try:
        for helper in helpers:
            helper.start()
        while queue.missing():
            while (name := queue.take()) is not None:
                queue.put(name, fit_or_error(queue.common, name, notify))
            queue.empty.set()
            for helper in helpers:
                helper.stop(busy=False)
                helper.join()
            queue.waiting.extend(queue.missing())  # the fits of helpers that ended early
    finally:
        queue.waiting.clear()
        queue.empty.set()
        for helper in helpers:
            helper.stop()
    ends = [(name, queue.outcomes[name]) for name in study.fits if name in queue.outcomes]
    for _, end in ends:
        if isinstance(end, Exception) and is_bug(end):
            raise end
    return ends


def is_bug(end: FitOutcome | Exception) -> bool:
    """Return whether a fit ended in an unexpected error, one that is not in `pliant.failures.FAILED`."""
    return isinstance(end, Exception) and not isinstance(end, FAILED)


def fit_or_error(
    common: tuple[Study, Mapping[str, Experiment], Model], name: str, notify: Notify,
) -> FitOutcome | Exception:
    """Compute a fit and return its outcome, or the error in which it ended."""
    study, experiments, model = common
    try:
        return run_fit(study, name, study.fits[name], experiments, model, notify)
    except FAILED as error:
        notify(f"warning: {fit_failure(name, error).sentence}")
        return error
    except Exception as error:  # noqa: BLE001  raised again when all fits have ended
        return error


class Helper(Thread):
    """A thread that starts a helper process and passes fits to it, one after the other."""

    def __init__(self, queue: FitQueue, notify: Notify) -> None:
        super().__init__(daemon=True)
        self.queue, self.notify = queue, notify
        self.process: subprocess.Popen[bytes] | None = None
        self.name_of_fit: str | None = None
        self.stopped = False

    def run(self) -> None:
        """Start the helper process after the fits have used 2 s of processor time, so that a short study starts none.
        Then pass fits to it until the queue is empty.
        """
        began = process_time()
        while process_time() - began < HEAD_START:
            if self.queue.empty.wait(POLL):
                return
        command = [sys.executable, "-P", "-c", START.format(path=sys.path)]
        try:
            with subprocess.Popen(  # noqa: S603  this interpreter, in a group that Ctrl-C does not reach
                command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, process_group=0
            ) as self.process:
                try:
                    self.serve(self.process)
                finally:
                    self.process.kill()
        except (OSError, EOFError, pickle.UnpicklingError) as error:
            if not self.stopped:
                self.notify(f"a helper process ended early ({type(error).__name__}): the main process computes the fit "
                            "in its place")  # fmt: skip

    def serve(self, process: Any) -> None:
        """Send fits to the process and store their outcomes until the queue is empty."""
        process.stdin.write(self.queue.packed)
        process.stdin.flush()
        pickle.load(process.stdout)  # noqa: S301  "ready": its modules are loaded
        while (name := self.queue.take()) is not None:
            self.name_of_fit = name
            send(process.stdin, name)
            messages, end = pickle.load(process.stdout)  # noqa: S301
            for message in messages:
                self.notify(message)
            self.queue.put(name, end)
            self.name_of_fit = None

    def stop(self, *, busy: bool = True) -> None:
        """End the helper process. With `busy=False`, it is ended only if it computes no fit at the moment."""
        if busy or self.name_of_fit is None:
            self.stopped = True
            if self.process is not None:
                self.process.kill()


def send(pipe: IO[bytes], what: Any) -> None:
    """Write one pickled object to a pipe and flush it."""
    pickle.dump(what, pipe)
    pipe.flush()


def run_helper() -> None:
    """Run as a helper process: read names of fits from standard input and write their outcomes to standard output."""
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # a library's prints must not mix with the outcomes
    common = pickle.load(sys.stdin.buffer)  # noqa: S301  from the process that started this one
    send(answers, "ready")
    while True:
        try:
            name = pickle.load(sys.stdin.buffer)  # noqa: S301
        except EOFError:
            return
        messages: list[str] = []
        end = fit_or_error(common, name, messages.append)
        send(answers, (messages, end))
