"""NumPy .npz: named arrays; pickled objects are refused.

What an array announces is compared with what the file can hold before memory is taken for it.
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
from pliant.recording.registry import ENDINGS, Reader

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    import xarray as xr

BROKEN = (OSError, ValueError, EOFError, KeyError, NotImplementedError, RuntimeError, SyntaxError, MemoryError,
          zipfile.BadZipFile, zlib.error, OverflowError, TypeError, TokenError)  # fmt: skip
LONGEST_END = 22 + 65535  # bytes of the record at the end of an archive, with its comment


def read_npz(path: Path, mapping: Mapping[str, Any] | None = None) -> xr.Dataset:
    """Read the arrays of a .npz file; options are those of `pliant.recording.arrays.ArrayMapping`."""
    try:
        with path.open("rb") as stream:
            arrays = read_arrays(stream, path.stat().st_size, path.name)
    except OSError as error:
        raise InputError(f"{path.name} cannot be read: {error.strerror or error}") from None
    return recording_from_arrays(arrays, mapping, path.name)


def read_arrays(stream: BinaryIO, size: int, name: str) -> dict[str, Any]:
    """Return the arrays of an .npz of `size` bytes; InputError names the file `name` where it is none or damaged."""
    try:
        with np.load(stream, allow_pickle=False) as file:
            check_announced(file.zip, size, name)
            arrays = {key: file[key] for key in file.files}
            announced = announced_entries(stream)
    except InputError:
        raise
    except BROKEN as error:
        reason = (str(error).splitlines() or [type(error).__name__])[0][:200]
        raise InputError(f"{name} is no readable .npz file, or it is damaged: {reason}") from None
    if announced != len(arrays):
        raise InputError(f"{name} is damaged: its index shows {len(arrays)} arrays, its end says {announced}")
    return arrays


def check_announced(archive: zipfile.ZipFile, size: int, name: str) -> None:
    """Refuse an archive of `size` bytes whose entries, or the arrays in them, announce more than it can hold."""
    most, entries = content_bound(size), archive.infolist()
    if (announced := sum(entry.file_size for entry in entries)) > most:
        raise InputError(f"{name} has {size} bytes and announces {announced}, more than the {most} that are read from "
                         "a file of its size; write it without compression if that is right")  # fmt: skip
    for entry in entries:
        with archive.open(entry) as file:
            if not entry.filename.endswith(".npy"):
                continue
            version = np.lib.format.read_magic(file)
            read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
            shape, _, dtype = read(file)
        if math.prod(shape) * dtype.itemsize > entry.file_size:
            raise InputError(f"{name} is damaged: its array {entry.filename[:-4]!r:.60} announces the shape "
                             f"{clipped(str(shape))}, but has {entry.file_size} bytes")  # fmt: skip


def announced_entries(stream: BinaryIO) -> int:
    """Number of entries of a zip archive, as its end says; `zipfile` lists what the index still shows.

    Source: PKWARE APPNOTE.TXT, 4.3.16 (end of central directory record); an archive of 65,535 or more says so elsewhere
    """
    stream.seek(0, 2)
    stream.seek(max(stream.tell() - LONGEST_END, 0))
    tail = stream.read()
    at = tail.rfind(b"PK\x05\x06")
    return int.from_bytes(tail[at + 10 : at + 12], "little")


READER = Reader("npz", ENDINGS["npz"], read_npz, lambda head: head.startswith(b"PK"))
