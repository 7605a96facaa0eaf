"""Select the number of links of a chain by the distance between the recorded body and the spline through the joints."""

from __future__ import annotations

from typing import TYPE_CHECKING

from pliant.errors import InputError
from pliant.numerics.spline import BOUNDARIES, CLAMPED
from pliant.reduction.body import body_of
from pliant.reduction.error import frame_errors, spline_map
from pliant.reduction.order_result import OrderResult
from pliant.reduction.placement import best_nodes, equal_nodes, stations_between

if TYPE_CHECKING:
    import numpy as np
    import xarray as xr
    from numpy.typing import NDArray

    from pliant.reduction.body import BodyShape

PLACEMENTS = ("equal", "best")
METRICS = ("arc", "closest")
NODES = ("auto", "stations", "interpolated")


def select_order(
    recording: xr.Dataset,
    *,
    max_order: int = 8,
    bound: float | None = None,
    boundary: str = CLAMPED,
    placement: str = "equal",
    metric: str = "arc",
    nodes: str = "auto",
) -> OrderResult:
    """Compute the largest error of the reconstructed shape for chains of 2 to `max_order` links, and choose the lowest
    number of links with an error within `bound` [m].

    In every frame a cubic spline through the n + 1 joints, base and tip included, is compared with the measured body at
    all its stations. Bodies may be planar or three-dimensional.

    Parameters
    ----------
    recording : xarray.Dataset
        A recording with positions along one body, base first. Frames with a missing station are left out and
        counted.
    max_order : int
        Largest number of segments to evaluate.
    bound : float, optional
        Largest allowed error in any frame, m. Without a bound no order is chosen.
    boundary : {"natural", "not-a-knot", "clamped+not-a-knot"}
        End conditions of the spline. The default uses the base tangent: +y in an aligned planar recording, +z in an
        aligned spatial one, otherwise measured in each frame from the first tenth of the body.
    placement : {"equal", "best"}
        Joints at equal arc length, or at the positions that minimise the largest error over the recording. That error
        is the distance at equal arc length for every `metric`.
    metric : {"arc", "closest"}
        Distance at equal arc length (the paper's), or to the closest point of the spline.
    nodes : {"auto", "stations", "interpolated"}
        Whether joints at equal arc length are at the nearest stations, or exactly at equal arc length between
        stations; "auto" interpolates from 65 stations on.

    Returns
    -------
    OrderResult

    Raises
    ------
    InputError
        When an option is unknown, or the recording has no usable shape.

    Notes
    -----
    The arc length is equal for all frames (that of the recording, or the time-mean sum of chords), so a joint stays at
    the same material point.

    Paper: Sec. III-A, Figs. 4 and 5 [fig:fitting, fig:matchCurve]
    """
    _check_options(boundary=boundary, placement=placement, metric=metric, nodes=nodes)
    if max_order < 2:
        raise InputError(f"max_order must be 2 segments or more, not {max_order}")
    if bound is not None and not bound > 0:
        raise InputError(f"bound must be a positive length in metres, not {bound}")
    body = body_of(recording)
    knots = _knots(body, max_order, boundary, placement, nodes)
    largest, mean = frame_errors(body, [spline_map(body.arc_length, k, boundary) for k in knots], metric)
    orders = tuple(k.size - 1 for k in knots)
    notes = list(body.notes)
    if len(orders) < max_order - 1:
        notes.append(f"orders above {orders[-1]} need more than {body.arc_length.size} stations")
    return OrderResult(
        orders=orders,
        time=body.time,
        max_error=largest,
        mean_error=mean,
        node_arc_length=tuple(knots),
        stations_between=tuple(stations_between(body.arc_length, k) for k in knots),
        bound=bound,
        boundary=boundary,
        placement=placement,
        metric=metric,
        stations=body.arc_length.size,
        frames_left_out=body.dropped,
        length=float(body.arc_length[-1]),
        notes=tuple(notes),
    )


def _check_options(**options: str) -> None:
    known = {"boundary": BOUNDARIES, "placement": PLACEMENTS, "metric": METRICS, "nodes": NODES}
    for name, value in options.items():
        if value not in known[name]:
            raise InputError(f"{name} must be one of {', '.join(known[name])}, not {value!r}")


def _knots(body: BodyShape, max_order: int, boundary: str, placement: str, nodes: str) -> list[NDArray[np.float64]]:
    """Return the arc lengths of the nodes for every order that the stations allow."""
    s = body.arc_length
    knots = []
    for n in range(2, max_order + 1):
        if s.size < n + 2:
            break
        equal = equal_nodes(s, n, nodes)
        if (equal[1:] <= equal[:-1]).any():
            break
        enough = s.size >= 2 * n + 1  # a station inside every segment
        knots.append(best_nodes(body, n, boundary, equal) if placement == "best" and enough else equal)
    if not knots:
        raise InputError(
            f"the {s.size} stations are too few or too unevenly spaced for two segments: "
            "four are needed, with one near the middle"
        )
    return knots
