"""Tables of a generated study file that describe the body, its position in the tracker's frame, its files, and the
model selection: which recordings train and judge, and what is always free.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr

from pliant.preprocessing.plausibility.pressure import ABSOLUTE, unloaded
from pliant.preprocessing.side import alignment_of
from pliant.recording.inputs import recorded_inputs
from pliant.study.column_guess import TableGuess
from pliant.study.draft_inputs import LINKS, can_be_slack, input_names
from pliant.study.draft_recordings import stated_load
from pliant.study.inspected import LATER, Inspected
from pliant.study.kinds import switched_on
from pliant.study.shorthand import OPEN
from pliant.study.toml_text import Lines
from pliant.study.trial import Trial, farthest, longest_rest

EARTH = 9.81  # m/s^2
NEARLY_PLANAR = 0.1  # out-of-plane fraction of the motion above which a comment is written
MINUTES = 5
FINE = 0.01  # of the largest rotation: steps of an angle that show how links differ
FIRST_SAMPLES = 3  # of an input in a rest, which show its level there
SAME_INPUT = 0.05  # of the widest range of an input of its kind: difference between inputs that count as the same
WAYS = {"along": "position of this station on its link", "across": "across it", "aside": "perpendicular to both"}


def camera(out: Lines, trials: Sequence[Trial]) -> None:
    """Write the [camera] table with open questions, if points are in pixels and no file states the scale."""
    assumed = [trial.assumed["camera"] for trial in trials if "camera" in trial.assumed]
    if not assumed:
        return
    out.table("camera")
    timed = "rate_hz" not in assumed[0]
    out.say(f"the points are in pixels: until you state {'this' if timed else 'these'}, "
            f"{'' if timed else '30 frames a second and '}1 pixel per mm {'is' if timed else 'are'} assumed below")
    if not timed:
        out.ask("rate_hz", "frames a second of the video")
    out.ask("pixels_per_mm", "or state scale, plane or board instead: see docs/your_own_data.md")


def mapping_table(out: Lines, inspected: Inspected) -> None:
    """Write the [mapping] table: the proposed columns of tables that nobody described, or open questions for the units
    of angle and pressure that no file states, and for the atmosphere in pressures that seem absolute.
    """
    if inspected.first.guess is not None:
        proposed_mapping(out, inspected, inspected.first.guess)
        return
    asked = {k for trial in inspected.trials for k in trial.assumed if k != "camera"}
    level = without_load(inspected.trials)
    if asked or level is not None:
        out.table("mapping")
    ask_offset(out, level)
    if asked:
        out.say("until you state these, degrees and kPa are assumed below")
    for name, known in (("angle_unit", "deg or rad"), ("pressure_unit", "gauge: kPa, bar, mbar, psi, Pa")):
        if name in asked:
            out.ask(name, known)


def ask_offset(out: Lines, level: float | None) -> None:
    """Write the open offset of a pressure that seems absolute and reads `level` [Pa] without load; None: no offset."""
    if level is None:
        return
    comment = (f"the pressure reads {level / 1e3:.4g} kPa without load: {-level / 1e3:.4g} subtracts the "
               "atmosphere, if it is absolute; 0.0 if it is gauge pressure")
    out.put("linear", {"pressure": {"offset": OPEN, "unit": "kPa"}}, comment)
    out.questions.append(f"offset: {comment}")


def proposed_mapping(out: Lines, inspected: Inspected, guess: TableGuess) -> None:
    """Write the proposed [mapping] table of tables that nobody described. The times of settled poses have no effect, so
    that nobody is asked for their rate.
    """
    out.table("mapping")
    out.say("proposed from names, units, ranges and integer steps of the columns: check it", *guess.notes)
    for name, value in guess.mapping.items():
        if name == "stations" or name in inspected.first.assumed or name in inspected.entries_apart:
            continue
        if name == "rate_hz" and inspected.poses and value == OPEN:
            out.put(name, 1.0, "the rows are settled poses, whose times have no effect")
        elif name in guess.questions:
            out.ask(name, guess.questions[name], None if value == OPEN else value, guess.questions[name])
        else:
            out.put(name, value)
    ask_offset(out, without_load(inspected.trials))
    out.questions += [f"{n}: {q}" for n, q in guess.questions.items() if guess.mapping[n] != OPEN]
    stations = guess.mapping.get("stations", {})
    out.table("mapping.stations") if stations else None
    for name, columns in stations.items():
        out.put(name, columns)


def without_load(trials: Sequence[Trial]) -> float | None:
    """Return the lowest pressure [Pa] without load of recordings whose only pressure seems absolute, although nothing
    states so; None for others, and where the mapping of the study has no offset to ask for.
    """
    if not all(may_be_offset(trial) for trial in trials):
        return None
    if not all(ABSOLUTE in trial.quality.doubts and "pressure" in trial.recording for trial in trials):
        return None
    return min(unloaded(trial.recording["pressure"].values.ravel()) for trial in trials)


def may_be_offset(trial: Trial) -> bool:
    """Return whether a recording has one pressure, in its own file and in a known unit, that nothing shifts or scales
    yet.
    """
    proposed = {} if trial.guess is None else trial.guess.mapping
    pressure = proposed.get("pressure", {})
    return (trial.log is None and len(trial.chambers) < 2 and "linear" not in {**(trial.mapping or {}), **proposed}
            and pressure.get("unit") != OPEN and not {"scale", "zero"} & set(pressure))  # fmt: skip


SWITCHES = {  # options of an alignment that are true where a recording needs them, and why
    "base_motion": "the base carries all stations along: its motion is an input of the model",
    "undo_jumps": "the orientation of a marker cluster jumps; jumps are counted and corrected",
}


def actuator(
    out: Lines, inspected: Inspected, length: float | None, mass: float | None, diameter: float | None = None
) -> None:
    """Write the [actuator] table: length, mass, diameter, number of links and tip mass."""
    out.table("actuator")
    trial, comment, question = inspected.first, "m, as you stated", "m, of the part that bends"
    if length is None and inspected.poses and not trial.dense:
        longest = farthest(inspected.trials)
        question += f": no pose shows the body at rest; the farthest reaches {longest:.3g} m" if longest else ""
    elif length is None and (rest := longest_rest(inspected.trials)) is not None:
        along = "along the stations" if trial.dense else "from base to tip at rest"
        length, comment = rest[0], f"m, {along} in {rest[1].path.name}: correct it if you measured it"
    if inspected.segments:
        out.put("segments", list(inspected.segments), "m, from the base on, as you stated; two links in each, "
                "or as segment_links = [...] states")  # fmt: skip
    else:
        out.ask("length", question, length, comment)
    out.ask("mass", "kg, of the part that bends: weigh it, or density times volume; stiffness, damping and torque scale"
            " with it",
            mass, "kg, as you stated")
    if diameter is not None:
        out.put("diameter", diameter, "m, outer, as you stated: used to check density, modulus and torque")
    else:
        out.propose("diameter", 0.03, "m, outer: remove the first # if you know it: for checks of density and modulus")
    if inspected.segments:
        out.put("joint_placement", "midsegment")
    elif one_angle(inspected):
        out.put("links", 3, "one angle shows no more than an even bend")
        out.put("joint_placement", "midsegment")
    elif trial.angles_only:
        out.propose("links", 2, "default: one for each angle, as many as angles can determine")
    elif not trial.dense and not trial.options and trial.recording.sizes["station"] == 1 and not trial.tendon_inputs:
        out.put("links", 3, "one tracked point shows no more than an even bend")
        out.put("joint_placement", "midsegment")
    elif not trial.dense:
        out.put("links", LINKS)
        out.put("joint_placement", "midsegment", "five links then have the frequency of a continuous beam to 1 %")
    out.propose("tip_mass", 0.006, "kg, a cap or a load at the tip: remove the first # if there is one")


def one_angle(inspected: Inspected) -> bool:
    """Return whether the recordings hold the angle of a single station, in a plane, and no positions; not where the
    angle is recorded in steps that hide what several links show beyond one.
    """
    return not inspected.space and all(
        t.angles_only and t.recording.sizes["station"] == 1
        and max(t.quality.step_deg.values(), default=0.0) <= FINE * t.peak_motion for t in inspected.trials)


def space_entry(out: Lines, inspected: Inspected) -> None:
    """Write the entry `space`, or a comment that proposes it, with the fraction of the motion that is out of its
    best-fit plane.
    """
    share = 100 * max(trial.out_of_plane for trial in inspected.trials)
    reason = f"{share:.0f} % of the motion is out of its best-fit plane"
    if inspected.space and inspected.first.angles_only:
        out.put("space", True, "the sensors show the direction of gravity in three axes")
    elif inspected.poses and inspected.space:
        out.put("space", True, "settled poses are modelled in space")
    elif inspected.space:
        out.put("space", True, f"{reason}; remove this line to model the motion in that plane alone")
    elif 0.01 * share > NEARLY_PLANAR and not inspected.first.angles_only:
        out.propose("space", True, f"{reason} and ignored: remove the first # for a study in space")


def weight(out: Lines, inspected: Inspected, gravity: Sequence[float] | None) -> None:
    """Write the entry for gravity: the stated value; an open question in space, where no body lies flat, or if the body
    is released, since its weight may drive the motion; otherwise a proposal as a comment.
    """
    trials = inspected.trials
    released = inspected.excited_by("release")
    stated = None if gravity is None else [float(g) for g in gravity]
    if stated is None and "gravity" in trials[0].recording:
        toward = trials[0].recording["gravity_constants"].values[0]
        vector = [round(float(g), 4) for g in EARTH * toward]
        out.put("gravity", vector, "m/s^2 in the base frame, as the mapping states its direction")
        return
    if stated is not None or released or (inspected.space and trials[0].recording.attrs["frame"] == "tracker"):
        reason = ": it moves the released body" if released else "; [0.0, 0.0, 0.0] if the weight has no effect"
        out.ask("gravity", f"m/s^2 in the axes of the tracker; {hanging(trials)}{reason}", stated,
                "m/s^2 in the axes of the tracker")
    else:
        axes = "m/s^2, x and y of the base frame, +y along the base" if trials[0].angles_only else \
            f"m/s^2 in the axes of the tracker; {hanging(trials)}"
        out.propose("gravity", down(trials) or [0.0, 0.0, -9.81],
                    f"{axes}; needed unless the body lies flat: remove the first #")  # fmt: skip


def down(trials: Sequence[Trial]) -> list[float] | None:
    """Return the gravity vector [m/s^2] of a body that hangs at rest, along the tracker's axis nearest to the base
    tangent or, if the base is unknown, to the direction from the first to the last station; None if a single point was
    tracked.

    For recordings of angles alone the direction is +y of the base frame.
    """
    if trials[0].angles_only:
        return [0.0, 9.81]
    aligned = [trial.aligned for trial in trials if trial.aligned is not None and "alignment" in trial.aligned.attrs]
    if aligned:
        tangent = np.array(alignment_of(aligned[0]).base_tangent)
    elif (position := trials[0].grouped["position"].values).shape[1] > 1:
        ends = np.nanmedian(position[:, [0, -1]], axis=0)
        tangent = ends[1] - ends[0]
    else:
        return None
    nearest = int(np.argmax(np.abs(tangent)))
    return [float(9.81 * np.sign(tangent[k])) if k == nearest else 0.0 for k in range(len(tangent))]


def hanging(trials: Sequence[Trial]) -> str:
    """Return the text of a comment with the gravity vector that holds if the body hangs at rest."""
    vector = down(trials)
    return "[0.0, 0.0, -9.81] if its z axis points up" if vector is None else f"{vector} if the body hangs at rest"


def fibre(out: Lines, trial: Trial, length: float | None) -> None:
    """Write the [fibre] table for a fibre whose tip is marked by a cap of known curvature."""
    out.table("fibre")
    out.say("the curvature of the end cap marks the tip; the base lies one body length before it along the fibre")
    out.ask("body_length", "m, of the body along the fibre", length, "m, as you stated")
    out.put("cap_curvature", float(trial.recording.attrs["cap_curvature"]), "1/m, as the file states")
    out.put("cap_length", float(trial.recording.attrs["cap_length"]), "m, as the file states")


def common_rest(out: Lines, inspected: Inspected) -> None:
    """Write the shift of several motions of markers under measured inputs to one rest position, if they rest under the
    same inputs; else propose it.
    """
    motions = all(kind.excitation == "trace" and not kind.poses for kind in inspected.kinds.values())
    if not (len(inspected.trials) > 1 and motions and inspected.first.recording.attrs["frame"] == "tracker"):
        return
    out.table("alignment")
    if rest_alike(inspected.trials):
        out.put("common_rest", True, "shifts all recordings, station by station, to where the first one rests")
    else:
        out.propose("common_rest", True, "if the body does not return exactly between recordings")


def rest_alike(trials: Sequence[Trial]) -> bool:
    """Return whether all recordings show the same stations, with the same load, each with a rest that its alignment
    used, and rest under the same inputs, within 5 % of the widest range of an input of this kind.
    """
    bodies = [t.aligned for t in trials if t.aligned is not None and "alignment" in t.aligned.attrs]
    if len(bodies) < len(trials) or any(switched_on(t) is not None for t in trials):
        return False
    stations, loads = {tuple(b["station"].values.tolist()) for b in bodies}, {stated_load(t) for t in trials}
    if len(stations) > 1 or len(loads) > 1 or OPEN in loads:
        return False
    first, *others = (resting_inputs(b) for b in bodies)
    ranges = dict[str, float]()
    for signal in (s for b in bodies for s in recorded_inputs(b)):
        wide = float(np.nanmax(signal.values) - np.nanmin(signal.values))
        ranges[signal.kind] = max(ranges.get(signal.kind, 0.0), wide)
    return bool(first) and all(
        other.keys() == first.keys()
        and all(abs(other[key] - value) <= SAME_INPUT * ranges[key[0]] for key, value in first.items())
        for other in others
    )


def resting_inputs(body: xr.Dataset) -> dict[tuple[str, str], float]:
    """Return the median [SI] of the first samples of each input of an aligned recording in its rest, at the end of
    which an input may rise already, by kind and name; NaN for one that was not sampled then.
    """
    start, stop = alignment_of(body).rest_s
    resting = dict[tuple[str, str], float]()
    for signal in recorded_inputs(body):
        during = signal.values[(signal.time >= start) & (signal.time <= stop)][:FIRST_SAMPLES]
        resting[signal.kind, signal.name] = float(np.nanmedian(during)) if np.isfinite(during).any() else np.nan
    return resting


def alignment(out: Lines, trial: Trial) -> None:
    """Write the [alignment] tables, which transform positions from the tracker's frame to the base frame."""
    if trial.recording.attrs["frame"] == "planar":
        if not trial.dense and trial.recording.sizes["station"] > 1:
            out.table("alignment.options")
            out.put("base", trial.base, "the recording is planar already; this station does not move and is not fitted")
        return
    if trial.stations:
        out.table("alignment.stations")
        out.say("each station combines the markers on one rigid part, by names or constant distances; base first,",
                "tip last")
        for name, markers in trial.stations.items():
            out.put(name, markers)
    out.table("alignment.options")
    if not trial.options:
        out.ask("origin", "[x, y, z] of the base, m, in the tracker's axes: no tracked station shows the base")
        out.ask("tangent", 'direction along the body at rest from its base, in these axes, as "+y" or [0.0, 1.0, 0.0]')
        out.say('if a station sits on the base, remove both and name it instead: base = "..."')
        return
    out.put("base", trial.options["base"])
    tangent = "base tangent from the first stations" if trial.dense else \
        "the axis nearest to the direction from base to tip; or state another" if "plane" in trial.options else \
        "from base to tip at rest; or state the body's axis in the tracker frame, e.g. \"+x\" or [1.0, 0.0, 0.0]"
    out.put("tangent", trial.options["tangent"], tangent)
    if "plane" in trial.options:
        out.put("plane", trial.options["plane"], "x axis of the base frame; azimuths count from it")
    for name in filter(trial.options.__contains__, SWITCHES):
        out.put(name, True, SWITCHES[name])
    if trial.problem:
        out.say(f"The alignment fails: {trial.problem}")
        out.questions.append(f"alignment: {trial.problem}")
    elif trial.aligned is not None:
        out.say(*[line for line in str(trial.aligned.attrs["history"]).splitlines()
                  if line.startswith(("aligned", "out of plane", "the plane is", "the base moved"))])


def reduction(out: Lines, inspected: Inspected) -> None:
    """Write the [reduction] table, by which a dense shape is approximated by links."""
    out.table("reduction")
    training = inspected.training()
    widest = max((t for t in inspected.trials if t.name in training), key=lambda trial: trial.peak_motion)
    out.put("recording", widest.name, "the recording that determines the links; of those of training it has the "
            "largest motion")  # fmt: skip
    out.put("links", LINKS, "as for a body with few stations; or remove this line: bound_mm then determines the number")
    out.put("bound_mm", 3.0, "the smallest number of links with a shape error below this in every frame")


def selection(out: Lines, inspected: Inspected) -> None:
    """Write the [model_selection] table: training and held-out recordings, time limit, and the parameters that are free
    in every model.
    """
    held_out, train = inspected.held_out(), inspected.training()
    out.table("model_selection")
    out.say("the training recordings choose the terms of the model (creep, friction, softening, ...): a term joins if",
            "parts of the recordings are then predicted better from the other parts")
    out.put("train", train)
    for name, other in inspected.copied.items():
        out.say(f"{name} is left out: {other} holds its frames, so that it cannot judge a model that {other} trains")
    if inspected.divided:
        out.put("held_out", [f"{name}{LATER}" for name in train], "the later poses of the file; the report judges how "
                "the model predicts them")
    elif held_out:
        out.put("held_out", held_out, "no part in the choice; the report judges how the model predicts this")
    else:
        out.say('to test the prediction, make one more recording and name it here: held_out = ["another"]')
    if one_angle(inspected):
        out.put("without", ["joints"], "all joints are alike: one angle does not show how they differ")
    out.put("minutes", MINUTES, "time limit: when it is reached, the best model so far is the result")
    if common := common_parameters(inspected):
        out.table("model_selection.common")
        out.say("part of every model, besides stiffness, damping and a torque of each input")
        for name, value, meaning in common:
            out.put(name, value, meaning)


def common_parameters(inspected: Inspected) -> list[tuple[str, Any, str]]:
    """Return (name, entry, comment) of the parameters that are part of every model: properties of the measurement, and
    the torques of a single pressure in space. Nothing moves between settled poses, so that their damping is held.

    The position of the last station is free for marker stations alone, not for dense shapes, planar recordings or free
    decays; of settled poses that of every station, since they do not show where it is on a straight body.
    """
    first = inspected.first
    released = all(kind.excitation == "release" for kind in inspected.kinds.values())
    common: list[tuple[str, Any, str]] = []
    if inspected.poses:
        common += [("damping", {"value": 1e-3, "free": False}, "N m s/rad, without effect on settled poses")]
    common += [(f"{name}.pretension", "free", "N, where it begins to pull; below 0 it hangs slack at displacement 0")
               for name in can_be_slack(inspected)]  # fmt: skip
    if inspected.space and not released and not input_names(inspected):
        common += [("torque_1", "free", "N m/Pa"),
                   ("gain_y", "free", "ratio of the torque about y to the torque about x")]
    if first.angles_only and inspected.excited_by("trace"):
        common += [("sensor_lag", "free", "s, time constant of the angle's sensor")]
    if first.dense or first.angles_only or first.recording.attrs["frame"] == "planar" or released:
        return common
    names = list(first.stations) or [str(s) for s in first.recording["station"].values]
    for name in names[:-1] if inspected.poses else []:
        if name != first.base or not first.options:
            common += [(f"{name}.{way}", "free", f"m, {meaning}: no pose shows the body at rest")
                       for way, meaning in WAYS.items()]  # fmt: skip
    tip = names[-1]
    common += [(f"{tip}.along", "free", "m, position of the last station on its link"),
               (f"{tip}.across", "free", "m, across it")]
    return common + ([(f"{tip}.aside", "free", "m, perpendicular to both")] if inspected.space else [])
