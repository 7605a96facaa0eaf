"""Figures of how a model was chosen: curvature of the body, error by number of links, stages of a model selection."""

from __future__ import annotations

from typing import Any

import numpy as np

from pliant.errors import InputError
from pliant.identification import ModelSelection
from pliant.plotting import NARROW, WIDTH, curvature_fan, error_by_order, order_bars, side_by_side, snapshots
from pliant.reduction import spline_shape
from pliant.validation.curves import instants
from pliant.validation.figures import drawing
from pliant.validation.outcome import Shape
from pliant.validation.wording import clip, digits

Array = np.ndarray


def order_figure(shape: Shape) -> Any:
    """Draw the largest error of the rebuilt shape in each frame, for each number of segments: in one panel against
    time, in the other as a distribution over the frames.
    """
    order = shape.order
    errors = dict(zip(order.orders, order.max_error, strict=True))
    with drawing():
        figure, (left, right) = side_by_side(2, (2, 1), 2.8)
        error_by_order(left, order.time, errors, bound=order.bound)
        order_bars(right, errors, bound=order.bound)
        figure.align_ylabels()
    return figure


def shape_figure(shape: Shape) -> Any:
    """Draw the curvature along a body at many instants, and at a few instants the chain of links with a spline through
    its joints.
    """
    with drawing():
        figure, (left, right) = side_by_side(2, (1, 1), 3.4)
        curvature_fan(left, shape.arc_length, shape.curvature, shape.rest_curvature)
        snapshots(right, *chain_through(shape))
        if shape.position.shape[2] == 3:
            right.set(xlabel="sideways (mm)", ylabel="z (mm)")
    return figure


def chain_through(shape: Shape) -> tuple[Array, Array, Array]:
    """Return points of the measured body, the joints of the chain, and a spline through these joints, at a few frames.
    Each is an array (frames, points, 2) [m] relative to the base.

    Only complete frames are used, since the chain was fitted to these alone. A body in space is projected onto the
    vertical plane in which it moves most.
    """
    links = shape.links
    whole = shape.position[np.isfinite(shape.position).all(axis=(1, 2))]
    if len(whole) != len(links.tips):
        raise InputError(f"the shape of {shape.name} has {len(whole)} complete frames, but its links were computed "
                         f"from {len(links.tips)}: compute them again from this shape by links_of")
    tips = links.tips - links.base
    frames = instants(tips[:, -1])
    upright = np.eye(tips.shape[2])
    joints = np.concatenate([np.zeros((len(frames), 1, len(upright))), tips[frames]], axis=1)
    splines = joints
    if links.n > 1:
        along = np.linspace(links.node_arc_length[0], links.node_arc_length[-1], 100)
        splines = spline_shape(tips[frames], links.node_arc_length, along, boundary=shape.order.boundary,
                               base=0 * upright[-1], base_tangent=upright[-1])  # fmt: skip
    curves = whole[frames] - links.base, joints, splines
    if len(upright) == 2:
        return curves
    side = np.linalg.eigh(np.cov(tips[:, -1, :2].T))[1][:, -1]
    first, second, third = (np.stack([a[..., :2] @ side, a[..., 2]], axis=-1) for a in curves)
    return first, second, third


def selection_figure(selection: ModelSelection) -> Any:
    """Draw the errors of every stage on training and held-out recordings; on a wide page also the computation times."""
    fitted = [s for s in selection.stages if s.result]
    rows = np.arange(len(fitted))
    narrow = WIDTH.get() < NARROW
    with drawing():
        height = 0.9 + 0.32 * len(fitted)
        figure, axes = side_by_side(1 if narrow else 3, (1,) if narrow else (2, 1, 1), height, sharey=True)
        axes = np.atleast_1d(axes)
        draw_errors(axes[0], selection, rows)
        for ax, (cost, what) in zip(axes[1:], (
            ([s.seconds for s in fitted], "time of the fits (s)"), ([s.step_ns for s in fitted], "simulated step (ns)"),
        ), strict=False):
            bars = ax.barh(rows, cost, height=0.5, color="0.75", edgecolor="black", linewidth=0.5)
            ax.bar_label(bars, [digits(c, 2) for c in cost], padding=2, fontsize=6.5)
            ax.set(xlabel=what, xlim=(0, 1.3 * max(cost)))
            ax.grid(visible=False, axis="y")
    return figure


def draw_errors(ax: Any, selection: ModelSelection, at: np.ndarray) -> None:
    """Draw the mean error of every stage as a marker and that of each recording as a dash, and shade the
    chosen stage.
    """
    fitted = [s for s in selection.stages if s.result]
    for label, colour, marker, errors in (
        ("training", "0.55", "o", [s.train for s in fitted]),
        ("held out", "#0b2f6b", "s", [s.held_out for s in fitted]),
    ):
        if not any(errors):
            continue
        rows = [list(e.values()) if e else [np.nan] for e in errors]
        ax.plot([np.mean(row) for row in rows], at, color=colour, marker=marker, linestyle="-", markersize=4,
                label=label)
        for k, row in enumerate(rows if max(map(len, rows)) > 1 else ()):
            ax.plot(row, [k] * len(row), color=colour, marker="|", linestyle="", markersize=8)
    (chosen,) = (k for k, s in enumerate(fitted) if s.stage.name == selection.chosen)
    ax.axhspan(chosen - 0.4, chosen + 0.4, color="0.88", zorder=0, label="chosen")
    ax.set_yticks(at, [clip(s.stage.title, 26) for s in fitted])
    ax.invert_yaxis()
    ax.set(xlabel="error (% of peak displacement)", xlim=(0, None))
    ax.legend()
