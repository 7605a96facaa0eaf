"""A log file of a control loop that survives a crash: rows of text are on the disk after at most half a second."""

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
from pliant.files import LARGEST_TABLE, content_of

if TYPE_CHECKING:
    import pandas as pd

SYNC = 0.5  # s between two writes to the disk
MARK = "# pliant-loop-log 1"


class LoopLog:
    """A CSV file to which a separate thread writes rows, so that a slow disk does not delay the loop.

    Parameters
    ----------
    path : str or Path
        Path of a new file.
    columns : sequence of str
        Column names with units, e.g. ``command_pa``.

    Attributes
    ----------
    dropped : int
        Number of rows that are not in the file, because the disk was more than 100 000 rows behind or failed.
    fault : str
        Description of the first write error; empty if there was none. Writing goes on every half second.
    """

    def __init__(self, path: str | Path, columns: Sequence[str]) -> None:
        self.path, self.columns, self.dropped, self.fault = Path(path), tuple(columns), 0, ""
        try:
            self._file = self.path.open("xb", buffering=0)
            self._begin()
        except FileExistsError:
            raise InputError(f"the log {path} exists already: give the name of a new file") from None
        except OSError as error:
            raise InputError(f"cannot write the log {path}: {error.strerror or error}") from None
        self._rows: queue.Queue[tuple[float, ...] | str] = queue.Queue(100_000)
        self._thread = threading.Thread(target=self._work, name="pliant-log", daemon=True)
        self._closed = threading.Event()
        self._thread.start()

    def _begin(self) -> None:
        """Write the first lines of the file. Remove it if this fails, because its name would be refused next time."""
        try:
            self._append(f"{MARK}\n{','.join(self.columns)}\n".encode("ascii"))
        except OSError:
            self._file.close()
            with suppress(OSError):
                self.path.unlink()
            raise

    def write(self, row: Sequence[float]) -> None:
        """Queue one row with a number for each column, without waiting."""
        try:
            self._rows.put_nowait(tuple(row))
        except queue.Full:
            self.dropped += 1

    def remark(self, sentence: str) -> None:
        """Queue one sentence, such as a fault, as a comment line between the rows, without waiting."""
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
        """Append all of `data` to the file and sync it to the disk, or restore the file and raise OSError."""
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
        """Write the remaining rows and close the file. Afterwards `fault` and `dropped` show whether rows were lost."""
        self._closed.set()
        self._thread.join()
        with suppress(OSError):
            self._file.close()


def line_of(row: tuple[float, ...] | str) -> str:
    """Return a row of numbers, or a remark, as a line of the file."""
    return row if isinstance(row, str) else ",".join(map(repr, map(float, row)))


def read_log(path: str | Path) -> pd.DataFrame:
    """Return the rows of a log as a table, also after the program that wrote it has crashed.

    ``attrs["remarks"]`` holds the sentences between the rows, such as a fault. An incomplete last row is left out and
    counted in ``attrs["cut_off"]``.

    Raises
    ------
    InputError
        When the file cannot be read or is not a log of a loop.
    """
    import pandas as pd

    text = content_of(path, "log", LARGEST_TABLE).decode("ascii", "replace")
    lines = text.replace("\r\n", "\n").split("\n")
    if len(lines) < 2 or lines[0] != MARK:
        raise InputError(f"{path} is not a log of a control loop: its first line must be {MARK!r}")
    columns, remarks = lines[1].split(","), [line[2:] for line in lines[2:-1] if line.startswith("# ")]
    lines = [line for line in lines if not line.startswith("# ") or line == MARK]
    whole = [line for line in lines[2:-1] if line.count(",") == len(columns) - 1]
    values = np.array([[float(v) for v in line.split(",")] for line in whole]).reshape(-1, len(columns))
    table = pd.DataFrame(values, columns=columns)
    table.attrs["remarks"] = remarks
    table.attrs["cut_off"] = len(lines) - 3 - len(whole) + bool(lines[-1])
    return table
