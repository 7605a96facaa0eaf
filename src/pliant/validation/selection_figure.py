"""Figure of a model selection: error of each stage on held-out recordings, and its computation time."""

from __future__ import annotations

from typing import Any

import numpy as np

from pliant.identification import ModelSelection
from pliant.plotting import NARROW, WIDTH, side_by_side
from pliant.validation.figures import drawing
from pliant.validation.wording import clip, digits


def selection_figure(selection: ModelSelection) -> Any:
    """Draw the errors of every stage on training and held-out recordings; on a wide page also the computation times."""
    steps = [s for s in selection.steps if s.result]
    at = np.arange(len(steps))
    narrow = WIDTH.get() < NARROW
    with drawing():
        height = 0.9 + 0.32 * len(steps)
        figure, axes = side_by_side(1 if narrow else 3, (1,) if narrow else (2, 1, 1), height, sharey=True)
        axes = np.atleast_1d(axes)
        draw_errors(axes[0], selection, at)
        for ax, (cost, what) in zip(axes[1:], (
            ([s.seconds for s in steps], "time of the fits (s)"), ([s.step_ns for s in steps], "simulated step (ns)"),
        ), strict=False):
            bars = ax.barh(at, cost, height=0.5, color="0.75", edgecolor="black", linewidth=0.5)
            ax.bar_label(bars, [digits(c, 2) for c in cost], padding=2, fontsize=6.5)
            ax.set(xlabel=what, xlim=(0, 1.3 * max(cost)))
            ax.grid(visible=False, axis="y")
    return figure


def draw_errors(ax: Any, selection: ModelSelection, at: np.ndarray) -> None:
    """Draw the mean error of every stage as a marker and that of each recording as a dash, and shade the
    chosen stage.
    """
    steps = [s for s in selection.steps if s.result]
    for label, colour, marker, errors in (
        ("training", "0.55", "o", [s.train for s in steps]),
        ("held out", "#0b2f6b", "s", [s.held_out for s in steps]),
    ):
        if not any(errors):
            continue
        rows = [list(e.values()) if e else [np.nan] for e in errors]
        ax.plot([np.mean(row) for row in rows], at, color=colour, marker=marker, linestyle="-", markersize=4,
                label=label)
        for k, row in enumerate(rows if max(map(len, rows)) > 1 else ()):
            ax.plot(row, [k] * len(row), color=colour, marker="|", linestyle="", markersize=8)
    (chosen,) = (k for k, s in enumerate(steps) if s.stage.name == selection.chosen)
    ax.axhspan(chosen - 0.4, chosen + 0.4, color="0.88", zorder=0, label="chosen")
    ax.set_yticks(at, [clip(s.stage.title, 26) for s in steps])
    ax.invert_yaxis()
    ax.set(xlabel="error (% of peak displacement)", xlim=(0, None))
    ax.legend()
