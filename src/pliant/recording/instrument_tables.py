"""Text tables of trackers that state names, rate and units in lines of their own: Qualisys (TSV), Vicon Nexus (CSV) and
NDI Aurora (CSV). They become one row of names above rows of numbers; columns keep their places.
"""

from __future__ import annotations

import json
import re
from typing import TYPE_CHECKING

from pliant.errors import InputError, clipped
from pliant.recording.tables import NUMBER, whole_number

if TYPE_CHECKING:
    from collections.abc import Sequence

QUALISYS, VICON = "NO_OF_FRAMES", {"Trajectories", "Devices", "Joints", "Model Outputs", "Segments"}
AURORA = {"Q0": "qw", "Qx": "qx", "Qy": "qy", "Qz": "qz", "Tx": "x [mm]", "Ty": "y [mm]", "Tz": "z [mm]"}


def as_table(lines: Sequence[str], name: str) -> tuple[list[str], list[str]]:
    """Return the lines of a text as one table, and sentences for the history; unchanged where no tracker of those named
    above wrote it.

    Raises
    ------
    InputError
        When such a file lacks its markers or its rate.
    """
    first = lines[0].split("\t")[0].split(",")[0].strip().strip('"') if lines else ""
    if first == QUALISYS:
        return of_qualisys(lines, name)
    if first in VICON:
        return of_vicon(lines, name)
    return of_aurora(lines, name) if first == "Tools" else (list(lines), [])


def of_qualisys(lines: Sequence[str], name: str) -> tuple[list[str], list[str]]:
    """Return the table of a TSV of Qualisys Track Manager: positions in mm, with a column of time behind them if the
    file has none.
    """
    about: dict[str, list[str]] = {}
    begin = 0
    for k, line in enumerate(lines):
        cells = [cell.strip() for cell in line.split("\t")]
        if not cells[0] or NUMBER.fullmatch(cells[0]) or cells[0] == "Frame":
            begin = k
            break
        about[cells[0]] = cells[1:]
    rate = float(text) if NUMBER.fullmatch(text := "".join(about.get("FREQUENCY", [])[:1])) else 0.0
    markers = [marker for marker in about.get("MARKER_NAMES", []) if marker]
    if not markers or not rate > 0:
        raise InputError(f"{name} is a table of Qualisys without MARKER_NAMES or FREQUENCY: export it with its header")
    names = [f"{marker.replace(' ', '_')}_{axis}" for marker in markers for axis in "xyz"]
    timed = lines[begin].startswith("Frame")
    rows = [line for line in lines[begin + timed :] if line.strip()]
    if timed:
        head = ["Frame", "t", *names]
    else:
        head = [*names, "t"]
        rows = [f"{row.rstrip(chr(9))}\t{k / rate:.6f}" if row.rstrip("\t").count("\t") + 1 == len(names) else row
                for k, row in enumerate(rows)]  # fmt: skip
    metadata = {"length_unit": "mm"}
    if (count := whole_number("".join(about.get("NO_OF_FRAMES", [])[:1]))) is not None:
        metadata["rows"] = count  # type: ignore[assignment]
    return [f"# {json.dumps(metadata)}", "\t".join(head), *rows, ""], [
        f"{name} is a table of Qualisys: {len(markers)} marker(s) in mm at {rate:g} Hz"]  # fmt: skip


def of_vicon(lines: Sequence[str], name: str) -> tuple[list[str], list[str]]:
    """Return the table of the trajectories in a CSV of Vicon Nexus. Their rate gives the times; other blocks, such as
    that of analog devices, are left out and named.
    """
    begins = [k for k, line in enumerate(lines) if line.strip().strip(",").strip('"') in VICON]
    titles = [lines[k].strip().strip(",").strip('"') for k in begins]
    if "Trajectories" not in titles:
        raise InputError(f"{name} is a table of Vicon without trajectories ({', '.join(titles)}): export them, too")
    at = titles.index("Trajectories")
    begin, end = begins[at], [*begins, len(lines)][at + 1]
    block = [line for line in lines[begin:end] if line.strip(" ,")]
    rate = block[1].strip().strip(",")
    if len(block) < 7 or not NUMBER.fullmatch(rate) or not float(rate) > 0:
        raise InputError(f"the trajectories of {name} state no rate below their title: export them again")
    bodies, parts, units = (row.split(",") for row in block[2:5])
    names, body = [], ""
    alone = [cell.rpartition(":")[2] for cell in bodies if cell.strip()]
    whole = len(set(alone)) < len(alone)  # markers of one name on several subjects
    for k, part in enumerate(parts):
        body = (bodies[k].strip() if k < len(bodies) else "") or body
        unit = units[k].strip() if k < len(units) else ""
        label = re.sub(r"\W+", "_", body if whole else body.rpartition(":")[2])
        names.append("t" if part.strip() == "Frame" else f"{label}_{part.strip().lower()} [{unit}]" if unit else part)
    rows, first = [], None
    for row in block[5:]:
        frame, _, rest = row.partition(",")
        number = whole_number(frame.strip())
        if number is None:
            raise InputError(f"a row of the trajectories of {name} begins with {clipped(frame, 30)!r}, not with the "
                             "number of its frame: export them again")
        first = number if first is None else first
        rows.append(f"{(number - first) / float(rate):.6f},{rest}")
    others = [title for title in titles if title != "Trajectories"]
    notes = [f"{name} is a table of Vicon: trajectories at {float(rate):g} Hz"]
    notes += [f"the block(s) {', '.join(others)} of {name} are not read"] if others else []
    return [",".join(names), *rows, ""], notes


def of_aurora(lines: Sequence[str], name: str) -> tuple[list[str], list[str]]:
    """Return the table of an NDI Aurora, whose names repeat for each tool, with the number of its tool in each name."""
    names, tool, inside = [], 0, False
    for cell in lines[0].split(","):
        part = cell.strip().strip('"')
        begins = part.startswith(("Port", "Tool ", "Handle"))
        tool, inside = tool + begins, inside or begins
        names.append(f"tool_{tool}_{AURORA.get(part, part.partition(':')[0])}" if inside else part)
        inside = inside and part != "Error"  # the last column of a tool
    if not tool or f"tool_{tool}_x [mm]" not in names:
        return list(lines), []
    return [",".join(names), *lines[1:]], [f"{name} is a table of an NDI tracker: {tool} tool(s) in mm"]
