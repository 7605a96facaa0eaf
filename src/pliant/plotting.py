"""Figures for papers on matplotlib axes, readable in greyscale: lines differ in dash and width as well as in colour."""

from __future__ import annotations

from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from string import ascii_lowercase
from typing import TYPE_CHECKING, Any

import matplotlib as mpl
import numpy as np
from cycler import cycler
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

from pliant.files import whole
from pliant.recording.inputs import recorded_inputs
from pliant.recording.rules import shape_values, shape_variable
from pliant.units import input_words, shown_in

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from matplotlib.axes import Axes
    from numpy.typing import ArrayLike

COLUMN_WIDTH, PAGE_WIDTH = 3.5, 7.16  # inches, two-column page
# dark to light, so that the order survives greyscale; distinguished by dashes as well
COLOURS = ("#000000", "#123e91", "#cc4a10", "#45a87a", "#b794d6", "#8a6d00", "#808080")
DASHES = ("-", "--", "-.", ":", (0, (5, 1, 1, 1, 1, 1)), (0, (1, 1)), (0, (8, 2)))
REST_COLOUR = "#d00000"
RC: dict[str, Any] = {
    "font.size": 8,
    "axes.titlesize": 8,
    "axes.labelsize": 8,
    "legend.fontsize": 7,
    "xtick.labelsize": 7,
    "ytick.labelsize": 7,
    "axes.linewidth": 0.6,
    "lines.linewidth": 1.0,
    "axes.grid": True,
    "grid.linewidth": 0.3,
    "grid.color": "0.85",
    "axes.axisbelow": True,
    "legend.frameon": False,
    "legend.handlelength": 2.8,
    "figure.dpi": 100,
    "savefig.dpi": 200,
    "svg.fonttype": "none",
    "svg.hashsalt": "pliant",
    "pdf.fonttype": 42,
}
WIDTH: ContextVar[float] = ContextVar("width", default=PAGE_WIDTH)  # inches, of the figures being drawn
TALLEST = 4.6  # inches, of a narrow figure: its page also holds a caption
NARROW = 5.0  # inches: in a narrower figure, panels are stacked and letters are smaller
SMALL = {"font.size": 6.5, "axes.titlesize": 6.5, "axes.labelsize": 6.5, "legend.fontsize": 6, "xtick.labelsize": 6,
         "ytick.labelsize": 6, "legend.handlelength": 2.0}


@contextmanager
def page(width: float) -> Iterator[None]:
    """Context manager within which all figures are drawn `width` inches wide."""
    token = WIDTH.set(width)
    try:
        yield
    finally:
        WIDTH.reset(token)


def side_by_side(count: int, ratios: tuple[float, ...], height: float, **kw: Any) -> Any:
    """Return a figure and its `count` axes in one row, or in one column if the figures' width is below 5 inches."""
    if WIDTH.get() >= NARROW:
        return new_figure(1, count, width_ratios=ratios, height=height, **kw)
    return new_figure(count, 1, height=min(0.85 * count * height, TALLEST), **kw)


def letter_panels(figure: Figure) -> None:
    """Label the panels of a figure (a), (b), ... above their upper left corners; a single panel gets no label."""
    size = SMALL["font.size"] if WIDTH.get() < NARROW else RC["font.size"]
    for k, ax in enumerate(figure.axes if len(figure.axes) > 1 else ()):
        title = ax.get_title(loc="left")
        ax.set_title(f"({ascii_lowercase[k % 26]}) {title}".strip(), loc="left", fontsize=size, pad=2.0)


@contextmanager
def style() -> Iterator[None]:
    """Context manager within which figures are drawn with pliant's fonts, sizes and line styles."""
    lines = cycler(color=COLOURS) + cycler(linestyle=DASHES)
    settings: Any = RC | {"axes.prop_cycle": lines} | (SMALL if WIDTH.get() < NARROW else {})
    with mpl.rc_context(settings):
        yield


def new_figure(
    rows: int = 1, columns: int = 1, *, width: float | None = None, height: float = 2.6, **kw: Any
) -> Any:
    """Return a new matplotlib figure (not of pyplot) with `rows` by `columns` axes. Width and height are in inches.

    ``figure, axes = new_figure(2, 1)``
    """
    figure = Figure(figsize=(width or WIDTH.get(), height), layout="constrained")
    return figure, figure.subplots(rows, columns, **kw)


def save_figure(figure: Figure, path: str | Path) -> list[Path]:
    """Save a figure to `path`, or to both an .svg and a .png file if `path` has no suffix. Returns the paths.

    Returns
    -------
    list of Path
        The files written.
    """
    path = Path(path)
    targets = [path] if path.suffix else [path.with_suffix(".svg"), path.with_suffix(".png")]
    for target in targets:
        metadata = {"Date": None} if target.suffix == ".svg" else None  # the same figure, the same bytes
        with whole(target) as draft:
            figure.savefig(draft, format=target.suffix[1:], metadata=metadata)
    return targets


def decades(ax: Axes) -> None:
    """Make the y axis of `ax` logarithmic, with labels at 1, 2 and 5 of each decade only."""
    ax.set_yscale("log", subs=(3, 4, 6, 7, 8, 9))
    ax.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    ax.yaxis.set_major_formatter("{x:g}")
    ax.yaxis.set_minor_formatter(NullFormatter())


def curvature_fan(ax: Axes, s: ArrayLike, kappa: ArrayLike, rest: ArrayLike, *, most: int = 60) -> None:
    """Draw the curvature profiles along the actuator of many frames, with the rest profile thick and red.

    Parameters
    ----------
    ax : Axes
    s : (S,) array, m
    kappa : (T, S) array, 1/m
        At most `most` frames, evenly spaced, are drawn.
    rest : (S,) array, 1/m
    """
    millimetres = np.asarray(s) * 1e3
    profiles = np.asarray(kappa)
    drawn = profiles[np.unique(np.linspace(0, len(profiles) - 1, min(most, len(profiles))).astype(int))]
    for k, profile in enumerate(drawn):
        label = f"{len(drawn)} of {len(profiles)} frames" if k == 0 else None
        ax.plot(millimetres, profile, color="0.45", linestyle="-", linewidth=0.4, alpha=0.7, label=label)
    ax.plot(millimetres, np.asarray(rest), color="white", linestyle="-", linewidth=3.6)
    ax.plot(millimetres, np.asarray(rest), color=REST_COLOUR, linestyle="-", linewidth=2.2, label="rest")
    ax.set(xlabel="arc length (mm)", ylabel="curvature (1/m)", xlim=(millimetres[0], millimetres[-1]))
    ax.legend()


def error_by_order(
    ax: Axes, time: ArrayLike, errors: Mapping[int, ArrayLike], *, bound: float | None = None, most: int = 4
) -> None:
    """Draw the largest shape error of each frame against time, with one line for each number of segments.

    Parameters
    ----------
    ax : Axes
    time : (T,) array, s
    errors : order -> (T,) array, m
        The first `most` orders and the last one are drawn.
    bound : float, m, optional
    """
    orders = sorted(errors)
    drawn = orders if len(orders) <= most + 1 else [*orders[:most], orders[-1]]
    for n in drawn:
        ax.plot(np.asarray(time), np.asarray(errors[n]) * 1e3, label=f"n = {n}", linewidth=0.9)
    if bound is not None:
        ax.axhline(bound * 1e3, color="0.3", linestyle="-", linewidth=0.6)
        ax.annotate(
            f"bound {bound * 1e3:g} mm", (1, bound * 1e3), xycoords=("axes fraction", "data"),
            xytext=(-2, 2), textcoords="offset points", ha="right", fontsize=7,
            bbox={"boxstyle": "square,pad=0.1", "facecolor": "white", "edgecolor": "none", "alpha": 0.8},
        )  # fmt: skip
    ax.set(xlabel="time (s)", ylabel="largest error (mm)")
    decades(ax)
    if bound is not None:
        ax.set_ylim(top=max(ax.get_ylim()[1], 2e3 * bound))  # the label of the bound fits above its line
    columns = len(drawn) if WIDTH.get() >= NARROW else 3
    ax.legend(loc="lower center", ncols=columns, bbox_to_anchor=(0.5, 1.0), columnspacing=1.2)


def order_bars(ax: Axes, errors: Mapping[int, ArrayLike], *, bound: float | None = None) -> None:
    """Draw the distribution of the frames' largest shape errors for each number of segments: median, 90 % range,
    maximum.

    Parameters
    ----------
    ax : Axes
    errors : order -> (T,) array, m
    bound : float, m, optional
    """
    orders = sorted(errors)
    values = [np.asarray(errors[n]) * 1e3 for n in orders]
    low, median, high = (np.array([np.percentile(v, p) for v in values]) for p in (5, 50, 95))
    ax.errorbar(
        orders, median, yerr=(median - low, high - median), fmt="s", color="black", markersize=4, capsize=3,
        linewidth=0.9, label="median, 5 to 95 %",
    )  # fmt: skip
    ax.plot(orders, [v.max() for v in values], "v", color=REST_COLOUR, markerfacecolor="none", label="maximum")
    if bound is not None:
        ax.axhline(bound * 1e3, color="0.3", linestyle="-", linewidth=0.6)
    ax.set(xlabel="number of segments n", ylabel="largest error of a frame (mm)", xticks=orders)
    decades(ax)
    ax.legend()


def snapshots(
    ax: Axes, measured: ArrayLike, joints: ArrayLike, reconstructed: ArrayLike, *, every: int | None = None
) -> None:
    """Draw measured points, joints and the reconstructed spline for some frames of a shape recording.

    Measured points are drawn as +, joints as o, and the spline through the joints as a line.

    Parameters
    ----------
    ax : Axes
    measured : (F, S, 2) array, m
    joints : (F, n + 1, 2) array, m
    reconstructed : (F, P, 2) array, m
    every : int, optional
        Draw every `every`-th measured point. Default: so that about 30 are drawn.
    """
    points, nodes, curves = (np.asarray(a) * 1e3 for a in (measured, joints, reconstructed))
    step = every or max(1, points.shape[1] // 30)
    for k in range(len(points)):
        first = k == 0
        ax.plot(*curves[k].T, color="black", linestyle="-", linewidth=0.9, label="spline" if first else None)
        ax.plot(
            *points[k, ::step].T, linestyle="", marker="+", color="#0b5fa5", markersize=5, markeredgewidth=0.7,
            label="measured" if first else None,
        )  # fmt: skip
        ax.plot(
            *nodes[k].T, linestyle="", marker="o", color=REST_COLOUR, markerfacecolor="white", markersize=5,
            label="joints" if first else None, zorder=3,
        )  # fmt: skip
    ax.set(xlabel="x (mm)", ylabel="y (mm)", aspect="equal")
    ax.legend()


def recording_overview(recording: Any, *, most: int = 5) -> Figure:
    """Return a figure of a recording: motion of its stations against time, and the recorded inputs below.

    Displacements have one panel for each axis, inputs one for each unit. At most `most` stations are drawn, evenly
    spread from base to tip.
    """
    inputs = recorded_inputs(recording)
    units = list(dict.fromkeys(entry.unit for entry in inputs))
    shape, values = shape_variable(recording), shape_values(recording)
    if shape == "position":
        motion, labels = 1e3 * values, [f"displacement {a} (mm)" for a in recording["axis"].values]
    elif shape == "angle":
        motion, labels = np.degrees(values), ["angle from its start (deg)"]
    else:
        motion, labels = values, [f"change of {shape} {a} (1)" for a in recording["axis"].values]
    names = [str(s) for s in recording["station"].values]
    drawn = sorted(set(np.linspace(0, len(names) - 1, min(most, len(names))).round().astype(int)))
    moved = motion - np.nanmedian(motion[: 10 if "position" in recording else 3], axis=0)
    rows = len(labels) + len(units)
    with style():
        figure, panels = new_figure(rows, 1, height=1.3 * rows + 0.6, sharex=True, squeeze=False)
        for k, (ax, label) in enumerate(zip(panels[:, 0], labels, strict=False)):
            for i in drawn:
                ax.plot(recording["time"].values, moved[:, i, k], label=names[i])
            ax.set_ylabel(label)
        panels[0, 0].legend(ncols=len(drawn), loc="lower right", bbox_to_anchor=(1, 1))
        for ax, unit in zip(panels[len(labels) :, 0], units, strict=True):
            factor, shown_unit = shown_in(unit)
            same_unit = [entry for entry in inputs if entry.unit == unit]
            for entry in same_unit:
                ax.plot(entry.time, factor * entry.values, label=entry.name)
            if len(same_unit) > 1:
                ax.legend(ncols=len(same_unit), loc="lower right", bbox_to_anchor=(1, 1))
            ax.set_ylabel(f"{input_words([unit])[0].replace('pressure', 'gauge pressure')} ({shown_unit})")
        panels[-1, 0].set_xlabel("time (s)")
        figure.align_ylabels()
    return figure


def clock_figure(time: ArrayLike, motion: ArrayLike, clock: ArrayLike, pressure: ArrayLike, delay: float,
                 drift: float = 0.0, title: str = "", word: str = "pressure") -> Figure:
    """Return a figure of motion and pressure against time, before and after the pressure's clock is corrected.

    The left panel shows the whole recording, the right one the steepest edge of the pressure.

    Parameters
    ----------
    time, motion : (T,) arrays
        Time [s], and one time series that represents the motion of the shape, in any unit.
    clock, pressure : (P,) arrays
        Time on the clock of the pressure log [s], and the pressure in any unit.
    delay, drift : float
        Offset [s] and relative rate error; the corrected times are ``clock * (1 + drift) + delay``.
    word : str
        Name of `pressure` in the legend, for other inputs.
    """
    t, y, c, p = (np.asarray(a, dtype=float) for a in (time, motion, clock, pressure))
    moved = c * (1.0 + drift) + delay
    pressure_at_t = np.interp(t, moved, p)
    y = y * (np.sign((y - y.mean()) @ (pressure_at_t - pressure_at_t.mean())) or 1.0)
    y, p = ((v - v.min()) / max(float(np.ptp(v)), 1e-300) for v in (y, p))
    window = 0.1
    rise = np.abs(np.interp(moved + window, moved, p) - p) * ((moved > t[0]) & (moved < t[-1]))
    edge = float(moved[np.argmax(rise)])
    with style():
        figure, (whole, close) = new_figure(1, 2, height=2.4, width_ratios=[3, 2])
        for ax in (whole, close):
            ax.plot(t, y, color="0.6", linestyle="-", linewidth=2.2, label="motion")
            ax.plot(moved, p, color="black", linestyle="-", linewidth=0.9, label=f"{word}, clock corrected")
            ax.plot(c, p, color="0.35", linestyle=":", linewidth=0.9, label=f"{word}, as logged")
            ax.set(xlabel="time on the shape's clock (s)", yticks=[0, 1])
        whole.set(ylabel="fraction of range", xlim=(t[0] - 0.05 * np.ptp(t), t[-1] + 0.05 * np.ptp(t)))
        close.set(xlim=(edge - 0.3, edge + 0.7), title=f"steepest edge of the {word}")
        whole.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3)
        figure.suptitle(title, fontsize=9)
    return figure
