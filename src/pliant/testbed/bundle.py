"""The recordings that are bundled with the package; ``python -m pliant.testbed.bundle`` regenerates them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from pliant.errors import InputError

if TYPE_CHECKING:
    import xarray as xr

FOLDER = Path(__file__).parent / "bundled"
BUNDLED = ("pulse_60", "pulse_119", "pulse_180", "step_240", "triangle")
LOGGED = ("pulse_60", "pulse_119", "pulse_180")  # also recorded by a flex sensor, as a small logger writes it
QUANTUM = 2.0**-17  # m: 7.6 um, far below the sensor's noise; zeros in the mantissa deflate well


def bundled_recording(name: str = "pulse_119") -> xr.Dataset:
    """Return one of the bundled recordings of actuator "a" by its name.

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
    """Generate one bundled recording, with positions rounded for storage."""
    from pliant.testbed.laboratory import generate

    return rounded(generate(name, "a", 1).recording)


def rounded(recording: xr.Dataset) -> xr.Dataset:
    """Return the recording with positions rounded for storage."""
    from pliant.recording import append_history

    position = recording["position"].copy(data=np.round(recording["position"].to_numpy() / QUANTUM) * QUANTUM)
    return append_history(recording.assign(position=position), f"positions rounded to {QUANTUM * 1e6:.1f} um")


def bundled_log(name: str = "pulse_119") -> Path:
    """Return the path of a bundled text log of angle and pressure by the recording's name.

    Raises
    ------
    InputError
        For an unknown name.
    """
    if name not in LOGGED:
        raise InputError(f"no bundled log {name!r}: use one of {', '.join(LOGGED)}")
    return FOLDER / f"angle_{name}.txt"


def angle_log(name: str, seed: int = 1) -> str:
    """Return the text log of a flex sensor's angle [deg], the pressure and its set point [kPa].

    It has semicolons, decimal commas and lines that end in a lone carriage return, as small loggers write them.
    """
    from pliant.testbed.laboratory import Laboratory, generate, one_each
    from pliant.testbed.rod import actuator
    from pliant.testbed.scenarios import scenario

    recording = generate(name, "a", seed, lab=Laboratory(output="angle")).recording
    time = recording["time"].to_numpy()
    (command,) = one_each(scenario(name).command, actuator("a"), "command")
    columns = (np.degrees(recording["angle"].to_numpy()[:, 0]), 1e-3 * recording["pressure"].to_numpy(),
               1e-3 * command(time))  # fmt: skip
    rows = [f"{t:.2f};{angle:.1f};{pressure:.2f};{wanted:.0f}" for t, angle, pressure, wanted in
            zip(time, *columns, strict=True)]  # fmt: skip
    return "".join(f"{line}\r" for line in ("time;angle;pressure;set_point", *rows)).replace(".", ",")


def main(folder: Path = FOLDER) -> None:
    """Write all bundled recordings and logs to `folder`."""
    from pliant.recording.netcdf import write_netcdf

    folder.mkdir(parents=True, exist_ok=True)
    for name in BUNDLED:
        write_netcdf(bundle_recording(name), folder / f"{name}.nc", float32=True, compress=True)
    for name in LOGGED:
        (folder / f"angle_{name}.txt").write_bytes(angle_log(name).encode())


if __name__ == "__main__":
    main()
