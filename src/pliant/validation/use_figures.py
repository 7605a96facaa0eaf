"""Figures of a model in use: simulated motion and its video, estimated state, contact, sweep and controlled tip."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import cycle, product
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from matplotlib import animation
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from pliant.errors import InputError
from pliant.plotting import DASHES, REST_COLOUR, new_figure, style
from pliant.simulation.result import ENDINGS, inputs_in
from pliant.units import KIND_OF, input_words, shown_in
from pliant.validation.curves import evenly_spaced, thin
from pliant.validation.figures import columns_in_time, drawing, legend


def estimate_overview(found: Any) -> Figure:
    """Draw joint angles, smoothed rates with two standard deviations, whitened innovations and strains against time."""
    time, lengthens = found["time"].values, "axial_strain" in found
    with style():
        figure, axes = new_figure(3 + lengthens, 1, height=5.4 + 1.8 * lengthens, sharex=True)
        turns = [axis for axis in ENDINGS if f"joint_angle{axis}" in found]
        for axis, (j, joint) in product(turns, enumerate(found["joint"].values)):
            rate, sd = (found[f"smooth_joint_rate{axis}{end}"].values[:, j] for end in ("", "_sd"))
            angle = 57.29578 * found[f"joint_angle{axis}"].values[:, j]
            (line,) = axes[0].plot(time, angle, label=f"joint {joint}{axis.replace('_', ' ')}")
            axes[1].plot(time, rate, color=line.get_color())
            axes[1].fill_between(time, rate - 2 * sd, rate + 2 * sd, color=line.get_color(), alpha=0.2, linewidth=0)
        axes[0].set_ylabel("angle (deg)")
        axes[0].legend(ncols=min(5, found.sizes["joint"]), loc="lower right", bbox_to_anchor=(1, 1))
        axes[1].set_ylabel("rate (rad/s), 2 sd")
        axes[2].plot(time, found["innovation"].values, linestyle="", marker=".", markersize=1.5, color="0.3")
        for level in (-2, 2):
            axes[2].axhline(level, color=REST_COLOUR, linewidth=0.6)
        axes[2].set_ylabel("whitened innovation (1)")
        for s, name in enumerate(found["segment"].values if lengthens else ()):
            strain, sd = (100.0 * found[f"smooth_axial_strain{end}"].values[:, s] for end in ("", "_sd"))
            (line,) = axes[3].plot(time, strain, label=str(name))
            axes[3].fill_between(time, strain - 2 * sd, strain + 2 * sd, color=line.get_color(), alpha=0.2, linewidth=0)
            axes[3].set_ylabel("strain (%), 2 sd")
            axes[3].legend()
        axes[-1].set_xlabel("time (s)")
        figure.align_ylabels()
    return figure


def contact_overview(found: Any) -> Figure:
    """Draw the test statistic with its threshold, and the position and force of a contact, against time."""
    time = found["time"].values
    with style():
        figure, axes = new_figure(3, 1, height=5.0, sharex=True)
        axes[0].plot(time, np.maximum(found["statistic"].values, 1e-2), color="black")
        axes[0].axhline(found.attrs["threshold"], color=REST_COLOUR, linewidth=0.8, label="threshold")
        axes[0].set(yscale="log", ylabel="test statistic (1)")
        axes[0].legend()
        low, high = (1e3 * found[name].values for name in ("arc_low", "arc_high"))
        axes[1].fill_between(time, low, high, color="0.8", linewidth=0, label="95 %")
        axes[1].plot(time, 1e3 * found["contact_arc_length"].values, color="black")
        axes[1].set_ylabel("position along the body (mm)")
        axes[1].legend()
        for name in ("normal", "tangential"):
            axes[2].plot(time, found[f"{name}_force"].values, label=name)
        axes[2].set(ylabel="force (N)", xlabel="time (s)")
        axes[2].legend()
        figure.align_ylabels()
    return figure


def sweep_figure(samples: Any) -> Figure:
    """Draw the results of a sweep: the tip against time with median and 95 % range, and a histogram of each parameter
    and each scalar result.
    """
    good = samples.isel(sample=np.flatnonzero(~samples["failed"].values.astype(bool)))
    names = [str(n) for n, a in good.data_vars.items() if a.dims == ("sample",) and n != "failed"]
    moving = "tip" in good
    with style():
        rows = -(-len(names) // 3)
        figure, grid = new_figure(rows + moving, 3, height=1.9 * (rows + moving), squeeze=False)
        for ax, name in zip(grid[int(moving):].flat, names, strict=False):
            ax.hist(good[name].values, bins="auto", color="0.6", edgecolor="0.3", linewidth=0.4)
            ax.set(xlabel=f"{name.removeprefix('parameter_').replace('_', ' ')} ({good[name].attrs['units']})",
                   ylabel="samples")
        for ax in grid.flat[3 * moving + len(names):]:
            ax.remove()
        if moving:
            for ax in grid[0]:
                ax.remove()
            wide = figure.add_subplot(grid[0, 0].get_gridspec()[0, :])
            for axis, shade in zip(good["axis"].values, ("0.0", "0.45", "0.7"), strict=False):
                low, middle, high = 1e3 * np.quantile(good["tip"].sel(axis=axis).values, (0.025, 0.5, 0.975), axis=0)
                wide.fill_between(good["time"].values, low, high, color=shade, alpha=0.25, linewidth=0)
                wide.plot(good["time"].values, middle, color=shade, label=f"tip {axis}, median and 95 %")
            wide.set(xlabel="time (s)", ylabel="position (mm)")
            wide.legend()
    return figure


def control_figure(
    time: Any, wanted: Any, reached: Any, command: Any, pressure: Any, names: Sequence[str] = ("",), unit: str = "Pa"
) -> Figure:
    """Draw a controlled tip: wanted and reached displacement above, command and measured pressure below.

    Parameters
    ----------
    time : (T,) array, s
    wanted, reached : (T,) array, m; (T, m) for several outputs, m or rad
    command, pressure : (T,) array, Pa; (T, C) for several chambers
    names : sequence of str
        Names of the outputs.
    unit : str
        SI unit of command and pressure: of tendons "N", "m" or "rad".
    """
    factor, word = shown_in(unit)
    with style():
        figure, panels = new_figure(2, 1, height=3.4, sharex=True)
        for name, actual, asked in zip(names, by_column(reached), by_column(wanted), strict=True):
            panels[0].plot(time, actual * 1e3, label=f"{name} reached (estimated)".strip())
            panels[0].plot(time, asked * 1e3, label=f"{name} wanted".strip())
        panels[0].set_ylabel("tip displacement (mm)" if len(names) == 1 else "change of outputs (mm, mrad)")
        for c, (asked, read) in enumerate(zip(by_column(command), by_column(pressure), strict=True)):
            number = f" {c + 1}" if np.ndim(command) > 1 else ""
            panels[1].step(time, asked * factor, where="post", label=f"command{number}")
            panels[1].plot(time, read * factor, label=f"measured{number}", linewidth=0.7)
        kind = "gauge pressure" if unit == "Pa" else KIND_OF[unit]
        panels[1].set(xlabel="time (s)", ylabel=f"{kind} ({word})")
        for panel in panels:
            panel.legend(loc="best")
        figure.align_ylabels()
    return figure


def by_column(values: Any) -> Any:
    """Return values (T,) or (T, m) over T frames as m rows (m, T), one for each column."""
    array = np.asarray(values)
    return array[None] if array.ndim == 1 else array.T


def inputs_shown(trajectory: xr.Dataset) -> tuple[np.ndarray, str]:
    """Return the inputs (T, C) of a motion, in the units in which figures show them, and the label of their axis."""
    values, units = inputs_in(trajectory)
    word, display_unit = input_words(units)
    return values * [shown_in(unit)[0] for unit in units], f"{word} ({display_unit})"


def named_input(name: str, unit: str, units: Sequence[str]) -> str:
    """Return the label of an input in a legend: its kind and `name`, with its unit if the `units` differ."""
    word, display_unit = input_words([unit])
    return f"{word}, {name}" + (f" ({display_unit})" if len(set(units)) > 1 else "")


def motion_figure(trajectory: xr.Dataset) -> Figure:
    """Draw the simulated coordinates of the tips of up to six links against time, with the inputs below.

    Parameters
    ----------
    trajectory : xarray.Dataset
        From `pliant.simulate`: tip_position (time, link, axis) in m, pressure or actuation (time, input).
    """
    values, label = inputs_shown(trajectory)
    inputs, units = trajectory["input"].values, inputs_in(trajectory)[1]
    names = [named_input(name, unit, units) for name, unit in zip(inputs, units, strict=True)]
    time, tips = trajectory["time"].values, trajectory["tip_position"].transpose("time", "link", "axis").values
    greys = [f"{grey:.2f}" for grey in np.linspace(0.6, 0.0, 6)]
    with drawing():
        figure, axes = columns_in_time([2.6], tips.shape[2], below=1.0)
        for axis, ax in enumerate(axes[0]):
            for i, colour, dash in zip(evenly_spaced(tips.shape[1]), greys, DASHES, strict=False):
                line: dict[str, Any] = {"color": colour, "linestyle": dash, "label": f"tip of link {i + 1}"}
                ax.plot(*thin(time, 1e3 * tips[:, i, axis]), **line)
            ax.set_ylabel(f"{'XYZ'[axis]} of the link tips (mm)")
        below = figure.axes[-1]
        for name, dash, p in zip(names, cycle(DASHES), values.T):
            below.plot(*thin(time, p), color="black", linestyle=dash, linewidth=0.9,
                       label=name if inputs.size > 1 else None)  # fmt: skip
        below.set_ylabel(label)
        figure.align_ylabels()
        legend(figure, [axes[0, 0], below])
    return figure


def body_film(
    path: Path, time: ArrayLike, base: ArrayLike, tips: ArrayLike, inputs: ArrayLike, label: str, *, rate: int = 25,
) -> None:
    """Write a video of a body: its links, the path of the tip, and the inputs beside it. A body in space is shown from
    two sides.

    Parameters
    ----------
    path : Path
        File to write, ending in .gif or .mp4.
    time : (T,) array, s
    base : (2, d) array, m
        Positions of the origin and the first joint, d = 2 or 3.
    tips : (T, n, d) array, m
    inputs : (T, C) array
        In the unit of `label`, the text beside their axis.
    rate : int
        Frames per second.

    Raises
    ------
    InputError
        For an .mp4 if ffmpeg is not installed.
    """
    if path.suffix == ".mp4" and not animation.writers.is_available("ffmpeg"):
        raise InputError("an .mp4 needs ffmpeg, which is not on the path: use .gif, or install ffmpeg")
    t, p, moving = (np.asarray(a, dtype=float) for a in (time, inputs, tips))
    body = 1e3 * np.concatenate([np.broadcast_to(base, (t.size, 2, moving.shape[2])), moving], axis=1)
    views = [body] if moving.shape[2] == 2 else [body[..., [across, 2]] for across in (0, 1)]
    frames = np.unique(np.searchsorted(t, np.arange(t[0], t[-1], 1.0 / rate)).clip(0, t.size - 1))
    with style():
        figure, (*sides, below) = new_figure(
            1, len(views) + 1, height=3.2, gridspec_kw={"width_ratios": [*[2] * len(views), 1]}
        )
        names = ["xy"] if len(views) == 1 else ["xz", "yz"]
        drawn = [(view, *body_lines(ax, view, name)) for ax, view, name in zip(sides, views, names, strict=True)]
        below.plot(t, p, color="black", linestyle="-", linewidth=0.9)
        (now,) = below.plot([], [], linestyle="", marker="o", color="black")
        below.set(xlabel="time (s)", ylabel=label)

        def draw(k: int) -> list[Any]:
            for view, line, way in drawn:
                line.set_data(*view[k].T)
                way.set_data(*view[: k + 1, -1].T)
            now.set_data(np.full(p[k].shape, t[k]), p[k])
            return [*(artist for _, *lines in drawn for artist in lines), now]

        video = animation.FuncAnimation(figure, draw, frames=frames)
        video.save(str(path), writer="pillow" if path.suffix == ".gif" else "ffmpeg", fps=rate, dpi=100)


def body_lines(ax: Axes, view: np.ndarray, names: str) -> tuple[Any, Any]:
    """Frame a body's motion (T, n + 2, 2) [mm] in axes, and return the still empty lines of the body and of its
    tip's path. `names` are the two coordinates.
    """
    margin = 0.06 * np.ptp(view[..., 1])
    ax.set(xlim=(view[..., 0].min() - 4 * margin, view[..., 0].max() + 4 * margin), aspect="equal",
           ylim=(min(view[..., 1].min(), 0.0) - margin, view[..., 1].max() + margin))  # fmt: skip
    ax.set(xlabel=f"{names[0]} (mm)", ylabel=f"{names[1]} (mm)")
    (way,) = ax.plot([], [], color=REST_COLOUR, linestyle="-", linewidth=0.8)
    (line,) = ax.plot(
        [], [], color="black", linestyle="-", linewidth=3.0, marker="o", markersize=3, markerfacecolor="white"
    )
    return line, way
