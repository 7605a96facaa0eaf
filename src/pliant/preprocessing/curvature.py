"""Compute the curvature of a body [1/m] over arc length and time from the positions of its stations.

The method "basis" is the most accurate: kappa(s) = sum_j c_j b_j(s) is integrated to positions and fitted to the points
by Gauss-Newton. The method "savgol" differentiates the points by a Savitzky-Golay filter and is faster.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from pliant.errors import InputError
from pliant.numerics.spline import NOT_A_KNOT, spline_matrix
from pliant.preprocessing.arc_length import station_arc_length, whole_frames

if TYPE_CHECKING:
    import xarray as xr
    from numpy.typing import NDArray
    Array = NDArray[np.float64]

METHODS = ("basis", "savgol", "spline")
UNEVEN = 0.01  # largest relative deviation of the spacing for a Savitzky-Golay filter
POLYNOMIAL = 4


CHUNK = 64  # frames at a time
ITERATIONS = 12
SETTLED = 1e-9  # convergence: change of the angle per step, rad
GROUPS = 24  # groups of stations, whose means give the initial guess
FINEST = 100  # quadrature intervals along the body, at least
SAMPLE_FRAMES = 20  # for the choice of the smoothing


@dataclass(frozen=True)
class CurvatureFit:
    """Result of `fit_curvature`: the curvature (T, S) [1/m] at S stations over T frames, the settings used, and the
    residual.

    `terms` and `smoothing` are the settings used, `rms_distance` [m] the root-mean-square distance of the fitted curve
    from the points, and `unsettled` the number of frames that did not converge.
    """

    curvature: Array
    terms: int
    smoothing: float
    rms_distance: float
    unsettled: int


def fit_curvature(
    position: Array, s: Array, *, terms: int | None = None, smoothing: float | None = None
) -> CurvatureFit:
    """Fit the planar curvature over arc length, sum_j c_j P_j(s) with Legendre polynomials P_j, to the positions (T, S,
    2) [m] of S stations in each of T frames. A start point and a start angle are fitted too.

    Minimises sum_k |p(s_k) - p_k|^2 + smoothing * int kappa''^2 ds with
    p(s) = p_0 + int (-sin phi, cos phi) ds,  phi(s) = phi_0 + int kappa ds.

    Parameters
    ----------
    position : (T, S, 2) array, m
    s : (S,) array, m
        Arc lengths of the stations.
    terms : int, optional
        Number of basis functions. Default: a quarter of the stations, 4 to 20.
    smoothing : float, m^5, optional
        Default: by generalised cross-validation, which assumes independent noise of the points.

    Returns
    -------
    CurvatureFit
    """
    count = int(np.clip(s.size // 4, 4, 20)) if terms is None else terms
    if not 1 <= count <= 2 * s.size - 4:
        raise InputError(f"terms must be between 1 and {2 * s.size - 4}, not {count}")
    if smoothing is not None and smoothing < 0:
        raise InputError(f"smoothing must not be negative, but is {smoothing}")
    model = _Model(s, count)
    weight = model.cross_validated(position) if smoothing is None else smoothing
    curvature = np.empty(position.shape[:2])
    squared, unsettled = 0.0, 0
    for start in range(0, len(position), CHUNK):
        rows = slice(start, start + CHUNK)
        parameters, distance, moving = model.solve(position[rows], weight)
        curvature[rows] = parameters[:, 3:] @ model.basis.T
        squared += float(np.square(distance).sum())
        unsettled += moving
    rms = float(np.sqrt(squared / curvature.size))
    return CurvatureFit(curvature, count, weight, rms, unsettled)


class _Model:
    """Positions as a function of (x_0, y_0, phi_0, c), by quadrature with two Gauss points per interval."""

    def __init__(self, s: Array, terms: int) -> None:
        length = float(s[-1])
        self.s = s
        self.basis = legendre_basis(s, length, terms)
        self.station_integrals = legendre_integrals(s, length, terms)
        fold = int(np.ceil(FINEST / (s.size - 1)))
        grid = np.interp(np.arange((s.size - 1) * fold + 1) / fold, np.arange(s.size), s)
        half = np.diff(grid) / 2
        gauss = (grid[:-1] + half)[:, None] + half[:, None] * np.array([-1.0, 1.0]) / np.sqrt(3.0)
        self.points_per_station = 2 * fold
        self.weights = np.repeat(half, 2)
        self.integrals = legendre_integrals(gauss.ravel(), length, terms)
        self.turns = np.concatenate((np.ones((gauss.size, 1)), self.integrals), axis=1)  # by phi_0 and c
        self.roughness = np.zeros((terms + 3, terms + 3))
        self.roughness[3:, 3:] = legendre_roughness(length, terms)

    def start(self, position: Array) -> Array:
        """Return initial parameters (T, 3 + m) of the curvature fit for T frames: start point x, y [m], start angle
        [rad] and m coefficients. They follow from a linear fit to the directions of chords.

        Chords between neighbouring stations would be too short for the noise of dense stations.
        """
        group = np.arange(self.s.size) * min(GROUPS, self.s.size) // self.s.size
        mean = (group[None, :] == np.arange(group[-1] + 1)[:, None]).astype(float)
        mean /= mean.sum(axis=1, keepdims=True)
        chord = np.diff(np.matmul(mean, position), axis=1)
        angle = np.unwrap(np.arctan2(-chord[..., 0], chord[..., 1]), axis=1)
        centre = mean @ self.station_integrals
        design = np.concatenate((np.ones((len(centre) - 1, 1)), (centre[1:] + centre[:-1]) / 2), axis=1)
        ridge = 1e-6 * np.eye(design.shape[1]) * np.square(design).sum(axis=0).max()
        fitted = np.linalg.solve(design.T @ design + ridge, design.T @ angle.T).T
        return np.concatenate((position[:, 0], fitted), axis=1)

    def linearised(self, parameters: Array, position: Array) -> tuple[Array, Array]:
        """Return the residual (T, 2 S) [m] of fitted minus measured positions (S of x, then S of y, in T frames), and
        its Jacobian (T, 2 S, 3 + m) with respect to the 3 + m parameters.
        """
        frames, stations = position.shape[:2]
        tangent = parameters[:, 2:3] + parameters[:, 3:] @ self.integrals.T
        c, w = np.cos(tangent) * self.weights, np.sin(tangent) * self.weights
        jacobian = np.zeros((frames, 2, stations, parameters.shape[1]))
        residual = parameters[:, :2, None] - position.transpose(0, 2, 1)
        for axis, ahead, normal in ((0, -w, -c), (1, c, -w)):
            residual[:, axis, 1:] += self._sums(ahead, self.turns[:, :1])[..., 0]
            jacobian[:, axis, :, axis] = 1.0
            jacobian[:, axis, 1:, 2:] = self._sums(normal, self.turns)
        return residual.reshape(frames, -1), jacobian.reshape(frames, 2 * stations, -1)

    def solve(self, position: Array, smoothing: float) -> tuple[Array, Array, int]:
        """Fit the curve in T frames: return its parameters (T, 3 + m) (start point, start angle, m coefficients), the
        distances (T, S) [m] from S stations, and the number of frames that did not converge.
        """
        parameters = self.start(position)
        penalty = smoothing * self.roughness
        scale = np.abs(self.station_integrals).max(axis=0)
        moving = np.ones(len(position), dtype=bool)
        for _ in range(ITERATIONS):
            residual, jacobian = self.linearised(parameters[moving], position[moving])
            transposed = jacobian.transpose(0, 2, 1)
            gradient = np.matmul(transposed, residual[..., None]) + penalty @ parameters[moving][..., None]
            step = np.linalg.solve(np.matmul(transposed, jacobian) + penalty, gradient)[..., 0]
            parameters[moving] -= step
            size = np.abs(step[:, 2]) + np.abs(step[:, 3:]) @ scale
            moving[moving] = size > SETTLED
            if not moving.any():
                break
        residual, _ = self.linearised(parameters, position)
        distance = np.hypot(*residual.reshape(len(position), 2, -1).transpose(1, 0, 2))
        return parameters, distance, int(moving.sum())

    def cross_validated(self, position: Array) -> float:
        """Return the weight [m^5] of the smoothing that has the lowest score in a generalised cross-validation, from
        positions (T, S, 2) [m] of S stations over T frames.
        """
        sample = position[np.unique(np.linspace(0, len(position) - 1, SAMPLE_FRAMES).astype(int))]
        values = 2 * self.s.size
        _, jacobian = self.linearised(self.start(sample), sample)
        normal = np.matmul(jacobian.transpose(0, 2, 1), jacobian).mean(axis=0)
        ratio = np.trace(normal[3:, 3:]) / np.trace(self.roughness) if self.roughness.any() else 0.0
        best, best_score = 0.0, np.inf
        for smoothing in ratio * 10.0 ** np.arange(-8.0, 3.0, 0.5):
            _, distance, _ = self.solve(sample, float(smoothing))
            trace = float(np.trace(np.linalg.solve(normal + smoothing * self.roughness, normal)))
            score = float(np.square(distance).sum()) / (1 - trace / values) ** 2
            if score < best_score:
                best, best_score = float(smoothing), score
        return best

    def _sums(self, values: Array, columns: Array) -> Array:
        """Return running integrals (T, S - 1, m) at all stations but the first: values (T, G) times columns (G, m)."""
        many = self.points_per_station
        cells = values[:, ::many, None] * columns[::many]
        for k in range(1, many):
            cells += values[:, k::many, None] * columns[k::many]
        return np.cumsum(cells, axis=1, out=cells)


def legendre_basis(s: Array, length: float, terms: int) -> Array:
    """Return the first `terms` Legendre polynomials at S arc lengths `s` [m] of a body, as columns (S, terms), with the
    body mapped to -1 ... 1.
    """
    return np.asarray(np.polynomial.legendre.legvander(2.0 * s / length - 1.0, terms - 1), dtype=np.float64)


def legendre_integrals(s: Array, length: float, terms: int) -> Array:
    """Return the integrals from 0 to S arc lengths `s` [m] of the first `terms` Legendre polynomials along a body, as
    columns (S, terms).

    int P_j dx = (P_{j+1} - P_{j-1}) / (2 j + 1), which vanishes at x = -1 for j > 0
    """
    values = np.polynomial.legendre.legvander(2.0 * s / length - 1.0, terms)
    integrals = np.empty((s.size, terms))
    integrals[:, 0] = s
    degree = np.arange(1, terms)
    integrals[:, 1:] = (values[:, 2:] - values[:, :-2]) / (2 * degree + 1) * length / 2
    return integrals


def legendre_roughness(length: float, terms: int) -> Array:
    """Return the matrix R (terms, terms) for which c^T R c is the integral of f''(s)^2 along the body, where f = sum_j
    c_j P_j in Legendre polynomials P_j.
    """
    x, w = np.polynomial.legendre.leggauss(terms)
    second = np.polynomial.legendre.legder(np.eye(terms), 2, axis=0) if terms > 2 else np.zeros((1, terms))
    values = np.polynomial.legendre.legval(x, second).T * (2.0 / length) ** 2
    return values.T @ (values * (w * length / 2)[:, None])


def curvature_of(
    recording: xr.Dataset,
    *,
    method: str = "basis",
    terms: int | None = None,
    smoothing: float | None = None,
    window: int = 51,
) -> xr.DataArray:
    """Compute the curvature [1/m] of a body over time and arc length from the positions in a recording.

    Parameters
    ----------
    recording : xarray.Dataset
        Positions along one body. Planar recordings give signed curvature (positive about +z). Three-dimensional
        ones give its magnitude, by the methods "savgol" and "spline" only.
    method : {"basis", "savgol", "spline"}
        Least-squares curvature basis; Savitzky-Golay derivatives (evenly spaced stations); or the cubic spline through
        the stations, which follows their noise.
    terms : int, optional
        Number of basis functions; default a quarter of the stations, 4 to 20.
    smoothing : float, m^5, optional
        Weight of int kappa''(s)^2 ds against the sum of squared distances (m^2). Default: by generalised
        cross-validation on a few frames.
    window : int
        Samples of the Savitzky-Golay filter, odd.

    Returns
    -------
    xarray.DataArray
        Curvature (time, arc_length), 1/m. Attributes hold the method, the number of frames left out for missing
        stations and, for the basis, the root-mean-square distance of the fit from the points.

    Raises
    ------
    InputError
        When the method does not suit the recording or an option is invalid.
    """
    import xarray as xr

    if method not in METHODS:
        raise InputError(f"method must be one of {', '.join(METHODS)}, not {method!r}")
    position, time, dropped = whole_frames(recording)
    s, notes = station_arc_length(recording, position)
    attrs = {"units": "1/m", "long_name": "curvature", "method": method, "frames_left_out": dropped}
    if method == "savgol":
        kappa = savgol_curvature(position, s, window)
        attrs["window"] = window
    elif method == "spline":
        rows = (spline_matrix(s, s, NOT_A_KNOT, derivative)[0] for derivative in (1, 2))
        kappa = turning(*(row @ (position - position[:, :1]) for row in rows))
    else:
        if position.shape[2] != 2:
            raise InputError("the curvature basis needs a planar recording: align it first, or use method='savgol' or "
                             "'spline'")  # fmt: skip
        fit = fit_curvature(position, s, terms=terms, smoothing=smoothing)
        kappa = fit.curvature
        attrs |= {"terms": fit.terms, "smoothing_m5": fit.smoothing, "rms_distance_m": fit.rms_distance}
        if fit.unsettled:
            attrs["frames_not_converged"] = fit.unsettled
    attrs["notes"] = "\n".join(notes)
    coords = {
        "time": ("time", time, {"units": "s", "long_name": "time on the clock of the shape"}),
        "arc_length": ("arc_length", s, {"units": "m", "long_name": "arc length from the base"}),
    }
    return xr.DataArray(kappa, coords, ("time", "arc_length"), name="curvature", attrs=attrs)


def savgol_curvature(position: Array, s: Array, window: int = 51) -> Array:
    """Compute the curvature (T, S) [1/m] at S evenly spaced stations over T frames by Savitzky-Golay filters of
    polynomial order 4, from their positions (T, S, d) [m] in d dimensions.

    kappa = (x' y'' - y' x'') / (x'^2 + y'^2)^(3/2); in three dimensions |r' x r''| / |r'|^3

    Raises
    ------
    InputError
        When the stations are unevenly spaced or fewer than the window.
    """
    if window % 2 == 0 or not POLYNOMIAL < window <= s.size:
        raise InputError(f"window must be odd, above {POLYNOMIAL} and at most {s.size} stations, not {window}")
    spacing = np.diff(s)
    uneven = float(np.abs(spacing / spacing.mean() - 1).max())
    if uneven > UNEVEN:
        raise InputError(
            f"Savitzky-Golay needs evenly spaced stations, but the spacing deviates by {100 * uneven:.1f} %: "
            "use method='basis'"
        )
    near = position - position[:, s.size // 2, None]  # a constant offset does not matter, but would cost digits
    return turning(*(rows @ near for rows in differences(s.size, window, float(spacing.mean()))))


def turning(first: Array, second: Array) -> Array:
    """Return the curvature (T, S) [1/m] from the first and second derivatives (T, S, d) of a position by arc length,
    for S stations over T frames. It has a sign in the plane (d = 2), none in space (d = 3).
    """
    if first.shape[2] == 2:
        across = first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0]
    else:
        across = np.linalg.norm(np.cross(first, second), axis=2)
    return across / np.linalg.norm(first, axis=2) ** 3


def differences(stations: int, window: int, spacing: float) -> tuple[Array, Array]:
    """Return two matrices (S, S) that map values at S evenly spaced stations to their first [1/m] and second [1/m^2]
    derivative by arc length.

    The derivatives are those of the polynomial that best fits the `window` stations about each one. Near the ends the
    last whole window is used. SciPy's own function takes 0.4 s to import.

    Source: Savitzky, Golay, Analytical Chemistry 36(8), 1964
    """
    half = window // 2
    near, power = np.arange(-half, half + 1), np.arange(POLYNOMIAL + 1)
    fit = np.linalg.pinv((near[:, None] / half) ** power)
    middle = np.clip(np.arange(stations), half, stations - 1 - half)
    x = (np.arange(stations) - middle)[:, None] / half
    notes = []
    for slope in (power * x ** np.maximum(power - 1, 0), power * (power - 1) * x ** np.maximum(power - 2, 0)):
        rows = np.zeros((stations, stations))
        np.put_along_axis(rows, middle[:, None] + near, slope @ fit, axis=1)
        notes.append(rows)
    return notes[0] / (half * spacing), notes[1] / (half * spacing) ** 2
