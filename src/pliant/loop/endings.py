"""Signals that would end or stop a program become an exception, so that what is under pressure is let go first."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

# all that may be caught and end or stop a program; SIGKILL, SIGSTOP, a crash and a lost supply are the receiver's part
NAMES = (
    "SIGTERM", "SIGHUP", "SIGQUIT", "SIGINT", "SIGBREAK", "SIGUSR1", "SIGUSR2", "SIGALRM", "SIGVTALRM", "SIGPROF",
    "SIGXCPU", "SIGIO", "SIGPWR", "SIGSTKFLT", "SIGTSTP", "SIGTTIN", "SIGTTOU", "SIGPIPE",
)


class Ended(SystemExit):
    """A signal ended the program; its exit code is 128 plus the signal's number."""


@contextmanager
def ended_by_signals() -> Iterator[None]:
    """While inside, the first signal that would end the program raises `Ended` (SIGINT: KeyboardInterrupt), once.

    Those that come later wait for the end of the block, so that none of them cuts short what the first one led to.
    Handlers of the program's own stay. Signals reach the main thread alone: in another thread nothing changes.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    came: list[int] = []

    def end(number: int, _frame: FrameType | None) -> None:
        came.append(number)
        if len(came) == 1:
            raise KeyboardInterrupt if number == signal.SIGINT else Ended(128 + number)

    before = {}
    for name in NAMES:
        number = getattr(signal, name, None)
        if number is not None and signal.getsignal(number) in (signal.SIG_DFL, signal.default_int_handler):
            before[number] = signal.signal(number, end)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
