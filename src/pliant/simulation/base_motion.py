"""Prescribed motion of the base, as an input of a simulation or a fit: recorded poses, and their smooth derivatives."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Literal, NamedTuple

import numpy as np

from pliant.compiler.choose import twin
from pliant.equations import base
from pliant.errors import InputError
from pliant.mechanics import Mechanics, mechanics_of
from pliant.mechanics.reaction import point_carried
from pliant.model import Model
from pliant.preprocessing.rotations import continuous, to_matrix
from pliant.shapes import Float
from pliant.simulation import state

Array = np.ndarray
LEAST_POSES = 6  # of a quintic spline


class BaseStates(NamedTuple):
    """Pose, velocity and acceleration of a base at T instants, in the axes of the base frame at rest."""

    position: Array  # (T, d) m
    axes: Array  # (T, d, d), the axes of the moved base frame as columns
    velocity: Array  # (T, d) m/s
    acceleration: Array  # (T, d) m/s^2
    angle: Array  # (T,) rad about +z in the plane; no entries in space
    rate: Array  # (T,) rad/s in the plane, (T, 3) in space
    turning: Array  # (T,) rad/s^2 in the plane, (T, 3) in space


@dataclass(frozen=True)
class BaseMotion:
    """Prescribed motion of the base of a body, such as one on the arm of a robot: its poses over time.

    Velocity and acceleration of the base are those of a spline through, or near, the poses. In the plane it is one of
    x, y and the angle, in space of x, y, z and the four components of the quaternions.

    Parameters
    ----------
    time : array (T,)
        Times of the poses, s, on the clock of the simulation, strictly increasing.
    position : array (T, 2), in space (T, 3)
        Position of the base frame's origin, m, in the axes of the base frame at rest. NaN marks an unknown pose.
    angle : array (T,), optional
        In the plane: angle of the base frame about +z, rad. Default: 0.
    quaternion : array (T, 4), optional
        In space: unit quaternions x, y, z, w of the base frame's rotation. Default: no rotation.
    cutoff : float, "auto" or None
        None: a spline of fifth degree through all poses, for poses without noise. A frequency in Hz: a cubic smoothing
        spline that passes half of a motion of this frequency, and all of much slower ones; its acceleration is 0 at
        both ends. "auto": the same, with a smoothness that follows from the data by generalised cross-validation.

    Attributes
    ----------
    gaps : int
        Number of poses that are unknown; the spline bridges them.

    Raises
    ------
    InputError
        When shapes do not match, times do not increase, or too few poses are known.
    """

    time: Float[Array, " T"]
    position: Float[Array, "T d"]
    angle: Float[Array, " T"] | None = None
    quaternion: Float[Array, "T 4"] | None = None
    cutoff: float | Literal["auto"] | None = None
    gaps: int = field(init=False, default=0)

    def __post_init__(self) -> None:
        time, position = (np.array(a, dtype=float) for a in (self.time, self.position))
        if time.ndim != 1 or position.ndim != 2 or position.shape not in ((time.size, 2), (time.size, 3)):
            raise InputError("a base motion needs positions (time, 2), or (time, 3) in space, with one row for each "
                             f"time, got shapes {position.shape} and {time.shape}")
        flat = position.shape[1] == 2
        stated, other = (self.angle, self.quaternion) if flat else (self.quaternion, self.angle)
        if other is not None:
            raise InputError("a base motion in the plane has an angle, and one in space a quaternion: give this one")
        rest: Any = 0.0 if flat else [0.0, 0.0, 0.0, 1.0]
        shape = (time.size,) if flat else (time.size, 4)
        turn = np.broadcast_to(rest, shape).copy() if stated is None else np.array(stated, dtype=float)
        if turn.shape != shape:
            raise InputError(f"the {'angle' if flat else 'quaternion'} of a base motion must have the shape {shape}, "
                             f"got {turn.shape}")
        rows = np.column_stack([time, position, turn])
        if np.isinf(rows).any() or np.isnan(time).any() or np.any(np.diff(time) <= 0):
            raise InputError("the times of a base motion must be finite and increase strictly, and no pose may be "
                             "infinite: remove the other rows")
        known = ~np.isnan(rows).any(axis=1)
        if known.sum() < LEAST_POSES:
            raise InputError(f"a base motion needs at least {LEAST_POSES} known poses, got {int(known.sum())} of "
                             f"{known.size}")
        if not (self.cutoff is None or self.cutoff == "auto" or (isinstance(self.cutoff, int | float)
                                                                 and 0 < self.cutoff < np.inf)):
            raise InputError(f"the cutoff of a base motion must be a frequency in Hz, 'auto' or None, got "
                             f"{self.cutoff!r:.60}")
        for name, value in (("time", time[known]), ("position", position[known]), ("gaps", int((~known).sum())),
                            ("angle" if flat else "quaternion", unbroken(turn[known]))):  # fmt: skip
            object.__setattr__(self, name, value)

    @property
    def dimension(self) -> int:
        """Dimension of the space in which the base moves, 2 or 3."""
        return int(self.position.shape[1])

    @property
    def turn(self) -> Array:
        """The angles (T, 1) [rad] or the quaternions (T, 4) of the base."""
        return self.angle[:, None] if self.angle is not None else np.asarray(self.quaternion)

    def mirrored(self) -> BaseMotion:
        """Return a motion in the plane turned by pi about the base tangent: x and the angle change their signs."""
        return replace(self, position=self.position * [-1.0, 1.0], angle=-self.turn[:, 0])

    @cached_property
    def curve(self) -> Any:
        """The spline through or near the poses: a function of time and of the order of its derivative."""
        return spline(self.time, np.column_stack([self.position, self.turn]), self.cutoff)

    def at(self, times: Float[Array, " K"]) -> BaseStates:
        """Return pose, velocity and acceleration of the base at K instants.

        Raises
        ------
        InputError
            When an instant is before the first or after the last known pose.
        """
        times = np.asarray(times, dtype=float)
        slack = 1e-9 * (1.0 + np.abs(self.time[[0, -1]]).max())
        if times.min() < self.time[0] - slack or times.max() > self.time[-1] + slack:
            raise InputError(f"the motion of the base is known from {self.time[0]:.6g} to {self.time[-1]:.6g} s, but "
                             f"is needed from {times.min():.6g} to {times.max():.6g} s: give poses for the whole time, "
                             "or simulate a part of it")
        times = np.clip(times, self.time[0], self.time[-1])
        d = self.dimension
        value, slope, bend = (self.curve(times, order) for order in range(3))
        placed = value[:, :d], slope[:, :d], bend[:, :d]
        if d == 2:
            angle = value[:, 2]
            c, s = np.cos(angle), np.sin(angle)
            axes = np.moveaxis(np.array([[c, -s], [s, c]]), -1, 0)
            return BaseStates(placed[0], axes, placed[1], placed[2], angle, slope[:, 2], bend[:, 2])
        axes, rate, turning = turns_of(value[:, d:], slope[:, d:], bend[:, d:])
        return BaseStates(placed[0], axes, placed[1], placed[2], np.zeros(0), rate, turning)

    def summary(self) -> str:
        """Return a sentence on how the velocity and the acceleration of the base were derived, for a report."""
        states = self.at(self.time)
        apart = 1e3 * float(np.sqrt(np.mean(np.sum((states.position - self.position) ** 2, axis=1))))
        fastest = (float(np.linalg.norm(np.reshape(a, (len(self.time), -1)), axis=1).max())
                   for a in (states.acceleration, states.rate))
        bridged = f", {self.gaps} unknown ones bridged" if self.gaps else ""
        how = "a spline of fifth degree through them" if self.cutoff is None else (
            "a cubic smoothing spline (generalised cross-validation)" if self.cutoff == "auto" else
            f"a cubic smoothing spline that passes half of {self.cutoff:g} Hz")  # fmt: skip
        return (f"the motion of the base is an input: {self.time.size} poses{bridged}; velocity and acceleration are "
                f"those of {how}, {apart:.2g} mm rms from the poses, with up to {next(fastest):.3g} m/s^2 and "
                f"{next(fastest):.3g} rad/s")


def unbroken(turn: Array) -> Array:
    """Return angles (T,) without jumps by a full turn, or unit quaternions (T, 4) without changes of sign."""
    if turn.ndim == 1:
        return np.unwrap(turn)
    norm = np.linalg.norm(turn, axis=1, keepdims=True)
    if (np.abs(norm - 1.0) > 1e-3).any():
        raise InputError("the quaternions of a base motion must have length 1: normalise them")
    return np.asarray(continuous((turn / norm)[:, None])[0][:, 0])


def turns_of(q: Array, slope: Array, bend: Array) -> tuple[Array, Array, Array]:
    """Return axes (T, 3, 3), angular velocity [rad/s] and angular acceleration [rad/s^2] (T, 3) from quaternions q (T,
    4) of any length and their first and second derivatives by time.

    omega = 2 Im(q' q*) / |q|^2, and its derivative by time.
    """
    square = np.sum(q * q, axis=1, keepdims=True)
    rate = 2.0 * turned_part(slope, q) / square
    turning = 2.0 * turned_part(bend, q) / square - rate * (2.0 * np.sum(q * slope, axis=1, keepdims=True) / square)
    return to_matrix(q / np.sqrt(square)), rate, turning


def turned_part(p: Array, q: Array) -> Array:
    """Return the vector part (T, 3) of the products p q* of quaternions (T, 4), x, y, z, w."""
    return np.asarray(q[:, 3:] * p[:, :3] - p[:, 3:] * q[:, :3] - np.cross(p[:, :3], q[:, :3]))


def spline(time: Array, rows: Array, cutoff: float | str | None) -> Any:
    """Return a spline through or near the rows (T, k) at T times, see `BaseMotion`: a function of time and order."""
    from scipy.interpolate import make_interp_spline, make_smoothing_spline

    if cutoff is None:
        return make_interp_spline(time, rows, k=5)
    lam = None
    if not isinstance(cutoff, str):
        spacing = float(np.ptp(time)) / (time.size - 1)
        lam = 1.0 / (spacing * (2.0 * np.pi * cutoff) ** 4)
    moves = [np.ptp(column) > 0.0 for column in rows.T]
    curves = [make_smoothing_spline(time, column, lam=lam) if moved else None
              for column, moved in zip(rows.T, moves, strict=True)]  # fmt: skip

    def curve(times: Array, order: int) -> Array:
        still = [np.full(times.size, column[0] if order == 0 else 0.0) for column in rows.T]
        return np.column_stack([still[k] if c is None else c(times, order) for k, c in enumerate(curves)])

    return curve


def base_rows(chain: Mechanics, motion: BaseMotion, nodes: Array) -> tuple[Array, Array]:
    """Return the motion of the base in each of m time steps between `nodes` (m + 1,) [s], (m, 5) or in space (m, 6) as
    `equations.base` takes it, and the loads on the links [N m] by which it acts beside this, see `base_fields`.
    """
    rows, fields = base_fields(chain, motion, nodes)
    return rows, chain.uniform_loads(fields - chain.model.gravity)


def base_fields(chain: Mechanics, motion: BaseMotion, nodes: Array) -> tuple[Array, Array]:
    """Return the motion of the base in each of m time steps between `nodes` (m + 1,) [s], (m, 5) or in space (m, 6) as
    `equations.base` takes it, and the field (m, 2 or 3) [m/s^2] that acts in place of gravity.

    The field is gravity less the mean acceleration of the origin: in the plane in the axes of the base at the start of
    a step, in space in those at its middle.
    """
    ends, h = motion.at(nodes), np.diff(nodes)
    gravity = chain.model.gravity
    if chain.dimension == 3:
        middle = motion.at(0.5 * (nodes[:-1] + nodes[1:]))
        mean = np.diff(ends.velocity, axis=0) / h[:, None]
        rows = np.concatenate([inward(middle.axes, middle.rate), inward(middle.axes, middle.turning)], axis=1)
        return rows, inward(middle.axes, gravity - mean)
    arm = np.einsum("tij,j->ti", ends.axes, point_carried(chain))
    velocity = ends.velocity + ends.rate[:, None] * np.stack([-arm[:, 1], arm[:, 0]], axis=1)
    mean, turn = np.diff(velocity, axis=0) / h[:, None], np.diff(ends.angle)
    rows = np.column_stack([turn / h, np.diff(ends.rate) / h, ends.rate[:-1], ends.rate[1:], turn])
    return rows, inward(ends.axes[:-1], gravity - mean)


def resting_load(chain: Mechanics, motion: BaseMotion, time: float) -> Array:
    """Return the loads [N m] on the links of a body at rest on a base that rests in its pose at `time` [s]."""
    gravity = chain.model.gravity
    return np.asarray(chain.uniform_loads(inward(motion.at(np.array([time])).axes, gravity) - gravity)[0])


def inward(axes: Array, vectors: Array) -> Array:
    """Return vectors (T, d) or (d,) in the axes (T, d, d) of the base, given in those of the base at rest."""
    return np.einsum("tji,tj->ti", axes, np.broadcast_to(vectors, axes.shape[:2]))


def check_base(model: Model, motion: BaseMotion) -> None:
    """Raise InputError unless `motion` is a motion of the base in the plane or the space in which the model moves."""
    if not isinstance(motion, BaseMotion):
        raise InputError(f"base must be a BaseMotion, with times and poses of the base, got {motion!r:.60}")
    needed = mechanics_of(model).dimension
    if motion.dimension != needed:
        where = "space" if needed == 3 else "a plane"
        raise InputError(f"model {model.name!r} moves in {where}, but the motion of its base has {motion.dimension} "
                         f"coordinates: give {needed}")


class BaseSteps:
    """Time steps of a body on a base that moves as prescribed, made one by one.

    Attributes
    ----------
    model : Model
        The model, with a moving base.
    chain : Mechanics
        Its mechanics, with arrays of its own for the spin of the base.
    motion : BaseMotion
    """

    def __init__(self, model: Model, motion: BaseMotion) -> None:
        check_base(model, motion)
        self.model, self.motion = model.with_(moving_base=True), motion
        self.chain = mechanics_of(self.model).with_own_base()
        self._begin, self._end = (twin(kernel, *self.chain.sizes) for kernel in (base.begin_step, base.end_step))

    def rest(self, pressure: Any, time: float) -> Array:
        """Return the joint coordinates (N,) in equilibrium under inputs (C,) on the base at rest in its pose at `time`
        [s].
        """
        return state.equilibrium(self.model, pressure, link_load=resting_load(self.chain, self.motion, time))

    def advance(self, step: Callable[[], int], row: Array, x: Array, v: Array) -> int:
        """Take one time step by calling ``step()``, while the base moves as the `row` of `base_fields` says, at
        coordinates x and rates v (N,), which change in place. Return what `step` returns.
        """
        self._begin(row, v, self.chain.body, self.chain.joints)
        failed = step()
        self._end(row, x, v, self.chain.body, self.chain.joints)
        return failed
