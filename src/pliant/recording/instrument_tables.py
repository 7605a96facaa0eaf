"""Text tables of trackers that state names, rate and units in lines of their own: Qualisys (TSV), Vicon Nexus (CSV),
NDI Aurora (CSV) and TRC, which several programs write. They become one row of names above
rows of numbers; columns keep their places.
"""

from __future__ import annotations

import json
import re
from typing import TYPE_CHECKING

from pliant.errors import InputError, clipped
from pliant.recording.stated import WARNING
from pliant.recording.tables import NUMBER, split_cells, whole_number

if TYPE_CHECKING:
    from collections.abc import Sequence

ABOVE_TRC = 5  # lines above its rows of numbers
QUALISYS, VICON = "NO_OF_FRAMES", {"Trajectories", "Devices", "Joints", "Model Outputs", "Segments"}
DERIVED = {"'": "velocity_", "''": "acceleration_"}  # what Vicon marks behind the name of an axis
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
    if lines and title_of(lines[0]) in VICON:
        return of_vicon(lines, name)
    if first == "PathFileType":
        return of_trc(lines, name)
    return of_aurora(lines, name) if first == "Tools" else (list(lines), [])


def of_trc(lines: Sequence[str], name: str) -> tuple[list[str], list[str]]:
    """Return the table of a TRC file, whose rows hold a frame number, the time, and the positions of its markers."""
    rows = [line.rstrip("\r\n") for line in lines if line.strip()]
    header = dict(zip(*(row.split("\t") for row in rows[1:3]), strict=False)) if len(rows) > ABOVE_TRC else {}
    markers = [cell.strip() for cell in rows[3].split("\t")[2:] if cell.strip()] if header else []
    if not markers or "Units" not in header:
        raise InputError(f"{name} is a TRC file without Units or names of markers in its first lines: export it again")
    names = names_of_markers(markers, header["Units"].strip())
    body, short = of_width(rows[ABOVE_TRC:], len(names) + 2, name)
    count = whole_number(header.get("NumFrames", "").strip())
    metadata = [] if count is None else [f"# {json.dumps({'rows': count})}"]
    return [*metadata, "\t".join(["Frame", "t", *names]), *body, ""], [
        f"{name} is a TRC file: {len(markers)} marker(s) in {header['Units'].strip()}", *short]  # fmt: skip


def names_of_markers(markers: Sequence[str], unit: str) -> list[str]:
    """Return the standard names of the columns of markers, each of which is a station whatever it is called."""
    return [f"{axis}_{marker.replace(' ', '_')} [{unit}]" for marker in markers for axis in "xyz"]


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
    if not markers and {"BODY_NAMES", "NO_OF_BODIES"} & set(about):
        raise InputError(f"{name} is a table of Qualisys with poses of rigid bodies (6DOF), not of markers: export the "
                         "positions of the markers (3D) as TSV")
    if not markers or not rate > 0:
        raise InputError(f"{name} is a table of Qualisys without MARKER_NAMES or FREQUENCY: export it with its header")
    names = names_of_markers(markers, "mm")
    timed = lines[begin].startswith("Frame")
    rows = [line for line in lines[begin + timed :] if line.strip()]
    head = ["Frame", "t", *names] if timed else [*names, "t"]
    rows, short = of_width(rows, len(names) + 2 * timed, name)
    if not timed:  # a cut last row gets no time: it stays too short
        rows = [f"{row}\t{k / rate:.6f}" if row.count("\t") + 1 == len(names) else row for k, row in enumerate(rows)]
    count = whole_number("".join(about.get("NO_OF_FRAMES", [])[:1]))
    metadata = [] if count is None else [f"# {json.dumps({'rows': count})}"]
    return [*metadata, "\t".join(head), *rows, ""], [
        f"{name} is a table of Qualisys: {len(markers)} marker(s) in mm at {rate:g} Hz", *short]  # fmt: skip


def of_width(rows: Sequence[str], width: int, name: str) -> tuple[list[str], list[str]]:
    """Return tab-separated rows without blank cells beyond `width`, and with blank cells for the last markers that a
    row lacks, which a sentence for the history counts. The last row is not filled: it may be cut.

    Raises
    ------
    InputError
        When a row holds more values than the names.
    """
    result, filled = [], 0
    for k, row in enumerate(rows):
        cells = row.split("\t")
        if any(cell.strip() for cell in cells[width:]):
            raise InputError(f"row {k + 1} below the header of {name} holds more than {width} values, the number of "
                             "its columns: export it again")
        lacking = width - len(cells)
        if lacking > 0 and lacking % 3 == 0 and k + 1 < len(rows):
            cells += [""] * lacking
            filled += 1
        result.append("\t".join(cells[:width]))
    return result, [f"{filled} row(s) of {name} end before their last marker, which is a gap there"] if filled else []


def title_of(line: str) -> str:
    """Return the text of a line that holds one cell alone, such as the title of a block; else the whole line."""
    return line.strip(' ,;\t"')


def of_vicon(lines: Sequence[str], name: str) -> tuple[list[str], list[str]]:
    """Return the table of the trajectories in a CSV of Vicon Nexus. Their rate gives the times; other blocks, such as
    that of analog devices, are left out and named.
    """
    begins = [k for k, line in enumerate(lines) if title_of(line) in VICON]
    titles = [title_of(lines[k]) for k in begins]
    if "Trajectories" not in titles:
        raise InputError(f"{name} is a table of Vicon without trajectories ({', '.join(titles)}): export them, too")
    at = titles.index("Trajectories")
    begin, end = begins[at], [*begins, len(lines)][at + 1]
    block = [line for line in lines[begin:end] if line.strip(" ,;\t")]
    if len(block) < 7:
        raise InputError(f"{name} is a table of Vicon with fewer than 2 rows of trajectories: export them again")
    rate = title_of(block[1])
    if not NUMBER.fullmatch(rate) or not float(rate) > 0:
        raise InputError(f"the trajectories of {name} state no rate below their title: export them again")
    delimiter = next((d for d in "\t;," if d in block[3]), ",")
    names = vicon_names(*(split_cells(row, delimiter) for row in block[2:5]))
    rows, first, commas = [], None, delimiter != "," and any("," in row for row in block[5:])
    for row in block[5:]:
        frame, _, rest = row.partition(delimiter)
        number = whole_number(frame.strip())
        if number is None:
            raise InputError(f"a row of the trajectories of {name} begins with {clipped(frame, 30)!r}, not with the "
                             "number of its frame: export them again")
        first = number if first is None else first
        time = f"{(number - first) / float(rate):.6f}"
        rows.append(f"{time.replace('.', ',') if commas else time}{delimiter}{rest}")
    others = [title for title in titles if title != "Trajectories"]
    notes = [f"{name} is a table of Vicon: trajectories at {float(rate):g} Hz"]
    if others:
        notes.append(f"{WARNING}the block(s) {', '.join(others)} of {name} are not read: save a pressure among them as "
                     "a table of its own, with columns of time and pressure, and give it to pliant new, too")
    return [delimiter.join(names), *rows, ""], notes


def vicon_names(bodies: Sequence[str], parts: Sequence[str], units: Sequence[str]) -> list[str]:
    """Return the names of the columns of trajectories, from the rows of their markers, axes and units."""
    names, body = [], ""
    alone = [cell.rpartition(":")[2] for cell in bodies if cell]
    whole = len(set(alone)) < len(alone)  # markers of one name on several subjects
    for k, part in enumerate(parts):
        body = (bodies[k] if k < len(bodies) else "") or body
        unit = units[k] if k < len(units) else ""
        label = re.sub(r"\W+", "_", body if whole else body.rpartition(":")[2])
        axis = part.rstrip("'")
        coordinate = f"{DERIVED.get(part.removeprefix(axis), '')}{axis.lower()}"
        names.append("t" if part == "Frame" else f"{label}_{coordinate} [{unit}]" if unit else part)
    return names


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
