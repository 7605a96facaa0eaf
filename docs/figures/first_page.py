"""Draw the moving picture of the first page: ``python docs/figures/first_page.py [results/demo]``.

Left what goes in, a bundled recording; right what comes out, the demo's model, which has not seen it. Without a folder
of `pliant demo` the demo's study is run first.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import FancyArrowPatch
from PIL import Image

from pliant import load_study, run_study
from pliant.plotting import style
from pliant.study import demo_study
from pliant.study.prepare import aligned_recording
from pliant.validation.store import load_outcome

RECORD, EVERY, FRAME_MS = "pulse_119", 6, 80  # every sixth frame of 75 a second: real time
MEASURED, MODELLED = "0.62", "#0b2f6b"
TARGET = Path(__file__).with_name("first_page.gif")


def layout():
    """The figure and its four axes: two bodies above, two curves below."""
    figure = Figure(figsize=(7.6, 4.5), dpi=100)
    FigureCanvasAgg(figure)
    grid = figure.add_gridspec(2, 2, height_ratios=(2.3, 1), left=0.075, right=0.985, bottom=0.105, top=0.91,
                               wspace=0.36, hspace=0.3)
    axes = [figure.add_subplot(grid[row, column]) for row in (0, 1) for column in (0, 1)]
    figure.add_artist(FancyArrowPatch((0.36, 0.6), (0.47, 0.6), arrowstyle="-|>", mutation_scale=26, linewidth=3,
                                      color=MODELLED, transform=figure.transFigure))
    figure.text(0.41, 0.635, "pliant run", ha="center", family="monospace", fontsize=9)
    return figure, axes


def scenery(axes, record, dense):
    """What stands still, and the artists that move."""
    exp, shape, model = record.experiment, 1e3 * dense, 1e3 * record.body
    seen, said, pressure, tip = axes
    points, = seen.plot([], [], ".", color="0.35", markersize=2.6, linestyle="")
    bone, = said.plot([], [], color=MEASURED, linewidth=9, linestyle="-", solid_capstyle="round", label="measured")
    chain, = said.plot([], [], "o-", color=MODELLED, linewidth=1.8, markersize=5, markerfacecolor="white",
                       label="modelled,\nfive links")
    for ax, title in ((seen, "In: a recording"), (said, "Out: a model that moves with it")):
        ax.set_title(title, fontsize=11, loc="left")
        ax.set(xlim=(shape[..., 0].min() - 12, 25), ylim=(-12, shape[..., 1].max() + 8), aspect="equal",
               xlabel="x (mm)")
        ax.set_anchor("W")
        ax.fill_between([-14, 14], -12, 0, color="0.3", linewidth=0)
    seen.set_ylabel("y (mm)")
    said.legend(loc="upper left", bbox_to_anchor=(0.98, 0.75), fontsize=8, labelspacing=1.2)
    pressure.plot(exp.pressure.time, 1e-3 * exp.pressure.pressure, color="0.35", linewidth=1, linestyle="-")
    pressure.set(ylabel="pressure (kPa)", xlabel="time (s)", ylim=(-8, 135))
    tip.plot(exp.time, 1e3 * exp.last_station[:, 0], color=MEASURED, linewidth=3.5, linestyle="-")
    tip.plot(exp.time, model[:, -1, 0], color=MODELLED, linewidth=1.1, linestyle="-")
    tip.set(ylabel="tip x (mm)", xlabel="time (s)")
    cursors = [ax.axvline(0.0, color="#c1440e", linewidth=1, linestyle="-") for ax in (pressure, tip)]
    for ax in axes:
        ax.tick_params(labelsize=8)
        ax.xaxis.label.set_size(8.5)
        ax.yaxis.label.set_size(8.5)
        ax.spines[["top", "right"]].set_visible(False)
    for ax in (pressure, tip):
        ax.set_xlim(exp.time[0], exp.time[-1])
    return points, bone, chain, cursors


def main(folder=None):
    """Draw every frame and write them as one file."""
    outcome = load_outcome(folder) if folder else run_study(load_study(demo_study()))
    record = next(r for r in outcome.fits[0].records if r.name == RECORD and r.role == "held_out")
    recording = aligned_recording(load_study(demo_study()), RECORD).body
    dense = np.stack([[np.interp(record.experiment.time, recording.time, recording.position.values[:, s, a])
                       for a in (0, 1)] for s in range(0, recording.sizes["station"], 4)]).transpose(2, 0, 1)
    with style():
        figure, axes = layout()
        points, bone, chain, cursors = scenery(axes, record, dense)
        pictures = []
        for k in range(0, len(record.experiment.time), EVERY):
            points.set_data(*(1e3 * dense[k]).T)
            bone.set_data(*(1e3 * dense[k]).T)
            chain.set_data(*(1e3 * record.body[k]).T)
            for cursor in cursors:
                cursor.set_xdata([record.experiment.time[k]] * 2)
            figure.canvas.draw()
            pictures.append(Image.fromarray(np.asarray(figure.canvas.buffer_rgba())).convert("RGB"))
    palette = pictures[len(pictures) // 3].quantize(32)
    pictures = [p.quantize(palette=palette, dither=Image.Dither.NONE) for p in pictures]
    pictures[0].save(TARGET, save_all=True, append_images=pictures[1:], duration=FRAME_MS, loop=0, optimize=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
