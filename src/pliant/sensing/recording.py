"""Convert a recording of the strain in a multicore fibre to a recording of positions along the fibre, with their
uncertainty.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from pliant.errors import InputError
from pliant.numerics.curve import spatial_curve
from pliant.recording.inputs import input_arguments
from pliant.recording.schema import check_holds, history_of, make_recording
from pliant.sensing.strain import CoreLayout, curvature_from_strain

if TYPE_CHECKING:
    import xarray as xr
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

def shape_from_strain(
    recording: xr.Dataset, layout: CoreLayout, *, common_mode: str = "least-squares", bridge: int = 0,
    sigma_strain: float | None = None,
) -> xr.Dataset:
    """Compute the shape of a multicore fibre from a recording of its strain, and return a recording of positions in
    space.

    Parameters
    ----------
    recording : xarray.Dataset
        A recording with strain (time, core, gauge) relative to the straight fibre.
    layout : CoreLayout
        One entry for each core of the recording, in its order.
    common_mode : {"least-squares", "centre"}
        How the strain common to all cores is determined; see `curvature_from_strain`.
    bridge : int
        Largest number of neighbouring missing gauges that are interpolated; they are counted in the history. Beyond a
        longer gap the shape is unknown and positions are NaN.
    sigma_strain : float, optional
        Standard deviation of the strain of one core and gauge. Default: from the residual of the strain model, where
        there are more cores than unknowns.

    Returns
    -------
    xarray.Dataset
        Recording in frame "tracker", with the first gauge at the origin and the tangent there along +y. Inputs are
        kept. Where the noise is known, the attribute `tip_sigma_m` holds the standard deviation of the last point of a
        straight fibre.

    Raises
    ------
    InputError
        When there is no strain, or the layout does not match the cores.
    """
    check_holds(recording, "strain", "shape_from_strain", "read a file with the strain of the cores")
    if bridge < 0:
        raise InputError(f"bridge must be 0 or a positive number of gauges, not {bridge}")
    s = recording["gauge_position"].values
    strain, filled, lost = _bridged(recording["strain"].values, s, bridge)
    state = curvature_from_strain(strain, s, layout, common_mode=common_mode)
    points, _ = spatial_curve(state.curvature, s)
    sigma = sigma_strain if sigma_strain is not None else _estimated_noise(state.residual, layout, state.sees_twist)
    attrs = {}
    if sigma is not None:
        spacing = float(np.diff(s).mean())
        attrs["tip_sigma_m"] = tip_sigma(sigma * state.curvature_gain, spacing, float(s[-1] - s[0]))
    twist = "measured" if state.sees_twist else "not measured by this layout, assumed zero"
    counted = f"{filled} missing strain value(s) interpolated, {lost} frame(s) unknown beyond a gap"
    history = [
        *history_of(recording),
        f"shape from strain: {layout.radius.size} cores, common mode by {common_mode}, twist {twist}; {counted}",
    ]
    attributes = {k: v for k, v in recording.attrs.items() if k in ("source", "source_format", "source_sha256")}
    nominal = recording.attrs.get("nominal_pressure")
    return make_recording(
        recording["time"].values, points, arc_length=s - s[0], history=history, attrs=attrs,
        nominal_pressure=nominal, **attributes, **input_arguments(recording),
    )  # fmt: skip


def _bridged(strain: Array, s: Array, bridge: int) -> tuple[Array, int, int]:
    """Return the strain with short gaps interpolated, the number of filled values, and of frames that keep a gap."""
    missing = np.isnan(strain)
    if not missing.any():
        return strain, 0, 0
    strain, filled = strain.copy(), 0
    for t, c in np.argwhere(missing.any(axis=2)):
        row = missing[t, c]
        edges = np.flatnonzero(np.diff(np.concatenate(([0], row.astype(int), [0]))))
        for start, stop in edges.reshape(-1, 2):
            if start > 0 and stop < row.size and stop - start <= bridge:
                ends = [start - 1, stop]
                strain[t, c, start:stop] = np.interp(s[start:stop], s[ends], strain[t, c, ends])
                filled += int(stop - start)
    return strain, filled, int(np.isnan(strain).any(axis=(1, 2)).sum())


def _estimated_noise(residual: Array, layout: CoreLayout, sees_twist: bool) -> float | None:
    spare = layout.radius.size - (4 if sees_twist else 3)
    if spare < 1:
        return None
    return float(np.sqrt(np.nanmean(np.square(residual)) * layout.radius.size / spare))


def tip_sigma(sigma_curvature: float, spacing: float, length: float) -> float:
    """Return the standard deviation [m] that errors of the measured curvature cause in the tip position of a straight
    fibre, across its axis.

    sigma_tip = sigma_kappa sqrt(ds L^3 / 3), for independent errors of the curvature samples

    Parameters
    ----------
    sigma_curvature : float, 1/m
        Standard deviation of one curvature sample.
    spacing, length : float, m
        Distance between samples, and length of the fibre.
    """
    return float(sigma_curvature * np.sqrt(spacing * length**3 / 3))
