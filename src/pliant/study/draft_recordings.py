"""Tables [recordings] of a generated study file: file, mapping, stations, and what the kind of experiment needs."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from pliant.preprocessing.align import without_unseen
from pliant.preprocessing.quality import standing_stations
from pliant.preprocessing.rest import nearest_rest
from pliant.recording.typed_steps import held_sentences
from pliant.study.column_guess import TableGuess
from pliant.study.draft_inputs import channels
from pliant.study.inspected import DIVIDED, LATER, Inspected
from pliant.study.kinds import Kind, TrialOfDraft
from pliant.study.shorthand import OPEN
from pliant.study.toml_text import Lines, key, relative
from pliant.study.trial import Trial
from pliant.units import KILOGRAM

NEVER = "s: the body is never at rest; here it is nearest to it"
DIVISION: tuple[tuple[str, list[float] | None], ...] = (("", [0.0, DIVIDED]), (LATER, [DIVIDED, 1.0]))
GRAMS = re.compile(r"(?<![a-z0-9.])(\d+(?:\.\d+)?)[ _-]?(g|kg)(?![a-z0-9])", re.IGNORECASE)
LOADED = re.compile(r"(?:load|weight|mass)[ _-]?\d+", re.IGNORECASE)


def recordings(out: Lines, inspected: Inspected, folder: Path, level: float | None) -> None:
    """Write the tables of all files. Trials that a column of a file numbers have one table."""
    written = set()
    for trial in inspected.trials:
        if trial.file_name not in written:
            divided = inspected.divided and trial.name not in inspected.copied
            for ending, part in DIVISION if divided else (("", None),):
                recording(out, trial, inspected, folder, level, ending)
                if part:
                    out.put("part", part, "of the file's poses")
                channels(out, trial, inspected)
        written.add(trial.file_name)


def recording(
    out: Lines, trial: Trial, inspected: Inspected, folder: Path, level: float | None, ending: str = "",
) -> None:
    """Write the [recordings] table of one file, with a summary of its content and what its kind of experiment needs.
    `ending` is that of the table's name.
    """
    kind, candidate = inspected.kinds[trial.name], TrialOfDraft(trial, inspected.trials, level)
    out.table(f"recordings.{key(trial.file_name + ending)}")
    out.say(*content_of(trial), kind.evidence(candidate))
    out.put("file", relative(trial.path, folder))
    if trial.log is not None:
        out.put("pressure_file", relative(trial.log, folder), "its clock is synchronised with that of the shape")
        steps = bool(held_sentences(trial.recording))
        if options := {**(trial.log_mapping or {}), **({"hold": True} if steps else {})}:
            out.put("pressure_mapping", options, "typed steps, held until the next row; false: linear between"
                    if steps else "")  # fmt: skip
    if trial.guess is not None:
        if trial.guess.trials and trial.number is not None:
            column, numbers = trial.guess.trials
            out.put("select", {"column": column, "values": numbers}, "a recording for each trial")
        columns(out, trial.guess, inspected)
    elif trial.mapping:
        out.put("mapping", trial.mapping)
    if not (kind.poses and trial.options) and (moving := moving_beside(trial)) is not None:
        out.put("stations", moving, "the stations that move, tip last")
    kind.entries(out, candidate)
    payload(out, trial)
    if "rest" in trial.options:
        out.put("alignment", {"options": {"rest": trial.options["rest"]}}, why_rest(trial))
    elif (rest := stated_rest(trial, kind)) is not None:
        out.put("alignment", {"options": {"rest": rest}}, NEVER)


def columns(out: Lines, guess: TableGuess, inspected: Inspected) -> None:
    """Write the entries of a proposed mapping that this file alone has, or has in its own way."""
    mapping = {name: value for name, value in guess.mapping.items() if name in inspected.entries_apart}
    comment = "the columns of this file"
    stations, first = guess.mapping.get("stations"), inspected.first.guess
    if first is not None and stations != first.mapping.get("stations"):
        comment = comment if mapping else "the order of the stations in this file"
        mapping["stations"] = stations
    if mapping:
        out.put("mapping", mapping, comment)


def why_rest(trial: Trial) -> str:
    """Return the comment on a rest that the inspection of a recording chose."""
    late = int(np.argmax(np.isfinite(trial.grouped["position"].values).all(axis=(1, 2))))
    if late:
        return f"s: not all stations are labelled in the first {late} frames, the rest before"
    return NEVER if nearest_rest(trial.grouped) else \
        "s: the motion begins at once, and every later rest is one under pressure"


def content_of(trial: Trial) -> list[str]:
    """Return the lines on the content of a file; none on pressures whose unit is an open question."""
    lines = trial.quality.summary().splitlines()
    unknown = "pressure_unit" in trial.assumed or (
        trial.guess is not None and bool({"pressure", "pressure_unit"} & set(trial.guess.questions)))
    return [line for line in lines if not (unknown and line.startswith("pressure "))]


def payload(out: Lines, trial: Trial) -> None:
    """Write the additional mass at the tip that the name of the file states, such as 100g, or ask for its unit if the
    name states a number alone, such as load52.
    """
    name, mass, meaning = trial.path.stem, stated_load(trial), "kg, additional mass at the tip: the name of the file"
    if mass == OPEN:
        out.put("known", {"tip_mass": OPEN}, f"{meaning} is {name}; 0 for none")
        out.questions.append("tip_mass: kg, additional mass at the tip that the name of a file states")
    elif mass:
        out.put("known", {"tip_mass": mass}, f"{meaning} is {name}")


def stated_load(trial: Trial) -> float | str:
    """Return the additional mass at the tip [kg] that the name of the file states, such as 100g; "?" if it states a
    number alone, such as load52; 0 if none.
    """
    if stated := GRAMS.search(trial.path.stem):
        return float(stated[1]) * KILOGRAM[stated[2].lower()]
    return OPEN if LOADED.search(trial.path.stem) else 0.0


def stated_rest(trial: Trial, kind: Kind) -> list[float] | None:
    """Return the time [start, end] [s] to take as that of rest, if the base was not tracked and the body is never at
    rest. None if the run finds a rest itself.
    """
    if trial.options or trial.angles_only or kind.poses or trial.recording.attrs["frame"] != "tracker":
        return None
    return nearest_rest(trial.grouped)


def moving_beside(trial: Trial) -> list[str] | None:
    """If some stations besides the base stand still, or no station is the base, return the names of the stations that
    move; otherwise None.
    """
    if not trial.options and not trial.angles_only and trial.recording.attrs["frame"] == "tracker":
        names = list(trial.stations) or [str(s) for s in without_unseen(trial.recording)["station"].values]
        return names if len(names) > 1 else None
    if trial.dense or trial.angles_only or trial.aligned is None:
        return None
    names = [str(s) for s in trial.aligned["station"].values if str(s) != trial.base]
    still = set(standing_stations(trial.aligned)) & set(names)
    return [n for n in names if n not in still] if 0 < len(still) < len(names) else None
