"""Bending stiffness EI of an actuator's cross-section, from the stiffness of a model's joints."""

from __future__ import annotations

import numpy as np

from pliant.model.parameters import ModelParameters

Array = np.ndarray
SAME = 0.1  # relative tolerance between the part before the first joint and the last link of a mid-segment chain
PLACEMENT = {"base": "each joint at the base of its segment", "midsegment": "each joint in the middle of its segment"}


def joint_placement(model: ModelParameters) -> str:
    """Return "midsegment" if the model's joints are in the middle of its segments, or "base" if at the base of each.

    `chain_model` describes the two placements.
    """
    stub, last = model.base_length, float(model.link_length[-1])
    halves = model.n == 1 or float(model.link_length[0]) > (1.0 + SAME) * last
    return "midsegment" if halves and stub > 0 and abs(stub - last) < SAME * last else "base"


def segments(model: ModelParameters) -> Array:
    """Return, for each of n joints, the length (n,) [m] of the part of the actuator whose bending the joint represents.

    For joints at the base of segments it is the link behind the joint, else half of the links on both sides.
    """
    if joint_placement(model) == "base":
        return np.array(model.link_length)
    joints = model.base_length + np.concatenate([[0.0], np.cumsum(model.link_length)[:-1]])
    borders = np.concatenate([[0.0], 0.5 * (joints[1:] + joints[:-1]), [model.length]])
    return np.diff(borders)


def bending_stiffness(model: ModelParameters) -> Array:
    """Return the bending stiffness EI (n,) [N m^2] of the actuator at each of n joints: joint stiffness times segment
    length.

    EI depends on the assumed `joint_placement`: with few links, fits of the same motion give springs that differ by
    tens of per cent between the two placements. The difference vanishes as the number of links grows.
    """
    return np.asarray(model.stiffness * segments(model))
