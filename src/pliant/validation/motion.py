"""Figure and video of a simulated motion."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import cycle
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
from pliant.simulation.result import inputs_in
from pliant.units import input_words, shown_in
from pliant.validation.curves import evenly_spaced, thin
from pliant.validation.figures import columns_in_time, drawing, legend


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
