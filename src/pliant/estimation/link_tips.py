"""Link tips from markers on an extensible or spatial body, and a model with the body's measured rest shape."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pliant.errors import InputError
from pliant.estimation.contract import Frame
from pliant.estimation.link_angles import complete, covering, neighbours
from pliant.estimation.measurement import rows_of
from pliant.mechanics import mechanics_of
from pliant.mechanics.spatial import SpatialChain, rotation
from pliant.model import Model, Space
from pliant.simulation import state

Array = np.ndarray
TURNS = 12  # iterations: the rotation of joints by weight depends on the rest angles, and these on it


class LinkTips:
    """Computes the positions of the link tips from material points along the body, such as markers.

    A tip lies between its two neighbouring points, divided in the same ratio as on the unstretched body.

    Parameters
    ----------
    model : Model
        May be extensible or spatial.
    arc_length : array (S,)
        Arc lengths of the points along the unstretched body, m, from the origin; increasing.
    noise : float
        Standard deviation of each coordinate of a tip in one frame, m.

    Attributes
    ----------
    rows : array (2 n, 4), (3 n, 5) in space
        The quantities that the values of `frame` measure: x and y, and z in space, of each tip.
    """

    def __init__(self, model: Model, arc_length: Array, noise: float = 3e-4) -> None:
        tips = model.base_length + np.cumsum(model.link_length)
        s = covering(arc_length, tips)
        self._left, self._share = neighbours(s, tips)
        self._shape = s.size, mechanics_of(model).dimension
        self.rows = rows_of(model, model.with_(stations=()).points)
        self._variance = np.full(len(self.rows), noise**2)

    def tips(self, points: Array) -> Array:
        """Return the tips (..., n, 2) [m] of n links from positions (..., S, 2) [m] of S points along the body. In
        space the last axis has length 3.
        """
        near, far = points[..., self._left, :], points[..., self._left + 1, :]
        return np.asarray((1.0 - self._share) * near + self._share * far)

    def frame(self, points: Array) -> Frame:
        """Return the link tips at one instant as a `Frame` for an estimator, from marker positions (S, 2) or (S, 3)
        [m]. The tips are NaN if a marker is lost.

        Raises
        ------
        InputError
            When the number of points or axes is wrong.
        """
        if points.shape != self._shape:
            size, axes = self._shape
            raise InputError(f"a shape must have {size} points, ({', '.join('xyz'[:axes])}) each, got {points.shape}")
        return Frame(self.rows, self.tips(points).ravel(), self._variance)


def with_rest_shape(model: Model, arc_length: Array, frames: Array) -> tuple[Model, LinkTips]:
    """Return the model with the rest shape measured in `frames` of the body at rest, and a `LinkTips` that computes the
    link tips from the body's markers. The noise of the tips is the one measured in these frames.

    Rest angles (in space rest rotations) follow from `frames` (T, S, d) [m] at rest. Lengths, stiffness, damping and
    torque law stay. Lost frames (NaN) are ignored.

    Raises
    ------
    InputError
        When fewer than 5 frames are complete.
    """
    link_tips = LinkTips(model, arc_length)
    tips = link_tips.tips(complete(frames))
    fitted = model
    for _ in range(TURNS):
        bend, shape = state.equilibrium(fitted), tips.mean(axis=0)
        fitted = (with_rest_rotations if model.space else with_rest_angles)(fitted, bend, shape)
    return fitted, LinkTips(fitted, arc_length, max(float(tips.std(axis=0).mean()), 1e-5))


def with_rest_angles(model: Model, bend: Array, tips: Array) -> Model:
    """Return the planar model with new rest angles. With these its n link tips are at `tips` (n, 2) [m] when the joint
    angles [rad] and the strains of S segments are `bend` (n + S,).
    """
    joint = (1.0 + model.stretch_share[0] @ bend[model.n :]) * model.first_joint
    across = np.diff(tips, axis=0, prepend=joint[None])
    angle = np.unwrap(np.arctan2(-across[:, 0], across[:, 1]))
    return model.with_(rest_angle=np.diff(angle, prepend=model.base_angle) - bend[: model.n])


def with_rest_rotations(model: Model, bend: Array, tips: Array) -> Model:
    """Return the spatial model with new rest rotations. With these its n link tips are at `tips` (n, 3) [m] when its N
    joint coordinates are `bend` (N,). Each rest rotation changes as little as possible.

    The tips (n, 3) [m] do not show twist.
    """
    from scipy.spatial.transform import Rotation

    chain, space = SpatialChain(model), model.space or Space()
    R, turns = chain.posed(bend).R, space.rest_of(model.n)
    whole = R[0]
    for k, direction in enumerate(np.diff(tips, axis=0, prepend=chain.nodes(bend)[None, 1])):
        own = R[k].T @ R[k + 1]  # the rest turn, and the joint's turn behind it
        before, after = own[:, 2], whole.T @ (direction / np.linalg.norm(direction))
        axis = np.cross(before, after)
        size = float(np.linalg.norm(axis))
        more = rotation(axis * (np.arctan2(size, before @ after) / size if size else 0.0))
        turns[k] = Rotation.from_matrix(more @ rotation(turns[k])).as_rotvec()
        whole = whole @ more @ own
    return model.with_(space=replace(space, rest_turn=turns))
