"""Kinds of experiment that a draft recognises, one class each: how a recording shows its kind, and which entries its
table in the study then needs. `KINDS` lists them, the most particular first.
"""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pliant.errors import InputError
from pliant.identification import experiment
from pliant.identification.edges import edges
from pliant.identification.experiment import Excitation
from pliant.identification.starts import LATEST
from pliant.recording.inputs import recorded_inputs
from pliant.study.named_levels import LEVEL, OF_TENDONS, named_pressures, named_tendon
from pliant.study.toml_text import Lines
from pliant.study.trial import RETURNED, Trial

Array = np.ndarray
STILL = 0.05  # of the displacement between files: a file whose stations move less holds one pose
APART_S = 0.3  # s between rows (median): a soft body has settled before the next row
MANY_POSES = 300  # of a file, that determine a model as well as all of them
STAYS = 0.01  # largest displacement over the distance of the stations, of a body at rest
JUMP = 0.1  # of the spread of the tip: rows of settled poses differ by more (root mean square)
ROUGH = 0.8  # change of successive steps over the steps: rows without a motion between them, if no time is known
FRACTION, FEWEST = 0.02, 500  # of the motion that thinning may lose, and the frames that it leaves
SWITCHING = 0.08  # of the duration in which inputs may be switched on
NEARLY = 0.95  # of the lowest value that an input has later: it is on
ZERO = 0.03  # of an input's highest value, below which it is off
GOES_ON = 0.5  # of the largest spread of a quarter of a recording: the body moves in the others too
GROWS = 1.05  # largest displacement of a quarter over that of the quarter before: no vibration that decays
FEWEST_MOVING = 40  # frames that show how a motion goes on
HELD_S = 1.0  # s for which an input keeps its level (median) in an experiment of steps and waits


@dataclass(frozen=True)
class TrialOfDraft:
    """A recording whose kind of experiment is to be found, with all recordings of the draft study, and the nominal
    pressure [Pa] that the user states for recordings without a measured one.
    """

    trial: Trial
    trials: Sequence[Trial]
    level: float | None = None


class Kind(ABC):
    """One kind of experiment."""

    excitation: Excitation = "trace"
    poses = False  # each row, or each file, is a settled pose
    measured = True  # its inputs were recorded

    @abstractmethod
    def evidence(self, candidate: TrialOfDraft) -> str:
        """Return what in the recording shows this kind, or "" if nothing does."""

    @abstractmethod
    def entries(self, out: Lines, candidate: TrialOfDraft) -> None:
        """Write the entries of the recording's table that this kind needs."""


class PoseOfFile(Kind):
    """One settled pose a file: nothing moves in a file, and the files differ."""

    poses, measured = True, False

    def evidence(self, candidate: TrialOfDraft) -> str:
        """Return a sentence if the stations of every file stay where they are, and differ between the files."""
        trials = candidate.trials
        if len(trials) < 2 or any(t.recording.attrs["frame"] != "tracker" or t.angles_only for t in trials):
            return ""
        if any(moving_inputs(t) for t in trials) or len({t.recording.sizes["station"] for t in trials}) > 1:
            return ""
        within = max(float(max(t.quality.travel_m.values())) for t in trials)
        points = [np.nanmedian(t.recording["position"].values, axis=0) for t in trials]  # (S, 3) of each, in any order
        between = max(float(np.linalg.norm(p[:, None] - points[0], axis=-1).min(axis=1).max()) for p in points)
        return "nothing moves in this file, and the files differ: it is one settled pose" \
            if within < STILL * between else ""

    def entries(self, out: Lines, candidate: TrialOfDraft) -> None:
        """Write that all rows are one pose, and the input that held it as the file's name says."""
        out.put("poses", "median", "all rows are one settled pose, their median")
        out.put("signal", "commanded", 'no input was recorded; "measured" if you measured it')
        levels = levels_by_name(candidate.trials)[candidate.trial.name]
        out.ask("inputs", "value of each input, SI", levels, levels_comment(candidate, levels))
        out.questions += [f"inputs: {UNIT_OF_INPUTS}"] if "?" in levels.values() else []


UNIT_OF_INPUTS = "value of the input that the name of each file states, in N, m, rad or Pa"


def levels_comment(candidate: TrialOfDraft, levels: Mapping[str, float | str]) -> str:
    """Return the comment beside the levels of a settled pose."""
    source = f"the name of the file is {candidate.trial.path.stem}"
    kind = named_kind(candidate.trials)
    unit = OF_TENDONS[kind][0] if kind else "Pa"
    return f"{UNIT_OF_INPUTS}: {source}" if "?" in levels.values() else f"{unit}, {source}"


def named_level(trial: Trial) -> tuple[str, float] | None:
    """Return the kind and the value [SI] of the input of a tendon that the name of a file states; None for others."""
    return named_tendon(trial.path.stem)


def named_kind(trials: Sequence[Trial]) -> str:
    """Return the kind of the inputs of tendons that the names of all files state, with different values; else ""."""
    stated = {named_level(trial) for trial in trials}
    kinds = {words[0] if words else "" for words in stated}
    return kinds.pop() if len(kinds) == 1 and len(stated) > 1 else ""


def moving_inputs(trial: Trial) -> bool:
    """Return whether a recorded input changes."""
    return any(np.ptp(signal.values[np.isfinite(signal.values)]) > 0 for signal in recorded_inputs(trial.recording))


def levels_by_name(trials: Sequence[Trial]) -> dict[str, dict[str, float | str]]:
    """Return the value of each input for each recording, as far as the file names state it: a pressure such as 30kPa
    [Pa], a tension such as 2N [N], a displacement such as 3mm [m] or an angle [rad], else "?". A part of the names that
    few values share, such as m1 and m2, names the inputs; the others are 0.
    """
    labelled = [named_pressures(trial.path.stem) for trial in trials]
    if labelled[0] and all(levels.keys() == labelled[0].keys() for levels in labelled):
        return {trial.name: {**levels} for trial, levels in zip(trials, labelled, strict=True)}
    parts = [trial.path.stem.split("_") for trial in trials]
    width = min(len(p) for p in parts)
    columns = [[p[k] for p in parts] for k in range(width)]
    naming = [c for c in columns if 1 < len(set(c)) <= len(trials) // 2 and all(re.match("[A-Za-z]", v) for v in c)]
    labels = naming[0] if naming else ["input"] * len(trials)
    names = list(dict.fromkeys(labels))
    levels: dict[str, dict[str, float | str]] = {}
    of_tendons = named_kind(trials)
    for trial, label in zip(trials, labels, strict=True):
        stated = named_level(trial)
        known = trial.highest_pa if LEVEL.search(trial.path.stem) else stated[1] if stated and of_tendons else None
        levels[trial.name] = {name: 0.0 if name != label else "?" if known is None else known for name in names}
    return levels


class PoseOfRow(Kind):
    """A settled pose in each row, with the inputs that hold it."""

    poses = True

    def evidence(self, candidate: TrialOfDraft) -> str:
        """Return a sentence if the rows are far apart in time and place, under measured inputs in space."""
        trial = candidate.trial
        if trial.angles_only or trial.recording.attrs["frame"] == "planar" or not moving_inputs(trial):
            return ""
        if stays(trial):
            return ""
        tip = trial.recording["position"].values[:, -1]
        tip = tip[np.isfinite(tip).all(axis=1)]
        if len(tip) < 3 or not (spread := float(tip.std(axis=0).max())):
            return ""
        step = np.diff(tip, axis=0)
        jump = float(np.sqrt((step**2).sum(axis=1).mean())) / spread
        rough = float(np.sqrt((np.diff(step, axis=0) ** 2).sum() / max((step**2).sum(), 1e-300)))
        apart = float(np.median(np.diff(trial.recording["time"].values)))
        timed = not trial.asks_rate
        if jump < JUMP or (timed and apart < APART_S) or (not timed and rough < ROUGH):
            return ""
        when = f"{apart:.2g} s apart and " if timed else ""
        return f"rows are {when}unlike their neighbours: each row is a settled pose"

    def entries(self, out: Lines, candidate: TrialOfDraft) -> None:
        """Write that each row is a pose."""
        out.put("poses", True, f"{self.evidence(candidate)}; remove this line if they follow a motion")
        count = int(candidate.trial.recording.sizes["time"])
        if (every := count // MANY_POSES) > 1:
            out.put("every", every, f"{-(-count // every)} of {count} poses are used; remove this line to use all")


def stays(trial: Trial) -> bool:
    """Return whether several stations stay where they are, so that their rows differ by noise alone."""
    position = trial.recording["position"].values
    places = np.nanmedian(position[:, np.isfinite(position).all(axis=2).any(axis=0)], axis=0)
    if not len(places):
        return False
    return trial.peak_motion < STAYS * float(np.linalg.norm(np.ptp(places, axis=0)))


class MeasuredInputs(Kind):
    """A motion under inputs that were recorded: steps and waits, slow sweeps or random commands."""

    def evidence(self, candidate: TrialOfDraft) -> str:
        """Return how the recorded inputs change: in steps, slowly or at random."""
        trial = candidate.trial
        if trial.asks_inputs:
            return "columns that change are probably its inputs"
        if not {"pressure", "actuation"} & set(trial.recording):
            return ""
        if not moving_inputs(trial):
            return "the recorded inputs never change"
        if waits(trial):
            return "the inputs change in steps and wait"
        every = thinning(trial)
        return f"the motion is slow: each frame of {every} shows it" if every > 1 else "the inputs were recorded"

    def entries(self, out: Lines, candidate: TrialOfDraft) -> None:
        """Write the thinning of a motion that is recorded much faster than it moves."""
        if (every := thinning(candidate.trial)) > 1:
            out.put("every", every, "each such frame is used: lines between them miss the motion by 2 % at most")
        if (warm_up := switched_on(candidate.trial)) is not None:
            out.put("warm_up", warm_up, "s: all inputs are switched on in this time, and none goes back to zero; the "
                    "body begins wherever it was left, so that this time is simulated but not compared")
            if shown_early(candidate.trial):
                out.put("start", "pose", "the body begins in the pose of its first frames")


def shown_early(trial: Trial) -> bool:
    """Return whether all stations of a recording are seen early enough to show the pose in which it begins."""
    recording = trial.grouped
    seen, time = np.isfinite(recording["position"].values).all(axis=2), recording["time"].values
    return bool(seen.any(axis=0).all() and time[seen.argmax(axis=0)].max() - time[0] <= LATEST)


class WithoutCause(Kind):
    """A motion that goes on to the end of the recording, with nothing recorded that moves the body."""

    measured = False

    def evidence(self, candidate: TrialOfDraft) -> str:
        """Return a sentence if no input is known and the motion of the last station neither rests nor decays."""
        trial = candidate.trial
        if trial.highest_pa is not None or candidate.level is not None or LEVEL.search(trial.path.stem):
            return ""
        goes_on = "no input was recorded, and the motion goes on to the end: no pulse and no free decay"
        return goes_on if never_ends(trial.last_motion) else ""

    def entries(self, out: Lines, candidate: TrialOfDraft) -> None:
        """Write what is missing."""
        del candidate
        out.say('what moved the body? pressure_file = "..." names the log of its inputs')


class FreeDecay(Kind):
    """A free decay after release: no input, and the body does not return to where it began."""

    excitation: Excitation = "release"
    measured = False

    def evidence(self, candidate: TrialOfDraft) -> str:
        """Return a sentence if the body moves away from its first pose without a known pressure."""
        pressed = candidate.trial.highest_pa is not None or LEVEL.search(candidate.trial.path.stem) is not None
        stays = not returned(candidate.trial) and not pressed
        return "no input, and the body does not return: taken as free decay after release" if stays else ""

    def entries(self, out: Lines, candidate: TrialOfDraft) -> None:
        """Write the excitation, and how to state a pressure instead."""
        when = moved(candidate.trial, self.excitation)
        out.put("excitation", "release", self.evidence(candidate) + (f" ({when})" if when else ""))
        if pulled_aside(candidate.trial):
            out.put("held", "measured", 'pulled aside before; "unloaded" if a hand held it straight')
        out.say('if a pressure moved the body, use these instead: nominal_pressure = 20.0 and pressure_unit = "kPa"')


class UnrecordedPressure(Kind):
    """A pulse or a step of a pressure that was not recorded, but stated in the file's name or by the user."""

    measured = False

    def entries(self, out: Lines, candidate: TrialOfDraft) -> None:
        """Write the nominal pressure, or ask for it."""
        trial, kind = candidate.trial, self.excitation
        when = moved(trial, kind)
        sides = "a pulse is assumed, its edges" if kind == "pulse" else "a step is assumed, its start"
        out.say(f"the pressure was not recorded: {sides} estimated from the motion and fitted"
                + (f" ({when})" if when else ""))
        if kind == "step":
            out.put("excitation", "step", "the body does not return, so the end of the pulse was not recorded")
        value, origin = trial.highest_pa, "from the name of the file"
        if candidate.level is not None:
            value, origin = candidate.level, "as you stated"
        out.ask("nominal_pressure", f"kPa gauge, the pressure level of the {kind} in {trial.path.name}",
                None if value is None else value / 1e3, origin)
        out.put("pressure_unit", "kPa")


class PressureStep(UnrecordedPressure):
    """A step of a pressure that was not recorded: the body does not return."""

    excitation: Excitation = "step"

    def evidence(self, candidate: TrialOfDraft) -> str:
        """Return a sentence if the body does not return."""
        return "the body does not return: a step of pressure" if not returned(candidate.trial) else ""


class PressurePulse(UnrecordedPressure):
    """A pulse of a pressure that was not recorded: the body returns."""

    excitation: Excitation = "pulse"

    def evidence(self, candidate: TrialOfDraft) -> str:
        """Return a sentence: what nothing else explains is taken as a pulse."""
        known = candidate.trial.highest_pa
        size = "" if known is None else f" of {known / 1e3:g} kPa, as its name says"
        return f"no input was recorded, and the body returns: a pulse of pressure{size}"


KINDS: tuple[Kind, ...] = (PoseOfFile(), PoseOfRow(), MeasuredInputs(), WithoutCause(), FreeDecay(), PressureStep(),
                           PressurePulse())  # fmt: skip


def recognised(trials: Sequence[Trial]) -> dict[str, Kind]:
    """Return the kind of each recording, by its name."""
    return {t.name: next(kind for kind in KINDS if kind.evidence(TrialOfDraft(t, trials))) for t in trials}


def pulled_aside(trial: Trial) -> bool:
    """Return whether a body that is released begins more bent than it ends: its last station is then nearer to the base
    or, if that was not tracked, to the first station.
    """
    if trial.angles_only or (len(trial.stations) or trial.recording.sizes["station"]) < 2:
        return False
    recording = trial.grouped
    position = recording["position"].values
    base = [str(s) for s in recording["station"].values].index(trial.base) if trial.options else 0
    chord = np.linalg.norm(position[:, -1] - position[:, base], axis=-1)
    return bool(np.nanmedian(chord[:5]) < np.nanmedian(chord[-max(5, len(chord) // 20):]))


def never_ends(motion: Array) -> bool:
    """Return whether the motion (T, axes) of a point goes on in each of the last three quarters of a recording, and is
    no vibration that decays from a release.
    """
    motion = motion[np.isfinite(motion).all(axis=-1)]
    if len(motion) < FEWEST_MOVING or not np.ptp(motion, axis=0).any():
        return False
    quarters = np.array_split(motion, 4)
    spread = [float(np.sqrt(np.mean((part - part.mean(axis=0)) ** 2))) for part in quarters]
    away = [float(np.linalg.norm(part - motion.mean(axis=0), axis=1).max()) for part in quarters]
    decays = max(away[2] / away[1], away[3] / away[2]) < GROWS
    return bool(min(spread[1:]) > GOES_ON * max(spread) and not decays)


def returned(trial: Trial) -> bool:
    """Return whether the last station ends near where it began."""
    away = np.linalg.norm(trial.last_motion - np.nanmedian(trial.last_motion[:5], axis=0), axis=-1)
    return bool(np.nanmedian(away[-max(5, len(away) // 20):]) < RETURNED * np.nanmax(away))


def waits(trial: Trial) -> bool:
    """Return whether the inputs change in steps between which they stay for a second or longer."""
    for signal in recorded_inputs(trial.recording):
        known = np.isfinite(signal.values)
        time, values = signal.time[known], signal.values[known]
        span = np.ptp(values) if values.size else 0.0
        if not span:
            continue
        edges_at = time[1:][np.abs(np.diff(values)) > 0.02 * span]
        if not 0 < len(edges_at) < 0.1 * len(values) or np.median(np.diff(edges_at, append=time[-1])) < HELD_S:
            return False
    return True


def switched_on(trial: Trial) -> float | None:
    """Return the time [s] from the first frame in which several inputs rise from zero, to which none returns, while
    some go on to move; None for a recording that begins otherwise.
    """
    inputs = [signal for signal in recorded_inputs(trial.recording)
              if np.isfinite(signal.values).all() and np.ptp(signal.values)]  # fmt: skip
    begin = float(trial.recording["time"].values[0])
    duration = float(np.ptp(trial.recording["time"].values))
    risen, moving = [], False
    for signal in inputs:
        later = signal.values[signal.time - begin > SWITCHING * duration]
        low, high = (float(later.min()), float(later.max())) if later.size else (0.0, 0.0)
        if not abs(signal.values[0]) < ZERO * high < low:
            return None
        risen.append(float(signal.time[np.argmax(signal.values >= NEARLY * low)]) - begin)
        moving |= high - low > 0.5 * high
    return round(max(risen), 1) if len(inputs) > 1 and moving else None


def thinning(trial: Trial) -> int:
    """Return how many frames apart two frames may be: the frames between them, joined by straight lines, then differ
    from the recorded ones by at most 2 % of the last station's motion (root mean square).
    """
    time = trial.recording["time"].values
    motion = trial.last_motion
    known = np.isfinite(motion).all(axis=-1)
    time, motion = time[known], motion[known]
    most = FRACTION * float(np.sqrt(np.mean((motion - motion.mean(axis=0)) ** 2))) if len(motion) else 0.0
    best = 1
    for every in (2, 3, 4, 5, 6, 8, 10, 12, 16, 20, 24, 32):
        if len(motion) < FEWEST * every:
            break
        joined = np.stack([np.interp(time, time[::every], column[::every]) for column in motion.T], axis=1)
        if np.sqrt(np.mean((joined - motion) ** 2)) > most:
            break
        best = every
    return best


def moved(trial: Trial, excitation: Excitation) -> str:
    """Return a comment with the times at which the motion begins and ends, or "" if they are unknown."""
    if trial.aligned is None or not trial.has_scale:
        return ""
    stations = tuple(str(n) for n in trial.aligned["station"].values if trial.angles_only or n != trial.base)
    recording = trial.aligned.assign_attrs(nominal_pressure=1.0)  # any level, since only the times are used
    try:
        edge_times = edges(experiment(trial.name, recording, stations=stations, excitation=excitation))
    except InputError:
        return ""
    return ", ".join(f"{what} near {time:.2f} s" for what, time in edge_times.items())
