"""The schema of ``metrics.json``, from which its documentation is generated."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal, TypeVar

from pydantic import BaseModel, ConfigDict, Field, create_model

from pliant.validation.metrics import metric_table

Role = Literal["train", "held_out", "forecast"]


class MetricsEntry(BaseModel):
    """Base class of the tables in metrics.json. A table holds exactly the fields that its class declares."""

    model_config = ConfigDict(extra="forbid")


class Pair(MetricsEntry):
    """A property of the motion, such as its frequency, measured and modelled; null if a motion does not have it."""

    measured: float | None
    modelled: float | None


class MissingRecord(MetricsEntry):
    """A recording whose motion under a fit could not be computed."""

    role: Role = Field(description="whether the fit used the recording for training or held it out")
    fit: str = Field("", description="the first fit with this recording; present under `records` only")
    not_computed: str = Field(description="what could not be computed, and why")


class Failure(MetricsEntry):
    """A fit, prediction, band or forecast that could not be computed."""

    what: str
    fit: str
    record: str = Field(description="name of the recording; empty if no single recording is concerned")
    reason: str
    role: Literal["train", "held_out", ""]


KINDS: dict[str, tuple[Any, Any]] = {  # kind of a metric: type and default of its entry
    "number": (float, ...), "number or null": (float | None, ...), "count": (int, ...), "pair": (Pair, ...),
    "band": (float | None, None), "edges": (dict[str, float] | None, None), "joints": (list[float] | None, ...),
}
T = TypeVar("T", bound=MetricsEntry)


def with_metrics(*, turns: bool) -> Callable[[type[T]], type[T]]:
    """Return a decorator that adds the metrics of a recording, of angles alone with `turns`, to a table's entries."""
    entries: dict[str, Any] = {name: (KINDS[m.kind][0], Field(KINDS[m.kind][1], description=m.meaning))
                               for name, m in metric_table(turns=turns).items()}  # fmt: skip

    def extended(table: type[T]) -> type[T]:
        return create_model(table.__name__, __base__=table, __doc__=table.__doc__, **entries)

    return extended


class Compared(MetricsEntry):
    """Entries of a recording under one fit beside its metrics."""

    role: Role = Field(description="whether the fit used the recording for training or held it out")
    fit: str = Field("", description="the first fit that computes this recording; present under `records` only")
    not_computed: str = Field("", description="results of this recording that could not be computed, and why")


@with_metrics(turns=False)
class Record(Compared):
    """Metrics of one recording of positions under one fit."""


@with_metrics(turns=True)
class AngleRecord(Compared):
    """Metrics of one recording of angles without positions under one fit."""


class Value(MetricsEntry):
    """One parameter of a fit, in SI units."""

    value: float
    unit: str
    free: bool = Field(description="whether the fit estimated it")
    std: float | None = Field(description="standard error; null if it was not free or the data do not determine it")
    source: str = Field(description="where its start value comes from")
    lower: float | None = Field(description="lower bound; null if there is none")
    upper: float | None = Field(description="upper bound; null if there is none")
    prior: float | None = Field(None, description="mean of the prior, SI; null without a prior")
    prior_std: float | None = Field(None, description="standard deviation of the prior, SI")
    rests_on: str = Field("", description="data, or the prior and how far the data shifted and narrowed it")
    scale: float = Field(description="change of the value that is one unit for the optimiser")


class CovarianceEntry(MetricsEntry):
    """Covariance of the free parameters of a fit, SI."""

    names: list[str]
    matrix: list[list[float]] = Field(description="(P, P), taking the residuals' correlation into account")
    white: list[list[float]] = Field(description="(P, P), as if the residuals were white noise")
    hidden: list[bool] = Field(description="(P,), true if the data do not determine the parameter")
    correlated: float = Field(description="s, correlation time of the residuals; 0 if they are like white noise")
    effective: float = Field(description="effective number of independent measurements")
    source: str = Field(description="method: sandwich, or block bootstrap")
    between: list[list[float]] | None = Field(
        None, description="(P, P), scatter between recordings beyond noise; null for fewer than three")
    clusters: str = Field("", description="between what the scatter counts in the matrix; empty for noise alone")
    form: list[list[float]] | None = Field(
        None, description="(P, P), errors of the model's form, which add to the matrix in the standard errors")


class FitTiming(MetricsEntry):
    """Computation times of a fit [s]."""

    fit_s: float = Field(description="whole fit with predictions and bands, s")
    optimiser_s: float
    simulated_sets: int = Field(description="number of parameter sets simulated for all recordings")


class FitEntry(MetricsEntry):
    """One fit of the study."""

    title: str
    status: str = Field(description="a sentence on how the optimisation ended")
    notes: list[str] = Field(description="warnings")
    converged: bool
    bic: float | None = Field(description="N ln(mean square residual) + k ln N of the training records")
    time_step_s: float = Field(description="time step of the fit and of its predictions, s")
    records: dict[str, Record | AngleRecord | MissingRecord]
    not_computed: list[Failure] = Field([], description="predictions and bands that could not be computed, and why")
    parameters: dict[str, Value]
    timing: FitTiming
    model: dict[str, Any] = Field(description="as in model.json, without its checksum")
    covariance: CovarianceEntry | None


class BaselineEntry(MetricsEntry):
    """A plain map, fitted to the training recordings of a fit: a polynomial of the inputs and of their lags."""

    title: str
    degree: int = Field(description="of the polynomial; 0 is the mean of the training frames, where no input moves")
    lags_s: list[float] = Field(description="time constants of the first-order lags, s; none or two")
    ridge: float
    held_at_edge: bool = Field(
        description="whether inputs beyond the training inputs count as on their edge; else the polynomial goes on")
    inputs: list[str] = Field(description="inputs and known loads; an empty name is the only input")
    coefficients: int = Field(description="number of coefficients of all coordinates")
    frames: int = Field(description="number of training frames used, after thinning")
    unit: Literal["mm", "deg"] = Field(description="unit of the two errors below")
    left_out_error: float | None = Field(
        description="RMS error on left-out training data, by which the map was chosen; null for a single frame")
    training_error: float
    notes: list[str] = Field(description="inputs that never move, or always together")
    records: dict[str, Record | AngleRecord] = Field(description="errors of the map, in the measures of the model's")
    outside_percent: dict[str, float] = Field(description="% of frames beyond the range of the training inputs")
    better: list[str] = Field(description="held-out recordings that the map predicts better than the model")
    explained: dict[str, float] = Field(
        description="fraction of the model's squared residual there that each kind of regressor explains")
    suggestion: str = Field(description="what that residual suggests")


class HeadlineEntry(MetricsEntry):
    """The short verdict on the study."""

    state: Literal["good", "beware", "missed", "open"]
    sentence: str
    warnings: list[str]


class TrialEntry(MetricsEntry):
    """A term that was tried in one step of the model selection."""

    name: str
    title: str
    screened: float | None = Field(description="cost that the screen predicts")
    cost: float | None = Field(description="cost of the fit, if the term was fitted")
    left_out: float | None = Field(description="sum of squared residuals of left-out parts, if the term was fitted")
    reason: str = Field(description="why it was taken or not")


class StepEntry(MetricsEntry):
    """A model on the way of the model selection."""

    name: str = Field(description="term that joined or left the model, or parameter that was held or got a prior")
    title: str
    change: Literal["begins", "joins", "leaves", "settles"]
    free: list[str]
    cost: float = Field(description="half the sum of squared residuals of the training recordings")
    train: dict[str, float] = Field(description="RMSE of training recordings, % of peak displacement")
    left_out: dict[str, float] = Field(
        description="RMSE of their parts, each predicted from the other parts, % of peak displacement")
    tried: list[TrialEntry] = Field(description="terms that were tried next")


class SelectionTable(MetricsEntry):
    """The model selection: the terms of the model, chosen from the training recordings alone."""

    terms: list[str]
    reason: str
    seconds: float = Field(description="wall time, s")
    complete: bool = Field(True, description="false if an interrupt or the time limit ended the search")
    steps: list[StepEntry]


class WiringResult(MetricsEntry):
    """One wiring of recorded pressures to chambers."""

    train_percent: float | None = Field(description="mean RMSE of the training recordings, % of the peak displacement")
    behind: float | None = Field(description="how much 2 ln L is below that of the best wiring")
    reason: str = Field(description="why it could not be fitted")


class WiringTable(MetricsEntry):
    """Comparison of wirings (which recorded pressure belongs to which chamber) by errors on training recordings."""

    fit: str = Field(description="name of the fit whose parameters and training recordings are used")
    sentence: str
    wirings: dict[str, WiringResult] = Field(description="by name, the most likely first")


class MoveEntry(MetricsEntry):
    """Change of one parameter from an earlier day to another, SI."""

    belongs: Literal["body", "mounting"]
    unit: str
    before: float
    after: float
    old_std: float | None = Field(description="standard error of the earlier fit; null if it was not free there")
    prior_std: float = Field(description="standard deviation of the prior of the other day")
    std: float | None = Field(description="standard error of the adapted fit; null if it is not determined")
    moved: float | None = Field(
        description="change over `old_std`; of a gain, without the part that all gains have in common")


class DayErrorEntry(MetricsEntry):
    """RMS error of one recording of another day under the earlier and the adapted model."""

    role: Literal["fitted", "judged"]
    before_mm: float | None = None
    after_mm: float | None = None
    travel_mm: float | None = Field(None, description="peak displacement")
    before_deg: float | None = None
    after_deg: float | None = None
    travel_deg: float | None = Field(None, description="peak rotation, of a recording of angles alone")


class AdaptationTable(MetricsEntry):
    """A fitted model on another day: verdict, moves of the parameters, and errors before and after."""

    verdict: Literal["same arm", "re-mounted", "changed body", "another arm", "another of the kind"]
    sentence: str
    changed: list[str] = Field(description="parameters of the body that moved by more than four standard deviations")
    seconds: float = Field(description="duration of the motion that was fitted, s")
    moves: dict[str, MoveEntry]
    errors: dict[str, DayErrorEntry] = Field(description="by part of a recording: the fitted one, then the rest")


class OrderTable(MetricsEntry):
    """Numbers of links tried for a recording of many points along the body, with the errors of each."""

    orders: dict[str, dict[str, float]] = Field(description="errors in mm by number of segments")
    chosen: int | None = Field(description="smallest number of links within the bound")
    bound_mm: float | None
    frames: int
    stations: int


class ClockEntry(MetricsEntry):
    """Correction of a pressure's clock to that of the shape."""

    delay_s: float
    drift: float
    message: str


class MetricsFile(MetricsEntry):
    """The whole content of metrics.json."""

    schema_name: Literal["pliant-metrics"] = Field(alias="schema")
    schema_version: Literal[1]
    run_id: str = Field("", description="identifier of the run, equal to that in results.nc")
    study: str = Field(description="name of the study")
    title: str
    description: str
    headline: HeadlineEntry | None = Field(description="assessment of the first fit's predictions")
    verdict: list[str] = Field(description="sentences with their numbers, the most important first")
    records: dict[str, Record | AngleRecord | MissingRecord] = Field(
        description="every recording, under the first fit that computes it")
    parameters: dict[str, Value] = Field(description="parameters of the first fit, whose model is model.json")
    fits: dict[str, FitEntry]
    baseline: dict[str, BaselineEntry] = Field({}, description="plain map of each fit, by the name of the fit")
    model_selection: SelectionTable | None
    wiring: WiringTable | None = Field(None, description="comparison of wirings, if the study has one")
    adaptations: dict[str, AdaptationTable] = Field({}, description="other days, by the name of the adapted fit")
    order: OrderTable | None = Field(description="selection of the number of links, for dense shapes")
    forecasts: dict[str, dict[str, Any]] = Field(
        description="title, stated changes (`stated`), results with units in their names, 95 % half-widths")
    findings: dict[str, list[str]] = Field(description="findings from reading and aligning, by recording")
    clocks: dict[str, ClockEntry]
    not_computed: list[Failure] = Field([], description="whole fits and forecasts that could not be computed, and why")
    timing: dict[str, float] = Field(description="computation times, s: prepare_s, fits_s, plain_maps_s, total_s")
    provenance: dict[str, str] = Field(description="version of pliant, and the source of each recording")
