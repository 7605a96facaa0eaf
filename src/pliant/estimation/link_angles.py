"""Link angles from points along a planar body, and a model with the body's measured rest shape."""

from __future__ import annotations

import numpy as np

from pliant.compiler.choose import twin
from pliant.equations.observation import JOINT
from pliant.errors import InputError
from pliant.estimation import kalman_loops
from pliant.estimation.contract import Frame
from pliant.estimation.measurement import rows_of
from pliant.mechanics import mechanics_of
from pliant.model import Model, fixed_length
from pliant.model.features import IN_SPACE, LENGTHENS, RESTING, Consumer
from pliant.simulation import state

Array = np.ndarray
LINK_ANGLES = Consumer("LinkAngles", RESTING - IN_SPACE - LENGTHENS)
WHOLE = 5  # least number of frames for a rest shape


class LinkAngles:
    """Angles of the links of a planar chain, computed from points (such as markers) along the body.

    Parameters
    ----------
    model : Model
    arc_length : array (S,)
        Arc lengths of the points, m, from the origin; increasing.
    noise : float
        Standard deviation of the angle between two links in one frame, rad.

    Attributes
    ----------
    rows : array (n, 4)
        The quantities that the values of `frame` measure: the angle of each link relative to the one before.
    """

    def __init__(self, model: Model, arc_length: Array, noise: float = 2e-3) -> None:
        fixed_length(model)
        ends = model.base_length + np.concatenate([[0.0], np.cumsum(model.link_length)])
        s = covering(arc_length, ends, 1e-3)
        if not (np.isfinite(noise) and noise > 0):
            raise InputError(f"the noise of an angle must be positive, in rad, got {noise}")
        if abs(s[-1] - ends[-1]) < 2e-3:  # links are chords, a little shorter than the arc: the last ends at the tip
            ends = ends * (s[-1] / ends[-1])
        self._left, self._share = neighbours(s, np.clip(ends, s[0], s[-1]))
        self._ends = self._left.astype(np.int64), self._share[:, 0].copy()
        self._values, self._size = twin(kalman_loops.joint_values), s.size
        self.rows, self._variance = joint_rows(model), np.full(model.n, noise**2)

    def ends(self, points: Array) -> Array:
        """Return the ends of the n links (n + 1, 2) [m], base first, interpolated between S points of the body (S, 2)
        [m].
        """
        return (1 - self._share) * points[self._left] + self._share * points[self._left + 1]

    def __call__(self, points: Array) -> Array:
        """Return the absolute link angles (n,) [rad] of points (S, 2) [m]."""
        across = np.diff(self.ends(points), axis=0)
        return np.unwrap(np.arctan2(-across[:, 0], across[:, 1]))

    def frame(self, points: Array) -> Frame:
        """Return the angles between links as a `Frame` for an estimator, from S points (S, 2) [m]; NaN if a point is
        lost.

        Angles between links have independent errors, absolute ones do not.

        Raises
        ------
        InputError
            When the number of points is not S.
        """
        if points.shape != (self._size, 2):
            raise InputError(f"a shape must have {self._size} points in the plane, (x, y) each, got {points.shape}")
        values = np.empty(len(self._variance))
        self._values(points, self._ends, values)
        return Frame(self.rows, values, self._variance)


def covering(arc_length: Array, places: Array, slack: float = 0.0) -> Array:
    """Return the arc lengths (S,) [m] of S points as an array; raise InputError unless they increase and cover the
    arc lengths `places` [m], but for `slack` [m] at the beginning and 2 mm at the end.
    """
    s = np.asarray(arc_length, dtype=float)
    if s.ndim != 1 or s.size < 2 or np.any(np.diff(s) <= 0) or s[0] > places[0] + slack or s[-1] < places[-1] - 2e-3:
        raise InputError(
            f"the points must lie along the body at increasing arc lengths that cover {places[0] * 1e3:.4g} to "
            f"{places[-1] * 1e3:.4g} mm, got {s.size} points from {s.min() * 1e3:.4g} to {s.max() * 1e3:.4g} mm"
        )
    return s


def neighbours(s: Array, places: Array) -> tuple[Array, Array]:
    """Return for each of K arc lengths `places` [m] the index (K,) of the point before it, of the points at the arc
    lengths `s` [m], and the weight (K, 1) of the point after it.
    """
    left = np.clip(np.searchsorted(s, places, side="right") - 1, 0, s.size - 2)
    return left, ((places - s[left]) / (s[left + 1] - s[left]))[:, None]


def complete(frames: Array) -> Array:
    """Return the frames without lost points, of T frames of S points (T, S, 2 or 3) [m]; raise InputError if there are
    fewer than 5.
    """
    whole = frames[np.isfinite(frames).all(axis=(1, 2))]
    if len(whole) < WHOLE:
        raise InputError(
            f"a rest shape needs at least {WHOLE} complete frames, got {len(whole)} of {len(frames)}: record the body "
            "at rest for longer, with all points in view"
        )
    return whole


def joint_rows(model: Model) -> Array:
    """Return rows (n, 4) that define n measured quantities for an estimator: the angle of each link relative to the
    link before it, and of the first link relative to +y.
    """
    return np.array([(JOINT, i, 0.0, 0.0) for i in range(model.n)], dtype=float)


def needs_joint_rows(model: Model, rows: Array, who: str) -> Array:
    """Return `rows` if they state that the measured values are the angles between links, else raise InputError. `who`
    names the estimator that needs these angles.

    Raises
    ------
    InputError
        When a frame holds other quantities.
    """
    if rows.shape != (model.n, 4) or not np.array_equal(rows[:, :2], joint_rows(model)[:, :2]):
        raise InputError(
            f"{who} needs {model.n} rows, each for the angle of a link relative to the one before, as "
            f"LinkAngles.frame returns them, but got {len(rows)} rows of other quantities: use KalmanFilter, which "
            "accepts any"
        )
    return rows


def calibrated(model: Model, arc_length: Array, frames: Array) -> Model:
    """Return the model with rest angles and link lengths measured on the actual body at rest, from T frames of S points
    along it (T, S, 2) [m].

    `arc_length` (S,) [m] gives the positions of the points along the body. Stiffness, damping and torque law stay. Lost
    frames (NaN) are ignored.

    Raises
    ------
    InputError
        When fewer than 5 frames are complete.
    """
    mean = complete(frames).mean(axis=0)
    link_angles = LinkAngles(model, arc_length)
    ends = link_angles.ends(mean)
    length = np.linalg.norm(np.diff(ends, axis=0), axis=1)
    angle = np.diff(link_angles(mean), prepend=model.base_angle)
    fitted = model.with_(link_length=length, rest_angle=angle, stations=())
    return fitted.with_(rest_angle=angle - state.equilibrium(fitted)) if fitted.gravity.any() else fitted


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
        fitted = mechanics_of(fitted).with_rest_shape(bend, shape)
    return fitted, LinkTips(fitted, arc_length, max(float(tips.std(axis=0).mean()), 1e-5))
