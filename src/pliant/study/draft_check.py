"""Check of a drafted study: it is prepared and fitted for one step, as a run would do it, with assumed values in place
of its open questions.
"""

from __future__ import annotations

import json
import time as clock
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np

from pliant.errors import PliantError
from pliant.identification import Experiment
from pliant.identification.fit import check_identifiable, first_problem, parameters_from, starts_of
from pliant.identification.problem import Problem
from pliant.model import Model
from pliant.selection import Term, terms_for
from pliant.selection.criterion import parts_of
from pliant.selection.first_model import beginning
from pliant.selection.fitted import FitSetting, fitted
from pliant.selection.screen import screened
from pliant.selection.select import MINUTES
from pliant.selection.slow import slow_body
from pliant.selection.start import quick_start, slow_start
from pliant.study.draft_tables import down, without_load
from pliant.study.inspected import Inspected
from pliant.study.prepare import without
from pliant.study.run import prepare_all
from pliant.study.schema import SelectionEntry, Study, load_study
from pliant.study.shorthand import OPEN
from pliant.study.trial import Trial, body_length, farthest

LENGTH, DENSITY, SLENDER, LEVER = 0.2, 1100.0, 10.0, 0.01  # m; kg/m^3; length over diameter; m
LEVEL_KPA, PAYLOAD = 30.0, 0.02  # kPa, kg
BEHIND = (0.9, 0.8, 0.7, 0.6, 0.5)  # of the length, from an assumed base to the last station
REACH = 1.05  # length of an assumed body over the largest distance that its last station has from the base
DERIVATIVES, SCREENS = 500.0, 60.0  # of the first model, and of all terms, that take together as long as a search
POSES, SECONDS, FRAMES = 40, 15.0, 50  # settled poses of a file, and seconds of a motion, that a check uses
QUICK_S = 5.0  # a first step that is shorter is repeated, so that the compilation of its kernels is not in the forecast


class DraftCheck(NamedTuple):
    """Result of a check.

    Attributes
    ----------
    problem : str
        Why the study cannot be run, "" if it can.
    seconds : float or None
        Forecast of the time of a run; None if it cannot be run.
    assumed : tuple of str
        Names of the entries for which a value was assumed.
    dropped : tuple of str
        A sentence for each recording that the run leaves out.
    """

    problem: str
    seconds: float | None
    assumed: tuple[str, ...]
    dropped: tuple[str, ...] = ()


def check_draft(text: str, folder: Path, inspected: Inspected) -> DraftCheck:
    """Prepare the study with the content `text`, whose files are relative to `folder`, and take one step of its first
    fit. Open questions are answered by assumed values.
    """
    if inspected.first.asks_inputs:
        return DraftCheck("its table does not show which columns are the inputs", None, ())
    if inspected.without_cause:
        return DraftCheck("nothing in its recordings shows what moves the body", None, ())
    content, assumed = answered(tomllib.loads(text), inspected)
    content["folder"] = str(folder.resolve())
    began = clock.perf_counter()
    try:
        with TemporaryDirectory() as directory:
            path = Path(directory) / f"{content['name']}.json"
            path.write_text(json.dumps(content), encoding="utf-8")
            study = load_study(path)
        search, dropped = first_step(study, whole=not assumed)
    except PliantError as error:
        return DraftCheck(str(error).replace(str(path), "the study"), None, assumed)
    return DraftCheck("", clock.perf_counter() - began + min(search, 60 * MINUTES), assumed, dropped)


def first_step(study: Study, *, whole: bool) -> tuple[float, tuple[str, ...]]:
    """Prepare a study, find the start of its model selection as a run does, compute the derivatives there, and screen
    the terms. Return the time of a search [s] that follows from these, and a sentence for each recording that is left
    out. Of long recordings a part is used, and the time is extrapolated.

    Raises
    ------
    PliantError
        When the study cannot be prepared, its first model cannot be simulated or, with `whole`, its recordings do not
        determine the parameters.
    """
    ready = prepare_all(study, lambda _line: None)
    entry = without(study, ready.dropped, ready.doubts).model_selection
    if entry is None:
        raise ValueError("the study has no model selection")
    train = [ready.experiments[name] for name in entry.train]
    short, parts = zip(*map(shortened, train), strict=True)
    problem, x = start_of_search(study, entry, train, short, ready.model, whole=whole and min(parts) == 1.0)
    seconds = search_seconds(entry, terms_for(ready.model, train, only=entry.terms, without=entry.without), problem, x)
    return seconds / float(np.mean(parts)), tuple(ready.dropped.values())


def search_seconds(entry: SelectionEntry, terms: Sequence[Term], problem: Problem, x: np.ndarray) -> float:
    """Return the time [s] that a search among `terms` takes from the first model with the scaled parameters x (P,), as
    the derivatives there and a screen of the terms show it.
    """
    slopes = seconds_of(lambda k: problem.jacobian(x + 1e-6 * (k + 1)))  # those at the start itself are known
    setting = FitSetting(tuple(problem.experiments), problem.time_step, entry.weighting, entry.loss)
    begun = {p.name: float(v) for p, v in zip(problem.free, x * problem.scale, strict=True)}
    parameters = [p.with_(value=begun.get(p.name, p.value)) for p in problem.parameters]
    parent = fitted(setting, problem.model, parameters, evaluations=0)
    terms = [t for t in terms if not t.needs and set(t.replaces) <= set(parent.free)]
    screen = seconds_of(lambda _: screened(parent, problem.model, terms, setting, parts_of(parent)))
    return DERIVATIVES * slopes + SCREENS * screen


def seconds_of(action: Callable[[int], object]) -> float:
    """Return the time [s] that an action takes; if it is quick, once what it compiles is compiled."""
    for k in range(2):
        began = clock.perf_counter()
        action(k)
        seconds = clock.perf_counter() - began
        if seconds > QUICK_S:
            break
    return seconds


def start_of_search(
    study: Study, entry: SelectionEntry, train: Sequence[Experiment], short: Sequence[Experiment], model: Model, *,
    whole: bool,
) -> tuple[Problem, np.ndarray]:
    """Return the problem of the first model of a search on `train`, with the recordings cut `short`, and its scaled
    parameters (P,) after one step of each fit that leads there.

    A body that follows its inputs slowly, or at once in space, begins as in a run, from its settled shapes. Raises
    FitError as `first_step`.
    """
    common = parameters_from(entry.common)
    setting = FitSetting(tuple(train), 0.0, entry.weighting, entry.loss)
    if slow := slow_body(setting, model):
        terms = terms_for(model, train, only=entry.terms, without=entry.without)
        if begun := slow_start(slow.briefly(short), model, common, terms, study.time_step, lambda _line: None):
            return begun.fit.problem, begun.fit.x
    brief = replace(setting, experiments=tuple(short), evaluations=1)
    if begun := quick_start(setting, brief, model, common, study.time_step, lambda _line: None):
        return begun.fit.problem, begun.fit.x
    first = beginning(model, short, common)
    problem = first_problem(short, model, first, study.time_step, entry.weighting)
    starts_of(problem, 1, np.random.default_rng(study.seed))
    if whole and len(model.chambers) < 2:  # several are fitted near their start values then
        check_identifiable(problem)
    return problem, problem.start


def shortened(exp: Experiment) -> tuple[Experiment, float]:
    """Return an experiment with its first seconds alone, or of many settled poses with a few, and the fraction of its
    frames that are left. A pulse, a step and a release are left whole.
    """
    count = exp.time.size
    if exp.poses:
        short = exp.thinned(max(1, count // POSES))
    elif exp.excitation == "trace":
        short = exp.of_frames(slice(0, max(FRAMES, int(np.searchsorted(exp.time - exp.time[0], SECONDS)))))
    else:
        return exp, 1.0
    return short, short.time.size / count


def answered(content: Mapping[str, Any], inspected: Inspected) -> tuple[dict[str, Any], tuple[str, ...]]:
    """Return the content of a drafted study with an assumed value for each open question, and the names of the entries
    for which a value was assumed.
    """
    filled: dict[str, Any] = json.loads(json.dumps(content))
    assumed: list[str] = []
    fill(filled, "", assumed_values(filled, inspected), assumed)
    for k, (name, entry) in enumerate(filled["recordings"].items()):
        for entry_name in entry.get("inputs", {}):
            if f"recordings.{name}.inputs.{entry_name}" in assumed:
                entry["inputs"][entry_name] = 1.0 + k  # different values, so that the poses differ
    return filled, tuple(dict.fromkeys(assumed))


def assumed_values(content: Mapping[str, Any], inspected: Inspected) -> dict[str, Any]:
    """Return the values to assume, by the path of the entry or by its last name. An assumed body reaches every place at
    which the recordings show its last station.
    """
    trial = inspected.first
    stated = content["actuator"].get("length", sum(inspected.segments))
    tangent, known = direction(inspected.trials), stated not in (None, OPEN)
    pixels = 1.0  # to a mm, as the film was read first
    if known and trial.assumed.get("camera") and (far := farthest(inspected.trials)):
        pixels = REACH * far / stated
    length = stated if known else farthest(inspected.trials) or body_length(trial) or spread(trial)
    base, reach = unseen_base(inspected.trials, tangent, length)
    if not known:
        length = REACH * max(length, reach)
    values = {
        "actuator.length": length, "actuator.mass": DENSITY * np.pi / 4 * (length / SLENDER) ** 2 * length,
        "actuator.gravity": [0.0, 0.0, 0.0], "fibre.body_length": length,
        "alignment.options.tangent": tangent, "alignment.options.origin": base,
        "camera.rate_hz": 30.0, "camera.pixels_per_mm": pixels, "mapping.angle_unit": "deg",
        "mapping.pressure_unit": "kPa", "driven_by": "tension", "lever": LEVER, "pulley": 2 * LEVER,
        "nominal_pressure": LEVEL_KPA, "tip_mass": PAYLOAD, "stop": length,
    }  # fmt: skip
    guess = trial.guess
    if (level := without_load(inspected.trials)) is not None:
        values["mapping.linear"] = {"pressure": {"offset": -level / 1e3, "unit": "kPa"}}
    proposed = {f"mapping.{name}": guess.neutral[name] for name in guess.questions} if guess else {}
    return {**values, **proposed, **({"mapping.camera.pixels_per_mm": pixels} if guess else {})}


def fill(node: dict[str, Any], where: str, values: Mapping[str, Any], assumed: list[str]) -> None:
    """Replace the open questions in a table and the tables in it by `values`, and add their paths to `assumed`."""
    for name, value in node.items():
        path = f"{where}.{name}" if where else name
        if path in values and OPEN in json.dumps(value):
            node[name] = values[path]
            assumed.append(path)
        elif value == OPEN:
            node[name] = values.get(name, 1.0)
            assumed.append(path)
        for table in value if isinstance(value, list) else [value]:
            if isinstance(table, dict) and path not in assumed:
                fill(table, path, values, assumed)


def spread(trial: Trial) -> float:
    """Return the length [m] of a body whose stations lie at equal distances from a base that is not tracked."""
    if trial.angles_only or trial.recording.sizes["station"] < 2:
        return LENGTH
    tips = np.nanmedian(trial.grouped["position"].values[:10], axis=0)
    return float(np.linalg.norm(np.diff(tips, axis=0), axis=1).sum()) * len(tips) / max(len(tips) - 1, 1) or LENGTH


def direction(trials: Sequence[Trial]) -> list[float]:
    """Return as the base tangent the axis of the tracker that is nearest to the direction from the first to the last
    station. If a single point was tracked, it is the axis along which that point moves least, and from most of its
    places towards the mean: a body that bends to all sides draws its tip back along its axis.
    """
    trial = trials[0]
    if trial.angles_only or trial.recording.attrs["frame"] != "tracker":
        return [0.0, 1.0]
    if (hang := down(trials)) is not None:
        return [x / 9.81 for x in hang]
    tip = tips(trials)
    k = int(np.argmin(tip.std(axis=0)))
    sign = 1.0 if np.median(tip[:, k]) > tip[:, k].mean() else -1.0
    return [sign if j == k else 0.0 for j in range(3)]


def tips(trials: Sequence[Trial]) -> np.ndarray:
    """Return the known positions (T, 3) [m] of the last station in all recordings without a tracked base."""
    tip = np.concatenate([trial.grouped["position"].values[:, -1] for trial in trials])
    return tip[np.isfinite(tip).all(axis=1)]


def unseen_base(trials: Sequence[Trial], tangent: Sequence[float], length: float) -> tuple[list[float], float]:
    """Return the origin [m] of a base that was not tracked, and the largest distance [m] of the last station from it.

    The origin lies behind the place of the last station that is farthest along the tangent, by most of the length that
    lets a body of this length reach all places.
    """
    if trials[0].angles_only or trials[0].recording.attrs["frame"] != "tracker" or trials[0].options:
        return [0.0, 0.0, 0.0], 0.0
    tip, along = tips(trials), np.array(tangent)
    centre = np.median(tip, axis=0)
    centre += (np.percentile(tip @ along, 95) - centre @ along) * along
    bases = [centre - part * length * along for part in BEHIND]
    reach = [float(np.linalg.norm(tip - base, axis=1).max()) for base in bases]
    best = next((k for k, far in enumerate(reach) if far <= length), int(np.argmin(reach)))
    return [float(x) for x in bases[best]], reach[best]
