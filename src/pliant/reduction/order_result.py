"""Result of the selection of a number of links: error of the reconstructed shape for each number, the chosen one and
the reason.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from pliant.display import Card, Shown
from pliant.shapes import Float

Array = np.ndarray
FEW_STATIONS = 3  # inside a segment; with fewer, the largest error at the stations may be 20 % too low


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
