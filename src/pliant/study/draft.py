"""Generation of the text of a first study file: entries with units and reasons, and a "?" for each open question."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypedDict, Unpack

from pliant.options import with_defaults
from pliant.preprocessing.plausibility import Case
from pliant.preprocessing.plausibility.pressure import ABSOLUTE
from pliant.preprocessing.plausibility.together import copies, exchanged
from pliant.recording.column_names import words_of
from pliant.recording.columns import CHANGING
from pliant.recording.inputs import recorded_inputs
from pliant.recording.schema import history_of
from pliant.recording.stated import WARNING
from pliant.study.doubts import body_warnings
from pliant.study.draft_check import DraftCheck, check_draft
from pliant.study.draft_inputs import inputs
from pliant.study.draft_recordings import recordings
from pliant.study.draft_tables import (
    actuator,
    alignment,
    camera,
    common_rest,
    fibre,
    mapping_table,
    reduction,
    selection,
    space_entry,
    weight,
    without_load,
)
from pliant.study.first_reading import UNUSED
from pliant.study.inspected import Inspected, inspect_all
from pliant.study.toml_text import Lines
from pliant.study.trial import Trial

TIMES = "unit of time"  # name of a check of plausibility


@dataclass(frozen=True)
class Draft:
    """A generated study file with its open questions and warnings.

    Attributes
    ----------
    text : str
        Content of the study file, TOML.
    questions : tuple of str
        Values that only the user knows; each is marked "?" in the text.
    doubts : tuple of str
        Warnings about recordings or body that look wrong; each is also a comment in the text.
    inspected : Inspected or None
        The recordings as they were inspected.
    check : DraftCheck or None
        What a check of the study showed; None if it was not checked.
    """

    text: str
    questions: tuple[str, ...]
    doubts: tuple[str, ...] = ()
    inspected: Inspected | None = field(default=None, repr=False)
    check: DraftCheck | None = None


class StatedBody(TypedDict, total=False):
    """The properties of a body that the user states.

    Attributes
    ----------
    length, mass, diameter : float, optional
        Length [m], mass [kg] and outer diameter [m].
    segments : sequence of float, optional
        Lengths of segments that differ [m], from the base on, instead of `length`.
    gravity : 3 floats, optional
        Gravity in the axes of the tracker [m/s^2].
    """

    length: float | None
    mass: float | None
    diameter: float | None
    segments: Sequence[float] | None
    gravity: Sequence[float] | None


UNKNOWN = StatedBody(length=None, mass=None, diameter=None, segments=None, gravity=None)


def draft_study(
    files: Sequence[str | Path], study: str | Path, *, mapping: Mapping[str, Any] | None = None,
    level: float | None = None, space: bool | None = None, **body: Unpack[StatedBody],
) -> Draft:
    """Read recordings of one actuator and return the text of a study file for them. No file is written.

    Parameters
    ----------
    files : sequence of str or Path
        Recordings of the same actuator in the same set-up. A file that holds pressure alone is joined to the recording
        whose name its own name begins with.
    study : str or Path
        Path of the study file to be. File names in the study are relative to its folder.
    mapping : dict, optional
        Columns and units that the files do not state; see `pliant.read`.
    level : float, optional
        Nominal gauge pressure of recordings without a measured pressure [Pa].
    space : bool, optional
        Whether the body moves in space (True) or bends in a plane (False). Default: as the recordings show.
    **body
        Known properties of the body; see `StatedBody`.

    Returns
    -------
    Draft

    Raises
    ------
    InputError
        When a file cannot be read or holds no positions, or two files share a name.
    """
    stated = with_defaults(draft_study, body, UNKNOWN)
    length, mass, diameter, gravity = stated["length"], stated["mass"], stated["diameter"], stated["gravity"]
    segments = tuple(stated["segments"] or ())
    length = sum(segments) or length
    inspected = replace(inspect_all(files, mapping, space), segments=segments)
    trials, first, title, out = inspected.trials, inspected.first, Path(study).stem, Lines()
    out.say('Written by `pliant new` from the files. Replace each "?" with the value that only you know.',
            "docs/studies.md explains every entry. Units are SI, unless the name of an entry states another unit.")
    case = Case(length=length, mass=mass, diameter=diameter, gravity=tuple(gravity or ()) or None)
    doubts = trial_doubts(inspected, case)
    out.say(*(f"! {line}" for line in doubts))
    out.put("name", title)
    out.put("title", title.replace("_", " "))
    camera(out, trials)
    mapping_table(out, inspected)
    actuator(out, inspected, length, mass, diameter)
    space_entry(out, inspected)
    weight(out, inspected, gravity)
    if first.capped:
        fibre(out, first, length)
    elif not first.angles_only:
        common_rest(out, inspected)
        alignment(out, first)
    if first.dense:
        reduction(out, inspected)
    inputs(out, inspected)
    recordings(out, inspected, Path(study).parent, level)
    selection(out, inspected)
    out.table("targets")
    out.say("limits that the report compares the predictions with; remove a line to leave that number unjudged")
    out.put("rmse_percent_of_travel", 5.0)
    return Draft("\n".join(out.text) + "\n", tuple(dict.fromkeys(out.questions)), doubts, inspected)


def checked(draft: Draft, study: str | Path) -> Draft:
    """Try a drafted study as a run would, and return the draft with what this shows in the first lines of its text: a
    forecast of the time that a run takes, or why it cannot be run yet. No file is written.

    Parameters
    ----------
    draft : Draft
        As `draft_study` returns it.
    study : str or Path
        Path of the study file to be.
    """
    if draft.inspected is None:
        return draft
    check = check_draft(draft.text, Path(study).parent, draft.inspected)
    head, _, rest = draft.text.partition("\nname = ")
    lines = textwrap.wrap(sentence(check), 140, subsequent_indent="  ", break_long_words=False,
                          break_on_hyphens=False)  # an indented line is no entry once its # is removed
    text = "\n".join([head, *(f"# {line}" for line in lines)]) + f"\nname = {rest}"
    return replace(draft, text=text, check=check)


def sentence(check: DraftCheck) -> str:
    """Return a sentence on what a check of the study showed."""
    entries = ", ".join(dict.fromkeys(name.rpartition(".")[2] for name in check.assumed))
    assumed = f"with assumed values for {entries}" if entries else "as it is"
    if check.problem or check.seconds is None:
        return f"! Tried {assumed}, this study cannot be run: {check.problem}"
    minutes = check.seconds / 60
    size = f"{max(1, round(check.seconds, -1 if check.seconds > 20 else 0)):.0f} s" if minutes < 2 else \
        f"{minutes:.0f} minutes"
    lost = f" ! {len(check.dropped)} recording(s) are left out: {'; '.join(check.dropped)}." if check.dropped else ""
    return f"Tried {assumed}, this study can be run. Forecast of the time of a run: {size}.{lost}"


def unexplained(trial: Trial) -> list[str]:
    """Return a warning if a recording has no inputs, and its file has further columns that change, or arrays, topics or
    channels that were not read: one of them may be what moves the body.
    """
    if recorded_inputs(trial.recording) or trial.asks_inputs:
        return []
    return [f"{line}; if one of them moves the body, name it as pressure or inputs in a mapping"
            for line in history_of(trial.recording) if line.startswith(CHANGING) or UNUSED.match(line)]


def several_bases(trial: Trial) -> dict[str, str]:
    """Return a warning if stations of several bodies say base, as armA_base and armB_base do, but not base_1 and 2."""
    bases = {re.sub(r"base[\W_]*\d*|[\W_]+", "", name.lower()): name for name in trial.names
             if "base" in words_of(name)}  # fmt: skip
    said = (f"{' and '.join(bases.values())} say base: if they are on two bodies, state the stations of one in each "
            "recording, and correct the length")  # fmt: skip
    return {"several bases": said} if len(bases) > 1 else {}


def trial_doubts(inspected: Inspected, case: Case) -> tuple[str, ...]:
    """Return the warnings about the recordings and the body, without duplicates; not on the times of settled poses,
    which have no effect.
    """
    trials, warnings = inspected.trials, dict[str, str]()
    asked = {ABSOLUTE} if without_load(trials) is not None else set()
    for trial in trials:
        left = {*asked, *([TIMES] if inspected.kinds[trial.name].poses else [])}
        doubts = {check: line for check, line in trial.quality.doubts.items() if check not in left}
        warnings |= {f"{trial.name} {check}": f"{trial.path.name}: {line}" for check, line in doubts.items()}
        known = case if trial.has_scale else replace(case, length=None)
        for check, line in body_warnings(known, trial.grouped, trial.aligned if trial.has_scale else None).items():
            warnings.setdefault(check, line)
    warnings |= several_bases(inspected.first)
    warnings |= {f"{trial.name} {CHANGING}": line for trial in trials for line in unexplained(trial)}
    warnings |= {f"{trial.name} {line}": f"{trial.path.name}: {line.removeprefix(WARNING)}" for trial in trials
                 if trial.angles_only for line in history_of(trial.recording) if line.startswith(WARNING)}
    aligned = {trial.name: trial.aligned for trial in trials if trial.aligned is not None}
    return (*warnings.values(), *copies({trial.name: trial.recording for trial in trials}), *exchanged(aligned))
