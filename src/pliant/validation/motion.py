"""Figure and video of a simulated motion."""

from __future__ import annotations

from itertools import cycle
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from matplotlib import animation
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from pliant.errors import InputError
from pliant.plotting import DASHES, REST_COLOUR, new_figure, style
from pliant.validation.curves import evenly_spaced, thin
from pliant.validation.figures import columns_in_time, drawing, legend


def motion_figure(trajectory: xr.Dataset) -> Figure:
    """Draw the simulated coordinates X, Y of the tips of up to six links against time, with the pressure below.

    Parameters
    ----------
    trajectory : xarray.Dataset
        From `pliant.simulate`: tip_position (time, link, axis) in m, pressure (time, input) in Pa.
    """
    pressure, inputs = 1e-3 * trajectory["pressure"].values, trajectory["input"].values
    names = [f"pressure, {name}" for name in inputs] if inputs.size > 1 else [None]
    time, tips = trajectory["time"].values, trajectory["tip_position"].transpose("time", "link", "axis").values
    greys = [f"{grey:.2f}" for grey in np.linspace(0.6, 0.0, 6)]
    with drawing():
        figure, axes = columns_in_time([2.6], below=1.0)
        for axis, ax in enumerate(axes[0]):
            for i, colour, dash in zip(evenly_spaced(tips.shape[1]), greys, DASHES, strict=False):
                line: dict[str, Any] = {"color": colour, "linestyle": dash, "label": f"tip of link {i + 1}"}
                ax.plot(*thin(time, 1e3 * tips[:, i, axis]), **line)
            ax.set_ylabel(f"{'XY'[axis]} of the link tips (mm)")
        below = figure.axes[-1]
        for name, dash, p in zip(names, cycle(DASHES), pressure.T):
            below.plot(*thin(time, p), color="black", linestyle=dash, linewidth=0.9, label=name)
        below.set_ylabel("pressure (kPa)")
        figure.align_ylabels()
        legend(figure, [axes[0, 0], below])
    return figure


def body_film(
    path: Path, time: ArrayLike, base: ArrayLike, tips: ArrayLike, pressure: ArrayLike, *,
    rate: int = 25,
) -> None:
    """Write a video of a body: its links, the path of the tip, and the pressure beside it.

    Parameters
    ----------
    path : Path
        File to write, ending in .gif or .mp4.
    time : (T,) array, s
    pressure : (T, C) array, kPa
    base : (2, 2) array, m
        Positions of the origin and the first joint.
    tips : (T, n, 2) array, m
    rate : int
        Frames per second.

    Raises
    ------
    InputError
        For an .mp4 if ffmpeg is not installed.
    """
    if path.suffix == ".mp4" and not animation.writers.is_available("ffmpeg"):
        raise InputError("an .mp4 needs ffmpeg, which is not on the path: use .gif, or install ffmpeg")
    t, p, moving = (np.asarray(a, dtype=float) for a in (time, pressure, tips))
    body = 1e3 * np.concatenate([np.broadcast_to(base, (t.size, 2, 2)), moving], axis=1)
    frames = np.unique(np.searchsorted(t, np.arange(t[0], t[-1], 1.0 / rate)).clip(0, t.size - 1))
    with style():
        figure, (ax, side) = new_figure(1, 2, height=3.2, gridspec_kw={"width_ratios": [2, 1]})
        margin = 0.06 * np.ptp(body[..., 1])
        ax.set(xlim=(body[..., 0].min() - 4 * margin, body[..., 0].max() + 4 * margin), aspect="equal",
               ylim=(min(body[..., 1].min(), 0.0) - margin, body[..., 1].max() + margin))  # fmt: skip
        ax.set(xlabel="x (mm)", ylabel="y (mm)")
        (way,) = ax.plot([], [], color=REST_COLOUR, linestyle="-", linewidth=0.8)
        (line,) = ax.plot(
            [], [], color="black", linestyle="-", linewidth=3.0, marker="o", markersize=3, markerfacecolor="white"
        )
        side.plot(t, p, color="black", linestyle="-", linewidth=0.9)
        (now,) = side.plot([], [], linestyle="", marker="o", color="black")
        side.set(xlabel="time (s)", ylabel="gauge pressure (kPa)")

        def draw(k: int) -> list[Any]:
            line.set_data(*body[k].T)
            way.set_data(*body[: k + 1, -1].T)
            now.set_data(np.full(p[k].shape, t[k]), p[k])
            return [line, way, now]

        video = animation.FuncAnimation(figure, draw, frames=frames)
        video.save(str(path), writer="pillow" if path.suffix == ".gif" else "ffmpeg", fps=rate, dpi=100)
