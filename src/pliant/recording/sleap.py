"""SLEAP: its analysis HDF5 file, which holds tracks x 2 x nodes x frames with scores and names.

Layout as SLEAP's exporter documents it: ``tracks`` (tracks, 2, nodes, frames), ``point_scores`` (tracks, nodes,
frames), ``node_names``, ``track_names``, ``track_occupancy`` (frames, tracks), stored column-major.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from pliant.errors import InputError
from pliant.recording.registry import ENDINGS, Reader
from pliant.recording.trackers import TrackerMapping, tracked

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    import xarray as xr


def read_sleap(path: Path, mapping: Mapping[str, Any] | None = None) -> xr.Dataset:
    """Read one track; options are those of `TrackerMapping`. Points whose score is low are gaps."""
    import h5py  # type: ignore[import-untyped]

    options = TrackerMapping.load(mapping, path.name)
    try:
        with h5py.File(path) as file:
            tracks, names = np.asarray(file["tracks"], dtype=float), texts(file["node_names"])
            labels = texts(file["track_names"]) or [f"track_{k}" for k in range(len(tracks))]
            scores = np.asarray(file["point_scores"], dtype=float) if "point_scores" in file else None
    except (OSError, KeyError, TypeError, ValueError) as error:
        raise InputError(f"{path.name} is no readable SLEAP analysis file: {str(error)[:200]}") from None
    if tracks.ndim != 4 or tracks.shape[:3] != (len(labels), 2, len(names)):
        wanted_shape = f"({len(labels)}, 2, {len(names)}, ...)"
        raise InputError(f"tracks of {path.name} must be (track, 2, node, frame) = {wanted_shape}, got {tracks.shape}")
    if scores is not None and scores.shape != (len(labels), len(names), tracks.shape[3]):
        raise InputError(f"point_scores of {path.name} do not fit its tracks: {scores.shape}")
    wanted = options.individual or (labels[0] if len(labels) == 1 else None)
    if wanted not in labels:
        asked = f"no track {wanted!r}" if wanted else "several tracks"
        raise InputError(f"{path.name} has {asked}: say individual, one of {', '.join(labels)}")
    k = labels.index(wanted)
    likelihood = None if scores is None else np.nan_to_num(scores[k].T)
    return tracked(path, options, names, tracks[k].transpose(2, 1, 0), likelihood=likelihood,
                   history=[f"track {wanted} of {len(labels)}"] if len(labels) > 1 else [])  # fmt: skip


def texts(values: Any) -> list[str]:
    """Names that a data set holds."""
    return [v.decode() if isinstance(v, bytes) else str(v) for v in np.ravel(values[()])]


READER = Reader("sleap", ENDINGS["sleap"], read_sleap, lambda head: b"track_occupancy" in head)
