"""Figures of how a model was chosen: curvature of the body, error by number of links, steps of a model selection."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from pliant.errors import InputError
from pliant.plotting import curvature_fan, decades, error_by_order, new_figure, order_bars, side_by_side, snapshots
from pliant.reduction import spline_shape
from pliant.selection import ModelSelection
from pliant.validation.curves import instants
from pliant.validation.figures import drawing
from pliant.validation.outcome import Shape
from pliant.validation.wording import clip

Array = np.ndarray
DARK = "#0b2f6b"
LINE = 0.12  # inch, height of a line of the list of models


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


def selection_figure(selection: ModelSelection, plain_map: float | None = None) -> Any:
    """Draw the errors of the training recordings and of their left-out parts against the number of free parameters, for
    each model on the way of a model selection. Numbers beside the points refer to the list of models below the axes,
    which has parameters that were held or got a prior at the end without a number. A dotted line shows the error of the
    plain map on left-out parts, in % of the peak displacement, if it is given.
    """
    steps = selection.steps
    with drawing():
        figure, ax = new_figure(1, 1, height=2.9 + LINE * len(steps))
        free = [len(s.free) for s in steps]
        ax.plot(free, [s.train_percent for s in steps], color="0.6", marker="o", markersize=4, label="training")
        ax.plot(free, [s.left_out_percent for s in steps], color=DARK, marker="s", markersize=4, label="parts left out")
        models = [s for s in steps if s.change != "settles"]
        errors = [max(s.train_percent, s.left_out_percent) for s in models]
        for numbers, place in numbered([len(s.free) for s in models], errors):
            ax.annotate(numbers, place, xytext=(5, 4), textcoords="offset points", fontsize=6.5)
        names = [f"{k}  {clip(s.sentence, 62)}" for k, s in enumerate(models, 1)]
        names += [f"    {clip(s.title, 60)}" for s in steps if s.change == "settles"]
        figure.supxlabel("\n".join(names), x=0.02, ha="left", fontsize=6.5)
        ax.plot(free[-1], steps[-1].left_out_percent, color=DARK, marker="s", markersize=8, fillstyle="none",
                linestyle="", label="chosen")
        if plain_map is not None:
            ax.axhline(plain_map, color="black", linestyle=":", linewidth=1.0, label="plain map, left out")
        decades(ax)
        ax.xaxis.get_major_locator().set_params(integer=True)
        ax.margins(y=0.12)
        ax.set(xlabel="free parameters", ylabel="error (% of peak displacement)",
               xlim=(min(free) - 0.5, max(free) + 0.5 + 0.06 * (max(free) - min(free))))
        ax.legend()
    return figure


def numbered(free: Sequence[int], error: Sequence[float]) -> list[tuple[str, tuple[int, float]]]:
    """Return the numbers of steps with `free` parameters and an `error` [%], and where they stand: those of places that
    would cover each other, in one text.
    """
    texts: list[tuple[list[int], tuple[int, float]]] = []
    for k, place in enumerate(zip(free, error, strict=True), 1):
        beside = (numbers for numbers, (count, size) in texts
                  if count == place[0] and size / 1.25 < place[1] < size * 1.25)
        if (numbers := next(beside, None)) is None:
            texts.append(([k], place))
        else:
            numbers.append(k)
    return [(", ".join(map(str, numbers)), place) for numbers, place in texts]
