"""Draw a raw recording for notebooks: the body at a few instants, and the path of its last station."""

from __future__ import annotations

import numpy as np
import xarray as xr

from pliant.drawing import body_svg

INSTANTS, MOST_FRAMES, MOST_STATIONS = 5, 400, 60  # that are drawn; a longer or denser recording is thinned


def recording_svg(recording: xr.Dataset, title: str) -> str:
    """Return an SVG drawing of the body at five instants, in the plane of its motion.

    The instants run from the first frame to the largest displacement of the last station. The first station is at the
    bottom, the line from it to the last station upright. Stations with faults are drawn as recorded.

    Parameters
    ----------
    recording : xarray.Dataset
        A recording; positions (T, S, 2 or 3), m.
    title : str
        Text for readers who cannot see the drawing.

    Returns
    -------
    str
        Empty where fewer than two frames show all stations, or there are fewer than two stations.
    """
    if "position" not in recording or min(recording.sizes["time"], recording.sizes["station"]) < 2:
        return ""
    frames = np.unique(np.linspace(0, recording.sizes["time"] - 1, MOST_FRAMES).astype(int))
    stations = np.unique(np.linspace(0, recording.sizes["station"] - 1, MOST_STATIONS).astype(int))
    position = recording["position"].values[frames][:, stations]
    whole = np.flatnonzero(np.isfinite(position).all(axis=(1, 2)))
    if whole.size < 2:
        return ""
    seen = on_plane(position - position[whole[0], 0], whole)
    away = np.linalg.norm(seen[whole, -1] - seen[whole[0], -1], axis=1)
    reached = [int(whole[np.argmax(away >= f * away.max())]) for f in np.linspace(0, 1, INSTANTS)]
    return body_svg([*(("measured", seen[k]) for k in dict.fromkeys(reached)), ("path", seen[:, -1])], title)


def on_plane(position: np.ndarray, whole: np.ndarray) -> np.ndarray:
    """Return the coordinates (T, S, 2) [m] of S stations over T frames in the plane of most motion: across and along
    the line from the first to the last station.

    `whole` holds the indices of frames that show all stations.
    """
    first = position[whole[0]]
    up = first[-1] - first[0]
    length = float(np.linalg.norm(up))
    up = up / length if length > 0 else np.eye(position.shape[-1])[1]
    moved = (position[whole] - first).reshape(-1, position.shape[-1])
    across = moved - np.outer(moved @ up, up)
    along = np.linalg.svd(across, full_matrices=False)[2][0]
    along = along - (along @ up) * up
    size = float(np.linalg.norm(along))
    if size < 0.5:  # nothing moves across the line: any direction across it
        along = np.eye(position.shape[-1])[int(np.argmin(np.abs(up)))]
        along = along - (along @ up) * up
        size = float(np.linalg.norm(along))
    along = along / size
    farthest = moved[np.argmax(np.linalg.norm(moved, axis=1))] @ along
    return np.stack([position @ along * (1.0 if farthest >= 0 else -1.0), position @ up], axis=-1)
