"""Synchronisation of a pressure log with the recorded shape, when a study is prepared."""

from __future__ import annotations

import xarray as xr

from pliant.errors import InputError
from pliant.preprocessing.sync import shift_pressure, sync
from pliant.recording import append_history
from pliant.study.schema import Recording
from pliant.validation.outcome import Clocks


def with_pressure(recording: xr.Dataset, log: xr.Dataset, name: str, file: str) -> xr.Dataset:
    """Return the recording with the pressure of a log from another file, still on the log's own clock."""
    if "pressure" not in log:
        raise InputError(f"recording {name}: {file} holds no pressure: state its pressure column in pressure_mapping")
    if "pressure" in recording:
        raise InputError(f"recording {name} holds a pressure already: remove pressure_file, or the pressure in its "
                         "mapping")  # fmt: skip
    joined = recording.assign({"pressure": log["pressure"]})
    digest = log.attrs.get("source_sha256", "")
    lines = str(log.attrs.get("history", "")).splitlines()
    return append_history(joined, *(f"{file}: {line}" for line in lines), f"pressure from {file} sha256 {digest}")


def on_one_clock(
    recording: xr.Dataset, entry: Recording, name: str
) -> tuple[xr.Dataset, Clocks | None, tuple[str, ...]]:
    """Return the recording with its pressure on the shape's clock, the estimated offset, and sentences for the report.

    The offset is None if nothing was estimated, since the clocks are stated to be equal or the offset is stated.
    """
    wanted = entry.clock if entry.clock is not None else "align" if entry.pressure_file else "same"
    if wanted == "same":
        return recording, None, ()
    if "pressure" not in recording:
        raise InputError(f"recording {name}: clock is stated, but there is no measured pressure: remove clock")
    if not isinstance(wanted, str):
        finding = f"the pressure's clock is moved by {1e3 * wanted:+.6g} ms, as stated"
        return shift_pressure(recording, wanted), None, (finding,)
    try:
        found = sync(recording, drift=True)
    except InputError as error:
        raise InputError(f"recording {name}: {error}") from None
    moved = shift_pressure(recording, found.delay_s, found.drift)
    return moved, Clocks.of(recording, found), (found.summary(),)
