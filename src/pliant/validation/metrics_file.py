"""The schema of ``metrics.json``, from which the documents are made."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field

Role = Literal["train", "held_out", "forecast"]


class MetricsEntry(BaseModel):
    """A table of the file; nothing stands in it that is not named here."""

    model_config = ConfigDict(extra="forbid")


class Pair(MetricsEntry):
    """A trait of the motion; null where a motion has no such thing."""

    measured: float | None
    modelled: float | None


class MissingRecord(MetricsEntry):
    """A recording whose motion under a fit could not be computed."""

    role: Role = Field(description="what the recording was to the fit")
    fit: str = Field("", description="the first fit that holds it; under `records` alone")
    not_computed: str = Field(description="what could not be computed, and why")


class Failure(MetricsEntry):
    """A fit, prediction, band or forecast that could not be computed."""

    what: str
    fit: str
    record: str = Field(description="empty where no single record is concerned")
    reason: str
    role: Literal["train", "held_out", ""]


class Compared(MetricsEntry):
    """Metrics of every recording under a fit, for positions and angles alike."""

    role: Role = Field(description="what the recording was to the fit")
    fit: str = Field("", description="the first fit that computes it; under `records` alone")
    not_computed: str = Field("", description="what could not be computed of it, such as its band, and why")
    rmse_percent_of_travel: float
    fit_percent: float | None  # none of a lone pose
    within_band_percent: float | None = None
    frequency_hz: Pair
    damping_ratio: Pair
    overshoot_percent: Pair
    frequency_large_hz: Pair
    damping_ratio_large: Pair
    frequency_small_hz: Pair
    damping_ratio_small: Pair
    joint_rmse_mrad: list[float] | None = Field(description="of each station; null for one, and for angles alone")
    joint_steady_error_mrad: list[float] | None
    frames: int
    points_not_seen: int
    fitted_edges_s: dict[str, float] | None = Field(
        None, description="start and stop of a held-out pulse whose pressure was not measured, fitted to it")


class Record(Compared):
    """One recording under one fit."""

    rmse_mm: float
    max_mm: float
    rmse_percent_of_length: float
    steady_state_mm: Pair
    steady_state_error_mm: float | None
    extension_mm: float | None
    extension_percent: float | None
    extension_modelled_mm: float | None
    extension_modelled_percent: float | None
    swing_large_mm: Pair
    swing_small_mm: Pair
    travel_mm: float


class AngleRecord(Compared):
    """One recording of angles without places under one fit."""

    rmse_deg: float
    max_deg: float
    steady_state_deg: Pair
    steady_state_error_deg: float | None
    sensor_step_deg: float | None
    swing_large_deg: Pair
    swing_small_deg: Pair
    travel_deg: float


class Value(MetricsEntry):
    """One parameter of a fit, SI."""

    value: float
    unit: str
    free: bool = Field(description="whether the fit moved it")
    std: float | None = Field(description="standard error; null where it was not free or the data do not show it")
    source: str = Field(description="where its start value comes from")
    lower: float | None = Field(description="bound; null where there is none")
    upper: float | None = Field(description="bound; null where there is none")
    prior: float | None = Field(None, description="mean of what is known before, SI; null without a prior")
    prior_std: float | None = Field(None, description="its standard deviation")
    rests_on: str = Field("", description="data, or the prior and by how much the data moved and narrowed it")
    scale: float = Field(description="the change that the optimiser takes for one")


class CovarianceEntry(MetricsEntry):
    """Covariance of the free parameters of a fit, SI."""

    names: list[str]
    matrix: list[list[float]] = Field(description="(P, P), residuals correlated as they are")
    white: list[list[float]] = Field(description="(P, P), as if they were white")
    hidden: list[bool] = Field(description="(P,), whether the data do not show it")
    correlated: float = Field(description="s, over which the residuals are correlated; 0 where they pass for white")
    effective: float = Field(description="how many numbers were seen, less what correlation takes from them")
    source: str = Field(description="sandwich, or block bootstrap")


class FitTiming(MetricsEntry):
    """Times of a fit."""

    fit_s: float = Field(description="everything, predictions and bands included")
    optimiser_s: float
    simulated_sets: int = Field(description="parameter sets that were simulated for all records")


class FitEntry(MetricsEntry):
    """One fit."""

    title: str
    status: str = Field(description="how it ended, in a sentence")
    notes: list[str] = Field(description="what to beware of")
    converged: bool
    bic: float | None = Field(description="N ln(mean square residual) + k ln N of the training records")
    records: dict[str, Record | AngleRecord | MissingRecord]
    not_computed: list[Failure] = Field([], description="predictions and bands that could not be computed, and why")
    parameters: dict[str, Value]
    timing: FitTiming
    model: dict[str, Any] = Field(description="as in model.json, without its checksum")
    covariance: CovarianceEntry | None


class HeadlineEntry(MetricsEntry):
    """The verdict in short."""

    state: Literal["good", "beware", "missed", "open"]
    sentence: str
    warnings: list[str]


class StageEntry(MetricsEntry):
    """One stage of a model selection."""

    title: str
    stands_on: str = Field(description="the stage that it begins from")
    free: list[str]
    train_percent: dict[str, float] = Field(description="RMSE in % of travel by training record")
    held_out_percent: dict[str, float] = Field(description="the same of held-out records")
    bic: float | None
    fit_s: float
    step_ns: float | None = Field(description="time of one step of that model")
    reason: str = Field(description="why it has no numbers, or why it is not the chosen one")
    not_determined: str = Field("", description="the parameters that the recordings do not determine, in words")
    as_given: list[str] = Field([], description="parameters left as the given model has them, since not determined")


class SelectionTable(MetricsEntry):
    """Models of growing size."""

    chosen: str
    reason: str
    stages: dict[str, StageEntry]


class WiringResult(MetricsEntry):
    """One wiring of recorded pressures to chambers."""

    train_percent: float | None = Field(description="mean RMSE of the training records, % of travel")
    behind: float | None = Field(description="2 ln L below that of the best wiring")
    reason: str = Field(description="why it could not be fitted")


class WiringTable(MetricsEntry):
    """Wirings compared by how the training records are followed."""

    fit: str = Field(description="whose parameters and training records")
    sentence: str
    wirings: dict[str, WiringResult] = Field(description="the likeliest first")


class OrderTable(MetricsEntry):
    """Numbers of links that were tried on the dense shape."""

    orders: dict[str, dict[str, float]] = Field(description="errors in mm by number of segments")
    chosen: int | None = Field(description="the lowest within the bound")
    bound_mm: float | None
    frames: int
    stations: int


class ClockEntry(MetricsEntry):
    """Correction of a pressure's clock to that of the shape."""

    delay_s: float
    drift: float
    message: str


class MetricsFile(MetricsEntry):
    """The whole file."""

    schema_name: Literal["pliant-metrics"] = Field(alias="schema")
    schema_version: Literal[1]
    run_id: str = Field("", description="of this run; results.nc has the same")
    study: str = Field(description="name of the study")
    title: str
    description: str
    headline: HeadlineEntry | None = Field(description="what to think of the first fit's predictions")
    verdict: list[str] = Field(description="plain sentences with their numbers, the most important first")
    records: dict[str, Record | AngleRecord | MissingRecord] = Field(
        description="every recording, under the first fit that computes it")
    parameters: dict[str, Value] = Field(description="of the first fit, whose model is model.json")
    fits: dict[str, FitEntry]
    model_selection: SelectionTable | None
    wiring: WiringTable | None = Field(None, description="of a study that compares wirings")
    order: OrderTable | None = Field(description="of a study that lays its chain through a dense shape")
    forecasts: dict[str, dict[str, Any]] = Field(
        description="title, what was changed (`stated`), numbers with units in their names, half-widths at 95 %")
    findings: dict[str, list[str]] = Field(description="what reading and aligning found, by recording")
    clocks: dict[str, ClockEntry]
    not_computed: list[Failure] = Field([], description="whole fits and forecasts that could not be computed, and why")
    timing: dict[str, float] = Field(description="s: prepare_s, fits_s, total_s")
    provenance: dict[str, str] = Field(description="version of pliant, and each recording's source")
