"""Tables of a generated study file for the chambers and tendons that the motion shows, and for the channels that drive
them.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from itertools import combinations

import numpy as np
import xarray as xr

from pliant.preprocessing.detectors import without_spikes
from pliant.recording.column_names import A_SET_POINT, is_command, words_of
from pliant.recording.inputs import RecordedInput, inputs_at, recorded_inputs
from pliant.recording.schema import history_of
from pliant.study.first_reading import several
from pliant.study.input_guess import UNITS
from pliant.study.inspected import Inspected
from pliant.study.kinds import levels_by_name, named_kind
from pliant.study.shorthand import OPEN
from pliant.study.tendon_ends import end_of_bend, ends_of_held_tendons, even_bend
from pliant.study.toml_text import Lines
from pliant.study.trial import Trial, body_length

LINKS = 5
LINE_STIFFNESS = 1000.0  # N/m
STIFF_LINE = ("N/m, tendon with its mounts, assumed and never fitted: under a displacement the motion shows only "
              "ratios of stiffnesses")
OF_ONE_SEGMENT = 4  # tendons; more bend several segments, and end at different positions along the body
FEWEST_SHOWING = 3  # stations with the base: so few can always be explained by the bend of some part
MUCH_BETTER = 0.5  # a bend of a part is used if its squared error is below this fraction of an even bend's
TOGETHER = 0.1  # singular values below this fraction of the largest: the inputs were driven together
EITHER_WAY = 0.1  # an input that falls below minus this fraction of its maximum has both signs


def inputs(out: Lines, inspected: Inspected) -> None:
    """Write the chambers and tendons of the body."""
    if not all(kind.measured for kind in inspected.kinds.values()) and inspected.poses:
        inputs_of_poses(out, inspected)
    elif inspected.space:
        chambers(out, inspected)
        tendons(out, inspected)
    else:
        chambers_in_plane(out, inspected)


def input_names(inspected: Inspected) -> list[str]:
    """Return the names of the model's inputs; [] for a single pressure, which has no name."""
    if inspected.poses and not inspected.driven.tendon_inputs and not inspected.channels:
        return list(levels_by_name(inspected.trials)[inspected.first.name])
    return [*inspected.channels, *inspected.tendons.values()]


def inputs_of_poses(out: Lines, inspected: Inspected) -> None:
    """Write the inputs of settled poses that the names of the files state, as chambers if they are pressures."""
    levels = levels_by_name(inspected.trials).values()
    known = all(value != OPEN for pose in levels for value in pose.values())
    kind = named_kind(inspected.trials) if known else ""
    if kind or not known:
        shared_by_tendons(out, {kind} - {""})
    for name in input_names(inspected):
        if known and not kind:
            out.item("actuator.chambers", name)
            out.put("torque", [1e-6], "N m/Pa, multiplied by the fitted gains")
            continue
        out.item("actuator.tendons", name)
        azimuth_of(out, azimuth_of_poses(inspected, name))
        if kind:
            out.put("driven_by", kind, "as the names of the files say")
        if kind not in ("", "tension"):
            out.put("line_stiffness", LINE_STIFFNESS, STIFF_LINE)


def azimuth_of_poses(inspected: Inspected, name: str) -> int | None:
    """Return the azimuth [degrees] of a tendon from the pose in which it moves the last station farthest from the axis
    of the base; None if no pose could be aligned.
    """
    levels = levels_by_name(inspected.trials)
    tips = [np.nanmedian(trial.last_motion[:, :2], axis=0) for trial in inspected.trials
            if trial.aligned is not None and levels[trial.name][name] != 0.0]  # fmt: skip
    if not tips:
        return None
    farthest = max(tips, key=lambda tip: float(np.linalg.norm(tip)))
    return round(float(np.degrees(np.arctan2(farthest[1], farthest[0])) % 360.0))


def chambers_in_plane(out: Lines, inspected: Inspected) -> None:
    """Write the chambers of a body in a plane, each with the joints that it bends and the side to which it bends them.

    Each chamber is judged by the recording in which its pressure varies most, compared with the other pressures.
    """
    for name, channel in inspected.channels.items():
        trial = max((t for t in inspected.trials if channel in t.chambers),
                    key=lambda t: t.pressure_ranges[channel] / sum(t.pressure_ranges.values()))  # fmt: skip
        out.item("actuator.chambers", name)
        if trial.aligned is None or trial.angles_only:
            out.propose("joints", [1, 2], "the joints that it bends; default: all")
            out.propose("joint_gain", -1.0, "for a chamber on the other side")
            continue
        side, begin, end = chamber_span(trial.aligned, channel)
        evidence, part = f"as the stations of {trial.path.name} move", f"from {1e3 * begin:.0f} to {1e3 * end:.0f} mm"
        divided = inspected.parts or even_parts(body_length(trial) or end)
        passed = [k for k in joints_up_to(end, divided) if k not in joints_up_to(begin, divided)]
        if trial.dense:
            out.say(f"joints = [...]  (the joints {part}, {evidence}; default: all)")
        elif len(passed) < len(divided):
            out.put("joints", passed, f"the joints that it bends: the body bends {part}, {evidence}")
        if side < 0:
            out.put("joint_gain", -1.0, f"it bends the body to the other side, {evidence}")


def chambers(out: Lines, inspected: Inspected) -> None:
    """Write the chambers of a body in space, each with the azimuth that the recording shows."""
    for name, channel in inspected.channels.items():
        trial = next((t for t in inspected.trials if t.aligned is not None and channel in several(t.recording)),
                     inspected.first_aligned)
        degrees = [] if trial.aligned is None else azimuths(trial.aligned)
        out.item("actuator.chambers", name)
        out.put("torque", [1e-6], "N m/Pa, multiplied by the fitted gains")
        in_degrees = degrees and channel in several(trial.recording)
        azimuth_of(out, round(degrees[several(trial.recording).index(channel)]) if in_degrees else None)


def tendons(out: Lines, inspected: Inspected) -> None:
    """Write the tendons of a body in space, with the azimuth and the joints that the recording shows for each."""
    trial = inspected.driven
    if not trial.tendon_inputs:
        return
    shared_by_tendons(out, {signal.kind for signal in trial.tendon_inputs})
    slack = can_be_slack(inspected)
    displaced = all(signal.kind != "tension" for signal in trial.tendon_inputs)
    shown = [] if trial.aligned is None else azimuths(trial.aligned, away=False)[-len(trial.tendon_inputs) :]
    ends = [] if trial.aligned is None or trial.angles_only else \
        tendon_ends(trial.aligned, len(trial.tendon_inputs), held=displaced)
    for k, signal in enumerate(trial.tendon_inputs):
        name = inspected.tendons[signal.name]
        out.item("actuator.tendons", name)
        out.put("driven_by", signal.kind, "as its column says" if trial.guess else "as the mapping states")
        azimuth_of(out, round(ends[k][0] if ends else shown[k]) if shown else None)
        divided = inspected.parts or even_parts(body_length(trial) or (ends[k][1] if ends else 0.0))
        if ends and len(passed := joints_up_to(ends[k][1], divided)) < len(divided):
            out.put("joints", passed, f"the joints that it passes: it bends the body up to {1e3 * ends[k][1]:.0f} mm")
        if trial.tracks_one_body and len(trial.tendon_inputs) > OF_ONE_SEGMENT:
            out.ask("stop", "m from the base, where it ends: a single tracked body does not show it")
        if both_ways(signal) and signal.kind != "tension" and name not in slack:
            out.put("pair", True, "its motor turns both ways: two opposite tendons; false for one that can be slack")
        if signal.kind != "tension":
            out.put("line_stiffness", LINE_STIFFNESS, STIFF_LINE)


def shared_by_tendons(out: Lines, kinds: Collection[str]) -> None:
    """Write the table of the entries that all tendons share, which are asked once. No kind: it is asked, too."""
    out.table("actuator.tendon_defaults")
    out.say("of every tendon; an entry of a single tendon takes precedence")
    if not kinds:
        out.ask("driven_by", "tension, displacement or angle of its motor; a pressure chamber is [[actuator.chambers]]")
    out.ask("lever", "m, distance of the tendons from the axis")
    if "angle" in kinds:
        out.ask("pulley", "m, radius of the motors' pulleys")


def azimuth_of(out: Lines, azimuth: int | None) -> None:
    """Write the azimuth [degrees] of a chamber or tendon, if it is known. Otherwise the run estimates the direction."""
    if azimuth is not None:
        out.put("azimuth_deg", azimuth, "around the axis, from x towards y of the base frame, as the stations move")


def both_ways(entry: RecordedInput) -> bool:
    """Return whether an input takes both signs."""
    values = entry.values[np.isfinite(entry.values)]
    return bool(values.min(initial=0.0) < -EITHER_WAY * values.max(initial=0.0))


def can_be_slack(inspected: Inspected) -> list[str]:
    """Return the names of the displacements of both signs, if the last station moves more like their positive parts
    than like themselves: tendons that were let out hang slack. Settled poses show it; a motor that turns is taken as
    one with two opposite tendons.
    """
    names = [inspected.tendons[pull.name] for pull in inspected.driven.tendon_inputs
             if pull.kind == "displacement" and both_ways(pull)]  # fmt: skip
    if not names or not inspected.poses:
        return []
    error = np.zeros(2)
    for trial in inspected.trials:
        tip = trial.recording["position"].values[:, -1]
        inputs = inputs_at(trial.recording, trial.recording["time"].values)
        known = np.isfinite(tip).all(axis=1) & np.isfinite(inputs).all(axis=1)
        for k, values in enumerate((inputs, np.maximum(inputs, 0.0))):
            design = np.column_stack([values, np.ones(len(values))])[known]
            left = tip[known] - design @ np.linalg.lstsq(design, tip[known], rcond=None)[0]
            error[k] += float((left**2).sum())
    return names if error[1] < error[0] else []


def even_parts(length: float) -> tuple[float, ...]:
    """Return the lengths [m] of the parts of a body in which a generated study has its joints, if none are stated."""
    return (length / LINKS,) * LINKS


def joints_up_to(end: float, parts: Sequence[float]) -> list[int]:
    """Return the numbers (from 1) of the joints between the base and `end` [m], with a margin of 5 %. A generated study
    has a joint in the middle of each of the `parts` [m].
    """
    joints = np.cumsum(parts) - 0.5 * np.array(parts)
    return [k + 1 for k, joint in enumerate(joints) if joint < 1.05 * end]


def is_set_point(name: str) -> bool:
    """Return whether the name of a channel says a set point. The word set does at its end alone, before a unit:
    cable_set1 is one of several sets.
    """
    words = words_of(name)
    if words and any(words[-1] in units for units in UNITS.values()):
        words.pop()
    return is_command("_".join(w for w in words if w != "set")) or words[-1:] == ["set"]


def named_by(trial: Trial) -> str:
    """Return the name of the column of the only pressure of a recording, by its mapping; "" if none names it."""
    pressure = (trial.guess.mapping if trial.guess else trial.mapping or {}).get("pressure", [])
    columns = pressure.get("columns", []) if hasattr(pressure, "get") else [pressure]  # arrays and channels by name
    if any(A_SET_POINT in line for line in history_of(trial.recording)):
        return "set"
    return columns[0] if len(columns) == 1 and isinstance(columns[0], str) else ""


def channels(out: Lines, trial: Trial, inspected: Inspected) -> None:
    """Write the entries that say which recorded channel drives which input of the model. Further entries say whether
    the inputs of tendons were measured, and how the model follows inputs that the log held constant between updates.
    """
    recorded = several(trial.recording)
    driving = {name: channel for name, channel in inspected.channels.items() if channel in recorded}
    measured = {signal.name for signal in trial.tendon_inputs}
    driving |= {name: channel for channel, name in inspected.tendons.items() if channel in measured}
    if driving:
        out.put("drive", driving, "input of the model = channel of the recording")
    moving = [s for s in recorded_inputs(trial.recording) if np.unique(s.values[np.isfinite(s.values)]).size > 1]
    if moving and all(is_set_point(signal.name or named_by(trial)) for signal in moving):
        out.put("signal", "commanded", 'set points by their names, which the body follows with a lag; or "measured"')
    elif trial.tendon_inputs:
        out.put("signal", "measured", 'or "commanded" for a set point, which the motor follows with a lag')
    if trial.quality.input_held:
        out.put("staircase", "lines", "the log holds inputs between updates; the model joins the changes by lines")


def azimuths(recording: xr.Dataset, *, away: bool = True) -> list[float]:
    """Estimate the azimuth of each chamber [degrees, 0 to 360, from x towards y] from the direction in which its
    pressure moves the last station or, without positions, in which the last sensor leans.

    A chamber bends the body away from itself; with ``away=False``, an input is a tendon, which bends it towards itself.
    The station's displacement is assumed to be linear in all inputs.

    Parameters
    ----------
    recording : xarray.Dataset
        Recording in the base frame, in space.
    """
    gain = (-1.0 if away else 1.0) * sideways(recording)[:, -1]
    return [float(a) for a in np.degrees(np.arctan2(gain[:, 1], gain[:, 0])) % 360.0]


def sideways(recording: xr.Dataset) -> np.ndarray:
    """Return the displacement of S stations per unit of each of C inputs, (C, S, 1) in a plane or (C, S, 2) in space [m
    per unit; without positions how the body leans, rad per unit], by least squares. Its components are perpendicular to
    the base tangent. Inputs that rise and fall together share what they move, in proportion to their ranges.
    """
    across = without_spikes(recording["position"].values)[..., :-1] if "position" in recording else leaning(recording)
    inputs = inputs_at(recording, recording["time"].values)
    sizes = np.nanstd(inputs, axis=0)
    sizes[sizes == 0.0] = 1.0
    scaled = (inputs - np.nanmean(inputs, axis=0)) / sizes
    design = np.column_stack([scaled, np.ones(len(inputs))])
    gain = np.full((inputs.shape[1], *across.shape[1:]), np.nan)
    for s in range(across.shape[1]):
        known = np.isfinite(across[:, s]).all(axis=1) & np.isfinite(inputs).all(axis=1)
        gain[:, s] = np.linalg.lstsq(design[known], across[known, s], rcond=TOGETHER)[0][:-1] / sizes[:, None]
    return gain


def leaning(recording: xr.Dataset) -> np.ndarray:
    """Return how the links of S stations lean in T frames of a recording of inclinations in space (T, S, 2) [rad]: the
    displacement of a point one metre along the link, by small rotations without twist from the first frames.
    """
    gravity, down = recording["gravity"].values, recording["gravity_constants"].values[0]
    change = gravity - np.nanmedian(gravity[:10], axis=0)
    about_x, about_y, _ = -np.cross(np.eye(3), down)  # change of gravity in the link's axes by a turn about each axis
    turn = change @ np.linalg.pinv(np.column_stack([about_x, about_y])).T
    return np.stack([turn[..., 1], -turn[..., 0]], axis=-1)


def chamber_span(recording: xr.Dataset, name: str) -> tuple[int, float, float]:
    """Return the side to which a chamber bends a planar body (1 or -1), and the distances [m] from the base between
    which it bends.

    The bend is assumed to be even between two points at tenths of the body, and the body straight elsewhere. If
    no part explains the displacements of the stations much better, the bend is assumed to be even over the whole body.

    Parameters
    ----------
    recording : xarray.Dataset
        Recording in the base frame, in a plane.
    name : str
        Name of the chamber.
    """
    gain = sideways(recording)[several(recording).index(name), :, 0]
    height = np.nanmedian(recording["position"].values[:10, :, -1], axis=0)
    measured = np.isfinite(gain) & np.isfinite(height)
    marks = np.linspace(0.0, np.nanmax(height), 11)
    candidates = []
    parts = list(combinations(marks, 2)) if measured.sum() > FEWEST_SHOWING else []
    for begin, end in [(0.0, marks[-1]), *parts]:
        shape = even_bend(height, begin, end)[measured]
        curvature = float(shape @ gain[measured] / (shape @ shape))
        squared_error = float(((gain[measured] - shape * curvature) ** 2).sum())
        candidates.append((squared_error, -1 if curvature > 0 else 1, begin, end))
    best = min(candidates)
    return (best if best[0] < MUCH_BETTER * candidates[0][0] else candidates[0])[1:]


def tendon_ends(recording: xr.Dataset, count: int, *, held: bool) -> list[tuple[float, float]]:
    """Return for the tendon of each of the last `count` inputs its azimuth [degrees] and the height of its end [m]. The
    height is measured along the base tangent at rest. With `held`, the inputs are the tendons' lengths.

    Parameters
    ----------
    recording : xarray.Dataset
        Recording in the base frame, in space, without input 0 in any channel.
    """
    height = np.nanmedian(recording["position"].values[:10, :, 2], axis=0)
    gains = np.array(sideways(recording))[-count:]
    if held and gains.shape[1] > 1:
        return ends_of_held_tendons(gains, height, [None] * count)
    return [end_of_bend(gain, height) for gain in gains]
