"""Reader of DeepLabCut files: tracked points of one or several animals with likelihoods, as CSV or HDF5.

Layout as DeepLabCut's documentation and its own reader have it: CSV rows ``scorer``, (``individuals`` with several
animals,) ``bodyparts``, ``coords`` (x, y, likelihood), then a row a frame with its number first; HDF5 a pandas table of
the same columns, see `pliant.recording.pandas_layout`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from pliant.errors import InputError
from pliant.recording.apart import read_apart
from pliant.recording.pandas_layout import read_frame
from pliant.recording.registry import ENDINGS, Reader
from pliant.recording.tables import read_rows, read_text, split_cells
from pliant.recording.trackers import TrackerMapping, tracked

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    import xarray as xr
    from numpy.typing import NDArray

LEVELS = ("scorer", "individuals", "bodyparts", "coords")


def read_deeplabcut(path: Path, mapping: Mapping[str, Any] | None = None) -> xr.Dataset:
    """Read the points that DeepLabCut tracked on one individual, from CSV or HDF5, and return them as a recording."""
    options = TrackerMapping.load(mapping, path.name)
    hdf = path.suffix.lower() in (".h5", ".hdf5")
    columns, frame, table, findings = from_hdf(path) if hdf else from_csv(path)
    animals = list(dict.fromkeys(c[1] for c in columns))
    animal = options.individual or (animals[0] if len(animals) == 1 else None)
    if animal not in animals:
        problem = f"no individual {animal!r}" if animal else "several individuals"
        raise InputError(f"{path.name} has {problem}: set individual in the mapping to one of {', '.join(animals)}")
    names = list(dict.fromkeys(c[2] for c in columns if c[1] == animal))
    where = {c[1:]: k for k, c in enumerate(columns)}
    lacking = [f"{n} {a}" for n in names for a in ("x", "y") if (animal, n, a) not in where]
    if lacking:
        raise InputError(f"{path.name} lacks the column {lacking[0]}: export it again from DeepLabCut")
    points = np.stack([table[:, [where[animal, n, "x"], where[animal, n, "y"]]] for n in names], axis=1)
    likelihood = None
    if all((animal, n, "likelihood") in where for n in names):
        likelihood = np.stack([table[:, where[animal, n, "likelihood"]] for n in names], axis=1)
    history = [*findings, *([f"individual {animal} of {len(animals)}"] if len(animals) > 1 else [])]
    points, likelihood, more = whole_clock(frame, points, likelihood, path.name)
    return tracked(path, options, names, points, likelihood=likelihood, history=[*history, *more])


def from_csv(path: Path) -> tuple[list[tuple[str, ...]], NDArray, NDArray, list[str]]:
    """Read a DeepLabCut CSV file: return its column names, frame numbers (T,) of T rows, values (T, C) of C columns,
    and history lines.

    Each column name is the tuple (scorer, individual, point, coordinate).
    """
    lines = read_text(path).split("\n")
    head = [split_cells(line, ",") for line in lines[:4]]
    rows = {row[0].lower(): row for row in head if row and row[0].lower() in LEVELS}
    if not {"bodyparts", "coords"} <= set(rows):
        raise InputError(f"{path.name} is not a DeepLabCut table: rows bodyparts and coords are missing in its "
                         "header; export it again, or correct format in its mapping")
    first, width = len(rows), len(rows["coords"])
    if any(len(row) != width for row in rows.values()):
        raise InputError(f"the header rows of {path.name} differ in length: the file is damaged, so export it again")
    table, findings = read_rows(lines, first, ",", path.name, width)
    columns = [tuple(rows[level][k] if level in rows else "" for level in LEVELS) for k in range(1, width)]
    return columns, table[:, 0], table[:, 1:], findings


def from_hdf(path: Path) -> tuple[list[tuple[str, ...]], NDArray, NDArray, list[str]]:
    """Read a DeepLabCut HDF5 file: return its column names, frame numbers (T,) of T rows, values (T, C) of C columns,
    and history lines.
    """
    frame = read_frame(*read_apart("hdf5", path, "DeepLabCut"), path.name)
    known = [name.lower() for name in frame.levels]
    if not {"bodyparts", "coords"} <= set(known):
        raise InputError(f"{path.name} is not a DeepLabCut table: its columns have no levels bodyparts and coords; "
                         "export it again, or correct format in its mapping")
    columns = [tuple(c[known.index(level)] if level in known else "" for level in LEVELS) for c in frame.columns]
    return columns, frame.rows, frame.values, []


def whole_clock(
    frame: NDArray, points: NDArray, likelihood: NDArray | None, file: str
) -> tuple[NDArray, NDArray | None, list[str]]:
    """Insert the frames that are missing between the first and last frame of a file, with NaN as points and 0 as
    likelihoods. Return the points and likelihoods of all frames, and a history line that counts the inserted ones.
    """
    if not (np.abs(frame) < 2**53).all() or np.any(frame != np.round(frame)) or np.any(np.diff(frame) <= 0):
        raise InputError(f"the first column of {file} must hold whole frame numbers that increase from row to row: "
                         "export it again from DeepLabCut")
    number = frame.astype(int)
    count = int(number[-1] - number[0]) + 1
    if count == len(number):
        return points, likelihood, []
    if count > 100 * len(number):
        raise InputError(f"{file} has {len(number)} rows for frames {number[0]} to {number[-1]}: the file is "
                         "damaged, so export it again")
    whole = np.full((count, *points.shape[1:]), np.nan)
    whole[number - number[0]] = points
    likely = None if likelihood is None else np.zeros((count, points.shape[1]))
    if likely is not None and likelihood is not None:
        likely[number - number[0]] = likelihood
    return whole, likely, [f"{count - len(number)} frames are missing in {file} and are gaps"]


def recognises(head: bytes) -> bool:
    """Return whether the first bytes of a file, `head`, are those of a DeepLabCut CSV or HDF5 file."""
    start = head[:20000].lower().lstrip(b"\xef\xbb\xbf")
    if start.startswith(b"\x89hdf"):
        return b"df_with_missing" in head
    return start.startswith(b"scorer,") and b"\nbodyparts," in start and b"\ncoords," in start


READER = Reader("deeplabcut", ENDINGS["deeplabcut"], read_deeplabcut, recognises)
