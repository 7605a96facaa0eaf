"""Reader of LabVIEW TDMS files (.tdms), by nptdms (extra ``tdms``) in a separate process.

Times come from the waveform properties of a channel (``wf_start_offset``, ``wf_increment``), or from a time channel,
such as ``Time``.
"""

from __future__ import annotations

import re
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

import numpy as np

from pliant.errors import InputError
from pliant.recording.apart import read_apart
from pliant.recording.logger_channels import Channel, pressure_log
from pliant.recording.mapping import shorten
from pliant.recording.registry import ENDINGS, Reader

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    import xarray as xr

CLOCK = re.compile(r"(.*/)?(x_value|t|time)([ _(\[]*s[)\]]?)?", re.IGNORECASE)


def read_tdms(path: Path, mapping: Mapping[str, Any] | None = None) -> xr.Dataset:
    """Read the pressures in a LabVIEW TDMS file and return them as a recording without shape."""
    if find_spec("nptdms") is None:
        raise InputError(f"{path.name}: TDMS files need nptdms, which is not installed: pip install 'pliant[tdms]'")
    arrays, facts = read_apart("tdms", path, "TDMS")
    clocks = [c["key"] for c in facts["channels"] if CLOCK.fullmatch(c["name"])]
    channels: dict[str, Channel] = {}
    for entry in facts["channels"]:
        values = arrays[entry["key"]]
        if entry["key"] in clocks:
            continue
        if entry["step"]:
            time = entry["start"] + entry["step"] * np.arange(len(values))
        elif len(clocks) == 1 and len(arrays[clocks[0]]) == len(values):
            time = arrays[clocks[0]]
        else:
            raise InputError(f"{path.name} has no times for channel {entry['name'][:60]}: export it with waveform "
                             "properties (wf_increment) or with one time channel of the same length")  # fmt: skip
        channels[entry["name"]] = Channel(time, values, entry["unit"])
    others = facts["others"]
    findings = [f"{len(others)} channel(s) of {path.name} hold no numbers: {shorten(others)}"] if others else []
    return pressure_log(channels, mapping, path.name, findings)


def recognises(head: bytes) -> bool:
    """Return whether the first bytes of a file, `head`, are those of a LabVIEW TDMS file."""
    return head.startswith(b"TDSm")


READER = Reader("tdms", ENDINGS["tdms"], read_tdms, recognises)
