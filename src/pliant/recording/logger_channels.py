"""Build a recording from the channels of a data logger: pressures, chosen by name or by unit, and the positions of
stations, by the names of their coordinates. Read LabVIEW TDMS files.

nptdms (extra ``tdms``) reads a TDMS file in a separate process. Times come from the waveform properties of a channel
(``wf_start_time``, ``wf_start_offset``, ``wf_increment``), or from a time channel, such as ``Time``.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from pliant.errors import InputError, clipped, inside
from pliant.recording.apart import read_apart
from pliant.recording.clock import without_repeats
from pliant.recording.column_arrays import calibrated, from_counts
from pliant.recording.column_names import standard_names, stations_of, unit_of
from pliant.recording.mapping import FileMapping, shorten
from pliant.recording.registry import ENDINGS, Reader, begins_with
from pliant.recording.schema import make_recording
from pliant.recording.stated import WARNING, Reading, Stated, judge_stated
from pliant.units import METRE, PASCAL, metre_per, pascal_per, standard_unit

if TYPE_CHECKING:
    from pathlib import Path

    import xarray as xr
    from numpy.typing import NDArray

CLOCK = re.compile(r"(.*/)?(x_value|t|time)([ _(\[]*s[)\]]?)?", re.IGNORECASE)


class Channel(NamedTuple):
    """One channel of a data logger: T sample times (T,) [s], values (T,), and the unit in the file ("" for none)."""

    time: NDArray[np.float64]
    values: NDArray[np.float64]
    unit: str


class ChannelMapping(FileMapping):
    """Options that select the channels of a data logger that hold gauge pressure, and state their unit.

    Attributes
    ----------
    pressure : list of str, optional
        Names of the channels of gauge pressure. Default: all channels with a unit of pressure.
    pressure_unit : str, optional
        Unit of these channels, where the file states none or a wrong one.
    chamber : list of str, optional
        Names of the chambers, one for each channel.
    scale, zero : float or list of float
        Raw counts become pressures by (counts - `zero`) * `scale`; one number, or one for each channel.
    """

    pressure: list[str] | None = None
    pressure_unit: str | None = None
    chamber: list[str] | None = None
    scale: float | list[float] = 1.0
    zero: float | list[float] = 0.0


def pressure_log(
    channels: Mapping[str, Channel], mapping: Mapping[str, Any] | None, file: str, history: Sequence[str] = (),
) -> xr.Dataset:
    """Return the pressures among the channels of a data logger, and the positions of the stations whose coordinates
    other channels hold, as a recording.

    Raises
    ------
    InputError
        When no channel holds pressure, one has no unit, or the chosen channels have different sample times.
    """
    options = ChannelMapping.load(mapping, file)
    names = options.pressure or [n for n, c in channels.items() if c.unit.strip().lower() in PASCAL]
    listing = ", ".join(f"{clipped(n, 40)} ({c.unit or 'no unit'})" for n, c in list(channels.items())[:20]) or "none"
    if missing := [n for n in names if n not in channels]:
        raise InputError(f"{file} has no channel {clipped(missing[0])!r}: correct pressure in its mapping; its "
                         f"channels are: {listing}")
    shape, doubts = positions_beside(names, channels, file)
    if not names and shape:
        with inside(file):
            return make_recording(shape.time, shape.position, station=shape.stations,
                                  history=[*history, *unread(channels, shape.channels, file)])  # fmt: skip
    if not names:
        raise InputError(f"{file} has no channel with a unit of pressure: name the channels in its mapping, "
                         f"pressure = [...] and pressure_unit; its channels are: {listing}")  # fmt: skip
    if options.chamber is not None and len(options.chamber) != len(names):
        raise InputError(f"the mapping for {file} names {len(options.chamber)} chambers for {len(names)} channels: "
                         "name one chamber per channel")
    units = [options.pressure_unit or channels[n].unit for n in names]
    if not all(units):
        raise InputError(f"{file} does not state the unit of {clipped(names[units.index('')])}: set pressure_unit "
                         "in its mapping")
    time = channels[names[0]].time
    for name in names[1:]:
        if not np.array_equal(channels[name].time, time):
            first, other = (f"{clipped(n)} ({len(channels[n].time)} samples from {channels[n].time[:1].sum():.6g} s)"
                            for n in (names[0], name))  # fmt: skip
            raise InputError(f"channels {first} and {other} of {file} have different sample times: read each channel "
                             "by its own mapping")
    keep, repeats = without_repeats(time, file)
    stored = np.stack([channels[n].values for n in names], axis=1)[keep]
    values = from_counts(stored, options.scale, options.zero, file) * [pascal_per(unit) for unit in units]
    single = len(names) == 1 and options.chamber is None
    findings = [*doubts, *unread(channels, [*names, *(shape.channels if shape else [])], file)]
    findings += calibrated(names, options.scale, options.zero, units[0])
    with inside(file):
        return make_recording(
            *([shape.time, shape.position] if shape else []), station=shape.stations if shape else None,
            pressure=values, pressure_time=time[keep],
            chamber=None if single else options.chamber or names, history=[*history, *findings, *repeats],
        )  # fmt: skip


class Positions(NamedTuple):
    """Positions (T, S, 3) [m] of S stations at T times [s], and the channels that hold them."""

    time: NDArray[np.float64]
    position: NDArray[np.float64]
    stations: list[str]
    channels: list[str]


def positions_beside(
    pressures: Sequence[str], channels: Mapping[str, Channel], file: str
) -> tuple[Positions | None, list[str]]:
    """Return the positions in the channels other than the pressures, and a sentence for the history where there are
    pressures and the positions cannot be read.
    """
    try:
        return positions_in({n: c for n, c in channels.items() if n not in pressures}, file), []
    except InputError as error:
        if not pressures:
            raise
        return None, [f"no positions of {file} are read: {error}"]


def positions_in(channels: Mapping[str, Channel], file: str) -> Positions | None:
    """Return the positions of the stations whose x, y and z the names of channels with a unit of length state; None
    where there are none.

    Raises
    ------
    InputError
        When these channels have different sample times or several units.
    """
    stated = {n: standard_unit(c.unit) if c.unit else unit_of(n, METRE) for n, c in channels.items()}
    names = [n for n in channels if stated[n] in METRE]
    renamed = standard_names([f"{n} [{stated[n]}]" if channels[n].unit else n for n in names], file)
    listed = {s: at["position"] for s, at in stations_of(renamed.names, names).items() if len(at["position"]) == 3}
    columns = [n for axes in listed.values() for n in axes]
    if not columns:
        return None
    time = channels[columns[0]].time
    if any(not np.array_equal(channels[n].time, time) for n in columns):
        raise InputError(f"the channels of positions of {file}, such as {clipped(columns[0])}, have different sample "
                         "times: export them at one rate")
    keep, _ = without_repeats(time, file)
    values = np.stack([channels[n].values for n in columns], axis=1)[keep] * metre_per(renamed.length_unit)
    return Positions(time[keep], values.reshape(len(values), -1, 3), [*listed], columns)


def unread(channels: Mapping[str, Channel], read: Sequence[str], file: str) -> list[str]:
    """Return a sentence on the channels that were not read; [] if all were."""
    left = [n for n in channels if n not in {*read}]
    return [f"{len(left)} channel(s) of {file} hold no pressure and were left out: {shorten(left)}"] if left else []


def read_tdms(path: Path, mapping: Mapping[str, Any] | None = None) -> Reading:
    """Read the pressures and positions in a LabVIEW TDMS file and return them as a recording."""
    if find_spec("nptdms") is None:
        raise InputError(f"{path.name}: TDMS files need nptdms, which is not installed: pip install 'pliant[tdms]'")
    arrays, facts = read_apart("tdms", path, "TDMS")
    clocks = [c["key"] for c in facts["channels"] if CLOCK.fullmatch(c["name"])]
    entries = [c for c in facts["channels"] if c["key"] not in clocks]
    begins = [c["begin"] for c in entries if c["begin"] is not None]
    stated = [Stated("whole segments", "the lengths of its segments", facts["segments"], facts["whole"])]
    if not entries:
        judge_stated(stated, path.name)  # the reason why there is no channel
    channels: dict[str, Channel] = {}
    cut = facts["whole"] < facts["segments"]  # inside a sample of one channel, which others of its length have
    for entry in entries:
        alike = [len(arrays[e["key"]]) for e in entries if e["stated"] == entry["stated"]]
        values, begin = arrays[entry["key"]][: min(alike) if cut else None], entry["begin"]
        shift = 1e-9 * (begin - min(begins)) if begin is not None else 0.0
        if entry["step"]:
            time = shift + entry["start"] + entry["step"] * np.arange(len(values))
        elif len(clocks) == 1 and len(arrays[clocks[0]]) in (len(values), entry["stated"]):
            time = arrays[clocks[0]][: len(values)]
        else:
            raise InputError(f"{path.name} has no times for channel {entry['name'][:60]}: export it with waveform "
                             "properties (wf_increment) or with one time channel of the same length")  # fmt: skip
        channels[entry["name"]] = Channel(time, values, entry["unit"])
        what = f"samples of {clipped(entry['name'], 40)}"
        stated += [Stated(what, "its segments", entry["stated"], len(values)),
                   Stated(what, "wf_samples", entry["samples"], len(values), "at least")]  # fmt: skip
    others = facts["others"]
    findings = [f"{len(others)} channel(s) of {path.name} hold no numbers: {shorten(others)}"] if others else []
    findings += start_sentences(entries, path.name)
    return Reading(pressure_log(channels, mapping, path.name, findings), tuple(stated))


def start_sentences(entries: Sequence[Mapping[str, Any]], file: str) -> list[str]:
    """Return sentences for the history where the channels of a TDMS file state different start times, or only some of
    them state one.
    """
    dated = {e["name"]: e["begin"] for e in entries if e["begin"] is not None and e["step"]}
    undated = [e["name"] for e in entries if e["begin"] is None and e["step"]]
    said = []
    if len(set(dated.values())) > 1:
        late = ", ".join(f"{clipped(n, 40)} {1e-9 * (b - min(dated.values())):.6g} s" for n, b in dated.items())
        said.append(f"the channels of {file} start at different times (wf_start_time) and were shifted: {late}")
    if dated and undated:
        said.append(f"{WARNING}{shorten(undated, 5)} of {file} state no start time (wf_start_time), but other channels "
                    "do: they are assumed to start with the first of these")
    return said


TDMS = Reader("tdms", ENDINGS["tdms"], read_tdms, begins_with(b"TDSm"))
