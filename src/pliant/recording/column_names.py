"""Translate column names that laboratories use into the standard names of the wide CSV format."""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

from pliant.errors import InputError, shown
from pliant.recording.clock import PARTS, SECONDS, parted_clock
from pliant.recording.tables import holds_number
from pliant.recording.vocabulary import (
    ABSOLUTE,
    AMBIENT,
    COMMAND,
    FLUID,
    NOT_INSIDE,
    OTHERS,
    PERHAPS_MEASURED,
    PLAINLY_OUTSIDE,
    PRESSED,
    REFERENCE,
    SET_POINT,
    as_written,
    base_to_tip,
    in_english,
    says_end,
)
from pliant.units import METRE, PASCAL, PIXEL, RADIAN, standard_unit

UNITS = (SECONDS, RADIAN, PASCAL)
PRESSURE = re.compile(r"(?:p|pressure)(?:[_ ](.+))?|(.+?)[_ ]pressure", re.IGNORECASE)
BEFORE = re.compile(r"([xyz])[_ .:](.+)", re.IGNORECASE)  # x_tip
COUNTED = re.compile(r"([xyz])([0-9]+)", re.IGNORECASE)  # x1
BEHIND = re.compile(r"(.+?)[_ .:](?:p(?:os|osition)?[_ .]?)?([xyz])", re.IGNORECASE)  # tip_x, tip_px
JOINED = re.compile(r"(.*[a-z\u00df-\u00ff0-9])([XYZ])|(.*[0-9\u3040-\u9fff])([xyzXYZ])")  # tipX, m0x
ONE_BODY = re.compile(r"(?:pos(?:ition)?|trans(?:lation)?|t|p)?[_ .]?([xyz])", re.IGNORECASE)  # without a station
BACK = re.compile(r"^([xyz])([bt])(?![a-z0-9])")  # xb, as bx
SHORT = re.compile(r"(?:(.+)[_ .:])?([a-z])([xyz])", re.IGNORECASE)  # bx, Port1_Tx
TIMES = {"t", "time", "timestamp", "time_stamp", "elapsed", "elapsed_time", "datetime", "date_time", "date", "clock",
         "zeit", "zeitstempel", "uhrzeit", "temps", "tiempo", "tempo", "tid", "tijd"}  # fmt: skip
A_SET_POINT = "a set point is read as the pressure:"  # beginning of the sentence on it
COUNTERS = {"millis": "ms", "micros": "us"}  # names of times that state their unit
ALONE = {"ms": "t_ms", "msec": "t_ms"}  # names of times where a table has no other, and no seconds beside them
TURN = re.compile(r"(?:(.+?)[_ .:]?)?(?:q|quat(?:ernion)?|rot(?:ation)?|ori|orientation|o)[_ .]?([xyzw0])",
                  re.IGNORECASE)  # fmt: skip
NUMBERED = {"0": "w"}  # q0 beside qx, qy and qz; q0 to q3 may be joint angles
BODY = "body"  # name of a single tracked body, where the names of its columns hold none
BRACKETED = re.compile(  # tip_x [mm], p [bar(g)], p (bar(g))
    r"(.+?)[\s_]*(?:\[\s*([^\[\]]+?)\s*\]|\(\s*([^()]+(?:\([^()]*\))?)\s*\))")
ENDING = re.compile(r"(.+)[_ ]([A-Za-z\u00b5\u03bc\u00b0]+)")  # tip_x_mm
CLOCK_FACE = re.compile(r"h*:?m+:s+(?:[.:,](?:m|s|f|0|x|u)+)?")  # hh:mm:ss.ms, how times are written
WORD = re.compile(r"[kMmh]Pa(?![a-z])|kN(?![a-z])|m[NAV](?![a-z])|[A-Z]{2,}(?![a-z])|"
                  r"[A-Z\u00c0-\u00de]?[a-z\u00df-\u00ff]+|[A-Z]|\d+|°|[^\W_\x00-\xff]+|[\u00c0-\u00de]")
LETTERS = set("afgoqvw")  # of quantities that are no positions
TORQUES = re.compile(r"(?:.* )?(?:fx fy fz tx ty tz|Fx Fy Fz Tx Ty Tz|FX FY FZ TX TY TZ)(?: .*)?")  # of a load cell
PERHAPS_A_PLACE = "tx, ty, tz of"  # beginning of the sentence on them
LOAD_OR_PLACE = ("fx", "fy", "fz", "tx", "ty", "tz")  # in lower case the last three may also be a place
LENGTHS, ANGLES = {*METRE, PIXEL}, {"angle", "angles", "theta", "flex"}  # units; words of tables of angles
WORDS = {"in", "atm"}  # units that are words as well: a name states them in brackets alone


class Renamed(NamedTuple):
    """Result of `standard_names`: new column names, the unit of length that the old ones state ("" for none), and a
    line for the history.
    """

    names: list[str]
    length_unit: str  # "" where no name states one
    findings: list[str]


def standard_names(names: list[str], file: str) -> Renamed:
    """Translate column names such as ``time_ms``, ``Pressure (mbar)`` or ``tip_x_mm`` to the standard names of a wide
    CSV.

    A name that matches no rule is kept. Names that would get the same standard name are kept too.

    Raises
    ------
    InputError
        When the position columns state different units of length, or only some of them state one.
    """
    written, plainly = names, Counter(map(as_written, names))
    names = [plain if plainly[plain := as_written(name)] == 1 else name for name in written]
    positions = {name: coordinate for name in names if (coordinate := _position(name))}
    positions = _of_one_spelling(positions)
    body, short = _one_body(names, positions), _short(names)
    positions = short if not positions and set(short) > set(body) else body or positions
    units = {unit for _, unit in positions.values()}
    if len(units) > 1:
        stated = ", ".join(sorted(unit or "no unit" for unit in units))
        raise InputError(f"{file} states several units of length in its column names ({stated}): convert the "
                         "columns to one unit")
    standard = {name: coordinate[0] for name, coordinate in positions.items()}
    standard |= _orientations(names, {new.partition("_")[2] for new in standard.values()})
    clocks = _clocks(names)
    standard |= {n: other for n in names if n not in standard and (other := clocks.get(n))}
    pressures = {n: other for n in names if n not in standard and (other := _pressure(n))}
    inside = {n: other for n, other in pressures.items() if not NOT_INSIDE.fullmatch(in_english(n))}
    standard |= inside or ({} if _perhaps_measured(filter(_says_pressure, set(names) - set(pressures))) else pressures)
    rest = [name for name in names if name not in standard]
    channels = _channels(rest, [*standard.values()])
    if not channels and not inside:
        commands = {} if positions or short else _set_points(rest, pressures)
        channels = commands or _channels(rest, [*standard.values()], PLAINLY_OUTSIDE)
    if not pressures and not channels and len(fluids := unitless_pressures(names)) == 1 and FLUID.fullmatch(fluids[0]):
        channels = {fluids[0]: "p_pa"}
    standard |= channels
    owners = Counter([*names, *(new for old, new in standard.items() if old != new)])
    changed = {old: new for old, new in standard.items() if old != new and owners[new] == 1}
    listed = [changed.get(n, n if n in standard else w) for n, w in zip(names, written, strict=True)]
    original = dict(zip(names, written, strict=True))
    findings = _sentence({original[n]: new for n, new in changed.items()}, units)
    findings += [f"{A_SET_POINT} {shown(original[n])} alone" for n in channels
                 if len(channels) == 1 and COMMAND.fullmatch(in_english(n))]  # fmt: skip
    return Renamed(listed, next(iter(units), ""), findings)


def parted(name: str, *, translated: bool = True) -> tuple[str, str]:
    """Split a column name such as ``tip_x_mm`` into the name without the unit, in lower case, and the unit ("" for
    none); `translated` into English, or as written.
    """
    said = in_english(name) if translated else as_written(name)
    words = [w for w in re.split(r"[\s_\[\]()]+", said.lower()) if w]
    words = [w for w in words if not CLOCK_FACE.fullmatch(w)] or words
    last = standard_unit(words[-1]) if words else ""
    if len(words) > 1 and any(last in units for units in UNITS):
        return "_".join(words[:-1]), last
    return "_".join(words), ""


def is_time(name: str) -> bool:
    """Return whether a column name denotes time, such as ``t``, ``time`` or ``timestamp``, with or without a unit."""
    return parted(name)[0] in TIMES or name.lower() in COUNTERS


def words_of(name: str) -> list[str]:
    """Return the words and numbers of a column name in lower case: servo_4_mm gives servo, 4, mm."""
    return written_words(in_english(name))


def written_words(name: str) -> list[str]:
    """Return the words and numbers of a column name in lower case, in the language of the file."""
    return [word.lower() for word in WORD.findall(as_written(name))]


def is_command(name: str) -> bool:
    """Return whether the name of a column says a set point, such as ``soll [kPa]`` or ``pTarget``."""
    return SET_POINT.fullmatch("_".join(words_of(name))) is not None


def is_no_place(words: Sequence[str]) -> bool:
    """Return whether a word, or two words in a row, of a column name say a quantity that is no measured position, such
    as velocity, force or target.
    """
    pairs = (f"{first}_{second}" for first, second in pairwise(words))
    return any(OTHERS.fullmatch(word) for word in (*words, *pairs))


def _sentence(changed: Mapping[str, str], units: Iterable[str]) -> list[str]:
    if not changed:
        return []
    old, new = next(iter(changed.items()))
    unit = "".join(f"; positions are in {unit}" for unit in units if unit)
    return [f"{len(changed)} column(s) are read under standard names, such as {shown(old)} as {shown(new)}{unit}"]


def _position(name: str) -> tuple[str, str] | None:
    """Return the standard name and the unit of a column of a station's coordinate, or None."""
    for bare, unit in (_without_unit(name, LENGTHS), (name, "")):  # tip_px is no name with a unit
        if match := BEFORE.fullmatch(bare) or COUNTED.fullmatch(bare):
            return f"{match[1].lower()}_{match[2]}", unit
        if match := BEHIND.fullmatch(bare) or JOINED.fullmatch(bare):
            owner, axis = [group for group in match.groups() if group]
            if re.split(r"[_ .:]", owner)[-1].lower() not in LETTERS and not is_no_place(words_of(owner)):
                return f"{axis.lower()}_{owner}", unit
    return None


def _of_one_spelling(positions: Mapping[str, tuple[str, str]]) -> dict[str, tuple[str, str]]:
    """Return the positions. Beside those such as x_tip, others such as stage_x are positions if their station has the
    same axes and the unit of these, or says base or tip.
    """
    before = {name: coordinate for name, coordinate in positions.items() if BEFORE.fullmatch(name)}
    axes, units = {new[0] for new, _ in before.values()}, {unit for _, unit in before.values()}
    count = Counter(new[1:] for name, (new, _) in positions.items() if name not in before)
    others = {name: (new, unit) for name, (new, unit) in positions.items() if name not in before
              and (not before or (count[new[1:]] == len(axes) and new[0] in axes
                                  and (says_end(new) or (unit and unit in units))))}  # fmt: skip
    return {name: coordinate for name, coordinate in positions.items() if name in before or name in others}


def _one_body(names: Iterable[str], others: Mapping[str, tuple[str, str]]) -> dict[str, tuple[str, str]]:
    """Return the standard names and units of the coordinates of a single body whose column names hold no name of it,
    such as ``x``, ``pos_y`` or ``tz [mm]``; empty where there are other positions, or not one of each coordinate.
    The name ``x_m`` is that of a station m.
    """
    parts = {name: _without_unit(name, LENGTHS) for name in names}
    bare = {name: (match[1].lower(), unit) for name, (word, unit) in parts.items()
            if (match := ONE_BODY.fullmatch(word)) and not name.lower().endswith("_m")}  # fmt: skip
    axes = sorted(axis for axis, _ in bare.values())
    if axes not in (["x", "y"], ["x", "y", "z"]) or set(others) - set(bare) or TORQUES.fullmatch(" ".join(names)):
        return {}
    return {name: (f"{axis}_{BODY}", unit) for name, (axis, unit) in bare.items()}


def _short(names: Iterable[str]) -> dict[str, tuple[str, str]]:
    """Return the standard names and units of the coordinates x, y and z of stations b, m and t, such as ``bx``, or that
    have the t of a translation before the axis, such as ``Port1_Tx`` of Port1; none where a table has angles.

    Letters also say moments, magnetic fields and torques: those of b, m and t are positions if they state a unit of
    length, or in lower case if both b and t are there, and those of a port if it has a quaternion or a unit.
    """
    parts = {name: (match[1] or "", match[2], match[3].lower(), unit) for name in names
             for word, unit in [_without_unit(BACK.sub(r"\2\1", name), LENGTHS)] if (match := SHORT.fullmatch(word))}
    count = Counter(part[:2] for part in parts.values())
    full = {name: part for name, part in parts.items() if count[part[:2]] == 3}
    letters = {letter for begin, letter, _, _ in full.values() if not begin}
    if any(ANGLES & {*words_of(name)} for name in names) or letters & {*"pP"}:
        return {}
    both = {"b", "t"} <= letters and not letters & {*"afgAFG"}
    turned = {match[1] for name in names if (match := TURN.fullmatch(name))}
    found = {name: (f"{axis}_{begin or letter}", unit) for name, (begin, letter, axis, unit) in full.items()
             if letter.lower() in ("t" if begin else "bmt")
             and (unit or (begin in turned if begin else both and letter.islower()))}  # fmt: skip
    return found if len({unit for _, unit in found.values()}) == 1 else {}


def _orientations(names: Iterable[str], stations: Collection[str]) -> dict[str, str]:
    """Return the standard names of the columns of quaternions, such as ``tip_qx`` or ``quat_w``, of stations of which
    the table has all four. The q0 beside qx, qy and qz is w.
    """
    turns = {name: (match[1] or BODY, NUMBERED.get(match[2], match[2].lower())) for name in names
             if (match := TURN.fullmatch(name))}  # fmt: skip
    count = Counter(station for station, _ in turns.values())
    return {name: f"q{axis}_{station}" for name, (station, axis) in turns.items()
            if station in stations and count[station] == 4 and not name.startswith(f"q{axis}_")}  # fmt: skip


def _clocks(names: Iterable[str]) -> dict[str, str]:
    """Return the standard names of the columns of time. Of a date beside a time, the time alone is one."""
    clocks = {}
    for name in names:
        unit = COUNTERS.get(name.lower(), parted(name)[1])
        if is_time(name) and unit in ("", *SECONDS):
            clocks[name] = f"t_{unit}" if unit not in ("", "s") else "t"
    known = {name: new for name, new in clocks.items()
             if parted(name, translated=False)[0] in TIMES or name.lower() in COUNTERS}  # fmt: skip
    clocks = known or clocks
    plain = {name: new for name, new in clocks.items() if parted(name)[0] not in ("date", "datetime", "date_time")}
    if not clocks and not any(PARTS["seconds"].fullmatch(name) for name in names):
        return {name: ALONE[name.lower()] for name in names if name.lower() in ALONE}
    return plain or clocks


def _pressure(name: str) -> str | None:
    bare, unit = _without_unit(name, PASCAL)
    match = PRESSURE.fullmatch(bare)
    if not match or not unit or ABSOLUTE.search(bare):
        return None
    chamber = match[1] or match[2]
    if chamber and AMBIENT.fullmatch(chamber):
        return None
    return f"p_{unit}_{chamber}" if chamber else f"p_{unit}"


def _channels(
    names: Iterable[str], known: Iterable[str], outside: re.Pattern[str] = NOT_INSIDE,
) -> dict[str, str]:
    """Return standard names of columns that only their unit identifies as pressures, such as ``P1 [kPa]``.

    A single such column becomes the only pressure, without a chamber name. Set points, supplies and atmospheric
    pressures, which `outside` names, are skipped: in English, or as written where other words say them.
    """
    said = in_english if outside is NOT_INSIDE else as_written
    inside = [name for name in names if not outside.fullmatch(said(name)) and not ABSOLUTE.search(name)]
    channels = {name: parts for name in inside if (parts := _without_unit(name, PASCAL))[1]}
    if len(channels) == 1 and not any(name.startswith("p_") for name in known):
        return {name: f"p_{unit}" for name, (_, unit) in channels.items()}
    return {name: f"p_{unit}_{bare}" for name, (bare, unit) in channels.items()}


def _set_points(names: Sequence[str], known: Collection[str]) -> dict[str, str]:
    """Return standard names of the set points with a unit of pressure of a log that holds no other pressure, such as
    ``soll [kPa]``; none where another column may hold the measured pressure. A reference may be that
    of a sensor.
    """
    if known or any(ABSOLUTE.search(name) for name in names) or _perhaps_measured(names):
        return {}
    commanded = {name: parts for name in names if COMMAND.fullmatch(in_english(name)) and not REFERENCE.search(name)
                 and (parts := _without_unit(name, PASCAL))[1]}  # fmt: skip
    return {name: f"p_{unit}" + f"_{bare}" * (len(commanded) > 1) for name, (bare, unit) in commanded.items()}


def _perhaps_measured(names: Iterable[str]) -> bool:
    """Return whether the name of a column other than a set point says that it may be a measured pressure."""
    return any(PRESSED.fullmatch(n) or PERHAPS_MEASURED.search(n)
               for n in map(in_english, names) if not COMMAND.fullmatch(n))  # fmt: skip


def _says_pressure(name: str) -> bool:
    """Return whether the name of a column says pressure, or has a unit of pressure."""
    said = in_english(name)
    return bool(PRESSED.fullmatch(said) or PRESSURE.fullmatch(said) or _without_unit(name, PASCAL)[1])


def unread_columns(names: Sequence[str], file: str, *, measured: bool = False) -> list[str]:
    """Return sentences for the history on columns that were left out and may be what a study needs, with the entry of
    a mapping that reads them: a place that may be the torques of a load cell, and a set point. With `measured`, a
    pressure is read, and set points are its commands.
    """
    said = []
    if {*LOAD_OR_PLACE} <= {*names}:
        said.append(f"{PERHAPS_A_PLACE} {file} are the torques of a load cell or the place of a body, and are not read:"
                    ' if a place, state stations = { tip = { position = ["tx", "ty", "tz"] } }, length_unit and the '
                    "pressure in its mapping")
    units = {name: _without_unit(name, PASCAL)[1] for name in names if COMMAND.fullmatch(in_english(name))}
    if measured:
        return said + [f"{shown(name)} of {file} is a set point by its name, and is not used beside measured pressure"
                       for name, unit in units.items() if unit]  # fmt: skip
    return said + [f"{shown(name)} of {file} is a set point by its name, and is not read: if nothing measured the "
                   f"pressure, state pressure = {{ columns = [{json.dumps(name)}], unit = {unit!r} }} in its mapping"
                   for name, unit in units.items() if unit]  # fmt: skip


def unitless_pressures(names: Iterable[str]) -> list[str]:
    """Return the names of columns that say pressure and no unit, such as ``pressure_left``; not those of set points,
    supplies and the atmosphere, nor those of temperatures beside others.
    """
    pressed = [name for name in names if PRESSED.fullmatch(name) and not NOT_INSIDE.fullmatch(name)]
    return [name for name in pressed if not {"temp", "temperature"} & {*words_of(name)}] or pressed


def pressures_named(names: Sequence[str], unit: str, file: str) -> tuple[list[str], list[str]]:
    """Return the column names of a table with standard names for the pressures without a unit, which are in `unit`, and
    a sentence for the history.

    Raises
    ------
    InputError
        When no name says pressure without a unit.
    """
    bare = unitless_pressures(names)
    if not bare:
        raise InputError(f"{file} has no column whose name says pressure and no unit: remove pressure_unit from its "
                         f"mapping, or name the columns by pressure = {{ columns = [...], unit = {unit!r} }}")
    parts = {name: re.sub(r"(?i)measured|pressure|[\W_]+$|^[\W_]+", "", name).strip("_ .") for name in bare}
    several = len(bare) > 1
    standard = {name: f"p_{unit.lower()}" + f"_{parts[name] or name}" * several for name in bare}
    finding = f"{len(bare)} column(s) are pressures in {unit}, as pressure_unit states, such as {shown(bare[0])}"
    return [standard.get(name, name) for name in names], [finding]


def _without_unit(name: str, units: Iterable[str]) -> tuple[str, str]:
    """Return a name without the unit at its end, and the unit ("" where it ends with none of `units`)."""
    name = as_written(name)
    if match := BRACKETED.fullmatch(name):
        unit = standard_unit(match[2] or match[3])
        return (match[1], unit) if unit in units else (name, "")
    match = ENDING.fullmatch(name)
    if match and (unit := standard_unit(match[2])) in units and match[2].lower() not in WORDS:
        return match[1], unit
    return name, ""


def unit_of(name: str, units: Iterable[str]) -> str:
    """Return which of the `units` the name of a column states at its end, in standard spelling; "" for none."""
    words = words_of(name)
    unit = _without_unit(name, units)[1] or (standard_unit(words[-1]) if len(words) > 1 else "")
    return unit if unit in units else ""


def bracketed_unit(name: str) -> str:
    """Return the unit that the name of a column states in brackets, in standard spelling; "" where there are none."""
    match = BRACKETED.fullmatch(as_written(name))
    return standard_unit(match[2] or match[3]) if match else ""


CLOCKS = {"t": "s", "t_s": "s", "t_ms": "ms", "t_us": "us", "t_ns": "ns", "t_min": "min", "t_h": "h"}
COARSE = ("t_min", "t_h")
SHAPES = ("stations", "points", "angles")


def completed(mapping: Mapping[str, Any], cells: Sequence[str], file: str) -> tuple[dict[str, Any], list[str]]:
    """Return the options of a table with the columns of its time and stations, where the mapping names none and the
    cells of its first row do, and sentences for the history.

    Stations are added if the mapping describes neither a shape nor a log, which has a time of its own.
    """
    options = dict(mapping)
    camera = options.get("camera")
    untimed = not {"time", "rate_hz"} & set(options) and not (isinstance(camera, Mapping) and "rate_hz" in camera)
    shapeless = not any(options.get(name) for name in SHAPES)
    alone = not untimed and (options.get("pressure") is not None or bool(options.get("inputs")))
    if any(map(holds_number, filter(None, cells))) or options.get("header") is False or not (untimed or shapeless):
        return options, []
    renamed = standard_names(list(cells), file)
    history = []
    if untimed:
        options = {**clock_of(renamed.names, cells), **options}
    if shapeless and not alone and (stations := stations_of(renamed.names, cells)):
        options["stations"] = stations
        if camera is None:
            refuse_pixels(renamed.length_unit, file)
            options.setdefault("length_unit", renamed.length_unit or "m")
        history.append(f"stations of {file} by the names of its columns: {', '.join(stations)}")
    return options, history


def refuse_pixels(unit: str, file: str) -> None:
    """Raise InputError if positions are in pixels, whose size nobody stated."""
    if unit == PIXEL:
        raise InputError(f"the positions of {file} are in pixels, as its columns say: state their scale in its "
                         "mapping, such as camera = { pixels_per_mm = 4.0 }")


def clock_of(names: Sequence[str], cells: Sequence[str]) -> dict[str, Any]:
    """Return the entries `time` and `time_unit` of a mapping for the column that the names say is the time; empty if
    there is none.
    """
    clock = next((k for k, name in enumerate(names) if name in CLOCKS), None)
    if clock is not None:
        return {"time": cells[clock], "time_unit": CLOCKS[names[clock]]}
    if parts := parted_clock(names):
        return {"time": (cells[parts.seconds], cells[parts.fraction]), "time_unit": parts.unit}
    return {}


def stations_of(names: Sequence[str], cells: Sequence[str]) -> dict[str, Any]:
    """Return the entry `stations` of a mapping for the columns whose standard names are coordinates of a station."""
    columns = dict(zip(names, cells, strict=True))
    stations: dict[str, Any] = {}
    for name in names:
        axis, _, station = name.partition("_")
        if axis != "x" or f"y_{station}" not in columns:
            continue
        label = f"s{station}" if station[0].isdigit() else station
        stations[label] = {"position": [columns[f"{a}_{station}"] for a in "xyz" if f"{a}_{station}" in columns]}
        turn = [columns[f"q{a}_{station}"] for a in "xyzw" if f"q{a}_{station}" in columns]
        stations[label] |= {"quaternion": turn} if len(turn) == 4 else {}
    return {label: stations[label] for label in base_to_tip([*stations])}
