"""What an experiment observed, laid out as the compiled loop shows it, and the weight of every number."""

from __future__ import annotations

import numpy as np

from pliant.identification.experiment import Experiment
from pliant.identification.prediction import turned
from pliant.preprocessing.detectors import quantum

Array = np.ndarray
WEIGHTINGS = ("travel", "metre", "noise")
LEAST_NOISE = 1e-9  # m and rad: recordings without noise keep finite weights


class Observations:
    """Seen positions and angles of one experiment, with weights.

    Attributes
    ----------
    data : array (T, S, 3)
        x [m], y [m], angle [rad]; in space x, y, z [m]. NaN where nothing was seen.
    seen : array (T, S, 3) of bool
    weight : array (S, 3)
        Of the residuals.
    """

    def __init__(self, exp: Experiment, weighting: str) -> None:
        angle = np.full(exp.position.shape[:2], np.nan) if exp.angle is None else exp.angle
        self.exp, self.planar = exp, exp.dimension == 2
        position = np.full_like(exp.position, np.nan) if exp.angles_alone else exp.position
        self.data = np.concatenate([position, angle[..., None]], axis=2) if self.planar else position
        self.seen = np.isfinite(self.data)
        self.rows, self.station, self.channel = np.nonzero(self.seen)
        swing = angle_travel(exp)
        stations = np.ones(len(exp.stations)) if weighting == "noise" else length_weights(exp)
        scale = {"travel": (exp.travel, swing), "metre": (1.0, swing / exp.travel), "noise": (1.0, 1.0)}[weighting]
        self.weight = np.sqrt(stations)[:, None] / np.array([scale[0], scale[0], scale[self.planar]])
        if weighting == "noise":
            self.weight /= noise_levels(exp, self.data)

    @property
    def count(self) -> int:
        """Numbers that were seen."""
        return int(self.rows.size)

    @property
    def flat_weight(self) -> Array:
        """Weight of each seen number."""
        return self.weight[self.station, self.channel]

    def residual(self, rows: Array) -> Array:
        """Weighted differences of what is modelled, rows (T, S, 3), and seen; angles by the shorter way round."""
        off: Array = self.modelled(rows)[self.seen] - self.data[self.seen]
        turn = (self.channel == 2) & self.planar
        off[turn] = (off[turn] + np.pi) % (2 * np.pi) - np.pi
        return off * self.flat_weight

    def slopes(self, derivatives: Array) -> Array:
        """Derivatives (P, N) of the residual from those of the rows, (P, T, S, 3)."""
        return self.modelled(derivatives)[:, self.seen] * self.flat_weight

    def modelled(self, rows: Array) -> Array:
        """Rows with the angles measured as they were observed."""
        if self.exp.angle is None:
            return rows
        return np.concatenate([rows[..., :2], turned(self.exp, rows)[..., None]], axis=-1)


def angle_travel(exp: Experiment) -> float:
    """Largest change of an observed angle, rad; 1 where none was observed."""
    if exp.angle is None:
        return 1.0
    return float(max(np.nanmax(np.nanmax(exp.angle, axis=0) - np.nanmin(exp.angle, axis=0)), 1e-9))


def length_weights(exp: Experiment) -> Array:
    """Weight (S,) of each station, of mean 1: the length of body that it stands for, or the same for all."""
    if exp.arc_length is None:
        return np.ones(len(exp.stations))
    edges = np.concatenate([exp.arc_length[:1], 0.5 * (exp.arc_length[1:] + exp.arc_length[:-1]), exp.arc_length[-1:]])
    share = np.diff(edges)
    return share / share.mean()


def noise_levels(exp: Experiment, data: Array) -> Array:
    """Standard deviation (S, 3) of the noise: as given, or from second differences in time, which motion hardly has.

    The steps of a sensor that counts in coarse ones are noise too, spread evenly over a step.
    """
    bend = np.diff(data, 2, axis=0)
    noise: Array = np.full(data.shape[1:], 1.0)
    for s in range(len(exp.stations)):
        for c in range(3):
            found = bend[np.isfinite(bend[:, s, c]), s, c]
            if found.size:
                noise[s, c] = max(float(np.median(np.abs(found))) / 0.6745 / np.sqrt(6.0), LEAST_NOISE)
            noise[s, c] = max(noise[s, c], quantum(data[:, s, c]) / np.sqrt(12.0)) if found.size else 1.0
    for k, name in enumerate(exp.stations):
        if name in exp.noise:
            noise[k, :2] = exp.noise[name]
    if exp.dimension == 3:
        noise[:, 2] = [exp.noise.get(name, level) for name, level in zip(exp.stations, noise[:, 2], strict=True)]
    if exp.angle_noise is not None:
        noise[:, 2] = exp.angle_noise
    return noise


def correlated_frames(observed: Observations, residual: Array) -> float:
    """Frames that a residual is correlated over: 1 + 2 (sum of its autocorrelations), 1 for white noise."""
    return 1.0 + 2.0 * sum(autocorrelations(observed, residual))


def autocorrelations(observed: Observations, residual: Array) -> list[float]:
    """Autocorrelation of a residual at lags of 1, 2, ... frames, over all its channels, while it is significant."""
    r = np.zeros(observed.seen.shape)
    r[observed.seen] = residual
    return falling_correlations(r.reshape(r.shape[0], -1), 2.0 / np.sqrt(residual.size))


def falling_correlations(r: Array, least: float) -> list[float]:
    """Autocorrelation of channels (T, C) of mean zero at lags of 1, 2, ... frames, until it falls below `least`."""
    power = float(np.sum(r * r))
    found: list[float] = []
    if power <= 0 or r.shape[0] < 8:
        return found
    for lag in range(1, r.shape[0] // 4):
        rho = float(np.sum(r[lag:] * r[:-lag])) / power
        if rho < least:
            break
        found.append(rho)
    return found
