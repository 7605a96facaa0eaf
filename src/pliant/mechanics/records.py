"""Records that the methods of `Mechanics` return, and the frame of the base of a planar chain."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from pliant.model import Model
from pliant.numerics.curve import tangents

Array = np.ndarray


class Energy(NamedTuple):
    """Kinetic, elastic and gravitational energy [J] of an actuator, at one instant or at T instants as arrays (T,)."""

    kinetic: Any
    elastic: Any
    gravity: Any


class CoordinateKind(NamedTuple):
    """A group of coordinates of the same kind, such as all joint angles or all strains, with their units and dataset
    names.
    """

    over: str  # dimension of datasets: "joint", "segment"
    noun: str  # name of one coordinate, in messages
    labels: list[Any]  # along that dimension
    rows: slice  # of coordinates, rates and generalised forces (N,)
    names: tuple[str, str, str, str]  # variables: coordinate, rate, disturbance, external force
    units: tuple[str, str, str]  # of coordinate, rate and force
    memory: tuple[str, str, str]  # variables of hysteresis: states, force; the states' dimension
    lever: Array  # (k,) generalised force [N m] of one unit of this force


def strain_kind(model: Model) -> tuple[CoordinateKind, ...]:
    """Return a tuple with the group of the strain coordinates, which are the last ones; () if no segment lengthens."""
    kind = CoordinateKind(
        "segment", "strain", [e.name for e in model.extensions], slice(model.size - len(model.extensions), model.size),
        ("axial_strain", "axial_strain_rate", "axial_disturbance", "external_axial_force"), ("1", "1/s", "N"),
        ("axial_memory_state", "axial_memory_force", "axial_memory"), model.segment_length,
    )
    return (kind,) if model.extensions else ()


class LinkFrames(NamedTuple):
    """Link angles, strains and lengths of a planar chain, as real numbers or as complex numbers for derivatives."""

    x: Any  # (n + S,) absolute angles, rad, strains behind them
    length: Any  # (n,) m
    base_length: Any  # m
    base_angle: Any  # rad
    share: Any  # (n + 1, S) fraction of each link that lies in each segment that lengthens


def link_coordinates(chain: LinkFrames, points: Array) -> tuple[Array, Array]:
    """Return the distances [m] of P points along and across the base part and each of n links, as two arrays (P, n +
    1).

    The points (P, 2) [m] are in the base frame. The base part is the first column.

    Coordinates along a link refer to the unstretched link.
    """
    n = len(chain.length)
    angle = np.append(chain.base_angle, chain.x[:n])
    stretch = 1.0 + chain.share @ chain.x[n:]
    (minus_s, c) = ahead = tangents(angle).T
    tips = np.cumsum(np.append(chain.base_length, chain.length) * stretch * ahead, axis=1)
    dx, dy = (points.T[:, :, None] - np.column_stack([np.zeros(2), tips[:, :-1]])[:, None])
    return (c * dy + minus_s * dx) / stretch, minus_s * dy - c * dx
