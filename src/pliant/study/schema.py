"""The entries of a study file (TOML, or the JSON that a run writes) and the checks of their values."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, BeforeValidator, Field, ValidationError, model_validator

from pliant.errors import InputError, explain_validation, inside
from pliant.files import MAPPING, STUDY, SWEEP, kind_of_file, read_entries, refuse_other
from pliant.identification.experiment import Excitation
from pliant.identification.fit import parameters_from
from pliant.identification.from_recording import Angles, Start
from pliant.model.tables import Table
from pliant.selection.terms import known_term
from pliant.study.body_tables import ActuatorEntry
from pliant.study.known_force import KnownForce, check_forces
from pliant.study.shorthand import expanded, refuse_mapping, refuse_open
from pliant.sweep.spec import Sweep

Weighting = Literal["travel", "metre", "noise", "decay"]
Loss = Literal["linear", "soft_l1", "huber", "cauchy"]
TermName = Annotated[str, AfterValidator(known_term)]
SPREAD = 0.15  # standard deviation between robots of a kind, as a fraction of each parameter
WEIGHTING: Any = Field("travel", description=(
    "errors relative to the peak displacement of each recording; `metre`: absolute; `noise`: relative to each "
    "station's noise, stated or estimated; `decay`: relative to the motion still to come, so that small swings count "
    "as much as large ones"))
LOSS: Any = Field("linear", description=(
    "all but `linear` limit the influence of outliers beyond 1 % of the peak displacement"))
REPLICATES: Any = Field(0, ge=0, le=10_000, description=(
    "replicates of a block bootstrap for the standard errors, usually 200; 0: the sandwich formula"))
TRAIN: Any = Field(description="training recordings, all fitted together")
HELD_OUT: Any = Field([], description="recordings to predict")


def as_list(entry: Any) -> Any:
    """Return a single table as a list of one."""
    return [entry] if isinstance(entry, Mapping) else entry


class StudyEntry(Table, BaseModel):
    """A table of the study file, in which an unknown key is an error."""


class AlignmentEntry(StudyEntry):
    """The transformation from the tracker to the base frame: markers of each station, and options of `pliant.align`."""

    stations: dict[str, Any] = {}  # name -> list of markers, or a table; see pliant.assemble
    options: dict[str, Any] = {}  # base, tangent, plane, ...
    swaps: Literal["undo", "exclude"] | None = None  # treatment of exchanged labels; None: unchanged
    common_rest: bool = False  # shift all recordings to the rest position of the first; study's alignment only


class Fibre(StudyEntry):
    """A shape-sensing fibre along the body. A cap of constant curvature at its tip, or a stated length of fibre before
    the body, determines which part of the fibre lies in the body.
    """

    body_length: float = Field(description="distance from base to tip along the fibre, m")
    cap_curvature: float | None = Field(default=None, description=(
        "curvature of the cap, 1/m; positive if it bends like the body under positive pressure"))
    cap_length: float | None = Field(default=None, description="length of the fibre in the cap, m")
    start: float | None = Field(
        default=None, ge=0, description="instead of the cap: length of fibre before the body, m")
    gauge_length: float | None = Field(
        default=None, description="length over which the sensor averages, m; by default one spacing of the points")
    rest: tuple[float, float] | None = Field(default=None, description=(
        "start and end of the rest, s; by default before the pressure rises or the body first moves"))
    clamp_length: float = Field(
        default=0.012, description="length of straight fibre at its start, which gives the base tangent, m")

    @model_validator(mode="after")
    def one_end(self) -> Fibre:
        """Check that the table [fibre] states either the cap (curvature and length) or `start`, not both."""
        capped = self.cap_curvature is not None and self.cap_length is not None
        if capped == (self.start is not None) or (self.cap_curvature is None) != (self.cap_length is None):
            raise ValueError("[fibre] needs either cap_curvature and cap_length, or start")
        return self


class Reduction(StudyEntry):
    """The approximation of a shape, recorded at many points along the body, by a chain of links."""

    recording: str | None = Field(
        None, description=("recording whose shape is used, by default the first of training: choose the one with the "
                           "largest bend"))
    links: int | None = Field(
        None, ge=1, le=64, description="number of links, if you choose it; by default the lowest within the bound")
    bound_mm: float = Field(
        3.0, gt=0, description="largest allowed error of the reconstructed shape in any frame")
    max_order: int = Field(8, ge=2, le=64, description="highest order to try")
    boundary: str = Field(
        "clamped+not-a-knot", description="end conditions of the spline; also `not-a-knot`, `natural`")
    placement: Literal["equal", "best"] = Field("equal", description=(
        "joints at equal arc length, or at the positions with the smallest largest error"))
    joint_placement: Literal["base", "midsegment"] = Field("base", description=(
        "position of each joint in its segment; in the middle, the joint stiffness corresponds to the physical one"))


class Recording(StudyEntry):
    """One recording of a study: its file, alignment, excitation, known loads, and the channels that drive the
    chambers.
    """

    file: str
    mapping: dict[str, Any] | None = None
    format: str | None = None
    pressure_file: str | None = None  # separate file with the log of the pressure
    pressure_mapping: dict[str, Any] | None = None
    clock: Literal["same", "align"] | float | None = None  # s to add to the log's times; default: align a separate log
    signal: Literal["measured", "commanded"] | None = None  # kind of its inputs, if that is known
    staircase: Literal["lines"] | None = None  # inputs held between updates are replaced by lines between their changes
    spikes: Literal["leave out", "keep"] = "leave out"  # of stations, and glitches of inputs
    window: tuple[float, float] | None = None  # s on the clock of the shape: the part to use
    part: tuple[float, float] | None = None  # fractions of its rows, 0 to 1: the part to use
    excitation: Excitation | None = None
    held: Literal["unloaded", "measured"] = "unloaded"  # position from which the body was released
    nominal_pressure: float | None = None
    pressure_unit: str = "Pa"  # of nominal_pressure
    allow_low_pressure: bool = False  # a highest pressure below 1 kPa is right, not a wrong unit
    stations: list[str] | None = None  # stations to compare with, in order, tip last
    known: dict[str, float] = {}  # parameters of this recording alone, SI
    gravity: list[float] | None = None  # m/s^2, of this recording, in the axes of gravity in [actuator]
    noise: dict[str, float] = {}  # m, standard deviation of a station's coordinates, if known
    drive: dict[str, str | int] = {}  # chamber of the model -> chamber of the recording, by name or index from 0
    poses: bool | Literal["median"] = False  # each row is a settled pose; "median": all rows are one, their median
    inputs: dict[str, float] = {}  # input of the model -> its value in all rows, SI, where the file holds none
    own_places: bool = False  # station positions from this recording's first frames, at rest
    start: Start | None = None  # of its simulation; default: by the first frames and the warm-up
    every: int = Field(1, ge=1)  # each such frame is used
    warm_up: float = Field(0.0, ge=0)  # s from the first frame on that are simulated, but not compared
    angles: Angles = False  # fit the angles too (of a dense shape: of its joints), or "only" them
    forces: list[KnownForce] = []
    alignment: AlignmentEntry | None = None  # takes precedence over the study's


class Fit(StudyEntry):
    """One fit: its free parameters, the recordings to train on and to hold out, and options of the optimisation."""

    title: str = Field("", description="name in the report")
    train: list[str] = TRAIN
    held_out: list[str] = HELD_OUT
    parameters: dict[str, float | Literal["free"] | dict[str, Any]] = Field(description=(
        "each `free` (estimated start value), a number (free, with this start value), or a table with `value`, "
        "`lower`, `upper`, `free`, `source`, `prior` and `prior_std` (prior knowledge), `shrink` (joints towards their "
        "mean)"))
    weighting: Weighting = WEIGHTING
    loss: Loss = LOSS
    starts: int = Field(3, ge=1, le=100, description=(
        "number of starts: the estimate, the optima of smaller fits that this one contains, and random values around "
        "the estimate"))
    joint_placement: Literal["base", "midsegment"] | None = Field(None, description=(
        "of this fit, by default the actuator's; the verdict then compares bending stiffness and error. Not with "
        "[reduction]"))
    links: int | None = Field(None, ge=1, le=100, description=(
        "of this fit, by default the actuator's. Not with [reduction], chambers or tendons"))
    regularise: bool = Field(False, description=(
        "fit although the recordings do not determine all parameters; otherwise the fit stops and names them"))
    bootstrap: int = REPLICATES


class SelectionEntry(StudyEntry):
    """Model selection: the terms of the model are chosen from the training recordings; the others judge the choice."""

    train: list[str] = TRAIN
    held_out: list[str] = HELD_OUT
    common: dict[str, float | Literal["free"] | dict[str, Any]] = Field({}, description=(
        "as `parameters` of a fit: free in every model, such as the position of a marker"))
    terms: list[TermName] = Field([], description="names of the terms that may be added; all by default")
    without: list[TermName] = Field([], description="names of terms that may not be added")
    minutes: float = Field(5.0, gt=0, le=1e4, description=(
        "time limit, at which the best model so far is the result, and the verdict says so; or `pliant run --minutes`"))
    weighting: Weighting = WEIGHTING
    loss: Loss = LOSS
    bootstrap: int = REPLICATES


class WiringEntry(StudyEntry):
    """Wirings to compare by their fit to the training recordings. A wiring says which recorded pressure drives which
    chamber.
    """

    fit: str = ""  # fit whose parameters and training recordings are used; default: the first
    drives: dict[str, dict[str, str | int]] = {}  # by name; default: every permutation of the stated pressures


class ForecastEntry(StudyEntry):
    """A prediction for a case that was not recorded."""

    title: str = Field("", description="name in the report")
    like: str = Field(description="the recording whose excitation the forecast uses")
    fit: str = Field("", description="the fit whose model makes the forecast; by default the study's first")
    known: dict[str, float] = Field(
        {}, description="differences from this recording, such as `{ tip_mass = 0.101 }`")
    level: float | None = Field(None, description="pressure of a pulse or step")
    pressures: dict[str, float] = Field({}, description=(
        "if the inputs were measured, the highest of each driven chamber or tendon: `{ left = 60.0, right = 60.0 }`; "
        "one unnamed chamber is called `chamber`"))
    pressure_unit: str = Field("Pa", description="of the pressures; tensions and others are in SI units")


class AdaptEntry(StudyEntry):
    """Another day: a fitted model is adapted to the first seconds of recordings, and judged on the rest."""

    recordings: list[str] = Field(min_length=1, description="recordings of the day, in their order")
    fit: str = Field("", description="fit to start from; by default the adaptation before, or the first fit")
    seconds: float = Field(20.0, gt=0, description="duration of the motion to fit, s, warm-up included")
    of_a_kind: bool = Field(False, description="whether the recordings are of another robot of the kind")
    spread: float = Field(SPREAD, gt=0, description=(
        "with `of_a_kind`: standard deviation between robots, as a fraction of each parameter"))


class Targets(StudyEntry):
    """Limits of the prediction errors, with which the report compares the results."""

    rmse_percent_of_travel: float | None = Field(
        default=None, description="error of each held-out recording, in % of its peak displacement")
    frequency_percent: float | None = Field(default=None, description=(
        "difference of the ring-down's frequency, in % of the measured one; of large and of small swings separately, "
        "if a recording shows both"))
    damping_percent: float | None = Field(default=None, description="difference of the damping ratio, likewise")
    steady_state_percent: float | None = Field(
        default=None, description="difference of the plateau, in % of the measured value")


class Study(StudyEntry):
    """The content of a study file."""

    name: str
    title: str = ""
    description: str = ""
    actuator: ActuatorEntry
    camera: dict[str, Any] | None = None  # for all recordings made by a tracker from a video
    mapping: dict[str, Any] = {}  # for all recordings; a recording's own mapping takes precedence
    alignment: AlignmentEntry = AlignmentEntry()
    fibre: Fibre | None = None
    reduction: Reduction | None = None
    recordings: dict[str, Recording]
    fits: dict[str, Fit] = {}
    model_selection: SelectionEntry | None = None
    wiring: WiringEntry | None = None
    forecasts: dict[str, ForecastEntry] = {}
    adapt: Annotated[list[AdaptEntry], BeforeValidator(as_list)] = []  # one table, or one for each day
    targets: Targets = Targets()
    sweep: Sweep | None = None
    time_step: float | None = Field(None, gt=0, le=0.1)  # s; None: chosen for the start of each fit, at most 2 to 50 ms
    seed: int = 0
    folder: str = "."  # start of relative file names; set when the study is loaded

    def with_minutes(self, minutes: float) -> Study:
        """Return the study with another time limit [min] of its model selection.

        Raises
        ------
        InputError
            When the study selects no model.
        """
        if self.model_selection is None:
            raise InputError(f"study {self.name}: there is no time limit to change, since it has no [model_selection]: "
                             "leave out --minutes, or add the table")
        return self.model_copy(update={"model_selection": self.model_selection.model_copy(update={"minutes": minutes})})


def load_study(path: str | Path) -> Study:
    """Read a study file, check its entries and return the study.

    Parameters
    ----------
    path : str or Path
        TOML file, or the JSON file that a run writes.

    Raises
    ------
    InputError
        When the file cannot be read, has an unknown or missing entry, or names a recording that it does not list.

    Examples
    --------
    >>> import pliant
    >>> from pliant.study import demo_study
    >>> sorted(pliant.load_study(demo_study()).recordings)
    ['pulse_119', 'pulse_180', 'pulse_60', 'step_240']
    """
    path = Path(path)
    if path.is_file() and kind_of_file(path) not in (MAPPING, SWEEP):  # these have refusals of their own
        refuse_other(path, STUDY)
    content = read_entries(path, "study")
    refuse_open(content, path)
    refuse_mapping(content, path)
    try:
        with inside(f"study {path}"):
            study = Study.model_validate(expanded(content))
    except ValidationError as error:
        raise explain_validation(error, f"study {path}", Study) from None
    if not study.recordings or not (study.fits or study.model_selection):
        raise InputError(
            f"study {path} needs at least one entry under [recordings] and one under [fits], or [model_selection]"
        )
    with inside(f"study {path}"):
        check_names(study)
    check_parameters(study, path)
    return study.model_copy(update={"folder": str((path.parent / study.folder).resolve())})


def check_listed(name: str, known: Collection[str], use: str, remedy: str) -> None:
    """Raise InputError if `name` is not one of the names `known`. The message begins with `use`, a sentence that ends
    before the name, and ends in `remedy`.
    """
    if name not in known:
        raise InputError(f"{use} {name!r}, which is not one of {', '.join(known)}: {remedy}")


def check_names(study: Study) -> None:
    """Check that each recording of a fit is listed, and that no fit trains on a recording that it holds out.

    Raises InputError otherwise.
    """
    learning: dict[str, Fit | SelectionEntry] = dict(study.fits)
    if study.model_selection:
        learning["[model_selection]"] = study.model_selection
    for name, fit in learning.items():
        for record in [*fit.train, *fit.held_out]:
            check_listed(record, study.recordings, f"fit {name} uses recording", "correct its `train` or `held_out`")
        both = set(fit.train) & set(fit.held_out)
        if both or not fit.train:
            problem = f"trains on and holds out {min(both)!r}" if both else "trains on no recording"
            raise InputError(f"fit {name} {problem}: correct its train or held_out")
    check_reduction(study)
    check_forces({n: r.forces for n, r in study.recordings.items()}, space=bool(study.actuator.space))
    for name, entry in study.forecasts.items():
        check_listed(entry.like, study.recordings, f"`like` of forecast {name} names recording", "correct it")
        if entry.fit:
            check_listed(entry.fit, study.fits, f"forecast {name} uses fit", "correct its `fit`")
    check_days(study, learning)
    if bad := [n for n in (*study.recordings, *study.forecasts) if "." in n or not n]:
        raise InputError(f"the name of a recording or forecast must not have a dot, got {bad[0]!r}")
    check_chambers(study)


def check_days(study: Study, learning: Mapping[str, Fit | SelectionEntry]) -> None:
    """Check that [adapt] names listed recordings that no fit trains on, and fits or adaptations before it."""
    fits = [name.strip("[]") for name in learning]
    for day, entry in zip(day_names(study), study.adapt, strict=True):
        for record in entry.recordings:
            check_listed(record, study.recordings, "[adapt] uses recording", "correct its `recordings`")
            if trained := [name for name, fit in learning.items() if record in fit.train]:
                raise InputError(f"[adapt] uses recording {record!r}, on which fit {trained[0]} trains: another day "
                                 "needs recordings that the fit has not seen")  # fmt: skip
        if entry.fit:
            check_listed(entry.fit, fits, "[adapt] uses fit", "correct its `fit`")
        fits.append(day)


def day_names(study: Study) -> list[str]:
    """Return the names of the adapted fits of a study: "adapted", "adapted_2", ..."""
    return [f"adapted_{k + 1}" if k else "adapted" for k in range(len(study.adapt))]


def check_reduction(study: Study) -> None:
    """Check that [reduction] names a listed recording, and that no fit also states links or joint placement."""
    if study.reduction is None:
        return
    if study.reduction.recording is not None:
        check_listed(study.reduction.recording, study.recordings, "[reduction] uses recording",
                     "correct its `recording`")  # fmt: skip
    if placed := [n for n, f in study.fits.items() if f.joint_placement or f.links]:
        entry = "joint_placement" if study.fits[placed[0]].joint_placement else "links"
        raise InputError(f"fit {placed[0]} states {entry}, but [reduction] places the joints: state it in [reduction]")


def check_chambers(study: Study) -> None:
    """Check the chambers and tendons of the actuator, and that recordings, forecasts and wirings drive no others.

    Chambers and tendons act on numbered joints, so that a fit cannot change the number of links.
    """
    jointed = study.actuator.chambers or study.actuator.tendons
    if jointed and (other := [n for n, f in study.fits.items() if f.links]):
        raise InputError(f"fit {other[0]} states links, but {jointed[0].name} acts on numbered joints of [actuator]: "
                         "state links in [actuator], in a separate study for each number of links")  # fmt: skip
    inputs = [c.name for c in study.actuator.chambers] + [t.name for t in study.actuator.tendons]
    names = inputs or ["chamber"]
    if inputs and (single := study.actuator.single_chamber()):
        raise InputError(f"state either {single[0]} in [actuator], for one chamber, or [[actuator.chambers]]")
    if study.actuator.tendons and not study.actuator.space:
        raise InputError("[[actuator.tendons]] needs a body in space: set space = true in [actuator]")
    driven: dict[str, Collection[str]] = {f"forecast {n}": f.pressures for n, f in study.forecasts.items()}
    driven |= {f"recording {n}": r.drive for n, r in study.recordings.items()}
    if study.wiring:
        driven |= {f"wiring {n}": drive for n, drive in study.wiring.drives.items()}
        if study.reduction is not None:
            raise InputError("[wiring] cannot be used with [reduction]: remove one of them")
        if not study.fits or study.wiring.fit not in ("", *study.fits):
            listed = f": use one of {', '.join(study.fits)}" if study.fits else ": add one under [fits]"
            raise InputError(f"[wiring] uses unknown fit {study.wiring.fit or '(the first)'!r}{listed}")
    for where, chambers in driven.items():
        if strange := [c for c in chambers if c not in names]:
            raise InputError(f"{where} drives the chamber {strange[0]!r}, but the actuator has {', '.join(names)}: use "
                             "these names")  # fmt: skip


def check_parameters(study: Study, path: Path) -> None:
    """Check, before any computation, that each parameter in the study exists and has a possible value."""
    tables: dict[str, Mapping[str, Any]] = {f"recording {n}": r.known for n, r in study.recordings.items()}
    tables |= {f"forecast {n}": f.known for n, f in study.forecasts.items()}
    tables |= {f"fit {n}": f.parameters for n, f in study.fits.items()}
    tables |= {"[model_selection]": study.model_selection.common} if study.model_selection else {}
    for where, entries in tables.items():
        with inside(f"study {path}, {where}"):
            parameters_from(entries)
