"""Quantities that a fit observes: points, orientations and sensor lag, also with complex or dual numbers.

The orientation of a rigid body follows from a link's station and two further points of the link, one metre along it and
one metre aside. They are observed like any point, so that the frame has exact derivatives and passes through the model
of the sensors.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from pliant.equations.observation import kinds_of, row_value
from pliant.equations.spatial_observation import rotation_between, tilt
from pliant.equations.symbols import ObservedChain, Sight
from pliant.errors import InputError
from pliant.identification.follow_loops import Places
from pliant.identification.loop_inputs import ForwardProblem, Numbers
from pliant.mechanics import Mechanics, mechanics_of

Array = np.ndarray
UNTURNED = np.eye(3)
TINY = 1e-20  # imaginary step: its square vanishes beside 1
LAG_STEP = 5e-3  # s, longest interval of the grid on which a lag is integrated
ASKEW = 1e-3  # rad: directions of gravity that differ by more contradict each other
LEAST_LAG = 1e-9  # s: a shorter one is none


class NumberKind(NamedTuple):
    """A number type for the compiled loops (float, complex or dual), with functions that convert floats to it and back,
    and that compile a loop for it.
    """

    of: Callable[[Any], Any]  # converts a float, or an array of floats, to a copy in this kind
    value: Callable[[Any], Any]  # converts back to floats
    twin: Callable[..., Any]  # compiles a kernel for a number of links and extensible segments


def in_kind(record: Any, kind: NumberKind) -> Any:
    """Return a named tuple with all floats and arrays converted to the number type `kind`: float, complex or dual."""
    return type(record)(*(in_kind(e, kind) if isinstance(e, tuple) else kind.of(e) for e in record))


def places_of(forward: ForwardProblem, numbers: Numbers, kind: NumberKind) -> Places:
    """Return where the observed points lie on the links of a chain, in the number type `kind`."""
    chain, shift = mechanics_of(forward.model), kind.of(np.zeros(3))
    shift[: len(numbers.shift)] = numbers.shift
    if chain.dimension == 3:
        parts: tuple[Any, Any] = (numbers.body, in_kind(chain.workspace(), kind))
    else:
        shift[2] = -numbers.reference
        links = kind.of(np.zeros((5, forward.model.n + 1)))
        parts = (ObservedChain(numbers.base_length, numbers.length, numbers.share), links)
    return Places(*parts, forward.carrier, numbers.along, numbers.across, numbers.aside, shift)


def lags_of(own: Mapping[str, float], stations: Sequence[str]) -> Array:
    """Return the time constant (S,) [s] of each station's sensor from the parameter values `own`; empty if none."""
    if not any(name.endswith("sensor_lag") for name in own):
        return np.zeros(0)
    return np.array([own.get(f"{s}.sensor_lag", own.get("sensor_lag", 0.0)) for s in stations])


def between_frames(times: Array) -> tuple[Array, Array]:
    """Return the frame times with further times inserted so that neighbours are at most 5 ms apart, and the indices of
    the frame times in the result.
    """
    parts = np.maximum(np.ceil(np.diff(times) / LAG_STEP - 1e-9), 1).astype(int)
    frames = np.append(0, np.cumsum(parts))
    return np.interp(np.arange(frames[-1] + 1), frames, times), frames


def behind_sensors(rows: Array, between: tuple[Array, Array], lags: Array) -> Array:
    """Return the observations (T, S, 3) of S lagging sensors at T frames, from rows (R, S, 3) at finer times.
    `lags` (S,) [s] are the sensors' time constants.
    """
    times, frames = between
    return np.asarray((lagged(rows, times, lags) if lags.size else rows)[frames])


def lagged(rows: Array, times: Array, lags: Array) -> Array:
    """Return the outputs (R, S, 3) of first-order sensors at S stations with time constants `lags` (S,) [s], for inputs
    `rows` (R, S, 3) at R times. Each sensor starts settled at the first row.

    tau y' = u - y is solved exactly for motions that are linear between two rows. The rows may be complex.
    """
    from scipy.linalg import solve_banded

    out = rows.copy()
    step = np.diff(times)
    for s, lag in enumerate(lags):
        tau: Any = lag if np.real(lag) > LEAST_LAG else LEAST_LAG + lag - np.real(lag)
        fraction = np.exp(-step / tau)
        rise = (1.0 - fraction) * tau / step
        banded = np.ones((2, times.size), dtype=rows.dtype)
        banded[1, :-1] = -fraction
        aim = rows[:, s].copy()
        aim[1:] = (rise - fraction)[:, None] * rows[:-1, s] + (1.0 - rise)[:, None] * rows[1:, s]
        out[:, s] = solve_banded((1, 0), banded, aim)
    return out


def with_axes(places: Array, oriented: Array) -> Array:
    """Return link coordinates (3, S + 2 m) of the observed points: S stations, and two auxiliary points on axes of each
    of the m links whose orientation is observed.
    """
    ends = places[:, oriented]
    ahead, aside = np.array([[1.0], [0.0], [0.0]]), np.array([[0.0], [0.0], [1.0]])
    return np.concatenate([places, ends + ahead, ends + aside], axis=1)


def repeated(values: Array, oriented: Array) -> Array:
    """Return the `values` (S,) of S stations, followed twice by those of the m stations whose orientation is observed:
    (S + 2 m,). The repeated values are for two auxiliary points on axes of each such station's link.
    """
    return np.concatenate([values, values[oriented], values[oriented]])


def frames_of(rows: Array, oriented: Array) -> Array:
    """Return the rotation matrices (..., T, m, 3, 3) of m links in T frames, from positions (..., T, S + 2 m, 3) of S
    stations and of two auxiliary points on axes of each link.
    """
    m = len(oriented)
    start, ahead, aside = rows[..., oriented, :], rows[..., -2 * m : -m, :], rows[..., -m:, :]
    z = unit(ahead - start)
    x = aside - start
    x = unit(x - np.sum(x * z, axis=-1, keepdims=True) * z)
    return np.stack([x, np.cross(z, x), z], axis=-1)


def unit(v: Array) -> Array:
    """Return vectors (..., 3) divided by their lengths; their components may be complex."""
    return np.asarray(v / np.sqrt(np.sum(v * v, axis=-1, keepdims=True)))


def turns_off(rows: Array, oriented: Array, measured: Array, framed: Array | None = None) -> Array:
    """Return rotation vectors (..., T, m, 3) [rad] from the measured to the modelled orientation of m stations in T
    frames. Both orientations are taken relative to the first frame.

    `measured` (T, m, 3, 3) holds rotation matrices in the axes of the base frame. The vectors are in the axes of the
    measured body. `framed` are the stations with auxiliary points in `rows`, if more than the m `oriented` ones.
    """
    framed = oriented if framed is None else framed
    frames = frames_of(rows, framed)[..., np.isin(framed, oriented), :, :]
    turned = frames @ np.swapaxes(frames[..., :1, :, :, :], -1, -2)
    return rotation_vectors(np.swapaxes(measured, -1, -2), np.swapaxes(turned, -1, -2))


def three_of(values: Sequence[Array]) -> Array:
    """Return up to three arrays (...) as (..., 3), of which the missing ones are NaN."""
    return np.stack([*values, *[np.full(values[0].shape, np.nan)] * (3 - len(values))], axis=-1)


def modelled_rows(rows: Array, variable: str, constants: Array, *, planar: bool) -> Array:
    """Return modelled values (..., T, S, 3) of a variable of recordings in `equations.observation.KINDS`, which has up
    to three kinds of rows, followed by NaN.

    They are computed from coordinates `rows` (..., T, S or more, 3) of S observed points in T frames: x, y, angle in
    the plane, x, y, z in space. `constants` (S, k) are those of the variable at each station. The angle of the station
    before, 0 before the first, stands for the angle of the link before. In space, angle, axes and rotation vector of a
    link follow from two auxiliary points for each station; they are NaN if `rows` has none.
    """
    sight = sight_of(rows, len(constants), planar=planar)
    return three_of([row_value(kind, sight, constants.T) for kind in kinds_of(variable, 2 if planar else 3)])


def check_direction(who: str, constants: Array, gravity: Array) -> None:
    """Raise InputError if a recorded direction of gravity in the base frame (S, d) is not that of the model's `gravity`
    (d,) [m/s^2]. A model without gravity, whose weight has no effect, has any direction.
    """
    strength = float(np.linalg.norm(gravity))
    if strength and (np.linalg.norm(constants - gravity / strength, axis=1) > ASKEW).any():
        stated, toward = (", ".join(f"{g:.3g}" for g in vector) for vector in (constants[0], gravity / strength))
        raise InputError(f"{who} states that gravity points along ({stated}) in the base frame, but the gravity of the "
                         f"model points along ({toward}): correct down in the mapping of the recording, or gravity")


def points_at(chain: Mechanics, x: Array) -> Array:
    """Return the coordinates (S or 3 S, 3) of the S stations of a chain at coordinates x (N,), as `modelled_rows` takes
    them: x, y, angle in the plane; in space x, y, z, followed by those of two auxiliary points for each station.
    """
    place, angle = chain.stations(x)
    if chain.dimension == 2:
        return np.column_stack([place, angle])
    frames = chain.link_frames(x)[[p.link + 1 for p in chain.model.points]]
    return np.concatenate([place, place + frames[:, :, 2], place + frames[:, :, 0]])


def sight_of(rows: Array, count: int, *, planar: bool) -> Sight:
    """Return what rows of a measurement may depend on, for `count` stations, as arrays behind the components."""
    p = np.moveaxis(rows[..., :count, :], -1, 0)
    none = np.full((3, *p.shape[1:]), np.nan)
    place, angle, turn, axes = p, none[0], none, np.full((3, *none.shape), np.nan)
    if planar:
        place, angle, zero = np.stack([*p[:2], none[0]]), p[2], 0.0 * p[2]
        axes = np.stack([[np.cos(angle), -np.sin(angle), zero], [np.sin(angle), np.cos(angle), zero], [zero] * 3])
    elif rows.shape[-2] == 3 * count:
        frames = frames_of(rows, np.arange(count))
        angle, turn = tilt(np.moveaxis(frames[..., 2], -1, 0)), np.moveaxis(rotation_vectors(frames), -1, 0)
        axes = np.moveaxis(frames, (-2, -1), (0, 1))
    angles = np.stack([angle, np.concatenate([np.zeros_like(angle[..., :1]), angle[..., :-1]], axis=-1)])
    return Sight(none, none, place, angles, turn, none, axes)


def slopes_through(function: Callable[[Array], Array], rows: Array, derivatives: Array) -> Array:
    """Return the derivatives (P, T, m, 3) with respect to P parameters of ``function(rows)`` (T, m, 3), by complex
    steps. `derivatives` (P, T, S, 3) are those of the modelled positions and angles `rows` (T, S, 3).
    """
    return np.asarray(function(rows + 1j * TINY * derivatives).imag / TINY)


def rotation_vectors(E: Array, R: Array = UNTURNED) -> Array:
    """Return the rotation vectors (..., 3) [rad] of rotation matrices E (..., 3, 3), or of the products E R^T with
    rotation matrices R (..., 3, 3). All may be complex.
    """
    end, start = (np.moveaxis(M, (-2, -1), (0, 1)) for M in (E, R))
    vectors = np.empty((3, *np.broadcast_shapes(end.shape[2:], start.shape[2:])), dtype=np.result_type(end, start))
    rotation_between(end, start, vectors)
    return np.moveaxis(vectors, 0, -1)
