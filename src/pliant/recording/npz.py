"""NumPy .npz: named arrays; pickled objects are refused."""

from __future__ import annotations

import zipfile
import zlib
from typing import TYPE_CHECKING, Any

import numpy as np

from pliant.errors import InputError
from pliant.recording.arrays import recording_from_arrays
from pliant.recording.registry import Reader

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    import xarray as xr

BROKEN = (OSError, ValueError, EOFError, KeyError, NotImplementedError, RuntimeError, SyntaxError, MemoryError,
          zipfile.BadZipFile, zlib.error, OverflowError, TypeError)  # fmt: skip


def read_npz(path: Path, mapping: Mapping[str, Any] | None = None) -> xr.Dataset:
    """Read the arrays of a .npz file; options are those of `pliant.recording.arrays.ArrayMapping`."""
    try:
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
    except BROKEN as error:
        reason = (str(error).splitlines() or [type(error).__name__])[0][:200]
        raise InputError(f"{path.name} is no readable .npz file, or it is damaged: {reason}") from None
    return recording_from_arrays(arrays, mapping, path.name)


READER = Reader("npz", (".npz",), read_npz, lambda head: head.startswith(b"PK"))
