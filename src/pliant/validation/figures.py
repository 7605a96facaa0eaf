"""Figures of measured and modelled motion: thick grey lines or + are measured, thin dark lines are modelled, dotted
lines are predicted by a plain map.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from itertools import cycle
from pathlib import Path
from textwrap import fill
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from pliant.errors import InputError
from pliant.files import whole
from pliant.identification import Experiment
from pliant.plotting import NARROW, TALLEST, WIDTH, side_by_side, style
from pliant.units import input_words, shown_in
from pliant.validation.curves import (
    autocorrelation,
    axes_of,
    evenly_spaced,
    instants,
    laws_of,
    pressures_of,
    slenderness,
    thin,
)
from pliant.validation.outcome import FitOutcome, Forecast, RecordOutcome
from pliant.validation.wording import ROLE, clip, digits, readable, sized

Array = np.ndarray
MOST_FITS = 4
STATIONS = 3  # of a record's figure
ONE_LINE = 8  # letters of a station's name that stand in one line with the quantity
BAND: dict[str, Any] = {"facecolor": "0.9", "edgecolor": "0.75", "linewidth": 0.4, "zorder": 0.5}
TIMELESS: dict[str, Any] = {"svg": {"Date": None}, "png": {"Software": None}, "pdf": {"CreationDate": None}}
SPARSE = 120  # up to this number of frames, measured points are drawn as single marks
MEASURED: dict[str, Any] = {"color": "0.57", "linestyle": "-", "linewidth": 1.9, "label": "measured"}
MEASURED_POINTS: dict[str, Any] = {
    "color": "0.35", "linestyle": "", "marker": "+", "markersize": 4.5, "markeredgewidth": 0.9, "label": "measured",
}
RESIDUALS = (("black", "-"), ("#c1440e", (0, (4, 1.5))), ("#0b6b5b", (0, (1, 1))))  # of x, y and z
MODELLED: dict[str, Any] = {"color": "#0b2f6b", "linestyle": "-", "linewidth": 0.9, "label": "modelled"}

BASELINE: dict[str, Any] = {"color": "#7a1f00", "linestyle": (0, (1, 1.5)), "linewidth": 1.2, "label": "plain map"}
BASE_LINES: dict[str, Any] = {"x": "-", "y": (0, (4, 1.5)), "z": (0, (1, 1))}
MARGIN = 0.3  # of the range of measured and modelled values: how far the axis extends for a plain map


@contextmanager
def drawing() -> Iterator[None]:
    """Apply the shared style inside the block, with text drawn literally: a `$` in a name does not start a formula."""
    with style(), mpl.rc_context({"text.parse_math": False, "axes.titlelocation": "left", "axes.labelsize": "medium"}):
        yield


def record_figure(record: RecordOutcome) -> Figure:
    """Draw measured and modelled motion of three stations against time, with residuals and inputs below.

    The stations are spread evenly and include the last one. Each axis has a column; recordings of angles have one.
    """
    exp = record.experiment
    chosen, (names, unit, factor) = evenly_spaced(len(exp.stations), STATIONS), axes_of(exp)
    forced = exp.excitation != "release"
    with drawing():
        figure, axes = columns_in_time([*[1.0] * len(chosen), 0.8], len(names), below=0.7 * forced)
        for row, s in enumerate(chosen):
            for axis, ax in enumerate(axes[row]):
                draw_band(ax, record, s, axis)
                measured(ax, exp.time, factor * exp.compared[:, s, axis])
                ax.plot(*thin(exp.time, factor * record.modelled[:, s, axis]), **MODELLED)
                draw_baseline(ax, record, s, axis)
                ax.set_ylabel(station_label(exp.stations[s], f"{names[axis]} ({unit})"))
        for axis, ax in enumerate(axes[len(chosen)]):
            draw_residuals(ax, exp.time, factor * (record.modelled - exp.compared)[..., axis])
            ax.set_ylabel(f"residual\n{names[axis]} ({unit})")
        panels = [*axes[:, 0], figure.axes[-1]]
        if forced:
            draw_inputs(figure.axes[-1], record)
            panels += draw_base(figure.axes[-1], exp)
        figure.align_ylabels()
        legend(figure, panels)
    return figure


def station_label(station: str, quantity: str) -> str:
    """Return the label of a panel: the station and what is drawn of it, in two lines if the station's name is long. The
    end of a name, which often numbers the station, is kept.
    """
    name, width = clip(readable(station)), 12 if WIDTH.get() < NARROW else 18
    if len(name) > width:
        name = f"{name[: width - 6].rstrip()}…{name[-5:]}"
    separator = " " if len(name) <= ONE_LINE else "\n"
    return f"{name}{separator}{quantity}"


def comparison_figure(fits: Sequence[FitOutcome], record_name: str) -> Figure:
    """Draw the last station of one recording under up to four fits side by side, on shared scales.

    Raises
    ------
    InputError
        When no fit has the recording.
    """
    pairs = [(f, r) for f in fits for r in f.records if r.name == record_name]
    if not pairs:
        raise InputError(f"no fit has the record {record_name!r}: check its name")
    drawn, letters = pairs[:MOST_FITS], int(13.4 * WIDTH.get())
    names, unit, factor = axes_of(pairs[0][1].experiment)
    with drawing():
        figure = Figure(figsize=(WIDTH.get(), 4.2), layout="constrained")
        axes = figure.subplots(len(names) + 1, len(drawn), sharex=True, sharey="row", squeeze=False)
        for column, (fit, record) in zip(axes.T, drawn, strict=True):
            exp = record.experiment
            for axis in range(len(names)):
                measured(column[axis], exp.time, factor * exp.last_station[:, axis])
                column[axis].plot(*thin(exp.time, factor * record.modelled[:, -1, axis]), **MODELLED)
                draw_baseline(column[axis], record, len(exp.stations) - 1, axis)
            distance = factor * np.linalg.norm(record.modelled[:, -1] - exp.last_station, axis=-1)
            column[-1].plot(*thin(exp.time, distance), color="black", linestyle="-", linewidth=0.7, label="distance")
            column[-1].set_xlabel("time (s)")
            rmse = f"RMSE {digits(sized(record.metrics, 'rmse')[0])} {unit}"
            wide = letters // len(drawn)
            column[0].set_title(f"{fill(clip(fit.title), wide)}\n{ROLE[record.role]}:\n{rmse}", fontsize="small")
        axes[-1, 0].set_ylim(0, None)
        last = clip(readable(drawn[0][1].experiment.stations[-1]), 18)
        for ax, what in zip(axes[:, 0], (*(f"{last} {name}" for name in names), "distance"), strict=True):
            ax.set_ylabel(f"{what} ({unit})")
        figure.align_ylabels()
        legend(figure, axes[:-1, 0])
    return figure


def residual_figure(record: RecordOutcome) -> Figure:
    """Draw the residual of the last station against time, and its autocorrelation with the 95 % band of white noise."""
    exp = record.experiment
    names, unit, factor = axes_of(exp)
    residual = factor * (record.modelled[:, -1] - exp.last_station)
    with drawing():
        figure, (left, right) = side_by_side(2, (1, 1), 2.5)
        for axis, (name, (colour, dash)) in enumerate(zip(names, RESIDUALS, strict=False)):
            line: dict[str, Any] = {"color": colour, "linestyle": dash, "linewidth": 0.85, "label": name}
            left.plot(*thin(exp.time, residual[:, axis]), **line)
            right.plot(*autocorrelation(exp.time, residual[:, axis]), **line | {"label": None})
        band = 1.96 / np.sqrt(max(np.isfinite(residual[:, 0]).sum(), 1))
        right.axhspan(-band, band, color="0.85", zorder=0, label="95 % of white noise")
        left.set(xlabel="time (s)", ylabel=f"residual of {clip(readable(exp.stations[-1]), 18)} ({unit})")
        least = min(-2.0 * band, *(float(np.min(line.get_ydata())) for line in right.lines))
        right.set(xlabel="lag (s)", ylabel="autocorrelation", ylim=(least - 0.05, 1.05))
        left.legend(ncols=2)
        right.legend()
        figure.align_ylabels()
    return figure


def torque_figure(fits: Sequence[FitOutcome]) -> Figure:
    """Draw the torque law of each fit against pressure. Filled marks show the peak pressures of training recordings,
    open marks those of held-out recordings.
    """
    laws = [law for f in fits for law in laws_of(f)]
    pressure = pressures_of(laws, 200)
    with drawing():
        figure, ax = side_by_side(1, (1,), 3.2)
        for (title, chamber, marks), mark in zip(laws, cycle("osD^v<>ph"), strict=False):
            label = f" {clip(title)}"  # the space: matplotlib hides labels that begin with _
            line, = ax.plot(1e-3 * pressure, 1e3 * chamber.torque_at(pressure), label=label)
            for p, role in marks.items():
                ax.plot(1e-3 * p, 1e3 * chamber.torque_at(p), linestyle="", marker=mark, markersize=5.5,
                        color=line.get_color(), markerfacecolor=line.get_color() if role == "train" else "white")
        ax.set(xlabel="gauge pressure (kPa)", ylabel="torque on each joint (mN m)",
               xlim=(1e-3 * pressure[0], None if pressure[-1] else 0.0))
        dots = [Line2D([], [], linestyle="", marker="o", color="0.3", label=f"{ROLE[role]} level", markersize=5.5,
                       markerfacecolor="0.3" if role == "train" else "white")
                for role in dict.fromkeys(role for _, _, levels in laws for role in levels.values())]
        ax.legend(handles=[*ax.get_legend_handles_labels()[0], *dots])
    return figure


def path_figure(record: RecordOutcome) -> Figure:
    """Draw the measured and modelled path of the last station and, with several stations, the body at a few instants.

    A body in space is drawn in three views: front (x, z), side (y, z) and top (x, y).
    """
    exp, modelled, body = record.experiment, record.modelled, len(record.experiment.stations) > 1
    with drawing():
        if exp.dimension == 2:
            size = (width := min(5.4, WIDTH.get()), 1.2 + 0.8 * width * slenderness(exp.position, modelled, body))
            ax = (figure := Figure(figsize=size, layout="constrained")).subplots()
            draw_path(ax, record, (0, 1))
            ax.set(xlabel="x (mm)", ylabel="y (mm)", aspect="equal", adjustable="datalim")
            legend(figure, [ax])
            return figure
        figure, views = three_views(np.concatenate([exp.position, modelled, np.zeros((len(modelled), 1, 3))], axis=1))
        for ax, view in views:
            draw_path(ax, record, view)
        legend(figure, figure.axes[:1])
    return figure


def three_views(points: Array) -> tuple[Figure, list[tuple[Axes, tuple[int, int]]]]:
    """Return a figure with front, side and top view of S points over T frames (T, S, 3) [m] at one scale, and the axes
    of each view.
    """
    low, high = (f(points.reshape(-1, 3), axis=0) for f in (np.nanmin, np.nanmax))
    margin = 0.06 * float((high - low).max()) or 1e-3
    low, high = 1e3 * (low - margin), 1e3 * (high + margin)
    x, y, z = high - low
    width = min(5.4, WIDTH.get())
    figure = Figure(figsize=(width, min(1.3 + (width - 1.2) * (y + z) / (x + y), TALLEST)), layout="constrained")
    grid = figure.add_gridspec(2, 2, width_ratios=(x, y), height_ratios=(z, y))
    views = []
    for (row, column), (across, up) in {(0, 0): (0, 2), (0, 1): (1, 2), (1, 0): (0, 1)}.items():
        ax = figure.add_subplot(grid[row, column])
        ax.set(xlabel=f"{'xyz'[across]} (mm)", ylabel=f"{'xyz'[up]} (mm)", aspect="equal",
               xlim=(low[across], high[across]), ylim=(low[up], high[up]))
        ax.locator_params(nbins=4)
        views.append((ax, (across, up)))
    return figure, views


def draw_path(ax: Axes, record: RecordOutcome, view: tuple[int, int]) -> None:
    """Draw the measured and modelled path of the last station, and the body at a few instants, in the plane of the two
    axes `view`.
    """
    exp, axes = record.experiment, list(view)
    position, modelled = exp.position[..., axes], record.modelled[..., axes]
    measured = np.isfinite(exp.last_station).all(axis=1)
    ax.plot(*(1e3 * position[:, -1]).T, **MEASURED if measured.sum() > SPARSE else MEASURED_POINTS)
    ax.plot(*(1e3 * modelled[:, -1]).T, **MODELLED)
    frames = instants(exp.last_station) if len(exp.stations) > 1 else []
    for k in frames:
        first = k == frames[0]
        chain = 1e3 * np.vstack([np.zeros((1, 2)), modelled[k]])
        ax.plot(*chain.T, color="0.15", linestyle="-", linewidth=0.8, marker="o", markersize=4,
                markerfacecolor="white", label="modelled stations" if first else None)
        ax.plot(*(1e3 * position[k]).T, linestyle="", marker="+", color="black", markersize=7,
                label="measured stations" if first else None)
        if k in (frames[0], frames[-1]) and view[0] == 0:
            ax.annotate(f"{exp.time[k]:.2f} s", chain[-1], textcoords="offset points", xytext=(0, 9), fontsize=7,
                        ha="center", bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.5})
    ax.plot(*(1e3 * position[measured, -1][0]), marker="s", markersize=5, color="black", markerfacecolor="none",
            linestyle="", label="first frame")


def forecast_figure(forecast: Forecast) -> Figure:
    """Draw the predicted motion of the last station for a case that was not recorded, with its 95 % band."""
    with drawing():
        figure, axes = columns_in_time([1.0], forecast.tip.shape[1])
        names, (unit, factor) = forecast.axes, forecast.shown_in
        line = MODELLED | {"label": "predicted, not recorded"}
        for axis, ax in enumerate(axes[0]):
            ax.plot(*thin(forecast.time, tip := factor * forecast.tip[:, axis]), **line)
            if forecast.half_width is not None:
                half = factor * forecast.half_width[:, axis]
                ax.fill_between(forecast.time, tip - half, tip + half, color="0.8", linewidth=0, label="95 % band")
            ax.set_ylabel(f"tip {names[axis]} ({unit})")
        legend(figure, axes[:, 0])
    return figure


def columns_in_time(heights: Sequence[float], columns: int = 2, *, below: float = 0.0) -> tuple[Figure, Any]:
    """Return a figure and its axes, which share one time axis: a row for each of the relative `heights`, and a column
    for each coordinate.

    With `below`, one more panel of that relative height spans all columns at the bottom; it is ``figure.axes[-1]``.
    """
    rows = [*heights, *[below] * (below > 0)]
    height = 0.6 + 1.3 * sum(rows)
    figure = Figure(figsize=(WIDTH.get(), min(height, TALLEST) if WIDTH.get() < NARROW else height),
                    layout="constrained")
    grid = figure.add_gridspec(len(rows), columns, height_ratios=rows)
    axes = np.empty((len(heights), columns), dtype=object)
    for row in range(len(heights)):
        for column in range(columns):
            axes[row, column] = figure.add_subplot(grid[row, column], sharex=axes.flat[0])
    if below:
        figure.add_subplot(grid[-1, :], sharex=axes[0, 0])
    last = figure.axes[-1:] if below else axes[-1].tolist()
    for ax in figure.axes:
        ax.tick_params(labelbottom=ax in last)
    for ax in last:
        ax.set_xlabel("time (s)")
    return figure, axes


def measured(ax: Axes, time: Array, value: Array) -> None:
    """Draw a measured curve as a thick grey line, or as + marks if it has at most 120 points."""
    if np.isfinite(value).sum() <= SPARSE:
        ax.plot(time, value, **MEASURED_POINTS)
    else:
        ax.plot(*thin(time, value), **MEASURED)


def draw_band(ax: Axes, record: RecordOutcome, station: int, axis: int) -> None:
    """Draw the prediction band of one station and axis, light grey, behind all lines."""
    if (band := record.band) is not None:
        time = record.experiment.time
        every = np.unique(np.linspace(0, time.size - 1, 400).astype(int))
        low, high = (band.factor * edge[every, station, axis] for edge in (band.lower, band.upper))
        ax.fill_between(time[every], low, high, label=f"{100 * band.level:g} % band", **BAND)


def draw_baseline(ax: Axes, record: RecordOutcome, station: int, axis: int) -> None:
    """Draw the prediction of the plain map for one station and axis, dotted; far outside the other values it is cut."""
    if record.baseline is None:
        return
    factor, (low, high) = record.experiment.shown_in[1], ax.get_ylim()
    ax.plot(*thin(record.experiment.time, factor * record.baseline[:, station, axis]), **BASELINE)
    margin, (lowest, highest) = MARGIN * (high - low), ax.get_ylim()
    ax.set_ylim(max(lowest, low - margin), min(highest, high + margin))


def draw_residuals(ax: Axes, time: Array, residual: Array) -> None:
    """Draw the residuals (T, S) of S stations over T frames: the last station as a dark line, some others thin and
    light behind it.
    """
    for k, s in enumerate(evenly_spaced(residual.shape[1] - 1)):
        label = "other stations" if k == 0 else None
        ax.plot(*thin(time, residual[:, s]), color="0.7", linestyle="-", linewidth=0.6, label=label)
    ax.plot(*thin(time, residual[:, -1]), color="black", linestyle="-", linewidth=0.7, label="last station")
    ax.axhline(0.0, color="0.4", linestyle="-", linewidth=0.5)


def draw_inputs(ax: Axes, record: RecordOutcome) -> None:
    """Draw the modelled inputs (behind valves or motors) over the measured inputs, or over the nominal level if none
    were measured.
    """
    exp = record.experiment
    word, unit = input_words(record.units)
    mixed = len(set(record.units)) > 1
    for k, (name, trace) in enumerate(exp.traces.items()):
        near = (trace.time >= exp.time[0]) & (trace.time <= exp.time[-1])
        name_word, display_unit = input_words([record.unit_of(name)])
        unit_of_line = f" ({display_unit})" if mixed else ""
        line = MEASURED | {"label": f"measured {name_word}{name and f', {name}'}{unit_of_line}",
                           "color": f"{0.57 - 0.12 * (k % 4):.2f}"}  # fmt: skip
        ax.plot(*thin(trace.time[near], shown_in(record.unit_of(name))[0] * trace.pressure[near]), **line)
    if exp.pressure is None:
        ax.axhline(shown_in(record.units[0])[0] * exp.level, color="0.5", linestyle=":", linewidth=1.2,
                   label=f"nominal {word}")  # fmt: skip
    behind = "the valve" if word == "pressure" else "its lag"
    modelled = MODELLED | {"color": "black", "linestyle": (0, (5, 1.5)), "label": f"{word} behind {behind}"}
    for column, name_word in zip(record.pressure.T, record.units, strict=True):
        ax.plot(*thin(exp.time, shown_in(name_word)[0] * column), **modelled)
    ax.set_ylabel(f"{word}\n({unit})")


def draw_base(ax: Axes, exp: Experiment) -> list[Axes]:
    """Draw the recorded position and angle of a moving base over the inputs, on axes of their own at the right, and
    return these axes; [] if the base rests. A rotation in space is drawn by its angle.
    """
    if exp.base is None:
        return []
    right, motion = ax.twinx(), exp.base
    for axis, column in zip("xyz", motion.position.T, strict=False):
        right.plot(*thin(motion.time, 1e3 * column), color="#c1440e", linewidth=0.8, linestyle=BASE_LINES[axis],
                   label=f"base {axis} (mm)")  # fmt: skip
    turn = motion.turn[:, 0] if motion.dimension == 2 else 2.0 * np.arccos(np.clip(np.abs(motion.turn[:, 3]), 0.0, 1.0))
    right.plot(*thin(motion.time, np.degrees(turn)), color="#0b6b5b", linewidth=0.8, label="base angle (deg)")
    right.set_ylabel("base (mm, deg)")
    return [right]


def legend(figure: Figure, axes: Iterable[Axes]) -> None:
    """Draw one legend below the figure with the labels of all given axes, each label once."""
    entries = {label: handle for ax in axes for handle, label in zip(*ax.get_legend_handles_labels(), strict=True)}
    fitting = figure.get_figwidth() / ((0.65 + 0.062 * max(map(len, entries))) * (1 if WIDTH.get() >= NARROW else 0.75))
    columns = max(1, min(len(entries), int(fitting)))
    figure.legend(entries.values(), entries.keys(), loc="outside lower center", ncols=columns)


def save(figure: Figure, folder: str | Path, name: str, kinds: Sequence[str] = ("svg", "png")) -> tuple[Path, ...]:
    """Write a figure as ``name.svg``, ``name.png`` (200 dpi), ... into `folder`, each atomically, and clear the figure.

    The same figure always gives the same bytes.

    Raises
    ------
    InputError
        When the folder cannot be created or written to.
    """
    targets = tuple(Path(folder) / f"{name}.{kind}" for kind in kinds)
    with drawing(), warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Glyph .* missing from")  # the report shows the name in full
        figure.draw_without_rendering()
        figure.set_layout_engine("none")  # keep this layout for all formats
        for target in targets:
            with whole(target) as draft:
                target.parent.mkdir(parents=True, exist_ok=True)
                figure.savefig(draft, format=target.suffix[1:], dpi=200, metadata=TIMELESS[target.suffix[1:]])
    figure.clear()
    return targets
