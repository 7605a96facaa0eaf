"""Generation of the text of a first study file: entries with units and reasons, and a "?" for each open question."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypedDict, Unpack

import numpy as np

from pliant.errors import InputError
from pliant.options import with_defaults
from pliant.preprocessing.alignment import alignment_of
from pliant.preprocessing.plausibility import Case
from pliant.preprocessing.plausibility.together import beside
from pliant.preprocessing.quality import standing_stations
from pliant.recording.typed_steps import held_sentences
from pliant.study.doubts import body_warnings
from pliant.study.draft_inputs import (
    LINKS,
    chambers,
    chambers_in_plane,
    channels,
    driven,
    first_aligned,
    tendons,
)
from pliant.study.draft_selection import selection, spatial_study
from pliant.study.first_reading import with_logs
from pliant.study.toml_text import Lines, key, relative
from pliant.study.trial import (
    Trial,
    body_length,
    excitation,
    from_one_side,
    in_space,
    inspect_trial,
    moved,
)

NEARLY_PLANAR = 0.1  # out-of-plane fraction of the motion above which a comment is written


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
    """

    text: str
    questions: tuple[str, ...]
    doubts: tuple[str, ...] = ()


class StatedBody(TypedDict, total=False):
    """The properties of a body that the user states.

    Attributes
    ----------
    length, mass, diameter : float, optional
        Length [m], mass [kg] and outer diameter [m].
    gravity : 3 floats, optional
        Gravity in the axes of the tracker [m/s^2].
    """

    length: float | None
    mass: float | None
    diameter: float | None
    gravity: Sequence[float] | None


UNKNOWN = StatedBody(length=None, mass=None, diameter=None, gravity=None)


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
    trials = inspect_all(files, mapping, space)
    names = [trial.name for trial in trials]
    if not names or len(set(names)) < len(names):
        raise InputError(f"a study needs recordings with different file names, got {', '.join(names) or 'none'}")
    first, title, out = trials[0], Path(study).stem, Lines()
    out.say('Written by `pliant new` from the files. Replace each "?" with the value that only you know.',
            "docs/studies.md explains every entry. Units are SI, unless the name of an entry states another unit.")
    case = Case(length=length, mass=mass, diameter=diameter, gravity=tuple(gravity or ()) or None)
    doubts = trial_doubts(trials, case)
    out.say(*(f"! {line}" for line in doubts))
    out.put("name", title)
    out.put("title", title.replace("_", " "))
    camera(out, trials)
    units(out, trials)
    actuator(out, first, length, mass, diameter)
    space_entry(out, trials)
    weight(out, trials, gravity)
    if first.capped:
        fibre(out, first, length)
    elif not first.angles_only:
        alignment(out, first)
    if first.dense:
        reduction(out, trials)
    if spatial_study(trials):
        chambers(out, first_aligned(trials))
    else:
        chambers_in_plane(out, trials)
    tendons(out, first_aligned(trials))
    for trial in trials:
        recording(out, trial, Path(study).parent, level)
        channels(out, trial, driven(trials))
    selection(out, trials)
    out.table("targets")
    out.say("limits that the report compares the predictions with; remove a line to leave that number unjudged")
    out.put("rmse_percent_of_travel", 5.0)
    return Draft("\n".join(out.text) + "\n", tuple(dict.fromkeys(out.questions)), doubts)


def inspect_all(
    files: Sequence[str | Path], mapping: Mapping[str, Any] | None, space: bool | None
) -> list[Trial]:
    """Read the files and return each inspected recording, all aligned in the plane or all in space.

    With `space=None` they are aligned in space if one of them moves in space or is driven by tendons.
    """
    pairs = with_logs([Path(f) for f in files])
    trials = [inspect_trial(shape, mapping, log) for shape, log in pairs]
    spatial = any(trial.spatial or trial.tendon_inputs for trial in trials) if space is None else space
    if spatial:
        return [in_space(trial) for trial in trials]
    return from_one_side(trials) if len(driven(trials)) > 1 else trials


def space_entry(out: Lines, trials: Sequence[Trial]) -> None:
    """Write the entry `space`, or a comment that proposes it, with the fraction of the motion that is out of its
    best-fit plane.
    """
    share = 100 * max(trial.out_of_plane for trial in trials)
    reason = f"{share:.0f} % of the motion is out of its best-fit plane"
    if spatial_study(trials):
        out.put("space", True, f"{reason}; remove this line to model the motion in that plane alone")
    elif 0.01 * share > NEARLY_PLANAR and not trials[0].angles_only:
        out.say(f"space = true  ({reason} and ignored: remove the # for a study in space)")


def trial_doubts(trials: Sequence[Trial], case: Case) -> tuple[str, ...]:
    """Return the warnings about the recordings and the body, without duplicates."""
    warnings: dict[str, str] = {}
    for trial in trials:
        doubts = trial.quality.doubts
        warnings |= {f"{trial.name} {check}": f"{trial.path.name}: {line}" for check, line in doubts.items()}
        for check, line in body_warnings(case, trial.grouped, trial.aligned if trial.has_scale else None).items():
            warnings.setdefault(check, line)
    return (*warnings.values(), *beside({trial.name: trial.aligned for trial in trials if trial.aligned is not None}))


def camera(out: Lines, trials: Sequence[Trial]) -> None:
    """Write the [camera] table with open questions, if points are in pixels and no file states the scale."""
    if not any("camera" in trial.assumed for trial in trials):
        return
    out.table("camera")
    out.say("the points are in pixels: until you state these, 30 frames a second and 1 pixel per mm are assumed below")
    out.ask("rate_hz", "frames a second of the video")
    out.ask("pixels_per_mm", "or state scale, plane or board instead: see docs/your_own_data.md")


def units(out: Lines, trials: Sequence[Trial]) -> None:
    """Write the [mapping] table with open questions for the units of angle and pressure that no file states."""
    asked = {k for trial in trials for k in trial.assumed if k != "camera"}
    if not asked:
        return
    out.table("mapping")
    out.say("until you state these, degrees and kPa are assumed below")
    for name, known in (("angle_unit", "deg or rad"), ("pressure_unit", "gauge: kPa, bar, mbar, psi, Pa")):
        if name in asked:
            out.ask(name, known)


def actuator(
    out: Lines, trial: Trial, length: float | None, mass: float | None, diameter: float | None = None
) -> None:
    """Write the [actuator] table: length, mass, diameter, number of links and tip mass."""
    out.table("actuator")
    comment = "m, as you stated"
    if length is None and (length := body_length(trial)) is not None:
        along = "along the stations" if trial.dense else "from base to tip at rest"
        comment = f"m, {along} in {trial.path.name}: correct it if you measured it"
    out.ask("length", "m, of the part that bends", length, comment)
    out.ask("mass", "kg, of the part that bends: weigh it, or density times volume; stiffness, damping and torque scale"
            " with it",
            mass, "kg, as you stated")
    if diameter is not None:
        out.put("diameter", diameter, "m, outer, as you stated: used to check density, modulus and torque")
    else:
        out.say("diameter = 0.03  (m, outer: remove the # if you know it; used to check density, modulus and torque)")
    if trial.angles_only:
        out.say("links = 2  (default: one for each angle, as many as angles can determine)")
    elif not trial.dense:
        out.put("links", LINKS)
        out.put("joint_placement", "midsegment", "five links then have the frequency of a continuous beam to 1 %")
    out.say("tip_mass = 0.006  (kg, a cap or a load at the tip: remove the # if there is one)")


def weight(out: Lines, trials: Sequence[Trial], gravity: Sequence[float] | None) -> None:
    """Write the entry for gravity: the stated value; an open question if the body is released, since its weight may
    drive the motion; otherwise a proposal as a comment.
    """
    released = any(excitation(trial) == "release" for trial in trials)
    if released or gravity is not None:
        out.ask("gravity", f"m/s^2 in the axes of the tracker; {hanging(trials)}: it moves the released body",
                None if gravity is None else [float(g) for g in gravity], "m/s^2 in the axes of the tracker")
    else:
        axes = "m/s^2, x and y of the base frame, +y along the base" if trials[0].angles_only else \
            f"m/s^2 in the axes of the tracker; {hanging(trials)}"
        out.say(f"gravity = {down(trials)}  ({axes}; needed unless the body lies flat)")


def down(trials: Sequence[Trial]) -> list[float]:
    """Return the gravity vector [m/s^2] of a body that hangs at rest, along the tracker's axis nearest to the base
    tangent.

    For recordings of angles alone the direction is +y of the base frame.
    """
    if trials[0].angles_only:
        return [0.0, 9.81]
    aligned = [trial.aligned for trial in trials if trial.aligned is not None and "alignment" in trial.aligned.attrs]
    tangent = np.array(alignment_of(aligned[0]).base_tangent if aligned else [0.0, 0.0, -1.0])
    nearest = int(np.argmax(np.abs(tangent)))
    return [float(9.81 * np.sign(tangent[k])) if k == nearest else 0.0 for k in range(len(tangent))]


def hanging(trials: Sequence[Trial]) -> str:
    """Return the text of a comment with the gravity vector that holds if the body hangs at rest."""
    return f"{down(trials)} if the body hangs at rest"


def fibre(out: Lines, trial: Trial, length: float | None) -> None:
    """Write the [fibre] table for a fibre whose tip is marked by a cap of known curvature."""
    out.table("fibre")
    out.say("the curvature of the end cap marks the tip; the base lies one body length before it along the fibre")
    out.ask("body_length", "m, of the body along the fibre", length, "m, as you stated")
    out.put("cap_curvature", float(trial.recording.attrs["cap_curvature"]), "1/m, as the file states")
    out.put("cap_length", float(trial.recording.attrs["cap_length"]), "m, as the file states")


def alignment(out: Lines, trial: Trial) -> None:
    """Write the [alignment] tables, which transform positions from the tracker's frame to the base frame."""
    if trial.recording.attrs["frame"] == "planar":
        if not trial.dense and trial.recording.sizes["station"] > 1:
            out.table("alignment.options")
            out.put("base", trial.base, "the recording is planar already; this station does not move and is not fitted")
        return
    if trial.stations:
        out.table("alignment.stations")
        out.say("each station combines the markers on one rigid part, grouped by their names; base first, tip last")
        for name, markers in trial.stations.items():
            out.put(name, markers)
    out.table("alignment.options")
    if not trial.options:
        out.ask("origin", "[x, y, z] of the base, m, in the tracker's axes: one tracked station does not show the base")
        out.ask("tangent", 'direction along the body at rest from its base, in these axes, as "+y" or [0.0, 1.0, 0.0]')
        return
    out.put("base", trial.options["base"])
    tangent = "base tangent from the first stations" if trial.dense else \
        "from base to tip at rest; or state the body's axis in the tracker frame, e.g. \"+x\" or [1.0, 0.0, 0.0]"
    out.put("tangent", trial.options["tangent"], tangent)
    if "undo_jumps" in trial.options:
        out.put("undo_jumps", True, "the orientation of a marker cluster jumps; jumps are counted and corrected")
    if trial.problem:
        out.say(f"The alignment fails: {trial.problem}")
        out.questions.append(f"alignment: {trial.problem}")
    elif trial.aligned is not None:
        out.say(*[line for line in str(trial.aligned.attrs["history"]).splitlines()
                  if line.startswith(("aligned", "out of plane", "the plane is", "the base moved"))])


def reduction(out: Lines, trials: Sequence[Trial]) -> None:
    """Write the [reduction] table, by which a dense shape is approximated by links."""
    out.table("reduction")
    widest = max(trials, key=lambda trial: trial.peak_motion)
    out.put("recording", widest.name, "the recording that determines the links; it has the largest motion")
    out.put("bound_mm", 3.0, "the smallest number of links with a shape error below this in every frame is used")
    out.say("links = 5  (use this instead of bound_mm to set the number of links yourself)")


def recording(out: Lines, trial: Trial, folder: Path, level: float | None) -> None:
    """Write the [recordings] table of one file, with a summary of its content and its excitation."""
    out.table(f"recordings.{key(trial.name)}")
    out.say(*trial.quality.summary().splitlines())
    out.put("file", relative(trial.path, folder))
    if trial.log is not None:
        out.put("pressure_file", relative(trial.log, folder), "its clock is synchronised with that of the shape")
        if held_sentences(trial.recording):
            out.put("pressure_mapping", {"hold": True}, "typed steps, held until the next row; false: linear between")
    if trial.mapping:
        out.put("mapping", trial.mapping)
    if (moving := moving_beside(trial)) is not None:
        out.put("stations", moving, f"the stations that move, tip last; the others do not move, like {trial.base}")
    kind, when = excitation(trial), moved(trial)
    if kind == "release":
        out.put("excitation", "release", "no pressure, and the body does not return: taken as free decay after release"
                + (f" ({when})" if when else ""))
        out.say('if a pressure moved the body, use these instead: nominal_pressure = 20.0 and pressure_unit = "kPa"')
    elif kind in ("pulse", "step"):
        edges = "a pulse is assumed, its edges" if kind == "pulse" else "a step is assumed, its start"
        out.say(f"the pressure was not recorded: {edges} estimated from the motion and fitted"
                + (f" ({when})" if when else ""))
        if kind == "step":
            out.put("excitation", "step", "the body does not return, so the end of the pulse was not recorded")
        stated = level is not None
        value, origin = (level, "as you stated") if stated else (trial.highest_pa, "from the name of the file")
        out.ask("nominal_pressure", f"kPa gauge, the pressure level of the {kind} in {trial.path.name}",
                None if value is None else value / 1e3, origin)
        out.put("pressure_unit", "kPa")


def moving_beside(trial: Trial) -> list[str] | None:
    """If some stations besides the base stand still, return the names of the stations that move; otherwise None."""
    if trial.dense or trial.angles_only or trial.aligned is None:
        return None
    names = [str(s) for s in trial.aligned["station"].values if str(s) != trial.base]
    still = set(standing_stations(trial.aligned)) & set(names)
    return [n for n in names if n not in still] if 0 < len(still) < len(names) else None
