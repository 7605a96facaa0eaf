"""Bending stiffness of a model's cross-section: what its joint springs mean for the body between them."""

from __future__ import annotations

import numpy as np

from pliant.model.parameters import ModelParameters

Array = np.ndarray
SAME = 0.1  # share by which the stub before the first joint and the last link of a mid-segment chain may differ
PLACEMENT = {"base": "each joint at the base of its segment", "midsegment": "each joint in the middle of its segment"}


def joint_placement(model: ModelParameters) -> str:
    """Return "midsegment" where joints sit in the middle of their segments, as `chain_model` lays them, else "base"."""
    stub, last = model.base_length, float(model.link_length[-1])
    halves = model.n == 1 or float(model.link_length[0]) > (1.0 + SAME) * last
    return "midsegment" if halves and stub > 0 and abs(stub - last) < SAME * last else "base"


def segments(model: ModelParameters) -> Array:
    """Length of body (n,) [m] that each joint stands for: the link after it, or half of the links around it."""
    if joint_placement(model) == "base":
        return np.array(model.link_length)
    joints = model.base_length + np.concatenate([[0.0], np.cumsum(model.link_length)[:-1]])
    borders = np.concatenate([[0.0], 0.5 * (joints[1:] + joints[:-1]), [model.length]])
    return np.diff(borders)


def bending_stiffness(model: ModelParameters) -> Array:
    """Return EI (n,) [N m^2] of the body at each joint: the joint's stiffness times the length it stands for.

    It depends on where the joints are assumed to sit (`joint_placement`): the same motion of few links gives springs
    that differ by tens of per cent between the two placements. It is exact as the number of links grows.
    """
    return np.asarray(model.stiffness * segments(model))
