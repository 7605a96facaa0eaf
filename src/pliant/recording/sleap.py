"""Reader of SLEAP analysis files (HDF5), which hold the tracked points of one or several animals.

Layout as SLEAP's exporter documents it: ``tracks`` (tracks, 2, nodes, frames), ``point_scores`` (tracks, nodes,
frames), ``node_names``, ``track_names``, ``track_occupancy`` (frames, tracks), stored column-major.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from pliant.errors import InputError
from pliant.recording.apart import read_apart
from pliant.recording.arrays import numbers, texts
from pliant.recording.registry import ENDINGS, Reader
from pliant.recording.trackers import TrackerMapping, tracked

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    import xarray as xr


def read_sleap(path: Path, mapping: Mapping[str, Any] | None = None) -> xr.Dataset:
    """Read the points that SLEAP tracked on one individual and return them as a recording.

    Points with a low score become gaps.
    """
    options = TrackerMapping.load(mapping, path.name)
    stored, facts = read_apart("hdf5", path, "SLEAP analysis")
    arrays = {name: stored[key] for name, (key, _, _) in facts["variables"].items()}
    lacking = [name for name in ("tracks", "node_names", "track_names") if name not in arrays]
    if lacking:
        raise InputError(f"{path.name} is not a SLEAP analysis file: it has no data set {lacking[0]}; export the "
                         "analysis file again from SLEAP")
    again, names = "export it again from SLEAP", texts(arrays["node_names"])
    tracks = numbers(arrays["tracks"], f"tracks of {path.name}", again)
    if tracks.ndim != 4:
        raise InputError(f"tracks of {path.name} must have the shape (track, 2, node, frame), not {tracks.shape}: "
                         "export the analysis file again from SLEAP")
    labels = texts(arrays["track_names"]) or [f"track_{k}" for k in range(len(tracks))]
    scores = None
    if "point_scores" in arrays:
        scores = numbers(arrays["point_scores"], f"point_scores of {path.name}", again)
    if tracks.shape[:3] != (len(labels), 2, len(names)):
        wanted_shape = f"({len(labels)}, 2, {len(names)}, ...)"
        raise InputError(f"tracks of {path.name} must have the shape (track, 2, node, frame) = {wanted_shape}, not "
                         f"{tracks.shape}: export the analysis file again from SLEAP")
    if scores is not None and scores.shape != (len(labels), len(names), tracks.shape[3]):
        raise InputError(f"point_scores of {path.name} have the shape {scores.shape}, which does not match its "
                         "tracks: export it again from SLEAP")
    wanted = options.individual or (labels[0] if len(labels) == 1 else None)
    if wanted not in labels:
        problem = f"no track {wanted!r}" if wanted else "several tracks"
        raise InputError(f"{path.name} has {problem}: set individual in its mapping to one of {', '.join(labels)}")
    k = labels.index(wanted)
    likelihood = None if scores is None else np.nan_to_num(scores[k].T)
    return tracked(path, options, names, tracks[k].transpose(2, 1, 0), likelihood=likelihood,
                   history=[f"track {wanted} of {len(labels)}"] if len(labels) > 1 else [])  # fmt: skip


READER = Reader("sleap", ENDINGS["sleap"], read_sleap, lambda head: b"track_occupancy" in head)
