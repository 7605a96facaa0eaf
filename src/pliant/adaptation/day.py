"""Recordings of another day: the seconds to fit, what judges the fit, and whether the model can be fitted to them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from pliant.errors import InputError
from pliant.identification.drives import at_rest
from pliant.identification.experiment import Experiment
from pliant.identification.fit import FitResult

LEAST_FRAMES = 10
LEAST_MOTION = 0.003  # of the body's length


class DayParts(NamedTuple):
    """Recordings of a day: the seconds to fit, and what judges the fit."""

    fitted: tuple[Experiment, ...]
    judged: tuple[Experiment, ...]

    @property
    def seconds(self) -> float:
        """Return the duration [s] of the motion to fit, without warm-ups."""
        return float(sum(np.ptp(e.time) - e.warm_up for e in self.fitted))


def parts_of_day(experiments: Sequence[Experiment], seconds: float) -> DayParts:
    """Divide recordings of a day into the first `seconds` of motion, and the rest.

    A recording under measured inputs is cut where the seconds end; the rest of it is simulated from its beginning and
    compared from there on. Other recordings are used whole. The seconds count from the first frame, warm-up included.

    Raises
    ------
    InputError
        When the seconds hold no motion, or too few frames.
    """
    fitted: list[Experiment] = []
    judged: list[Experiment] = []
    left = seconds
    for exp in experiments:
        duration = float(np.ptp(exp.time))
        if left <= 0 and fitted:
            judged.append(exp)
        elif exp.excitation != "trace" or duration <= left:
            fitted.append(exp)
        else:
            first, rest = cut(exp, left)
            fitted.append(first)
            judged += rest
        left -= duration
    return DayParts(tuple(fitted), tuple(judged))


def cut(exp: Experiment, seconds: float) -> tuple[Experiment, list[Experiment]]:
    """Return the first `seconds` of an experiment under measured inputs and, if it is long enough, the rest of it."""
    early = exp.time <= exp.time[0] + seconds
    if np.count_nonzero(early & ~exp.warming) < LEAST_FRAMES:
        warm = f" after the warm-up of {exp.warm_up:g} s" if exp.warm_up else ""
        raise InputError(f"recording {exp.name} has {np.count_nonzero(early & ~exp.warming)} frames in its first "
                         f"{seconds:g} s{warm}, and a fit needs {LEAST_FRAMES}: state more seconds")  # fmt: skip
    try:
        first = exp.of_frames(early)
    except InputError as error:
        raise InputError(f"the first {seconds:g} s cannot be used: {error}") from None
    if np.count_nonzero(~early) < LEAST_FRAMES:
        return exp, []
    name = f"{exp.name}_rest"
    if exp.poses:
        return first, [replace(exp.of_frames(~early), name=name)]
    after = float(exp.time[np.flatnonzero(~early)[0]] - exp.time[0])
    return first, [replace(exp, name=name, warm_up=max(after, exp.warm_up))]


def check_day(old: FitResult, day: DayParts) -> None:
    """Raise InputError if recordings of a day do not move, or lack inputs or stations of the fitted model."""
    model = old.model
    known = {p.name for p in model.points}
    for exp in day.fitted:
        if strange := [s for s in exp.stations if s not in known]:
            raise InputError(f"recording {exp.name} shows the station {strange[0]!r}, which the fitted model does not "
                             f"have ({', '.join(sorted(known))}): it is of another arm, or its stations need the "
                             "names of the study")  # fmt: skip
        if exp.without_positions != old.turns:
            holds, wanted = ("angles alone", "positions") if old.turns < exp.without_positions else (
                "positions", "angles alone")  # fmt: skip
            raise InputError(f"recording {exp.name} holds {holds}, but the model was fitted to {wanted}: use a "
                             "recording of the same kind")  # fmt: skip
        if exp.drives and (idle := at_rest(model, exp)):
            raise InputError(f"recording {exp.name} lacks an input of the fitted model: {idle} Name the recorded "
                             "input in drive")  # fmt: skip
        if exp.excitation == "trace" and exp.pressure is not None and not np.ptp(exp.pressure.pressure):
            raise InputError(f"the input of recording {exp.name} stays at {exp.pressure.pressure[0]:g} throughout, "
                             "although the arm moves: name the column of the input that moved it")  # fmt: skip
    least = LEAST_MOTION * model.length
    moving = [e for e in day.fitted if e.without_positions or e.travel >= least]
    if not moving:
        raise InputError(f"the first {day.seconds:.3g} s of {day.fitted[0].name} hold no motion: the tip moves by "
                         f"{1e3 * max(e.travel for e in day.fitted):.2g} mm, less than {100 * LEAST_MOTION:g} % of the "
                         "body's length; state more seconds, or use a recording in which the arm moves")  # fmt: skip


def part_like(exp: Experiment, old: FitResult, day: DayParts) -> DayParts:
    """Return as many seconds of a recording of an earlier fit as are fitted of a day."""
    part = parts_of_day([exp], sum(float(np.ptp(e.time)) for e in day.fitted))
    check_day(old, part)
    return part
