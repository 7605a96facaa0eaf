"""Compute the curvature of a body [1/m] over arc length and time from the positions of its stations.

The method "basis" is the most accurate: kappa(s) = sum_j c_j b_j(s) is integrated to positions and fitted to the points
by Gauss-Newton. The method "savgol" differentiates the points by a Savitzky-Golay filter and is faster.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from pliant.errors import InputError
from pliant.numerics.spline import NOT_A_KNOT, spline_matrix
from pliant.preprocessing.arc_length import station_arc_length, whole_frames
from pliant.preprocessing.curvature_fit import fit_curvature

if TYPE_CHECKING:
    import xarray as xr
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

METHODS = ("basis", "savgol", "spline")
UNEVEN = 0.01  # largest relative deviation of the spacing for a Savitzky-Golay filter
POLYNOMIAL = 4


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
            "resample along arc length first, or use method='basis'"
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
    found = []
    for slope in (power * x ** np.maximum(power - 1, 0), power * (power - 1) * x ** np.maximum(power - 2, 0)):
        rows = np.zeros((stations, stations))
        np.put_along_axis(rows, middle[:, None] + near, slope @ fit, axis=1)
        found.append(rows)
    return found[0] / (half * spacing), found[1] / (half * spacing) ** 2
