"""A log that survives: rows of numbers as text, on the disk at most half a second after they were written."""

from __future__ import annotations

import io
import os
import queue
import threading
from collections.abc import Sequence
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
        Rows that were not taken because the disk fell behind by more than 100 000 rows.
    """

    def __init__(self, path: str | Path, columns: Sequence[str]) -> None:
        self.path, self.columns, self.dropped = Path(path), tuple(columns), 0
        try:
            self._file = self.path.open("x", encoding="ascii", newline="\n")
        except FileExistsError:
            raise InputError(f"the log {path} exists already: name a new one") from None
        except OSError as error:
            raise InputError(f"cannot write the log {path}: {error.strerror or error}") from None
        self._file.write(f"{MARK}\n{','.join(self.columns)}\n")
        self._rows: queue.Queue[tuple[float, ...] | None] = queue.Queue(100_000)
        self._thread = threading.Thread(target=self._work, name="pliant-log", daemon=True)
        self._closed = threading.Event()
        self._thread.start()

    def write(self, row: Sequence[float]) -> None:
        """One row, as many numbers as there are columns; never waits."""
        try:
            self._rows.put_nowait(tuple(row))
        except queue.Full:
            self.dropped += 1

    def _work(self) -> None:
        while not self._closed.wait(SYNC):
            self._drain()
        self._drain()

    def _drain(self) -> None:
        text = io.StringIO()
        while True:
            try:
                row = self._rows.get_nowait()
            except queue.Empty:
                break
            if row is not None:
                text.write(",".join(map(repr, map(float, row))) + "\n")
        if text.tell():
            self._file.write(text.getvalue())
            self._file.flush()
            os.fsync(self._file.fileno())

    def close(self) -> None:
        """Write what is left and close the file."""
        self._closed.set()
        self._thread.join()
        self._file.close()


def read_log(path: str | Path) -> pd.DataFrame:
    """Rows of a log, also of one whose program died; a last row that was cut off is left out and counted in ``attrs``.

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
    columns = lines[1].split(",")
    whole = [line for line in lines[2:-1] if line.count(",") == len(columns) - 1]
    values = np.array([[float(v) for v in line.split(",")] for line in whole]).reshape(-1, len(columns))
    table = pd.DataFrame(values, columns=columns)
    table.attrs["cut_off"] = len(lines) - 3 - len(whole) + bool(lines[-1])
    return table
