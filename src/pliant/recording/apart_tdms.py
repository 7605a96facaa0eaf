"""Read a LabVIEW TDMS file by nptdms, in a separate process."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import numpy as np
from nptdms import TdmsFile

from pliant.recording.apart_worker import Content, Refused, content_bound

LEAD_IN = 28  # bytes: tag, contents, version, length of the segment, length of its metadata
BIG_ENDIAN = 1 << 6  # bit of the contents


def read(path: str) -> Content:
    """Return the numeric channels of a TDMS file with their sample times, and the names of the other channels. A file
    that states more values than it can hold is refused.

    The facts also hold the numbers of segments and of samples that the file states, and that are whole.
    """
    arrays: dict[str, np.ndarray] = {}
    listed, others = [], []
    bound = content_bound(Path(path).stat().st_size)
    begun, whole = segments(path)
    with TdmsFile.open(path) as file:
        cut = file.file_status.channel_statuses or {}
        channels = [c for group in file.groups() for c in group.channels()]
        names = [c.name for c in channels]
        if 8 * sum(len(c) for c in channels) > bound:
            raise Refused("the file states more values than it can hold by its size: it may be damaged, so copy or "
                          "export it again")
        for k, channel in enumerate(channels):
            name = channel.name if names.count(channel.name) == 1 else f"{channel.group_name}/{channel.name}"
            if channel.dtype.kind not in "iuf" or not len(channel):
                others.append(name)
                continue
            arrays[f"v{k}"] = np.asarray(channel[:], np.float64)
            missing = cut[channel.path].expected_length - cut[channel.path].read_length if channel.path in cut else 0
            listed.append({"name": name, "key": f"v{k}", "stated": len(channel) + missing,
                           **waveform(channel.properties)})  # fmt: skip
    return arrays, {"channels": listed, "others": others, "segments": begun, "whole": whole}


def waveform(properties: Any) -> dict[str, Any]:
    """Return the properties of a waveform: its unit, start offset and step [s], its start time [ns] (None for none or
    the zero of LabVIEW's clock), and the number of samples of its first part.
    """
    step, begin = properties.get("wf_increment"), properties.get("wf_start_time")
    begin = np.datetime64("NaT" if begin is None else begin)
    dated = not np.isnat(begin) and begin.astype("datetime64[Y]") > np.datetime64("1904")
    return {
        "unit": str(properties.get("unit_string", "")), "start": float(properties.get("wf_start_offset", 0.0)),
        "step": None if step is None else float(step), "samples": int(properties.get("wf_samples", 0)),
        "begin": int(begin.astype("datetime64[ns]").astype(np.int64)) if dated else None,
    }  # fmt: skip


def segments(path: str) -> tuple[int, int]:
    """Return the number of segments that begin in a TDMS file, and the number of those that are whole.

    Source: the description of the TDMS file format by National Instruments: each segment states its length.
    """
    size, position, begun, whole = Path(path).stat().st_size, 0, 0, 0
    with Path(path).open("rb") as file:
        while position < size:
            file.seek(position)
            lead = file.read(LEAD_IN)
            begun += 1
            if len(lead) < LEAD_IN or not lead.startswith(b"TDSm"):
                break
            order = ">" if int.from_bytes(lead[4:8], "little") & BIG_ENDIAN else "<"
            position += LEAD_IN + struct.unpack(order + "Q", lead[12:20])[0]
            whole += position <= size
    return begun, whole
