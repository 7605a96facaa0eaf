"""Select the number of links of a chain by the distance between the recorded body and the spline through the joints."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from pliant.display import Card, Shown
from pliant.errors import InputError
from pliant.numerics.spline import BOUNDARIES, CLAMPED
from pliant.reduction.body import body_of
from pliant.reduction.error import frame_errors, spline_map
from pliant.reduction.placement import best_nodes, equal_nodes, stations_between
from pliant.shapes import Float

if TYPE_CHECKING:
    import xarray as xr
    from numpy.typing import NDArray

    from pliant.reduction.body import BodyShape

Array = np.ndarray
FEW_STATIONS = 3  # inside a segment; with fewer, the largest error at the stations may be 20 % too low
PLACEMENTS = ("equal", "best")
METRICS = ("arc", "closest")
NODES = ("auto", "stations", "interpolated")


@dataclass(frozen=True, repr=False)
class OrderResult(Shown):
    """Error of the reconstructed shape for every evaluated number of links (order) and every frame, and the chosen
    order.

    Attributes
    ----------
    orders : tuple of int
        Numbers of segments n.
    time : (T,) array, s
        Times of the frames that were used.
    max_error, mean_error : (R, T) arrays, m
        Largest and mean error over the stations, for each of R orders and each frame.
    node_arc_length : tuple of (n + 1,) arrays, m
        Arc lengths of the joints, base and tip included, for each order.
    stations_between : tuple of int
        Fewest stations inside a segment, for each order. An order with 0 cannot be judged.
    bound : float or None, m
        Largest allowed error.
    boundary, placement, metric : str
        Options of `select_order`.
    stations : int
        Number of stations.
    frames_left_out : int
        Number of frames with missing stations, which were left out.
    length : float, m
        Arc length of the body.
    notes : tuple of str
        Assumptions and remarks, one sentence each.
    """

    orders: tuple[int, ...]
    time: Float[Array, " T"]
    max_error: Float[Array, "R T"]
    mean_error: Float[Array, "R T"]
    node_arc_length: tuple[Float[Array, " n+1"], ...]
    stations_between: tuple[int, ...]
    bound: float | None
    boundary: str
    placement: str
    metric: str
    stations: int
    frames_left_out: int
    length: float
    notes: tuple[str, ...]

    @property
    def frames(self) -> int:
        """Number of frames of the recording in which the error was computed."""
        return len(self.time)

    @property
    def chosen(self) -> int | None:
        """Lowest number of links whose largest error over all frames is within the bound; None where there is none."""
        if self.bound is None:
            return None
        for n, errors, inside in zip(self.orders, self.max_error, self.stations_between, strict=True):
            if inside > 0 and errors.max() <= self.bound:
                return n
        return None

    @property
    def reason(self) -> str:
        """Sentence that says why this number of links was chosen, or why none was. It warns where the stations are too
        few to judge.
        """
        if self.bound is None:
            return "No order was chosen, because no bound was given."
        bound = f"the bound of {self.bound * 1e3:g} mm"
        judged = [n for n, inside in zip(self.orders, self.stations_between, strict=True) if inside > 0]
        if self.chosen is None and not judged:
            return f"No order can be judged: with {self.stations} stations there is none between the joints."
        if self.chosen is None:
            n = min(judged, key=lambda m: float(self.max_error[self._row(m)].max()))
            least = self.max_error[self._row(n)].max() * 1e3
            text = (f"No order up to {judged[-1]} is within {bound}: the smallest maximum error is {least:.2f} mm, "
                    f"at n = {n}.")
            return text + self._caution(n)
        n = self.chosen
        text = f"n = {n} is the lowest order within {bound} in all {self.frames} frames"
        return f"{text} (maximum error {self.max_error[self._row(n)].max() * 1e3:.2f} mm)." + self._caution(n)

    def fraction_within(self, order: int) -> float:
        """Return the fraction of frames in which the largest error of a chain of this number of links is within the
        bound; 1 without a bound.
        """
        if self.bound is None:
            return 1.0
        return float((self.max_error[self._row(order)] <= self.bound).mean())

    def worst_frames(self, order: int, count: int = 5) -> list[tuple[float, float]]:
        """Return time [s] and largest error [m] of the `count` frames that a chain of this number of links reconstructs
        worst, worst first.
        """
        errors = self.max_error[self._row(order)]
        return [(float(self.time[k]), float(errors[k])) for k in np.argsort(-errors, kind="stable")[:count]]

    def operations(self, order: int) -> int:
        """Return the approximate number of additions and multiplications to evaluate the dynamics of a chain of `order`
        links once.

        It counts dense equations in absolute angles.
        """
        return round(order**3 / 3 + 55 * order**2 / 6)

    def to_dict(self) -> dict[str, Any]:
        """Return the errors [mm] of every number of links and the chosen number as a dict, as `pliant order --json`
        prints it.
        """
        return {
            "orders": {str(n): self._row_dict(k) for k, n in enumerate(self.orders)},
            "chosen": self.chosen,
            "bound_mm": None if self.bound is None else self.bound * 1e3,
            "frames": self.frames,
            "stations": self.stations,
        }

    def summary(self) -> str:
        """Return the chosen number of links, the settings of the selection and the data used, as sentences."""
        kind = "at equal arc length" if self.metric == "arc" else "to the closest point"
        where = "at equal lengths" if self.placement == "equal" else "where the largest error is smallest"
        text = f"{self.reason} Error {kind}, joints {where}, {self.boundary} spline, {self.stations} stations"
        text += f" over {self.length * 1e3:.1f} mm."
        if self.frames_left_out:
            text += f" {self.frames_left_out} frame(s) with missing stations were left out."
        return text

    def card(self) -> Card:
        """Return the chosen number of links and a table of the errors of every number, for display in a notebook."""
        head = ["segments", "max mm", "mean mm", "95 % of max mm", "frames within bound"]
        rows = []
        for n, row in zip(self.orders, self.to_dict()["orders"].values(), strict=True):
            numbers = (f"{row[key]:.3f}" for key in ("max_mm", "mean_mm", "p95_of_max_mm"))
            within = "" if self.bound is None else f"{100 * self.fraction_within(n):.1f} %"
            rows.append([f"{n}{' *' if n == self.chosen else ''}", *numbers, within])
        return Card(f"Order of {self.frames} frames of {self.stations} stations", [self.summary()], head, rows)

    def _row(self, order: int) -> int:
        return self.orders.index(order)

    def _row_dict(self, k: int) -> dict[str, float]:
        largest = self.max_error[k] * 1e3
        return {
            "max_mm": float(largest.max()),
            "mean_mm": float(self.mean_error[k].mean() * 1e3),
            "median_of_max_mm": float(np.median(largest)),
            "p95_of_max_mm": float(np.percentile(largest, 95)),
        }

    def _caution(self, order: int) -> str:
        inside = self.stations_between[self._row(order)]
        if inside >= FEW_STATIONS:
            return ""
        return (
            f" But a segment of n = {order} has only {inside} station(s) between its joints, too few to judge this "
            "order: the true maximum error may be larger."
        )


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
