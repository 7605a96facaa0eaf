"""Fits of a study side by side: helper processes take fits from the line while this process works through it.

A fit knows nothing of another, so what it finds does not depend on who made it. A study that is done in a moment starts
no helper: to start one costs as much. A helper that ends leaves its fit to this process.
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

Tell = Callable[[str], None]
HEAD_START = 2.0  # s of the processor: a busy machine is not helped by more processes
POLL = 0.2  # s
START = """
import sys
sys.path[:] = {path!r}
from pliant.heavy import hide_heavy
hide_heavy()
from pliant.study.side_by_side import help_out
help_out()
"""


class Line:
    """The fits that wait, and what has become of the others."""

    def __init__(self, study: Study, experiments: Mapping[str, Experiment], model: Model) -> None:
        self.common = (study, experiments, model)
        self.waiting = deque(study.fits)
        self.ended: dict[str, FitOutcome | Exception] = {}
        self.empty = Event()

    def take(self) -> str | None:
        """The name of the next fit; None when no more waits."""
        try:
            return self.waiting.popleft()
        except IndexError:
            return None

    def missing(self) -> list[str]:
        """The fits that nobody has made; none after an unexpected error."""
        given_up = any(map(is_bug, self.ended.values()))
        return [] if given_up else [name for name in self.common[0].fits if name not in self.ended]

    def put(self, name: str, end: FitOutcome | Exception) -> None:
        """Store the outcome of a fit; after an unexpected error no further fit is started."""
        self.ended[name] = end
        if is_bug(end):
            self.waiting.clear()


def run_fits(
    study: Study, experiments: Mapping[str, Experiment], model: Model, tell: Tell, workers: int | None = None,
) -> list[tuple[str, FitOutcome | Exception]]:
    """Compute all fits of a study, by as many processes as there are `workers`; default: one for each core.

    Returns
    -------
    list of (str, FitOutcome or Exception)
        Name and outcome of each fit in the study's order; of a fit that could not be computed, the error (one of
        `pliant.failures.FAILED`). Any other error is raised.
    """
    line = Line(study, experiments, model)
    helpers = [Helper(line, tell) for _ in range(min(workers or cores(), len(study.fits)) - 1)]
    try:
        for helper in helpers:
            helper.start()
        while line.missing():
            while (name := line.take()) is not None:
                line.put(name, ended(line.common, name, tell))
            line.empty.set()
            for helper in helpers:
                helper.stop(busy=False)
                helper.join()
            line.waiting.extend(line.missing())  # what a helper had when it ended
    finally:
        line.waiting.clear()
        line.empty.set()
        for helper in helpers:
            helper.stop()
    ends = [(name, line.ended[name]) for name in study.fits if name in line.ended]
    for _, end in ends:
        if isinstance(end, Exception) and is_bug(end):
            raise end
    return ends


def is_bug(end: FitOutcome | Exception) -> bool:
    """Whether a fit ended in an error that no computation ends in on purpose."""
    return isinstance(end, Exception) and not isinstance(end, FAILED)


def ended(common: tuple[Study, Mapping[str, Experiment], Model], name: str, tell: Tell) -> FitOutcome | Exception:
    """A fit, or why it could not be computed."""
    study, experiments, model = common
    try:
        return run_fit(study, name, study.fits[name], experiments, model, tell)
    except FAILED as error:
        tell(f"warning: {fit_failure(name, error).sentence}")
        return error
    except Exception as error:  # noqa: BLE001  raised where all fits have ended
        return error


class Helper(Thread):
    """A process beside this one, and who hands it one fit after the other."""

    def __init__(self, line: Line, tell: Tell) -> None:
        super().__init__(daemon=True)
        self.line, self.tell = line, tell
        self.process: subprocess.Popen[bytes] | None = None
        self.name_of_fit: str | None = None
        self.stopped = False

    def run(self) -> None:
        """Work until no fit waits."""
        began = process_time()
        while process_time() - began < HEAD_START:
            if self.line.empty.wait(POLL):
                return
        command = [sys.executable, "-P", "-c", START.format(path=sys.path)]
        try:
            with subprocess.Popen(  # noqa: S603  ourselves; a group of its own: Ctrl-C is this process' to answer
                command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, process_group=0
            ) as self.process:
                try:
                    self.serve(self.process)
                finally:
                    self.process.kill()
        except (OSError, EOFError, pickle.UnpicklingError) as error:
            if not self.stopped:
                self.tell(f"a process that made fits beside this one ended ({type(error).__name__}): this one goes on")

    def serve(self, process: Any) -> None:
        """Hand out fits, take what they became."""
        send(process.stdin, self.line.common)
        pickle.load(process.stdout)  # noqa: S301  it has loaded what it needs
        while (name := self.line.take()) is not None:
            self.name_of_fit = name
            send(process.stdin, name)
            messages, end = pickle.load(process.stdout)  # noqa: S301
            for line in messages:
                self.tell(line)
            self.line.put(name, end)
            self.name_of_fit = None

    def stop(self, *, busy: bool = True) -> None:
        """End the process, or only one that has no fit."""
        if busy or self.name_of_fit is None:
            self.stopped = True
            if self.process is not None:
                self.process.kill()


def send(pipe: IO[bytes], what: Any) -> None:
    """Write one pickle."""
    pickle.dump(what, pipe)
    pipe.flush()


def help_out() -> None:
    """Serve as a helper process: fits by name from standard input, each answered on standard output, until it ends."""
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # what a library prints must not come between the answers
    common = pickle.load(sys.stdin.buffer)  # noqa: S301  from the process that started this one
    send(answers, "ready")
    while True:
        try:
            name = pickle.load(sys.stdin.buffer)  # noqa: S301
        except EOFError:
            return
        messages: list[str] = []
        end = ended(common, name, messages.append)
        send(answers, (messages, end))
