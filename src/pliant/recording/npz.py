"""Reader of NumPy .npz files: named arrays; pickled objects are refused.

The stated size of an array is compared with the size of the file before memory is allocated.
"""

from __future__ import annotations

import math
import zipfile
import zlib
from tokenize import TokenError
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np

from pliant.errors import InputError, clipped
from pliant.recording.apart_worker import content_bound
from pliant.recording.arrays import recording_from_arrays
from pliant.recording.registry import ENDINGS, Reader, begins_with

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    import xarray as xr

BROKEN = (OSError, ValueError, EOFError, KeyError, NotImplementedError, RuntimeError, SyntaxError, MemoryError,
          zipfile.BadZipFile, zlib.error, OverflowError, TypeError, TokenError)  # fmt: skip
LONGEST_END = 22 + 65535  # bytes of the record at the end of an archive, with its comment


def read_npz(path: Path, mapping: Mapping[str, Any] | None = None) -> xr.Dataset:
    """Read the arrays of a NumPy .npz file and return them as a recording."""
    return recording_from_arrays(arrays_of(path), mapping, path.name)


def arrays_of(path: Path) -> dict[str, Any]:
    """Return the arrays of an .npz file by name."""
    try:
        with path.open("rb") as stream:
            return read_arrays(stream, path.stat().st_size, path.name)
    except OSError as error:
        raise InputError(f"{path.name} cannot be read: {error.strerror or error}") from None


def read_arrays(stream: BinaryIO, size: int, name: str) -> dict[str, Any]:
    """Return the arrays of an .npz file by name; raise InputError where it is damaged or no .npz file."""
    try:
        with np.load(stream, allow_pickle=False) as file:
            check_announced(file.zip, size, name)
            arrays = {key: file[key] for key in file.files}
            announced = announced_entries(stream)
    except InputError:
        raise
    except BROKEN as error:
        if "allow_pickle" in str(error):
            raise InputError(f"{name} holds Python objects, such as a dict, which are not read as they may run code: "
                             "save its arrays under names, such as numpy.savez('name.npz', time=t, position=x, "
                             "p_kpa=p)") from None
        reason = (str(error).splitlines() or [type(error).__name__])[0][:200]
        raise InputError(f"{name} cannot be read as .npz; it may be damaged, so copy it again: {reason}") from None
    if announced != len(arrays):
        raise InputError(f"{name} is damaged: its index lists {len(arrays)} arrays, its end record states "
                         f"{announced}; copy it again")
    return arrays


def check_announced(archive: zipfile.ZipFile, size: int, name: str) -> None:
    """Raise InputError where an .npz archive of `size` bytes states more content than such a file can hold, as damaged
    files do.
    """
    most, entries = content_bound(size), archive.infolist()
    if (announced := sum(entry.file_size for entry in entries)) > most:
        raise InputError(f"{name} has {size} bytes, but states {announced} bytes of content, more than the {most} "
                         "accepted from a file of this size; write it uncompressed if it is intact")  # fmt: skip
    for entry in entries:
        with archive.open(entry) as file:
            if not entry.filename.endswith(".npy"):
                continue
            version = np.lib.format.read_magic(file)
            read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
            shape, _, dtype = read(file)
        if math.prod(shape) * dtype.itemsize > entry.file_size:
            raise InputError(f"{name} is damaged: its array {entry.filename[:-4]!r:.60} states the shape "
                             f"{clipped(str(shape))}, but has {entry.file_size} bytes; copy it again")  # fmt: skip


def announced_entries(stream: BinaryIO) -> int:
    """Return the number of files in a zip archive that its end record states.

    `zipfile` lists the entries in the index instead, which may be fewer in a damaged file.

    Source: PKWARE APPNOTE.TXT, 4.3.16 (end of central directory record); an archive of 65,535 or more says so elsewhere
    """
    stream.seek(0, 2)
    stream.seek(max(stream.tell() - LONGEST_END, 0))
    tail = stream.read()
    record = tail.rfind(b"PK\x05\x06")
    return int.from_bytes(tail[record + 10 : record + 12], "little")


READER = Reader("npz", ENDINGS["npz"], read_npz, begins_with(b"PK"))
