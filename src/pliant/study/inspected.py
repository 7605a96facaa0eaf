"""Inspection of all files of a draft together: kinds of experiment, plane or space, stations in one order."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import combinations, count, permutations, takewhile
from pathlib import Path
from typing import Any

import numpy as np

from pliant.errors import InputError
from pliant.preprocessing.plausibility.together import alike
from pliant.preprocessing.quality import quality
from pliant.recording.column_names import words_of
from pliant.recording.tables import without_dots
from pliant.study.column_guess import guessed_table
from pliant.study.first_reading import several, with_logs
from pliant.study.kinds import STILL, Kind, PoseOfFile, PoseOfRow, UnrecordedPressure, WithoutCause, recognised
from pliant.study.plates import one_body, rigid, rigid_clusters
from pliant.study.shorthand import open_entries
from pliant.study.trial import (
    Trial,
    directions,
    from_first_frames,
    from_one_side,
    in_space,
    inspect_file,
    inspect_guessed,
    on_plates,
    with_alignment,
)

Array = np.ndarray
BASE_STILL = 0.2  # of the largest displacement between files: the station that moves less is the base
LAST_NUMBER = re.compile(r"[_ .:-]*[A-Za-z]*[_ .:-]*\d+$")
ALIKE = 0.15  # of the highest pressure: sister channels differ by less (median)
MOST_ORDERED = 7  # stations beside the base whose orders are all compared
CLEARER = 1.2  # by which the second-best order must differ more from another pose than the best, to be ruled out
FEWEST_POSES = 40  # of a file whose later poses are held out
DIVIDED, LATER = 0.8, "_later"  # fraction of such a file that trains; ending of the other part's name
TRAINING = {"train", "training"}
JUDGING = {"test", "testing", "validation", "valid", "val", "eval", "evaluation", "holdout"}


@dataclass(frozen=True)
class Inspected:
    """The recordings of a draft.

    Attributes
    ----------
    trials : sequence of Trial
    kinds : dict
        Kind of experiment by the name of the recording.
    space : bool
        Whether the body moves in space.
    channels : dict
        Recorded pressure of each chamber of the model, by the chamber's name; {} if there is only one pressure.
    segments : tuple of float
        Lengths of the segments of the body [m], from the base on, if the user states them.
    """

    trials: Sequence[Trial]
    kinds: Mapping[str, Kind]
    space: bool
    channels: Mapping[str, str]
    segments: tuple[float, ...] = ()

    @property
    def parts(self) -> tuple[float, ...]:
        """Return the lengths [m] of the parts in which the joints of stated segments are, two in each; () without."""
        return tuple(0.5 * length for length in self.segments for _ in range(2))

    @property
    def first(self) -> Trial:
        """Return the first recording."""
        return self.trials[0]

    @property
    def first_aligned(self) -> Trial:
        """Return the first recording that could be aligned in the base frame, or the first if none could."""
        return next((trial for trial in self.trials if trial.aligned is not None), self.trials[0])

    @property
    def driven(self) -> Trial:
        """Return the recording with the most inputs of tendons, an aligned one if there is one. If none has any, it is
        `first_aligned`.
        """
        return max([self.first_aligned, *self.trials],
                   key=lambda trial: (len(trial.tendon_inputs), trial.aligned is not None))  # fmt: skip

    @cached_property
    def entries_apart(self) -> set[str]:
        """Return the names of the entries, other than stations, in which the proposed mappings differ, or which only
        some have, and which no mapping leaves open: each recording states its own.
        """
        mappings = [trial.guess.mapping for trial in self.trials if trial.guess is not None]
        return {name for mapping in mappings for name in mapping if name != "stations"
                and any(other.get(name) != mapping[name] for other in mappings)
                and not any([*open_entries(other.get(name))] for other in mappings)}  # fmt: skip

    @property
    def poses(self) -> bool:
        """Return whether the recordings are settled poses, so that nothing moves between them."""
        return all(kind.poses for kind in self.kinds.values())

    @property
    def without_cause(self) -> list[Path]:
        """Return the files if nothing in any of them shows what moves the body, else []."""
        unexplained = all(isinstance(kind, WithoutCause) for kind in self.kinds.values())
        return list(dict.fromkeys(trial.path for trial in self.trials)) if unexplained else []

    @property
    def tendons(self) -> dict[str, str]:
        """Return the name of the tendon of the model that each recorded input drives, by the input's name."""
        signals = dict.fromkeys(s.name for trial in (self.driven, *self.trials) for s in trial.tendon_inputs)
        return dict(zip(signals, names_of_parts([*signals], self.channels), strict=True))

    def excited_by(self, excitation: str) -> bool:
        """Return whether some recording has this excitation."""
        return any(kind.excitation == excitation for kind in self.kinds.values())

    @cached_property
    def copied(self) -> dict[str, str]:
        """Return the recordings whose frames are in a longer one, which is named with each: no part of the study."""
        return {copy: other for copy, other, _ in alike({trial.name: trial.recording for trial in self.trials})}

    @property
    def divided(self) -> bool:
        """Return whether the poses of the only recording are divided: the later ones judge."""
        known = [trial for trial in self.trials if trial.name not in self.copied]
        return len(known) == 1 and isinstance(self.kinds[known[0].name], PoseOfRow) and (
            int(known[0].recording.sizes["time"]) >= FEWEST_POSES)

    def training(self) -> list[str]:
        """Return the names of the recordings that train: all but the held-out ones and copies."""
        return [trial.name for trial in self.trials if trial.name not in {*self.held_out(), *self.copied}]

    def held_out(self) -> list[str]:
        """Return the names of the recordings to hold out for validation; [] if there is only one recording.

        They are those whose names say so, such as validation beside train. Otherwise it is the recording with the
        middle pressure (of two, the lower), so that the test does not extrapolate. If some pressure is unknown, the
        peak displacement decides instead. If only some recordings drive several chambers together, one of these is held
        out, so that the fit has the effect of each chamber alone.
        """
        known = [trial for trial in self.trials if trial.name not in self.copied]
        if named := held_out_by_name(known):
            return named
        if len(known) < 2:
            return []
        together = [trial for trial in known if len(trial.chambers) > 1]
        trials = together if len(together) < len(known) and together else known
        if any(isinstance(kind, PoseOfFile) for kind in self.kinds.values()):
            tips = np.array([np.nanmedian(trial.last_motion, axis=0) for trial in trials])
            size = dict(zip((t.name for t in trials), np.linalg.norm(tips - tips.mean(axis=0), axis=1), strict=True))
        elif all(trial.highest_pa is not None for trial in trials):
            size = {trial.name: abs(trial.highest_pa or 0.0) for trial in trials}
        else:
            size = {trial.name: trial.peak_motion for trial in trials}
        return [sorted(size, key=lambda name: float(size[name]))[(len(trials) - 1) // 2]]


def held_out_by_name(trials: Sequence[Trial]) -> list[str]:
    """Return the recordings whose names say that they judge, or that they do not train while others do."""
    words = {trial.name: set(words_of(trial.name)) for trial in trials}
    judging = [name for name, said in words.items() if said & JUDGING and not said & TRAINING]
    if not judging and any(said & TRAINING for said in words.values()):
        judging = [name for name, said in words.items() if not said & TRAINING]
    return judging if len(judging) < len(trials) else []


def inspect_all(
    files: Sequence[str | Path], mapping: Mapping[str, Any] | None, space: bool | None
) -> Inspected:
    """Read the files and return the inspected recordings, all aligned in the plane or all in space.

    With `space=None` they are aligned in space if one of them moves in space, is driven by tendons, or holds settled
    poses.

    Raises
    ------
    InputError
        When a file cannot be read or holds no positions, or two files share a name.
    """
    trials = [trial for reading in with_logs([Path(f) for f in files], mapping) for trial in inspect_file(reading)]
    names = [trial.name for trial in trials]
    if not names or len(set(names)) < len(names):
        raise InputError(f"a study needs recordings with different file names, got {', '.join(names) or 'none'}")
    trials = on_plates(apart_in_others(trials))
    kinds = recognised(trials)
    if any(kind.poses or kind.excitation == "release" for kind in kinds.values()):
        trials = [on_resting_base(trial) for trial in trials]
        kinds = recognised(trials)
    if all(isinstance(kind, PoseOfFile) for kind in kinds.values()):
        trials = in_one_order(trials)
    trials = [from_first_frames(t) if isinstance(kinds[t.name], UnrecordedPressure) else t for t in trials]
    poses = any(kind.poses for kind in kinds.values())
    in_3d = poses or any(trial.spatial or trial.tendon_inputs for trial in trials)
    spatial = in_3d if space is None else space
    if spatial:
        trials = [in_space(trial, settled=kinds[trial.name].poses) for trial in trials]
    channels = channels_of(trials)
    if not spatial and len(channels) > 1:
        trials = from_one_side(trials)
    return Inspected(trials, kinds, spatial, channels)


def on_resting_base(trial: Trial) -> Trial:
    """Return the trial without a motion of its base as an input, which releases and settled poses do not have."""
    if not trial.options.get("base_motion"):
        return trial
    options = {name: value for name, value in trial.options.items() if name != "base_motion"}
    share = quality(trial.recording).out_of_plane_share
    trial = replace(trial, options=options, quality=replace(trial.quality, out_of_plane_share=share))
    return trial if trial.capped else with_alignment(trial)


def apart_in_others(trials: Sequence[Trial]) -> list[Trial]:
    """Return the trials with the markers of a plate as stations of their own, if each file holds one pose and these
    markers, which keep their distances in it, have others in another file: they are on no rigid plate.
    """
    first = trials[0].recording
    plates = {name: markers for trial in trials for name, markers in trial.stations.items() if len(markers) > 1}
    alike = len({tuple(map(str, trial.recording["station"].values)) for trial in trials}) == 1
    if not plates or not alike or len(trials) < 2 or any(trial.angles_only for trial in trials):
        return list(trials)
    medians = [np.nanmedian(trial.recording["position"].values, axis=0) for trial in trials]
    moved = float(np.nanmax(np.linalg.norm(np.array(medians) - medians[0], axis=-1)))
    poses = first[["position"]].isel(time=np.zeros(len(trials), int)).copy(data={"position": np.array(medians)})
    if any(trial.peak_motion > STILL * moved for trial in trials) or all(map(partial(rigid, poses), plates.values())):
        return list(trials)
    stations = rigid_clusters(poses)
    grouped = [replace(trial, stations=stations) for trial in trials]
    return [with_alignment(replace(t, options=directions(t.recording, t.quality, stations, dense=t.dense)))
            for t in grouped]  # fmt: skip


def channels_of(trials: Sequence[Trial]) -> dict[str, str]:
    """Return the recorded pressure of each chamber of the model, by the chamber's name.

    Sister channels, whose names differ in the last number alone and whose pressures are alike in all recordings, such
    as those of five pouches on one valve, are one chamber. The channel nearest to their median drives it.
    """
    names = list(dict.fromkeys(name for trial in trials for name in trial.chambers))
    stems = {name: LAST_NUMBER.sub("", name) for name in names}
    groups: dict[str, list[str]] = {}
    for name in names:
        groups.setdefault(stems[name] or name, []).append(name)
    channels: dict[str, str] = {}
    for stem, members in groups.items():
        middle = middle_channel(trials, members) if len(members) > 1 else members[0]
        if len(members) > 1 and middle:
            channels[stem] = middle
        else:
            channels |= {name: name for name in members}
    short = shortened(channels)
    return dict(zip(names_of_parts([*short]), short.values(), strict=True))


def names_of_parts(channels: Sequence[str], taken: Collection[str] = ()) -> list[str]:
    """Return the names of the chambers or tendons that recorded channels drive: without dots, and with a number behind
    a name that is `taken` or repeats another.
    """
    names: list[str] = []
    for channel in channels:
        free = (without_dots(channel) + (f"_{k}" if k > 1 else "") for k in count(1))
        names.append(next(name for name in free if name not in {*names, *taken}))
    return names


def shortened(channels: Mapping[str, str]) -> dict[str, str]:
    """Return the channels under shorter names: without the first words that all share, such as Measured_pressure_, as
    long as each shorter name begins with a letter.
    """
    words = [re.split(r"(?<=[_ .:-])", name) for name in channels]
    shared = [*takewhile(lambda part: len(set(part)) == 1, zip(*words, strict=False))] if len(words) > 1 else []
    for skipped in range(len(shared), 0, -1):
        short = ["".join(parts[skipped:]) for parts in words]
        if all(name[:1].isalpha() for name in short) and len(set(short)) == len(short):
            return dict(zip(short, channels.values(), strict=True))
    return dict(channels)


def middle_channel(trials: Sequence[Trial], members: Sequence[str]) -> str:
    """Return the pressure channel that differs least from the median of all `members`; "" if the pressures of some
    member are not like the others'.
    """
    apart = np.zeros(len(members))
    for trial in trials:
        if not set(members) <= set(several(trial.recording)):
            return ""
        values = trial.recording["pressure"].sel(chamber=list(members)).values
        centre = np.median(values, axis=1)
        away = np.median(np.abs(values - centre[:, None]), axis=0)
        if away.max() > ALIKE * np.nanpercentile(np.abs(centre), 95):
            return ""
        apart = np.maximum(apart, away)
    return members[int(np.argmin(apart))]


def in_one_order(trials: Sequence[Trial]) -> list[Trial]:
    """Return recordings, each of one settled pose, with the point that stays where it is in all files as their base;
    unchanged if none does.

    Stations of tables that nobody described come in one order: base first, then by their distance from it in the least
    bent pose; see `orders_of`. So do those whose names differ in numbers alone, such as M1 and M2, if the numbers
    change places between the files: the base has not the same one in all.
    """
    medians = [np.nanmedian(trial.grouped["position"].values, axis=0) for trial in trials]  # (S, 3) of each
    gaps = np.array([[np.linalg.norm(p - point, axis=1).min() for p in medians] for point in medians[0]])  # (S, files)
    still = int(np.argmin(gaps.max(axis=1)))
    if gaps[still].max() > BASE_STILL * gaps.max():
        return list(trials)
    base = medians[0][still]
    orders, unsure = orders_of(medians, base)
    names = [tuple(trial.names) for trial in trials]
    numbered = len({*names}) == 1 and bool(one_body(names[0]))
    if numbered and len({order[0] for order in orders}) > 1 and all(trial.guess is None for trial in trials):
        trials = [described(trial) for trial in trials]
    trials = [ordered(trial, order) for trial, order in zip(trials, orders, strict=True)]
    return with_doubt(trials, [trials[k].path.name for k in unsure]) if unsure else trials


def orders_of(poses: Sequence[Array], base: Array) -> tuple[list[list[int]], list[int]]:
    """Return the order of the points of each pose (S, 3) from the base, which stays at `base` (3,), and the indices of
    the poses whose order is not sure.

    The points of the pose that reaches farthest, which is bent least, come by their distances from the base. Each other
    pose, by its reach, follows the one before it.
    """
    reach = [float(np.linalg.norm(points - base, axis=1).max()) for points in poses]
    straight, *bent = sorted(range(len(poses)), key=lambda k: -reach[k])
    orders = {straight: [int(k) for k in np.argsort(np.linalg.norm(poses[straight] - base, axis=1))]}
    before, unsure = poses[straight][orders[straight]], []
    for k in bent:
        orders[k], sure = like_another(poses[k], before)
        before = poses[k][orders[k]]
        unsure += [] if sure else [k]
    return [orders[k] for k in range(len(poses))], sorted(unsure)


def with_doubt(trials: Sequence[Trial], files: Sequence[str]) -> list[Trial]:
    """Return the trials with a question on the order of the stations in `files`; unchanged where none is proposed."""
    question = (f"the markers of {', '.join(files)} fit two orders nearly alike, as those of a strongly bent body do: "
                "check the columns of each station there")
    return [trial if trial.guess is None else
            replace(trial, guess=replace(trial.guess, questions={**trial.guess.questions, "stations": question}))
            for trial in trials]  # fmt: skip


def described(trial: Trial) -> Trial:
    """Return the trial with a proposed mapping of its table, which names the columns of each station; unchanged if its
    file is no table.
    """
    guess = guessed_table(trial.path, trial.mapping)
    listed = {} if guess is None else guess.mapping.get("stations", {})
    if guess is None or len(listed) != len(trial.names):
        return trial
    stations = dict(zip(trial.names, listed.values(), strict=True))
    note = (f"the names {', '.join(trial.names)} change places between the files: the point that stays where it is, "
            "is the base, and the distances of the others show their order")
    mapping, neutral = ({**entries, "stations": stations} for entries in (guess.mapping, guess.neutral))
    return replace(trial, guess=replace(guess, notes=(*guess.notes, note), mapping=mapping, neutral=neutral))


def like_another(place: Array, first: Array) -> tuple[list[int], bool]:
    """Return the order of points (S, 3) in which their distances from each other are most like those of `first` (S, 3),
    another pose of the same points, and whether no other order is nearly as like. The base is where it is in `first`.
    """
    base = int(np.argmin(np.linalg.norm(place - first[0], axis=1)))
    others = [k for k in range(len(place)) if k != base]
    wanted = np.linalg.norm(first[:, None] - first, axis=-1)
    apart = np.linalg.norm(place[:, None] - place, axis=-1)
    orders = [[base, *order] for order in permutations(others)] if len(others) <= MOST_ORDERED else \
        improved([base, *sorted(others, key=lambda k: float(apart[k, base]))], apart, wanted)
    unlike = [float(np.abs(apart[np.ix_(order, order)] - wanted).sum()) for order in orders]
    best, *next_best = np.argsort(unlike)
    return orders[best], not next_best or unlike[next_best[0]] > CLEARER * unlike[best]


def improved(order: list[int], apart: Array, wanted: Array) -> list[list[int]]:
    """Return the best order that exchanges of two points lead to, behind the first of `order`, by the distances `apart`
    (S, S) of the points and those `wanted` (S, S), and all orders that differ from it by one exchange.
    """
    while True:
        swaps = [order]
        for i, j in combinations(range(1, len(order)), 2):
            swaps.append([*order])
            swaps[-1][i], swaps[-1][j] = order[j], order[i]
        unlike = [float(np.abs(apart[np.ix_(o, o)] - wanted).sum()) for o in swaps]
        best = int(np.argmin(unlike))
        if not best:
            return swaps
        order = swaps[best]


def ordered(trial: Trial, order: Sequence[int]) -> Trial:
    """Return the trial with its stations in another order, the first of which is the base, if its file is a table that
    nobody described; else with the base alone.
    """
    names = trial.names
    if trial.guess is None:
        return replace(trial, options=pose_options(trial, names[order[0]]))
    listed = trial.guess.mapping["stations"]
    titles = ["base", *(f"p{k}" for k in range(1, len(order) - 1)), "tip"]
    stations = {title: listed[names[k]] for title, k in zip(titles, order, strict=True)}
    guess = replace(trial.guess, mapping={**trial.guess.mapping, "stations": stations},
                    neutral={**trial.guess.neutral, "stations": stations})  # fmt: skip
    again = inspect_guessed(trial, guess)
    return replace(again, options=pose_options(again, "base"))


def pose_options(trial: Trial, base: str) -> dict[str, Any]:
    """Return the options of the alignment of a settled pose: no pose shows the body at rest, so that the tangent is the
    axis of the tracker nearest to the direction from the base to the last station.
    """
    recording = trial.grouped
    position = np.nanmedian(recording["position"].values, axis=0)
    chord = position[-1] - position[[str(s) for s in recording["station"].values].index(base)]
    k = int(np.argmax(np.abs(chord)))
    sign = "+" if chord[k] > 0 else "-"
    return {"base": base, "tangent": f"{sign}{'xyz'[k]}", "plane": f"+{'xyz'[(k + 1) % 3]}"}
