"""Read a LabVIEW TDMS file by nptdms, in a separate process."""

from __future__ import annotations

import numpy as np
from nptdms import TdmsFile

from pliant.recording.apart_worker import Content, Refused, content_bound


def read(path: str) -> Content:
    """Return the numeric channels of a TDMS file with their sample times, and the names of the other channels. A file
    that states more values than it can hold is refused.
    """
    from pathlib import Path

    arrays: dict[str, np.ndarray] = {}
    listed, others = [], []
    bound = content_bound(Path(path).stat().st_size)
    with TdmsFile.open(path) as file:
        if file.file_status.incomplete_final_segment:
            raise Refused("the file is truncated, as its last segment is incomplete: copy or export it again")
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
            step = channel.properties.get("wf_increment")
            start = channel.properties.get("wf_start_offset", 0.0)
            unit = str(channel.properties.get("unit_string", ""))
            listed.append({"name": name, "key": f"v{k}", "unit": unit, "start": float(start),
                           "step": None if step is None else float(step)})  # fmt: skip
    return arrays, {"channels": listed, "others": others}
