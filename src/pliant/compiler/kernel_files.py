"""Files of the kernel cache: locks between processes, and removal of the kernels that were used least recently.

Loops that Numba compiled have an index ``.nbi`` and data files ``.nbc``, steps of `machine_code` one file ``.code``.
"""

from __future__ import annotations

import os
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from time import monotonic, sleep, time
from typing import IO

try:
    import fcntl
except ImportError:  # no such locks on this system: processes may compile the same kernel at the same time
    fcntl = None  # type: ignore[assignment]

LONGEST_WAIT = 120.0  # s, for another process that compiles the same kernel; then this one compiles for itself
DAY = 86400.0  # s
FORGOTTEN = 30 * DAY  # since a kernel was used
MOST_BYTES = 128_000_000  # of all stored kernels; a run of the tests stores less than half of it


def mark_used(index: Path) -> None:
    """Set the time of a kernel's index file to the present, at most once a day."""
    with suppress(OSError):  # another process may have removed it
        if time() - index.stat().st_mtime > DAY:
            os.utime(index)


def evict(folder: Path, most: int = MOST_BYTES) -> None:
    """Remove kernels that were not used for 30 days, and further ones, those not used for longest first, until the
    stored files hold at most `most` bytes.

    The folders beside `folder`, which other versions of Numba use, are counted too. A kernel that another process
    stores at the moment is kept; a process that looks for a removed kernel compiles it.
    """
    kernels: defaultdict[Path, list[tuple[float, int]]] = defaultdict(list)  # time of use and size of each file
    for file in stored_files(folder):
        with suppress(OSError):  # another process may have been first
            known = file.stat()
            kernels[kernel_of(file)].append((known.st_mtime, known.st_size))
    left = sum(size for files in kernels.values() for _, size in files)
    for kernel, files in sorted(kernels.items(), key=lambda item: max(item[1])):
        if left <= most and time() - max(files)[0] < FORGOTTEN:
            return
        with alone(kernel.with_name(f"{kernel.name}.lock"), wait=0.0) as free:
            if free:
                with suppress(OSError):
                    remove(kernel)
                left -= sum(size for _, size in files)


def stored_files(folder: Path) -> Iterator[Path]:
    """Yield the files of stored kernels in a cache folder and in those of other versions of Numba beside it. Incomplete
    files that a killed process left a day ago are removed.
    """
    for candidate in {folder, *folder.parent.glob("kernels-*")}:
        with suppress(OSError):
            for file in list(candidate.iterdir()):
                if file.suffix in (".nbi", ".nbc", ".code"):
                    yield file
                elif ".tmp." in file.name and time() - file.stat().st_mtime > DAY:
                    file.unlink()


def kernel_of(file: Path) -> Path:
    """Return the common start of the paths of one kernel's files: ``NAME`` of ``NAME.nbi`` and ``NAME.1.nbc``."""
    return file.with_name(file.name.rsplit(".", 1 + (file.suffix == ".nbc"))[0])


def remove(kernel: Path) -> None:
    """Remove the files of a kernel, the index last: a new index gives the numbers of its data files out again, so that
    an old data file must not answer for another signature.
    """
    data = [file for file in kernel.parent.iterdir() if file.suffix == ".nbc" and kernel_of(file) == kernel]
    for file in (*data, *(kernel.with_name(f"{kernel.name}{ending}") for ending in (".nbi", ".code"))):
        with suppress(FileNotFoundError):
            file.unlink()


@contextmanager
def alone(file: Path, wait: float | None = None) -> Iterator[bool]:
    """Context manager that locks `file` against other processes; yields True if locked, False if the lock was not free
    within `wait` seconds.

    `wait` None means `LONGEST_WAIT`. Systems without file locks always yield True, and so does a folder in which no
    file can be made, such as that of a full disk.
    """
    try:
        handle = None if fcntl is None else file.open("ab")
    except OSError:
        handle = None
    if handle is None:
        yield True
        return
    with handle:
        got = taken(handle, LONGEST_WAIT if wait is None else wait)
        try:
            yield got
        finally:
            if got:
                with suppress(OSError):
                    fcntl.flock(handle, fcntl.LOCK_UN)  # explicit, since a forked child may hold the handle too


def taken(handle: IO[bytes], wait: float) -> bool:
    """Lock an open file against other processes, and return whether this succeeded within `wait` seconds. It counts as
    locked on a file system without locks.
    """
    end = monotonic() + wait
    while True:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            if monotonic() > end:
                return False
            sleep(0.02)
        except OSError:
            return True
        else:
            return True
