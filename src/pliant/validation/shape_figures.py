"""Figures of a dense shape: its curvature, the errors of each number of segments, and the chain of links."""

from __future__ import annotations

from typing import Any

import numpy as np

from pliant.errors import InputError
from pliant.plotting import curvature_fan, error_by_order, order_bars, side_by_side, snapshots
from pliant.reduction import spline_shape
from pliant.validation.curves import instants
from pliant.validation.figures import drawing
from pliant.validation.outcome import Shape

Array = np.ndarray


def order_figure(shape: Shape) -> Any:
    """Draw the largest error of the rebuilt shape against time and its spread, for each number of segments."""
    order = shape.order
    errors = dict(zip(order.orders, order.max_error, strict=True))
    with drawing():
        figure, (left, right) = side_by_side(2, (2, 1), 2.8)
        error_by_order(left, order.time, errors, bound=order.bound)
        order_bars(right, errors, bound=order.bound)
        figure.align_ylabels()
    return figure


def shape_figure(shape: Shape) -> Any:
    """Draw the curvature along the body at many instants, and the chain of links with its spline at a few."""
    with drawing():
        figure, (left, right) = side_by_side(2, (1, 1), 3.4)
        curvature_fan(left, shape.arc_length, shape.curvature, shape.rest_curvature)
        snapshots(right, *chain_through(shape))
        if shape.position.shape[2] == 3:
            right.set(xlabel="sideways (mm)", ylabel="z (mm)")
    return figure


def chain_through(shape: Shape) -> tuple[Array, Array, Array]:
    """Return measured points (F, S, 2), joints (F, n + 1, 2) and splines (F, P, 2) [m from base] at a few frames.

    Only complete frames are used, since the chain was fitted to these alone. A body in space is projected onto the
    vertical plane in which it moves most.
    """
    links = shape.links
    whole = shape.position[np.isfinite(shape.position).all(axis=(1, 2))]
    if len(whole) != len(links.tips):
        raise InputError(f"shape of {shape.name}: {len(whole)} complete frames, but links for {len(links.tips)}")
    tips = links.tips - links.base
    frames = instants(tips[:, -1])
    upright = np.eye(tips.shape[2])
    joints = np.concatenate([np.zeros((len(frames), 1, len(upright))), tips[frames]], axis=1)
    splines = joints
    if links.n > 1:
        along = np.linspace(links.node_arc_length[0], links.node_arc_length[-1], 100)
        splines = spline_shape(tips[frames], links.node_arc_length, along, boundary=shape.order.boundary,
                               base=0 * upright[-1], base_tangent=upright[-1])  # fmt: skip
    shown = whole[frames] - links.base, joints, splines
    if len(upright) == 2:
        return shown
    side = np.linalg.eigh(np.cov(tips[:, -1, :2].T))[1][:, -1]
    first, second, third = (np.stack([a[..., :2] @ side, a[..., 2]], axis=-1) for a in shown)
    return first, second, third
