"""Read the shape of a body from a file, which may hold the strain of a multicore fibre."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from pydantic import Field

from pliant.errors import InputError, clipped
from pliant.recording import read
from pliant.recording.luna import combine_cores
from pliant.recording.mapping import FileMapping, options_of
from pliant.recording.schema import append_history, history_of
from pliant.sensing.recording import shape_from_strain
from pliant.sensing.strain import CoreLayout

if TYPE_CHECKING:
    from collections.abc import Mapping

    import xarray as xr


class Cores(FileMapping):
    """Options that describe the cores of a multicore fibre: their positions in the cross-section, and the files that
    hold their strain.
    """

    radius_um: float = Field(gt=0)  # distance of the outer cores from the axis of the fibre
    outer: int = Field(3, ge=2)  # number of outer cores, evenly spread
    centre: bool = True  # a centre core comes first
    first_angle_deg: float = 0.0  # of the first outer core
    pitch_mm: float | None = None  # length of one turn of a spun fibre, positive for a right-handed helix
    common_mode: Literal["least-squares", "centre"] = "least-squares"
    bridge: int = Field(0, ge=0)  # neighbouring gauges without a value that are interpolated, at most
    files: tuple[str, ...] = ()  # parts of file names, one a core; the first is in the name of the file read

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
