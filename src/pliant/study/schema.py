"""The study file (TOML, or the JSON that a run leaves behind): its entries and their checks."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from pliant.errors import InputError, explain_validation
from pliant.files import read_entries
from pliant.identification.fit import parameters_from
from pliant.identification.from_recording import Angles
from pliant.identification.recorded import Excitation
from pliant.model import Station
from pliant.simulation.forces import PointForce
from pliant.study.questions import refuse_mapping, refuse_open
from pliant.study.shorthand import written_out
from pliant.sweep.spec import Sweep

Weighting = Literal["travel", "metre", "noise"]
Loss = Literal["linear", "soft_l1", "huber", "cauchy"]
Replicates = Field(0, ge=0, le=10_000)  # of a block bootstrap for the standard errors; 0: the sandwich formula


class StudyEntry(BaseModel):
    """A table of the study file; an unknown key is an error, never ignored."""

    model_config = ConfigDict(extra="forbid")


class ChamberTable(StudyEntry):
    """One of several chambers: the joints that it turns, and its torque law."""

    name: str = Field(min_length=1, pattern=r"^[^.]+$")  # its parameters are called name.parameter
    joints: list[int] | None = Field(default=None, min_length=1)  # from 1, the first; default: all
    torque: list[float] = [0.0]  # N m/Pa^k
    gain: float | list[float] = 1.0  # share of the law that those joints feel; below 0: bends to the other side
    azimuth_deg: float | None = None  # in space: around the axis, from x of the base frame towards y
    axial_gain: float | list[float] = 0.0  # 1/m, axial force in parts of the torque; 1 / offset by geometry


class TendonTable(StudyEntry):
    """One tendon of a body in space, or a pair on one motor; see `pliant.model.Tendon`."""

    name: str = Field(min_length=1, pattern=r"^[^.]+$")  # its parameters are called name.parameter
    driven_by: Literal["tension", "displacement", "angle"]
    joints: list[int] | None = Field(default=None, min_length=1)  # that it passes, from 1; default: all
    azimuth_deg: float | None = None  # around the axis, from x of the base frame towards y; default: as the tip moves
    lever: float = Field(gt=0)  # m, distance from the axis, at the base where it changes
    taper: float = 0.0  # by how much it comes nearer to the axis for each length along it
    stop: float | None = Field(default=None, gt=0)  # m from the base, where it ends; default: the last of its joints
    line_stiffness: float = Field(1000.0, gt=0)  # N/m; not of one driven by its tension
    pretension: float = 0.0  # N; below 0 it hangs slack
    pulley: float = Field(0.0, ge=0)  # m, radius; of one driven by an angle
    pair: bool = False  # two opposite tendons on one motor
    friction: float = Field(0.0, ge=0)  # coefficient along the path
    slip_rate: float = Field(1e-3, gt=0)  # m/s, over which friction changes its direction


class ExtensionTable(StudyEntry):
    """A segment of the body that lengthens, between two places along it."""

    name: str = Field("body", min_length=1, pattern=r"^[^.]+$")  # its parameters are called name.parameter
    start: float = 0.0  # m, from the base
    stop: float | None = None  # m; default: the tip
    stiffness: float = Field(1000.0, gt=0)  # N, axial force per strain
    damping: float = Field(0.0, ge=0)  # N s
    stiffening: float | None = None  # s of an axial spring EA e (1 + s e + a e^2); default: a linear one
    cubic_stiffening: float | None = None  # a of the same
    stiffening_bound: float | None = Field(None, ge=0, lt=1)  # f: what s does to the slope at most, in parts of EA


class TaperTable(StudyEntry):
    """A solid round body whose radius changes along it: stiffness and mass follow, and the stiffness of extensions."""

    at: list[float] = Field(min_length=2)  # m from the base; straight lines between
    radius: list[float] = Field(min_length=2)  # m
    modulus: float = Field(gt=0)  # Pa, of elasticity
    density: float = Field(gt=0)  # kg/m^3


class StationTable(StudyEntry):
    """Where an observed point is on the body; without it that is read off the first frames, the body unloaded."""

    name: str
    at: float  # m along the body, from the base
    along: float = 0.0  # m beyond that
    across: float = 0.0  # m, to the left of the link
    aside: float = 0.0  # m, out of the plane


class SpaceTable(StudyEntry):
    """Entries of a body in space."""

    stiffness_ratio: float = Field(1.0, gt=0)  # bending stiffness about y over that about x
    twist_ratio: float = Field(0.0, ge=0)  # torsional over bending stiffness; 0: the chain does not twist
    radius: float = Field(0.0, ge=0)  # m, of the cross-section: its inertia about the axis


class ActuatorEntry(StudyEntry):
    """The body, SI. A preset gives all of it; other entries overrule the preset."""

    preset: str | None = None  # a module of pliant.actuators
    length: float | None = None  # m, of the part that bends
    base_length: float | None = Field(None, ge=0)  # m, rigid between the base and the part that bends
    mass: float | None = None  # kg, without the tip mass
    links: int | None = Field(None, ge=1, le=64)
    joint_placement: Literal["base", "midsegment"] | None = None
    mass_at: Literal["rod", "tip"] | None = None
    tip_mass: float | None = None  # kg
    stiffness: float | list[float] | None = None  # N m/rad
    damping: float | list[float] | None = None  # N m s/rad
    torque: list[float] | None = None  # N m/Pa^k, of the only chamber
    chambers: list[ChamberTable] = []  # in its place, where there are several
    tendons: list[TendonTable] = []  # in their place or beside them, of a body in space
    extensions: list[ExtensionTable] = []  # segments that lengthen
    taper: TaperTable | None = None  # in place of mass and stiffness
    stations: list[StationTable] = []  # observed points
    rest_angle: float | list[float] | None = None  # rad
    gravity: list[float] | None = None  # m/s^2, (x, y) as force_n has them or (x, y, z) of the tracker
    space: bool | SpaceTable = False  # the body moves in space, not in a plane
    section_area: float | None = Field(None, gt=0)  # m^2 of solid section, against which a fitted mass is checked
    diameter: float | None = Field(None, gt=0)  # m, outer: density, modulus and torque are checked with it
    source: dict[str, str] = {}


class AlignmentEntry(StudyEntry):
    """From the tracker to the base frame: which markers make a station, and the options of `pliant.align`."""

    stations: dict[str, Any] = {}  # name -> list of markers, or a table; see pliant.assemble
    options: dict[str, Any] = {}  # base, tangent, plane, ...
    swaps: Literal["undo", "exclude"] | None = None  # what to do where labels are exchanged; None: nothing
    common_rest: bool = False  # all recordings are moved to rest where the first one does; of the study's alignment


class Fibre(StudyEntry):
    """A fibre along the body: its tip marked by a cap of constant curvature, or its base at a known length."""

    body_length: float  # m, along the fibre
    cap_curvature: float | None = None  # 1/m, its sign as the body bends under positive pressure
    cap_length: float | None = None  # m; the base is one body length before the cap
    start: float | None = Field(default=None, ge=0)  # m along the fibre to the base, where no cap marks the tip
    gauge_length: float | None = None  # m, over which the sensor averages
    rest: tuple[float, float] | None = None  # s, when the body is at rest; default: before the pressure or the motion
    clamp_length: float = 0.012  # m of straight fibre at its start, held in the clamp: gives the base tangent


    @model_validator(mode="after")
    def one_end(self) -> Fibre:
        """The body is found by its cap or by where it starts."""
        capped = self.cap_curvature is not None and self.cap_length is not None
        if capped == (self.start is not None) or (self.cap_curvature is None) != (self.cap_length is None):
            raise ValueError("a fibre has cap_curvature and cap_length, or start")
        return self


class Reduction(StudyEntry):
    """From a dense shape to links."""

    recording: str | None = None  # whose shape decides; default: the first
    links: int | None = Field(None, ge=1, le=64)  # None: the lowest order within the bound
    bound_mm: float = Field(3.0, gt=0)
    max_order: int = Field(8, ge=2, le=64)
    boundary: str = "clamped+not-a-knot"
    placement: Literal["equal", "best"] = "equal"
    joint_placement: Literal["base", "midsegment"] = "base"  # where in its segment each joint sits


class KnownForce(StudyEntry):
    """A known force at a point of the body, as of a thread that pulls; straight lines between the times."""

    station: str | None = None  # a point of the model
    link: int | None = Field(None, ge=1)  # or a place on a link, 1 the first
    along: float | None = None  # m, from the joint, with a link
    across: float = 0.0  # m, to the left of the link
    time_s: list[float]
    force_n: list[tuple[float, float]]  # in the axes of a planar recording, in the base frame of a tracked one

    @model_validator(mode="after")
    def one_place(self) -> KnownForce:
        """A force has one place."""
        if (self.station is None) == (self.link is None) or (self.link is None) != (self.along is None):
            raise ValueError("a known force pulls at a station, or at a link with along (and across)")
        return self

    def in_base_frame(self, x_sign: int) -> PointForce:
        """Return the force as an experiment takes it, with the sign of the recording's x axis in the base frame."""
        at = self.station or Station("known force", (self.link or 1) - 1, self.along or 0.0, self.across)
        return PointForce(np.array(self.time_s), np.array(self.force_n).reshape(-1, 2) * [x_sign, 1.0], at)


class Recording(StudyEntry):
    """One recording; see `shorthand` for defaults and many trials in one file."""

    file: str
    mapping: dict[str, Any] | None = None
    format: str | None = None
    pressure_file: str | None = None  # a log of the pressure, apart from the shape
    pressure_mapping: dict[str, Any] | None = None
    clock: Literal["same", "align"] | float | None = None  # s to add to the log's times; default: align another file's
    signal: Literal["measured", "commanded"] | None = None  # what its inputs are, where that is known
    staircase: Literal["lines"] | None = None  # inputs held between updates: straight lines between their changes
    window: tuple[float, float] | None = None  # s on the clock of the shape: the part that is used
    part: tuple[float, float] | None = None  # of its rows, from 0 to 1: the part that is used
    excitation: Excitation | None = None
    held: Literal["unloaded", "measured"] = "unloaded"  # where a body that is let go was held before
    nominal_pressure: float | None = None
    pressure_unit: str = "Pa"  # of nominal_pressure
    allow_low_pressure: bool = False  # a highest pressure below 1 kPa is right, not a wrong unit
    stations: list[str] | None = None  # which to compare with, in order, the tip last
    known: dict[str, float] = {}  # parameters of this recording alone, SI
    noise: dict[str, float] = {}  # m, standard deviation of a station's coordinates, where it is known
    drive: dict[str, str | int] = {}  # chamber of the model -> chamber of the recording, by name or index from 0
    poses: bool | Literal["median"] = False  # each row is a settled pose; "median": all rows are one, their median
    inputs: dict[str, float] = {}  # input of the model -> its value in all rows, SI, where the file holds none
    own_places: bool = False  # read the places of its stations off its own first frames, the chain at rest
    angles: Angles = False  # fit the recorded angles too (of a reduced shape: those of its joints), or "only" them
    forces: list[KnownForce] = []
    alignment: AlignmentEntry | None = None  # its entries overrule the study's


class Fit(StudyEntry):
    """One fit: what is free, what it learns from, what it must predict; see `shorthand` for `like` and `without`."""

    title: str = ""
    train: list[str]
    held_out: list[str] = []
    parameters: dict[str, float | Literal["free"] | dict[str, Any]]
    weighting: Weighting = "travel"
    loss: Loss = "linear"
    starts: int = Field(3, ge=1, le=100)
    joint_placement: Literal["base", "midsegment"] | None = None  # of this fit; default: the actuator's
    links: int | None = Field(None, ge=1, le=100)  # of this fit; default: the study's
    regularise: bool = False  # fit although the recordings do not tell the parameters apart
    bootstrap: int = Replicates


class SelectionEntry(StudyEntry):
    """Models from the given one upwards, each freeing more; the held-out records say which becomes the study's."""

    train: list[str]
    held_out: list[str] = []
    common: dict[str, float | Literal["free"] | dict[str, Any]] = {}  # free on every stage
    stages: list[str] = []  # names of `pliant.identification.STAGES`; all when empty
    weighting: Weighting = "travel"
    loss: Loss = "linear"
    starts: int = Field(1, ge=1, le=100)
    bootstrap: int = Replicates


class WiringEntry(StudyEntry):
    """Wirings to compare: which recorded pressure drives which chamber."""

    fit: str = ""  # whose parameters and training records; default: the first
    drives: dict[str, dict[str, str | int]] = {}  # by name; default: every order of the pressures that are stated


class ForecastEntry(StudyEntry):
    """A prediction for a case that was not recorded."""

    title: str = ""
    like: str  # the recording whose excitation it shares
    fit: str = ""  # whose model predicts; default: the study's
    known: dict[str, float] = {}
    level: float | None = None
    pressures: dict[str, float] = {}  # chamber -> highest, on the recording's course; others stay as they began
    pressure_unit: str = "Pa"


class Targets(StudyEntry):
    """Targets by which the verdict judges the predictions."""

    rmse_percent_of_travel: float | None = None
    frequency_percent: float | None = None  # of large and of small swings, where a record shows both
    damping_percent: float | None = None  # of the damping ratio, likewise
    steady_state_percent: float | None = None


class Study(StudyEntry):
    """A study file."""

    name: str
    title: str = ""
    description: str = ""
    actuator: ActuatorEntry
    camera: dict[str, Any] | None = None  # of every recording that a tracker made of a video
    mapping: dict[str, Any] = {}  # of every recording; what a recording's own says overrules it
    alignment: AlignmentEntry = AlignmentEntry()
    fibre: Fibre | None = None
    reduction: Reduction | None = None
    recordings: dict[str, Recording]
    fits: dict[str, Fit] = {}
    model_selection: SelectionEntry | None = None
    wiring: WiringEntry | None = None
    forecasts: dict[str, ForecastEntry] = {}
    targets: Targets = Targets()
    sweep: Sweep | None = None
    step: float = Field(2e-3, gt=0, le=0.1)  # s, of the integration
    seed: int = 0
    folder: str = "."  # where relative file names start; set when the study is loaded


def load_study(path: str | Path) -> Study:
    """Read and check a study file.

    Parameters
    ----------
    path : str or Path
        TOML, or JSON as a run writes it.

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
    try:
        content = read_entries(path, "study")
        refuse_open(content, path)
        refuse_mapping(content, path)
        study = Study.model_validate(written_out(content, path))
    except ValidationError as error:
        raise explain_validation(error, f"study {path}") from None
    check_names(study, path)
    return study.model_copy(update={"folder": str((path.parent / study.folder).resolve())})


def check_names(study: Study, path: Path) -> None:
    """Every recording that is used is listed, and no record is trained on and held out at once."""
    if not study.recordings or not (study.fits or study.model_selection):
        raise InputError(
            f"study {path} needs at least one entry under [recordings] and one under [fits], or [model_selection]"
        )
    listed = ", ".join(study.recordings)
    learning: dict[str, Fit | SelectionEntry] = dict(study.fits)
    if study.model_selection:
        learning["[model_selection]"] = study.model_selection
    for name, fit in learning.items():
        for record in [*fit.train, *fit.held_out]:
            if record not in study.recordings:
                raise InputError(f"study {path}: fit {name} uses recording {record!r}; listed are {listed}")
        both = set(fit.train) & set(fit.held_out)
        if both or not fit.train:
            problem = f"trains on and holds out {min(both)!r}" if both else "trains on no recording"
            raise InputError(f"study {path}: fit {name} {problem}")
    check_reduction(study, path)
    check_forecast_names(study, path)
    if bad := [n for n in (*study.recordings, *study.forecasts) if "." in n or not n]:
        raise InputError(f"study {path}: the name of a recording or forecast has no dot, got {bad[0]!r}")
    check_chambers(study, path)
    check_parameters(study, path)


def check_forecast_names(study: Study, path: Path) -> None:
    """Every forecast is like a recording that is listed, and by a fit that is."""
    for name, entry in study.forecasts.items():
        if entry.like not in study.recordings:
            listed = ", ".join(study.recordings)
            raise InputError(f"study {path}: forecast {name} is like recording {entry.like!r}; listed are {listed}")
        if entry.fit and entry.fit not in study.fits:
            fits = ", ".join(study.fits)
            raise InputError(f"study {path}: forecast {name} is of fit {entry.fit!r}; there are {fits}")


def check_reduction(study: Study, path: Path) -> None:
    """The shape that decides the chain is listed, and no fit places the joints again."""
    if study.reduction is None:
        return
    if study.reduction.recording not in (None, *study.recordings):
        listed = ", ".join(study.recordings)
        raise InputError(f"study {path}: [reduction] uses recording {study.reduction.recording!r}; listed are {listed}")
    if placed := [n for n, f in study.fits.items() if f.joint_placement or f.links]:
        own = "joint_placement" if study.fits[placed[0]].joint_placement else "links"
        raise InputError(f"study {path}: fit {placed[0]} has {own}, and [reduction] places the joints of the "
                         "study: state it there")  # fmt: skip


def check_chambers(study: Study, path: Path) -> None:
    """Recordings drive chambers that the actuator has; it has a torque law or chambers, not both.

    Chambers and tendons stand on joints, so no fit has another number of links than theirs.
    """
    jointed = study.actuator.chambers or study.actuator.tendons
    if jointed and (other := [n for n, f in study.fits.items() if f.links]):
        raise InputError(f"study {path}: fit {other[0]} has links of its own, and {jointed[0].name} acts on joints of "
                         "the actuator's: state links in [actuator], in a study for each number")  # fmt: skip
    inputs = [c.name for c in study.actuator.chambers] + [t.name for t in study.actuator.tendons]
    names = inputs or ["chamber"]
    if inputs and study.actuator.torque is not None:
        raise InputError(f"study {path}: give [actuator] torque, of the only chamber, or [[actuator.chambers]]")
    if study.actuator.tendons and not study.actuator.space:
        raise InputError(f"study {path}: [[actuator.tendons]] pull at a body in space: [actuator] space = true")
    driven: dict[str, Collection[str]] = {f"forecast {n}": f.pressures for n, f in study.forecasts.items()}
    driven |= {f"recording {n}": r.drive for n, r in study.recordings.items()}
    if study.wiring:
        driven |= {f"wiring {n}": drive for n, drive in study.wiring.drives.items()}
        if study.reduction is not None:
            raise InputError(f"study {path}: [wiring] compares bodies of few stations, not with [reduction]")
        if not study.fits or study.wiring.fit not in ("", *study.fits):
            listed = f": use one of {', '.join(study.fits)}" if study.fits else ": add one under [fits]"
            raise InputError(f"study {path}: [wiring] compares by fit {study.wiring.fit or '(the first)'!r}{listed}")
    for where, chambers in driven.items():
        if strange := [c for c in chambers if c not in names]:
            raise InputError(
                f"study {path}: {where} drives the chamber {strange[0]!r}; the actuator has {', '.join(names)}"
            )


def check_parameters(study: Study, path: Path) -> None:
    """Every parameter that is fitted or known exists and is possible: said before any work is done."""
    tables: dict[str, Mapping[str, Any]] = {f"recording {n}": r.known for n, r in study.recordings.items()}
    tables |= {f"forecast {n}": f.known for n, f in study.forecasts.items()}
    tables |= {f"fit {n}": f.parameters for n, f in study.fits.items()}
    tables |= {"[model_selection]": study.model_selection.common} if study.model_selection else {}
    for where, entries in tables.items():
        try:
            parameters_from(entries)
        except InputError as error:
            raise InputError(f"study {path}, {where}: {error}") from None
