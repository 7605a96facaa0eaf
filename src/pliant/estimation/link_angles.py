"""From points along the body to link angles, and the model with the rest shape of the body at hand."""

from __future__ import annotations

import numpy as np

from pliant.errors import InputError
from pliant.model import Model
from pliant.simulation import state

Array = np.ndarray


class LinkAngles:
    """Absolute link angles from points along the body: chords between the points that lie at the model's joints.

    Parameters
    ----------
    model : Model
    arc_length : array (S,)
        Of the points, m, from the origin; increasing.
    """

    def __init__(self, model: Model, arc_length: Array) -> None:
        s = np.asarray(arc_length, dtype=float)
        ends = model.base_length + np.concatenate([[0.0], np.cumsum(model.link_length)])
        if s.ndim != 1 or s.size < 2 or np.any(np.diff(s) <= 0) or s[0] > ends[0] + 1e-3 or s[-1] < ends[-1] - 2e-3:
            raise InputError(
                f"the points must lie along the body at increasing arc lengths that cover {ends[0] * 1e3:.4g} to "
                f"{ends[-1] * 1e3:.4g} mm, got {s.size} from {s.min() * 1e3:.4g} to {s.max() * 1e3:.4g} mm"
            )
        if abs(s[-1] - ends[-1]) < 2e-3:  # links are chords, a little shorter than the arc: the last ends at the tip
            ends = ends * (s[-1] / ends[-1])
        ends = np.clip(ends, s[0], s[-1])
        self._left = np.clip(np.searchsorted(s, ends, side="right") - 1, 0, s.size - 2)
        self._share = ((ends - s[self._left]) / (s[self._left + 1] - s[self._left]))[:, None]
        self._mirror = np.array([model.bend_sign, 1.0])
        self.size = s.size

    @property
    def parts(self) -> tuple[Array, Array, float]:
        """Point before each end of a link (n + 1,), share of the next one (n + 1,), sign of the bend."""
        return self._left.astype(np.int64), self._share[:, 0].copy(), float(self._mirror[0])

    def ends(self, points: Array) -> Array:
        """Ends of the links (n + 1, 2) among points (S, 2), m, before the model's bend sign."""
        return ((1 - self._share) * points[self._left] + self._share * points[self._left + 1]) * self._mirror

    def __call__(self, points: Array) -> Array:
        """Absolute link angles (n,), rad."""
        across = np.diff(self.ends(points), axis=0)
        return np.unwrap(np.arctan2(-across[:, 0], across[:, 1]))


def calibrated(model: Model, arc_length: Array, frames: Array) -> Model:
    """The model with the rest shape of the body at hand: rest angles and link lengths from frames (T, S, 2) at rest.

    Stiffness, damping and torque law stay. Lost frames (NaN) are left out.

    Raises
    ------
    InputError
        When fewer than 5 frames are whole.
    """
    whole = frames[np.isfinite(frames).all(axis=(1, 2))]
    if len(whole) < 5:
        raise InputError(f"a rest shape needs at least 5 whole frames, got {len(whole)} of {len(frames)}")
    mean = whole.mean(axis=0)
    chords = LinkAngles(model, arc_length)
    ends = chords.ends(mean)
    length = np.linalg.norm(np.diff(ends, axis=0), axis=1)
    angle = np.diff(chords(mean), prepend=model.base_angle)
    made = model.with_(link_length=length, rest_angle=angle, stations=())
    return made.with_(rest_angle=angle - state.equilibrium(made)) if made.gravity.any() else made
