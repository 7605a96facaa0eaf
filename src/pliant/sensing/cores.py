"""The shape of a body from the strain of a multicore fibre: of a recording of strain, or of the files of its cores."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from pydantic import Field

from pliant.errors import InputError, clipped
from pliant.numerics.curve import spatial_curve
from pliant.recording import read
from pliant.recording.inputs import input_arguments
from pliant.recording.luna import combine_cores
from pliant.recording.mapping import FileMapping, options_of
from pliant.recording.schema import append_history, check_holds, history_of, make_recording
from pliant.sensing.strain import CoreLayout, curvature_from_strain

if TYPE_CHECKING:
    from collections.abc import Mapping

    import xarray as xr
    from numpy.typing import NDArray

    Array = NDArray[np.float64]


class Cores(FileMapping):
    """Options that describe the cores of a multicore fibre: their positions in the cross-section, and the files that
    hold their strain.
    """

    radius_um: float = Field(gt=0, description="distance of the outer cores from the axis of the fibre")
    outer: int = Field(3, ge=2, description="number of outer cores, evenly spread")
    centre: bool = Field(True, description="whether a centre core comes first")
    first_angle_deg: float = Field(0.0, description="angle of the first outer core")
    pitch_mm: float | None = Field(
        None, description="length of one turn of a spun fibre, positive for a right-handed helix; none: straight cores")
    common_mode: Literal["least-squares", "centre"] = Field("least-squares", description=(
        "how the strain that all cores share is found: by least squares, or from the centre core"))
    bridge: int = Field(0, ge=0, description=(
        "largest number of neighbouring gauges without a value that are interpolated (and counted)"))
    files: tuple[str, ...] = Field((), description=(
        "parts of the file names, the first in the name of the file that is given; none: one file holds all cores"))

    def layout(self) -> CoreLayout:
        """Return the positions of the cores in the cross-section of the fibre as a `CoreLayout`."""
        return CoreLayout.symmetric(
            self.outer, 1e-6 * self.radius_um, centre=self.centre, first_angle=np.radians(self.first_angle_deg),
            pitch=None if self.pitch_mm is None else 1e-3 * self.pitch_mm,
        )

    def paths(self, path: Path) -> list[Path]:
        """Return the paths of the files of all cores. `path` is the file of the first core; the others have the same
        name, with the part that stands for the core replaced.
        """
        if not self.files:
            return [path]
        first = self.files[0]
        if path.name.count(first) != 1:
            raise InputError(f"the first of cores.files, {clipped(first)!r}, must occur once in the name of the file, "
                             f"{path.name}: read the file of the first core, or correct cores.files")  # fmt: skip
        return [path.with_name(path.name.replace(first, part)) for part in self.files]


def read_shape(path: str | Path, mapping: Mapping[str, Any] | None = None, *, format: str | None = None) -> xr.Dataset:  # noqa: A002
    """Read a recording from a file, as `pliant.read` does. The strain of a multicore fibre is converted to its shape.

    Parameters
    ----------
    path : str or Path
        File; where each core has a file of its own, that of the first core.
    mapping : dict, optional
        See `pliant.read`. Its table `cores` has the entries of `Cores`; without it strain stays strain.
    format : str, optional
        See `pliant.read`.

    Returns
    -------
    xarray.Dataset
        Recording; a shape from strain is in frame "tracker", with its first gauge at the origin.

    Raises
    ------
    InputError
        When a file cannot be read, or the table `cores` does not fit what it holds.

    See Also
    --------
    pliant.sensing.shape_from_strain
    """
    path = Path(path)
    mapping = options_of(path, mapping) if hasattr(mapping, "items") else mapping
    if mapping is None or "cores" not in mapping:
        return read(path, mapping=mapping, format=format)
    table = mapping["cores"]
    if not isinstance(table, dict):
        raise InputError(f"cores of the mapping of {path.name} must be a table, such as {{ radius_um = 35 }}")
    cores = Cores.load(table, path.name, "cores in the mapping of")
    rest = {key: value for key, value in mapping.items() if key != "cores"}
    files = cores.paths(path)
    recordings = [read(file, mapping=rest or None, format=format) for file in files]
    for file, recording in zip(files, recordings, strict=True):
        if "strain" not in recording:
            raise InputError(f"{file.name} holds no strain, but its mapping describes the cores of a fibre: "
                             "leave cores out")  # fmt: skip
    named = [strain.assign_coords(core=[part]) for strain, part in zip(recordings, cores.files, strict=False)]
    joined = combine_cores(named) if len(named) > 1 else recordings[0]
    layout, count = cores.layout(), joined.sizes["core"]
    if count != layout.radius.size:
        raise InputError(f"{path.name} holds the strain of {count} core(s), but its mapping describes "
                         f"{layout.radius.size}: name the files of the others in cores.files, or correct outer and "
                         "centre")  # fmt: skip
    for file, recording in zip(files[1:], recordings[1:], strict=True):
        digest = recording.attrs.get("source_sha256", "")
        joined = append_history(joined, f"strain from {file.name} sha256 {digest}", *history_of(recording))
    return shape_from_strain(joined, layout, common_mode=cores.common_mode, bridge=cores.bridge)


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
