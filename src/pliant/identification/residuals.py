"""Residuals of a model against the observed values of an experiment, with their weights."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from pliant.equations.observation import FURTHER, KINDS
from pliant.identification.experiment import Experiment
from pliant.identification.observation import rotation_vectors, slopes_through, three_of, turns_off
from pliant.identification.prediction import further_rows, referenced_angles
from pliant.preprocessing.detectors import quantum, white_noise

Array = np.ndarray
WEIGHTINGS = ("travel", "metre", "noise", "decay")
LEAST_MOTION = 0.05  # of the peak displacement: frames with less motion to come weigh alike
MOVES = 100.0  # sum of squares of the values of a recording, over that of its noise, above which they show a motion
AT_END = 5  # frames that show where a motion ends


class Observations:
    """Observed positions and angles of one experiment, with the weight of each residual in a fit.

    Attributes
    ----------
    data : array (T, S, 3)
        x [m], y [m], angle [rad]. In space x, y, z [m], and after the S stations a row of zeros [rad] for each station
        with an orientation: the target of the rotation vector from the measured to the modelled orientation. NaN where
        nothing was seen.
    seen : array (T, S, 3) of bool
        Whether `data` holds an observation.
    weight : array (S, 3)
        Weights of the residuals of each station.
    frame_weight : array (T,)
        Weights of the residuals of each frame.
    """

    def __init__(self, exp: Experiment, weighting: str) -> None:
        angle = np.full(exp.position.shape[:2], np.nan) if exp.angle is None else exp.angle
        self.exp, self.planar = exp, exp.dimension == 2
        position = np.full_like(exp.position, np.nan) if exp.angles_alone else exp.position
        self.take(np.concatenate([position, angle[..., None]], axis=2) if self.planar else position)
        self.first = {"": 0, "angle": 0}  # first of the S columns of `data` that hold a variable compared alone
        self.more: list[Callable[[Array], Array]] = []  # modelled values of kinds beside positions and angles
        self.unknown: list[tuple[int, tuple[int, ...]]] = []  # their rows and channels whose noise level is not given
        swing = largest_change(exp.angle)
        stations = np.ones(len(exp.stations)) if weighting == "noise" else length_weights(exp)
        scale = {"metre": (1.0, swing / exp.travel), "noise": (1.0, 1.0)}.get(weighting, (exp.travel, swing))
        self.frame_weight = decay_weights(exp) if weighting == "decay" else np.ones(exp.time.size)
        self.weight = np.sqrt(stations)[:, None] / np.array([scale[0], scale[0], scale[self.planar]])
        if weighting == "noise":
            self.weight /= noise_levels(exp, self.data)
        if exp.orientation is not None:
            self.add_orientations(exp.orientation[:, exp.oriented], stations[exp.oriented], weighting)
        for name, rows in exp.further.items():
            swing = exp.travel if KINDS[FURTHER[name]].unit == "m" else largest_change(rows.values)
            values = three_of([*np.moveaxis(rows.compared, -1, 0)])
            self.first |= {name: self.data.shape[1]}
            weight = self.weights(values, swing, stations, rows.noise, weighting)
            of = partial(further_rows, name=name, recorded=rows, planar=self.planar)
            self.add(values, weight, of, noise_known=rows.noise is not None)

    def add_orientations(self, quaternion: Array, share: Array, weighting: str) -> None:
        """Add the orientations of m stations in T frames, as quaternions (T, m, 4), to the observed values. `share`
        (m,) holds the weights of the stations.
        """
        turn, measured = measured_turns(quaternion)
        vectors = np.where(measured[..., None], rotation_vectors(turn), np.nan)
        known = self.exp.orientation_noise
        swing = max(float(np.nanmax(np.linalg.norm(vectors, axis=2))), 1e-9)
        off = partial(turns_off, oriented=self.exp.oriented, measured=turn, framed=self.exp.framed)
        weight = self.weights(vectors, swing, share, known, weighting)
        self.add(0.0 * vectors, weight, off, noise_known=known is not None)

    def weights(self, values: Array, swing: float, share: Array, noise: float | None, weighting: str) -> Array:
        """Return the weights (m, 3) of m values (T, m, 3) of another kind in T frames, whose largest change is `swing`.
        `share` (m,) holds the weights of their stations, `noise` their standard deviation if it is known.
        """
        scale = {"metre": swing / self.exp.travel, "noise": 1.0}.get(weighting, swing)
        weight = np.repeat(np.sqrt(share)[:, None], 3, axis=1) / scale
        return weight / (white_noise(values) if noise is None else noise) if weighting == "noise" else weight

    def add(self, values: Array, weight: Array, modelled: Callable[[Array], Array], *, noise_known: bool) -> None:
        """Add m values (T, m, 3) of another kind in T frames, with their weights (m, 3).

        ``modelled(rows)`` returns what the model says of them, (..., T, m, 3), from the positions and angles (..., T,
        S, 3) of S observed points. Its derivatives are those of complex steps, so that it must take complex numbers.
        """
        first = self.data.shape[1]
        self.take(np.concatenate([self.data, values], axis=1))
        self.weight = np.concatenate([self.weight, weight])
        self.more.append(modelled)
        self.unknown += [] if noise_known else [(first + i, (0, 1, 2)) for i in range(values.shape[1])]

    def take(self, data: Array) -> None:
        """Set the observed values (T, S, 3), NaN where nothing was seen, and the indices of those that were seen. The
        warm-up of the experiment is left out.
        """
        data = np.where(self.exp.warming[:, None, None], np.nan, data)
        self.data, self.seen = data, np.isfinite(data)
        self.rows, self.station, self.channel = np.nonzero(self.seen)

    @property
    def count(self) -> int:
        """Return the number of observed values, N."""
        return int(self.rows.size)

    @property
    def flat_weight(self) -> Array:
        """Return the weights (N,) of all N observed values."""
        return self.weight[self.station, self.channel] * self.frame_weight[self.rows]

    @property
    def is_compared(self) -> Array:
        """Return whether each of N observed values (N,) is one of `Experiment.compared`."""
        first = self.first[self.exp.alone]
        mine = (self.station >= first) & (self.station < first + len(self.exp.stations))
        return mine & ((self.channel == 2) == (self.exp.alone == "angle")) if self.planar and not first else mine

    @property
    def motion(self) -> float:
        """Return the sum of squared residuals of a body that stands still in the mean of its observed positions and
        angles; inf where a recording shows no motion above its noise, or settled poses, or values of further kinds.
        """
        if self.more or self.exp.poses:
            return float("inf")
        middle = np.nan_to_num(self.data).sum(axis=0) / np.maximum(self.seen.sum(axis=0), 1)
        away = (self.data - middle)[self.seen] * self.flat_weight
        noise = white_noise(self.data)[self.station, self.channel] * self.flat_weight
        still = float(np.sum(away**2))
        return still if still > MOVES * float(np.sum(noise**2)) else float("inf")

    def residual(self, rows: Array) -> Array:
        """Return the N weighted residuals (N,): modelled positions and angles (T, S, 3) of S stations in T frames,
        minus the N observed values.
        """
        off: Array = self.modelled(rows)[self.seen] - self.data[self.seen]
        turn = (self.channel == 2) & self.planar
        off[turn] = (off[turn] + np.pi) % (2 * np.pi) - np.pi
        return off * self.flat_weight

    def slopes(self, derivatives: Array, rows: Array | None = None) -> Array:
        """Return the derivatives (P, N) of N weighted residuals with respect to P parameters, from those of the
        positions and angles of S stations in T frames, (P, T, S, 3).

        If there are values of further kinds (`more`), `rows` (T, S, 3) themselves are needed too.
        """
        return self.modelled(derivatives, rows)[:, self.seen] * self.flat_weight

    def unknown_noise(self) -> list[tuple[int, tuple[int, ...]]]:
        """Return the stations and channels (x, y, angle) whose noise level was not given, so that it is estimated."""
        exp = self.exp
        axes: tuple[int, ...] = (0, 1) if self.planar else (0, 1, 2)
        unknown = [(s, axes) for s, name in enumerate(exp.stations) if name not in exp.noise]
        if self.planar and exp.angle_noise is None:
            unknown += [(s, (2,)) for s in range(len(exp.stations))]
        return unknown + self.unknown

    def modelled(self, rows: Array, about: Array | None = None) -> Array:
        """Return modelled positions and angles in the form of the observed ones. Angles are measured from the
        recording's reference. An orientation is returned as the rotation vector [rad] from the measured one.
        """
        own = rows
        if self.exp.angle is not None:
            own = np.concatenate([rows[..., :2], referenced_angles(self.exp, rows)[..., None]], axis=-1)
        if not self.more:
            return own
        # `about`: the rows themselves, if `rows` are their derivatives
        more = [of(rows) if about is None else slopes_through(of, about, rows) for of in self.more]
        return np.concatenate([own[..., : len(self.exp.stations), :], *more], axis=-2)


def measured_turns(quaternion: Array) -> tuple[Array, Array]:
    """Return rotation matrices (T, m, 3, 3) of the quaternions (T, m, 4) of m stations in T frames, and a mask (T, m)
    of those that are not missing.
    """
    from scipy.spatial.transform import Rotation

    complete = np.isfinite(quaternion).all(axis=2)
    whole = np.where(complete[..., None], quaternion, [0.0, 0.0, 0.0, 1.0])
    return Rotation.from_quat(whole.reshape(-1, 4)).as_matrix().reshape(*complete.shape, 3, 3), complete


def decay_weights(exp: Experiment) -> Array:
    """Return weights (T,) of T frames that are inversely proportional to the motion still to come, with mean square 1.

    The motion still to come is the largest distance of any station from its last position, in this or a later frame. At
    least `LEAST_MOTION` of the largest value is assumed.
    """
    positions = exp.compared
    last = [column[np.isfinite(column).all(axis=1)][-AT_END:].mean(axis=0) for column in np.swapaxes(positions, 0, 1)]
    away = np.nan_to_num(np.linalg.norm(positions - np.array(last), axis=2)).max(axis=1)
    to_come = np.maximum.accumulate(away[::-1])[::-1]
    weight = 1.0 / (to_come + LEAST_MOTION * to_come[0])
    frames = np.isfinite(positions).any(axis=(1, 2))
    return np.asarray(weight / np.sqrt(np.mean(weight[frames] ** 2)))


def largest_change(values: Array | None) -> float:
    """Return the largest change of any of S values (T, S) over T frames; 1 if there are none."""
    if values is None:
        return 1.0
    return float(max(np.nanmax(np.nanmax(values, axis=0) - np.nanmin(values, axis=0)), 1e-9))


def length_weights(exp: Experiment) -> Array:
    """Return weights (S,) of the stations in proportion to the body length that each represents, of mean 1.
    Without arc lengths all weights are 1.
    """
    if exp.arc_length is None:
        return np.ones(len(exp.stations))
    edges = np.concatenate([exp.arc_length[:1], 0.5 * (exp.arc_length[1:] + exp.arc_length[:-1]), exp.arc_length[-1:]])
    share = np.diff(edges)
    return share / share.mean()


def noise_levels(exp: Experiment, data: Array) -> Array:
    """Return the noise standard deviation (S, 3) of x, y [m] and angle [rad], in space of x, y, z [m], at S stations.
    Where the experiment does not state it, it is estimated from `data`.

    The quantisation of a coarse sensor counts as noise too, uniform over one step.
    """
    noise, known = white_noise(data), np.isfinite(np.diff(data, 2, axis=0)).any(axis=0)
    for s, c in zip(*np.nonzero(known), strict=True):
        noise[s, c] = max(noise[s, c], quantum(data[:, s, c]) / np.sqrt(12.0))
    for k, name in enumerate(exp.stations):
        if name in exp.noise:
            noise[k, :2] = exp.noise[name]
    if exp.dimension == 3:
        noise[:, 2] = [exp.noise.get(name, level) for name, level in zip(exp.stations, noise[:, 2], strict=True)]
    if exp.angle_noise is not None:
        noise[:, 2] = exp.angle_noise
    return noise


def noise_ratio(observed: Observations, residual: Array) -> float:
    """Return the root-mean-square residual of positions and angles over the standard deviation of their noise."""
    exp, stations = observed.exp, len(observed.exp.stations)
    if exp.alone in exp.further:
        mine, first = observed.is_compared, observed.first[exp.alone]
        levels = white_noise(observed.data[:, first : first + stations])
        noise = levels if exp.further[exp.alone].noise is None else np.full_like(levels, exp.further[exp.alone].noise)
    else:
        mine, first, noise = observed.station < stations, 0, noise_levels(exp, observed.data[:, :stations])
    off = (residual / observed.flat_weight)[mine] / noise[observed.station[mine] - first, observed.channel[mine]]
    return float(np.sqrt(np.mean(off**2)))


def correlated_frames(observed: Observations, residual: Array) -> float:
    """Return the correlation length of a residual (N,) in frames: 1 + 2 (sum of its autocorrelations)."""
    return 1.0 + 2.0 * sum(autocorrelations(observed, residual))


def autocorrelations(observed: Observations, residual: Array) -> list[float]:
    """Return the autocorrelation of a residual (N,) at lags of 1, 2, ... frames, up to the first insignificant one."""
    r = np.zeros(observed.seen.shape)
    r[observed.seen] = residual
    return falling_correlations(r.reshape(r.shape[0], -1), 2.0 / np.sqrt(residual.size))


def falling_correlations(r: Array, least: float) -> list[float]:
    """Return the autocorrelation of zero-mean time series (T, C) at lags of 1, 2, ... frames, up to the first value
    below `least`. It is pooled over all C series of T frames.
    """
    power = float(np.sum(r * r))
    correlations: list[float] = []
    if power <= 0 or r.shape[0] < 8:
        return correlations
    for lag in range(1, r.shape[0] // 4):
        rho = float(np.sum(r[lag:] * r[:-lag])) / power
        if rho < least:
            break
        correlations.append(rho)
    return correlations
