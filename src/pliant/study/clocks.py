"""The pressure's clock in a study: another file's log joined to the shape, and both brought onto one clock."""

from __future__ import annotations

import xarray as xr

from pliant.errors import InputError
from pliant.preprocessing.sync import shift_pressure, sync
from pliant.recording import append_history
from pliant.study.schema import Recording
from pliant.validation.outcome import Clocks


def with_pressure(recording: xr.Dataset, log: xr.Dataset, name: str, file: str) -> xr.Dataset:
    """The recording with the pressure of a log in another file, on the log's own clock."""
    if "pressure" not in log:
        raise InputError(f"recording {name}: {file} holds no pressure: name its column in pressure_mapping")
    if "pressure" in recording:
        raise InputError(f"recording {name} holds a pressure already: leave pressure_file out, or the pressure in its "
                         "mapping")  # fmt: skip
    joined = recording.assign({"pressure": log["pressure"]})
    digest = log.attrs.get("source_sha256", "")
    lines = str(log.attrs.get("history", "")).splitlines()
    return append_history(joined, *(f"{file}: {line}" for line in lines), f"pressure from {file} sha256 {digest}")


def on_one_clock(
    recording: xr.Dataset, entry: Recording, name: str
) -> tuple[xr.Dataset, Clocks | None, tuple[str, ...]]:
    """The recording with its pressure on the clock of the shape, how that was found, and what to tell of it."""
    wanted = entry.clock if entry.clock is not None else "align" if entry.pressure_file else "same"
    if wanted == "same":
        return recording, None, ()
    if "pressure" not in recording:
        raise InputError(f"recording {name}: clock goes with a measured pressure, but it holds none")
    if not isinstance(wanted, str):
        finding = f"the pressure's clock is moved by {1e3 * wanted:+.6g} ms, as stated"
        return shift_pressure(recording, wanted), None, (finding,)
    try:
        found = sync(recording, drift=True)
    except InputError as error:
        raise InputError(f"recording {name}: {error}") from None
    moved = shift_pressure(recording, found.delay_s, found.drift)
    return moved, Clocks.of(recording, found), (found.summary(),)
