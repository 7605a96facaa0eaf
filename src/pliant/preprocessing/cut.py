"""Cut a recording to an interval of time, or a fibre to the part that lies in the body."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from pliant.equations.observation import FURTHER
from pliant.errors import InputError
from pliant.numerics.spline import local_cubic_matrix
from pliant.preprocessing.arc_length import station_arc_length, whole_frames
from pliant.recording.schema import append_history, check_recording, refuse_loss

FEWEST_FRAMES = 10
TOUCH = 1e-9  # m: a station that is this close to an end belongs to the body

if TYPE_CHECKING:
    import xarray as xr
    from numpy.typing import NDArray


def cut_time(recording: xr.Dataset, start: float, end: float) -> xr.Dataset:
    """Return the part of a recording, shape and inputs, between the times `start` and `end` [s].

    Parameters
    ----------
    recording : xarray.Dataset
        A recording whose inputs and shape have synchronised times.
    start, end : float, s

    Raises
    ------
    InputError
        When fewer than ten frames lie between them.
    """
    clocks = [name for name in ("time", "pressure_time", "input_time") if name in recording.coords]
    clock_of = {name: recording[name].to_numpy() for name in clocks}
    rows = {name: np.flatnonzero((clock >= start) & (clock <= end)) for name, clock in clock_of.items()}
    if len(rows["time"]) < FEWEST_FRAMES:
        first, last = clock_of["time"][[0, -1]]
        raise InputError(
            f"{len(rows['time'])} frames are between {start:g} and {end:g} s, but {FEWEST_FRAMES} are needed: choose "
            f"a longer interval; the recording runs from {first:.6g} to {last:.6g} s"
        )
    line = f"cut to {start:g} to {end:g} s: {len(rows['time'])} of {len(clock_of['time'])} frames"
    return check_recording(append_history(recording.isel(rows), line))


def cut_body(recording: xr.Dataset, base: float, tip: float) -> xr.Dataset:
    """Return the recording with the stations between the arc lengths `base` and `tip` [m] only, and with arc length 0
    at `base`.

    Lead, cap and tail are cut off. Positions at exactly `base` and `tip` are interpolated by a local cubic. A recording
    with orientations is cut at whole stations instead.

    Parameters
    ----------
    recording : xarray.Dataset
        Positions along one fibre.
    base, tip : float, m
        Arc length from the first station.

    Returns
    -------
    xarray.Dataset
        The body, with a line in its history. Pressure is kept, strain is dropped.

    Raises
    ------
    InputError
        When fewer than four stations lie between `base` and `tip`.
    """
    position, _, _ = whole_frames(recording)
    s, _ = station_arc_length(recording, position)
    if not 0 <= base < tip <= s[-1] + TOUCH:
        raise InputError(f"base and tip must be within 0 to {s[-1]:.6g} m of the fibre, base first, not {base:.6g} "
                         f"to {tip:.6g} m")
    inside = np.flatnonzero((s >= base - TOUCH) & (s <= tip + TOUCH))
    if inside.size < 4:
        raise InputError(f"only {inside.size} station(s) lie between {base:.6g} and {tip:.6g} m, but four are "
                         "needed: move base or tip")
    cut = recording.isel(station=inside).drop_vars("strain", errors="ignore")
    if {"quaternion", "angle", *FURTHER} & set(recording.data_vars):
        arcs, start = s[inside], s[inside[0]]
    else:
        cut, arcs = _with_exact_ends(recording, cut, s, inside, (base, tip))
        start = base
    cut = cut.assign_coords(arc_length=("station", arcs - start))
    cut["arc_length"].attrs.update(units="m", long_name="arc length of the station from the base")
    refuse_loss(recording, cut, "cut_body", ("strain",))
    lead, tail = inside[0], s.size - 1 - inside[-1]
    line = f"cut to the body from {base * 1e3:.2f} to {tip * 1e3:.2f} mm: {lead} station(s) of lead, {tail} of tail"
    return check_recording(append_history(cut, line))


def _with_exact_ends(
    recording: xr.Dataset,
    cut: xr.Dataset,
    s: NDArray[np.float64],
    inside: NDArray[np.intp],
    ends: tuple[float, float],
) -> tuple[xr.Dataset, NDArray[np.float64]]:
    """Return the cut recording with stations at exactly both ends, and the arc lengths of its stations."""
    names, arcs = [str(n) for n in cut["station"].values], s[inside]
    points = [cut["position"].values]
    neighbours = max(0, inside[0] - 2), max(0, min(inside[-1] - 1, s.size - 4))
    for end, near, gap in ((0, neighbours[0], arcs[0] - ends[0]), (1, neighbours[1], ends[1] - arcs[-1])):
        if gap <= 1e-6 * ends[1]:
            continue
        around = slice(near, near + 4)
        weights = local_cubic_matrix(s[around], [ends[end]])
        new = np.matmul(weights, recording["position"].values[:, around])
        index = len(names) * end
        names.insert(index, ("base", "tip")[end])
        arcs = np.insert(arcs, index, ends[end])
        points.insert(len(points) * end, new)
    array = np.concatenate(points, axis=1)
    extended = cut.drop_dims("station").assign_coords(station=names)
    extended = extended.assign(position=(("time", "station", "axis"), array, dict(recording["position"].attrs)))
    return extended, arcs
