"""A log that survives: rows of numbers as text, on the disk at most half a second after they were written."""

from __future__ import annotations

import os
import queue
import threading
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from pliant.errors import InputError

if TYPE_CHECKING:
    import pandas as pd

SYNC = 0.5  # s between two writes to the disk
MARK = "# pliant-loop-log 1"


class LoopLog:
    """Rows into a CSV file by a thread of its own, so that no disk holds up the loop.

    Parameters
    ----------
    path : str or Path
        A new file.
    columns : sequence of str
        Names with units, e.g. ``command_pa``.

    Attributes
    ----------
    dropped : int
        Rows that are not in the file: the disk fell behind by more than 100 000 rows, or took no more.
    fault : str
        One sentence when the disk took no more, empty otherwise. Rows are tried again, each half a second.
    """

    def __init__(self, path: str | Path, columns: Sequence[str]) -> None:
        self.path, self.columns, self.dropped, self.fault = Path(path), tuple(columns), 0, ""
        try:
            self._file = self.path.open("xb", buffering=0)
            self._append(f"{MARK}\n{','.join(self.columns)}\n".encode("ascii"))
        except FileExistsError:
            raise InputError(f"the log {path} exists already: name a new one") from None
        except OSError as error:
            raise InputError(f"cannot write the log {path}: {error.strerror or error}") from None
        self._rows: queue.Queue[tuple[float, ...] | str] = queue.Queue(100_000)
        self._thread = threading.Thread(target=self._work, name="pliant-log", daemon=True)
        self._closed = threading.Event()
        self._thread.start()

    def write(self, row: Sequence[float]) -> None:
        """One row, as many numbers as there are columns; never waits."""
        try:
            self._rows.put_nowait(tuple(row))
        except queue.Full:
            self.dropped += 1

    def remark(self, sentence: str) -> None:
        """One sentence among the rows, such as a fault; never waits."""
        with suppress(queue.Full):
            self._rows.put_nowait(f"# {' '.join(sentence.split())}")

    def _work(self) -> None:
        while not self._closed.wait(SYNC):
            self._drain()
        self._drain()

    def _drain(self) -> None:
        rows = []
        with suppress(queue.Empty):
            while True:
                rows.append(self._rows.get_nowait())
        if not rows:
            return
        try:
            self._append("".join(f"{line_of(row)}\n" for row in rows).encode("ascii", "replace"))
        except OSError as error:
            self.dropped += len(rows)
            self.fault = self.fault or f"the log {self.path} lost rows: {error.strerror or error}"

    def _append(self, data: bytes) -> None:
        """All of it onto the disk, or none of it."""
        end = self._file.seek(0, os.SEEK_END)
        try:
            left = memoryview(data)
            while left:
                left = left[self._file.write(left) :]
            os.fsync(self._file.fileno())
        except OSError:
            with suppress(OSError):
                self._file.truncate(end)
            raise

    def close(self) -> None:
        """Write what is left and close the file; `fault` and `dropped` then tell what the disk did not take."""
        self._closed.set()
        self._thread.join()
        with suppress(OSError):
            self._file.close()


def line_of(row: tuple[float, ...] | str) -> str:
    """A row, or a remark, as it stands in the file."""
    return row if isinstance(row, str) else ",".join(map(repr, map(float, row)))


def read_log(path: str | Path) -> pd.DataFrame:
    """Rows of a log, also of one whose program died; a last row that was cut off is left out and counted in ``attrs``.

    ``attrs["remarks"]`` holds the sentences among the rows, such as a fault.

    Raises
    ------
    InputError
        When the file is no log.
    """
    import pandas as pd

    try:
        lines = Path(path).read_text(encoding="ascii", errors="replace").split("\n")
    except OSError as error:
        raise InputError(f"cannot read the log {path}: {error.strerror or error}") from None
    if len(lines) < 2 or lines[0] != MARK:
        raise InputError(f"{path} is no log of a loop: its first line must be {MARK!r}")
    columns, remarks = lines[1].split(","), [line[2:] for line in lines[2:-1] if line.startswith("# ")]
    lines = [line for line in lines if not line.startswith("# ") or line == MARK]
    whole = [line for line in lines[2:-1] if line.count(",") == len(columns) - 1]
    values = np.array([[float(v) for v in line.split(",")] for line in whole]).reshape(-1, len(columns))
    table = pd.DataFrame(values, columns=columns)
    table.attrs["remarks"] = remarks
    table.attrs["cut_off"] = len(lines) - 3 - len(whole) + bool(lines[-1])
    return table
