"""Planar occupancy map of the surroundings, from touches and swept areas, and stiffness of the touched object."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from pliant.contact.likelihood_ratio import frames_of
from pliant.errors import InputError
from pliant.files import whole
from pliant.plotting import COLUMN_WIDTH, REST_COLOUR, new_figure, style

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = np.ndarray
FREE, TOUCHED = -0.85, 2.2  # log-odds of one pass and of one touch
CLEAR = 3.0  # least force of a touch, in its standard deviations
STILL = 0.5  # rad/s: faster joints produce torques that look like contact
STEADY, SAME_PLACE, SAME_FORCE = 0.13, 5e-3, 0.3  # s for which position [m] and relative force must be steady
LIMIT = 8.0  # largest absolute log-odds of a cell
DEPTH = 2.0e-3  # m behind a touched surface that count as solid


@dataclass(frozen=True)
class ProbingContacts:
    """Evidence of one recording for an occupancy map: centrelines of the moving body, and surface points that it
    touched.

    Attributes
    ----------
    curve : (T, P, 2) array
        Centreline of the body in every frame, m.
    point, normal : (C, 2) arrays
        Touched surface points [m] and unit normals out of the obstacle, towards the body.
    deviation : (C,) array
        Standard deviation of each point, m.
    force : (C,) array
        Force along the normal, N.
    """

    curve: Array
    point: Array
    normal: Array
    deviation: Array
    force: Array


def probing_contacts_of(contact: xr.Dataset, *, half_width: float = 0.0, most: float = 0.02) -> ProbingContacts:
    """Return the touched surface points, their normals, and the body's centreline in every frame, from a result of
    `find_contact`.

    Parameters
    ----------
    half_width : float
        Distance of the body's surface from its centreline, m.
    most : float
        Widest 95 % interval of a contact's position, m; less certain contacts are ignored. Also ignored are contacts
        whose force does not differ clearly from zero, whose position or force is not steady (a body that bounces or
        leaves), or that occur while the body moves fast.

    Raises
    ------
    InputError
        When the body moves in space.
    """
    tips = contact["tip_position"].values
    if tips.shape[-1] != 2:
        raise InputError("a map needs a body in a plane: in space, use position and force of each contact instead")
    curve = np.concatenate([np.zeros((len(tips), 1, 2)), tips], axis=1)
    width = (contact["arc_high"] - contact["arc_low"]).values
    clear = np.abs(contact["normal_force"].values) > CLEAR * contact["normal_force_sd"].values
    moving = np.abs(np.gradient(contact["joint_angle"].values, contact["time"].values, axis=0)).max(axis=1)
    good = contact["in_contact"].values & (width <= most) & clear & (moving <= STILL) & steady(contact)
    push = contact["contact_normal"].values[good]  # the obstacle pushes the body this way
    point = contact["contact_position"].values[good] - half_width * push
    return ProbingContacts(
        dense(curve), point, push, np.maximum(0.25 * width[good], 5e-4), np.abs(contact["normal_force"].values[good])
    )


def steady(contact: xr.Dataset) -> Array:
    """Return for each frame (T,) whether position and force of the contact were steady for the last 0.13 s."""
    period = float(np.median(np.diff(contact["time"].values)))
    arc, force = contact["contact_arc_length"].values, contact["normal_force"].values
    same = np.ones(len(arc), dtype=bool)
    for back in range(1, frames_of(STEADY, period) + 1):
        before = [np.concatenate([np.full(back, np.nan), a[:-back]]) for a in (arc, force)]
        same &= np.abs(arc - before[0]) <= SAME_PLACE
        same &= np.abs(force - before[1]) <= SAME_FORCE * np.abs(force)
    return same


def dense(curve: Array, count: int = 40) -> Array:
    """Return T body curves of S points, given as `curve` (T, S, 2) [m], resampled to `count` points each by linear
    interpolation.
    """
    position = np.linspace(0, curve.shape[1] - 1, count)
    left = np.minimum(position.astype(int), curve.shape[1] - 2)
    part = (position - left)[None, :, None]
    return np.asarray((1 - part) * curve[:, left] + part * curve[:, left + 1])


def map_contacts(
    pokes: Sequence[xr.Dataset | ProbingContacts], *, cell: float = 1e-3, half_width: float = 0.0, margin: float = 0.02
) -> xr.Dataset:
    """Compute a planar occupancy map from recordings in which a body touches the same surroundings.

    Every cell starts undecided (log-odds 0). A pass of the body lowers the log-odds of a cell. A touched surface point
    raises those just behind the surface, weighted by the certainty of its position. All other cells stay undecided.

    Parameters
    ----------
    pokes : sequence of xarray.Dataset or ProbingContacts
        Results of `find_contact`, one for each recording.
    cell : float
        Edge of a cell, m.
    half_width : float
        Half of the body's width, m.
    margin : float
        Width of the border around everything that was swept or touched, m.

    Returns
    -------
    xarray.Dataset
        log_odds, probability and entropy [bit] (y, x); surface points, normals and their standard deviation (touch);
        attrs: stiffness [N/m] of the touched object with its standard deviation, NaN if it cannot be determined.

    Raises
    ------
    InputError
        When `pokes` is empty, or the cell size is not positive.

    Examples
    --------
    On recordings of your own::

        from pliant.contact import find_contact, map_contacts
        from pliant.contact.occupancy_map import save_map
        pokes = [find_contact(r, model, free=learnt) for r in recordings]
        chart = map_contacts(pokes, cell=1e-3)
        chart.probability.sel(x=-0.08, y=0.12, method="nearest")   # occupied?
        chart.surface, chart.surface_sd                            # touched points, m
        chart.attrs["stiffness"]                                   # N/m
        save_map(chart, "chart.nc"), save_map(chart, "chart.csv")
    """
    if not pokes:
        raise InputError("a map needs the contacts of at least one recording, got none: pass results of find_contact")
    if not cell > 0:
        raise InputError(f"the cell of a map must be larger than 0 m, got {cell} m")
    probed = [p if isinstance(p, ProbingContacts) else probing_contacts_of(p, half_width=half_width) for p in pokes]
    x, y = axes(probed, cell, margin + half_width)
    odds = np.zeros((y.size, x.size))
    for contacts in probed:
        odds += free_log_odds(contacts, x, y, cell, half_width) + touch_log_odds(contacts, x, y)
    odds = np.clip(odds, -LIMIT, LIMIT)
    probability = 1.0 / (1.0 + np.exp(-odds))
    entropy = -(probability * np.log2(probability) + (1 - probability) * np.log2(1 - probability))
    stiffness, deviation = stiffness_of(probed)
    joined = [np.concatenate([getattr(p, name) for p in probed]) for name in ("point", "normal", "deviation", "force")]
    return xr.Dataset(
        {
            "log_odds": (("y", "x"), odds, {"units": "1"}), "probability": (("y", "x"), probability, {"units": "1"}),
            "entropy": (("y", "x"), entropy, {"units": "bit"}),
            "surface": (("touch", "axis"), joined[0], {"units": "m"}),
            "surface_normal": (("touch", "axis"), joined[1], {"units": "1"}),
            "surface_sd": ("touch", joined[2], {"units": "m"}), "surface_force": ("touch", joined[3], {"units": "N"}),
        },
        {"x": ("x", x, {"units": "m"}), "y": ("y", y, {"units": "m"}), "axis": ["x", "y"]},
        {"schema": "pliant-map", "pokes": len(probed), "cell_m": cell, "stiffness": stiffness,
         "stiffness_sd": deviation},
    )


def axes(pokes: Sequence[ProbingContacts], cell: float, margin: float) -> tuple[Array, Array]:
    """Return x and y [m] of the centres of map cells that cover all body curves and touched points."""
    spots = np.concatenate([a.reshape(-1, 2) for p in pokes for a in (p.curve, p.point)])
    spots = spots[np.isfinite(spots).all(axis=1)]
    low, high = np.floor((spots.min(axis=0) - margin) / cell), np.ceil((spots.max(axis=0) + margin) / cell)
    return tuple((np.arange(a, b + 1) + 0.5) * cell for a, b in zip(low, high, strict=True))  # type: ignore[return-value]


def free_log_odds(contacts: ProbingContacts, x: Array, y: Array, cell: float, half_width: float) -> Array:
    """Return the log-odds of occupancy, one number per map cell (y, x), from the area that the body swept. They are
    negative there and 0 elsewhere. Repeated sweeps count once.
    """
    points = refined_curves(contacts.curve[np.isfinite(contacts.curve).all(axis=(1, 2))], cell).reshape(-1, 2)
    inside = np.zeros((y.size, x.size), dtype=bool)
    reach = max(0, int(np.floor(half_width / cell)))
    for dx in range(-reach, reach + 1):
        for dy in range(-reach, reach + 1):
            if (dx * dx + dy * dy) * cell * cell <= half_width**2 or dx == dy == 0:
                i = np.clip(np.round((points[:, 0] - x[0]) / cell).astype(int) + dx, 0, x.size - 1)
                j = np.clip(np.round((points[:, 1] - y[0]) / cell).astype(int) + dy, 0, y.size - 1)
                inside[j, i] = True
    return np.where(inside, FREE, 0.0)


def refined_curves(curve: Array, cell: float) -> Array:
    """Return F body curves of P points (F, P, 2) [m], interpolated in time and along the body so that they skip no map
    cell of edge `cell` [m].
    """
    gap = np.linalg.norm(np.diff(curve, axis=1), axis=2).max(initial=0.0)
    curve = dense(curve, max(curve.shape[1], int(np.ceil(curve.shape[1] * gap / cell)))) if gap > cell else curve
    parts = [curve[:1]]
    for before, after in pairwise(curve):
        count = int(np.clip(np.ceil(np.abs(after - before).max() / cell), 1, 200))
        share = np.arange(1, count + 1)[:, None, None] / count
        parts.append(before + share * (after - before))
    return np.concatenate(parts)


def touch_log_odds(contacts: ProbingContacts, x: Array, y: Array) -> Array:
    """Return the log-odds of occupancy, one number per map cell (y, x), from touched surface points. They are positive
    behind each point and 0 far from all points. The less certain a point's position, the wider and lower the raised
    region.

    Touches of one recording share the model's errors and are not independent, so that a cell gets the strongest one.
    """
    odds = np.zeros((y.size, x.size))
    X, Y = np.meshgrid(x, y)
    for point, normal, sd in zip(contacts.point, contacts.normal, contacts.deviation, strict=True):
        depth = -(normal[0] * (X - point[0]) + normal[1] * (Y - point[1]))  # into the obstacle
        across = -normal[1] * (X - point[0]) + normal[0] * (Y - point[1])
        behind = np.exp(-0.5 * ((depth - 0.5 * DEPTH) / (0.5 * DEPTH + sd)) ** 2)
        certainty = TOUCHED * DEPTH / (DEPTH + sd)
        odds = np.maximum(odds, certainty * behind * np.exp(-0.5 * (across / (DEPTH + sd)) ** 2) * (depth > -sd))
    return odds


def stiffness_of(pokes: Sequence[ProbingContacts]) -> tuple[float, float]:
    """Return the touched object's stiffness [N/m], from force against indentation, and its standard deviation.

    Indentation is measured along the mean normal, relative to the start of the force; all recordings are combined. Both
    are NaN if the slope is less than twice its standard deviation, as for a rigid object.
    """
    slopes, weights = [], []
    for contacts in pokes:
        if contacts.force.size < 5:
            continue
        way = contacts.normal.mean(axis=0)
        depth = -(contacts.point @ (way / max(float(np.linalg.norm(way)), 1e-12)))
        a, b = depth - depth.mean(), contacts.force - contacts.force.mean()
        power = float(a @ a)
        if power < (2e-4) ** 2 * a.size:  # moved by less than 0.2 mm: no slope to see
            continue
        slope = float(a @ b) / power
        left = float(np.sum((b - slope * a) ** 2)) / max(a.size - 2, 1)
        slopes.append(slope)
        weights.append(power / max(left, 1e-12))
    if not slopes:
        return float("nan"), float("nan")
    total = float(np.sum(weights))
    mean = float(np.dot(slopes, weights)) / total
    return (mean, total**-0.5) if mean > 2 * total**-0.5 else (float("nan"), float("nan"))


def fused(pokes: Sequence[ProbingContacts]) -> ProbingContacts:
    """Combine the `ProbingContacts` of several recordings into one."""
    names = ("curve", "point", "normal", "deviation", "force")
    return replace(pokes[0], **{name: np.concatenate([getattr(p, name) for p in pokes]) for name in names})


def save_map(chart: xr.Dataset, path: str | Path) -> Path:
    """Write a contact map as .nc (whole dataset), .csv (x, y, probability of every cell) or .png (figure).

    Raises
    ------
    InputError
        For another suffix, or when the file cannot be written.
    """
    path = Path(path)
    if path.suffix not in (".nc", ".csv", ".png"):
        raise InputError(f"a map can be written as .nc, .csv or .png, not as {path.name!r}")
    with whole(path) as draft:
        if path.suffix == ".nc":
            chart.to_netcdf(draft, engine="h5netcdf")
        elif path.suffix == ".csv":
            X, Y = np.meshgrid(chart["x"].values, chart["y"].values)
            table = np.column_stack([X.ravel(), Y.ravel(), chart["probability"].values.ravel()])
            np.savetxt(draft, table, delimiter=",", header="x_m,y_m,probability", comments="", fmt="%.6g")
        else:
            contact_map(chart).savefig(draft, format="png")
    return path


def contact_map(chart: Any) -> Figure:
    """Plot a contact map: occupied cells dark, and the touched points with their normals."""
    with style():
        figure, ax = new_figure(width=COLUMN_WIDTH, height=3.2)
        x, y = (1e3 * chart[name].values for name in ("x", "y"))
        half = 0.5e3 * float(chart.attrs["cell_m"])
        box = (x[0] - half, x[-1] + half, y[0] - half, y[-1] + half)
        image = ax.imshow(chart["probability"].values, origin="lower", extent=box, cmap="Greys", vmin=0, vmax=1)
        points, normals = 1e3 * chart["surface"].values, chart["surface_normal"].values
        if len(points):
            ax.plot(*points.T, linestyle="", marker="o", markersize=2, color=REST_COLOUR, label="touched")
            ax.quiver(*points.T, *normals.T, color=REST_COLOUR, width=0.003, scale=25)
            ax.legend(loc="upper right")
        ax.set(xlabel="x (mm)", ylabel="y (mm)", aspect="equal")
        ax.grid(visible=False)
        figure.colorbar(image, ax=ax, label="probability of being solid")
    return figure
