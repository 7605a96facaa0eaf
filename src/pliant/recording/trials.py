"""Find the trials in a file that holds several: structs of a MATLAB file, or the values of a column of a table."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from pliant.recording.arrays import trials_in_arrays
from pliant.recording.columns import trials_in_table
from pliant.recording.mat import trials_in_mat
from pliant.recording.npz import arrays_of

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path


def trials_of(path: Path, mapping: Mapping[str, Any] | None) -> dict[str, dict[str, Any]]:
    """Return the options by which each trial of a file is read, by the name of the trial; empty for a file with one.

    A table holds several trials if its mapping has ``select`` without a value. A MATLAB file does if ``struct`` of its
    mapping names an array of structs or, without a mapping, if it has one array of structs with usual names. An .npz
    file does if its positions have four dimensions.

    Raises
    ------
    InputError
        When the file cannot be read, or the mapping does not fit it.
    """
    if path.is_dir():
        return {}
    if path.suffix.lower() == ".mat":
        return trials_in_mat(path, mapping)
    if path.suffix.lower() == ".npz":
        return trials_in_arrays(arrays_of(path), mapping, path.name)
    return trials_in_table(path, mapping) if mapping and "select" in mapping else {}
