"""From points that ride on a body as it lengthens to the tips of its links, and the model with its rest shape."""

from __future__ import annotations

import numpy as np

from pliant.errors import InputError
from pliant.estimation.contract import Frame
from pliant.estimation.measurement import rows_of
from pliant.model import Model
from pliant.simulation import state

Array = np.ndarray
WHOLE = 5  # frames that tell a rest
TURNS = 4  # the weight turns joints by what the rest angles are, and these follow from it


class LinkTips:
    """Places of the link tips from points that stay where they are on the body, such as markers.

    A tip lies between its neighbours among the points in the shares that it has of the unstretched body.

    Parameters
    ----------
    model : Model
        It may lengthen.
    arc_length : array (S,)
        Of the points along the unstretched body, m, from the origin; increasing.
    noise : float
        Standard deviation of each coordinate of a tip in one frame, m.

    Attributes
    ----------
    rows : array (2 n, 4)
        What the values of `frame` see: x and y of each tip.
    """

    def __init__(self, model: Model, arc_length: Array, noise: float = 3e-4) -> None:
        s = np.asarray(arc_length, dtype=float)
        tips = model.base_length + np.cumsum(model.link_length)
        if s.ndim != 1 or s.size < 2 or np.any(np.diff(s) <= 0) or s[0] > tips[0] or s[-1] < tips[-1] - 2e-3:
            raise InputError(
                f"the points must lie along the body at increasing arc lengths that cover {tips[0] * 1e3:.4g} to "
                f"{tips[-1] * 1e3:.4g} mm, got {s.size} from {s.min() * 1e3:.4g} to {s.max() * 1e3:.4g} mm"
            )
        self._left = np.clip(np.searchsorted(s, tips, side="right") - 1, 0, s.size - 2)
        self._share = ((tips - s[self._left]) / (s[self._left + 1] - s[self._left]))[:, None]
        self._size = s.size
        self.rows = rows_of(model, model.with_(stations=()).points)
        self._variance = np.full(2 * model.n, noise**2)

    def tips(self, points: Array) -> Array:
        """Tips of the links (..., n, 2) among points (..., S, 2), m."""
        near, far = points[..., self._left, :], points[..., self._left + 1, :]
        return np.asarray((1.0 - self._share) * near + self._share * far)

    def frame(self, points: Array) -> Frame:
        """What estimators take of points (S, 2) [m]; NaN where one is lost. InputError for other than S points."""
        if points.shape != (self._size, 2):
            raise InputError(f"a shape has {self._size} points in the plane, (x, y) each, got {points.shape}")
        return Frame(self.rows, self.tips(points).ravel(), self._variance)


def rested(model: Model, arc_length: Array, frames: Array) -> tuple[Model, LinkTips]:
    """The model with the rest angles of the body at hand, and what its frames are measured by, with the noise at rest.

    Lengths, stiffness, damping and law stay. Lost frames (NaN) are left out.

    Raises
    ------
    InputError
        When fewer than 5 frames are whole.
    """
    places = LinkTips(model, arc_length)
    seen = places.tips(frames[np.isfinite(frames).all(axis=(1, 2))])
    if len(seen) < WHOLE:
        raise InputError(f"a rest shape needs at least {WHOLE} whole frames, got {len(seen)} of {len(frames)}")
    made = model
    for _ in range(TURNS):
        loose = state.equilibrium(made)
        joint = (1.0 + made.stretch_share[0] @ loose[made.n :]) * made.first_joint
        across = np.diff(seen.mean(axis=0), axis=0, prepend=joint[None])
        angle = np.unwrap(np.arctan2(-across[:, 0], across[:, 1]))
        made = model.with_(rest_angle=np.diff(angle, prepend=model.base_angle) - loose[: model.n])
    return made, LinkTips(made, arc_length, max(float(seen.std(axis=0).mean()), 1e-5))
