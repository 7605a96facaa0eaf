"""The recordings that come with the package: ``python -m pliant.testbed.bundle`` makes them anew."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from pliant.errors import InputError

if TYPE_CHECKING:
    import xarray as xr

FOLDER = Path(__file__).parent / "bundled"
BUNDLED = ("pulse_60", "pulse_119", "pulse_180", "step_240", "triangle")
QUANTUM = 2.0**-17  # m: 7.6 um, far below the sensor's noise; zeros in the mantissa deflate well


def bundled_recording(name: str = "pulse_119") -> xr.Dataset:
    """One of the recordings of actuator "a" that come with the package.

    Raises
    ------
    InputError
        For an unknown name.
    """
    from pliant.recording import read

    if name not in BUNDLED:
        raise InputError(f"no bundled recording {name!r}: use one of {', '.join(BUNDLED)}")
    return read(FOLDER / f"{name}.nc")


def bundle_recording(name: str) -> xr.Dataset:
    """Generate one bundled recording, rounded for storage."""
    from pliant.recording import append_history
    from pliant.testbed.laboratory import generate

    ds = generate(name, "a", 1).recording
    rounded = ds["position"].copy(data=np.round(ds["position"].to_numpy() / QUANTUM) * QUANTUM)
    return append_history(ds.assign(position=rounded), f"positions rounded to {QUANTUM * 1e6:.1f} um")


def main(folder: Path = FOLDER) -> None:
    """Write all bundled recordings."""
    from pliant.recording.netcdf import write_netcdf

    folder.mkdir(parents=True, exist_ok=True)
    for name in BUNDLED:
        write_netcdf(bundle_recording(name), folder / f"{name}.nc", float32=True, compress=True)


if __name__ == "__main__":
    main()
