"""Convert signals that end a program to exceptions, so that it can release the pressure before it ends."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

# all signals that end or stop a program and can be caught; the receiver handles SIGKILL, SIGSTOP, crash and power loss
NAMES = (
    "SIGTERM", "SIGHUP", "SIGQUIT", "SIGINT", "SIGBREAK", "SIGUSR1", "SIGUSR2", "SIGALRM", "SIGVTALRM", "SIGPROF",
    "SIGXCPU", "SIGIO", "SIGPWR", "SIGSTKFLT", "SIGTSTP", "SIGTTIN", "SIGTTOU", "SIGPIPE",
)


class Ended(SystemExit):
    """Exception raised when a signal ends the program. The exit code is 128 plus the signal's number."""


@contextmanager
def ended_by_signals() -> Iterator[None]:
    """Context manager in which the first signal that would end the program raises `Ended`.

    SIGINT raises KeyboardInterrupt. Later signals are ignored until the end of the block, so that they cannot interrupt
    the reaction to the first one. The program's own signal handlers are kept. Signals reach only the main thread: in
    another thread the context manager does nothing.
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
