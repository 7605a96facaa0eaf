"""Definition of a parameter sweep: the [sweep] table of a study file, and the parameter values of each sample."""

from __future__ import annotations

import itertools
from typing import Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

from pliant.errors import InputError

Array = np.ndarray
PULSE = ("level", "start", "width")  # of the pressure pulse; can vary like parameters, as NAME.level for one chamber


class Range(BaseModel):
    """Values of one swept parameter (SI): a number, a list, a grid from `low` to `high`, or a distribution."""

    model_config = ConfigDict(extra="forbid")
    value: float | None = None  # the same for every sample
    values: list[float] | None = None
    low: float | None = None
    high: float | None = None
    count: int | None = Field(None, ge=2, le=100_000)  # points of a grid; without it, uniform from low to high
    mean: float | None = None
    std: float | None = Field(None, gt=0)

    @model_validator(mode="before")
    @classmethod
    def number(cls, entry: Any) -> Any:
        """Convert a bare number in the study file to the table {"value": number}, which gives it to every sample."""
        return {"value": entry} if isinstance(entry, (int, float)) else entry

    @model_validator(mode="after")
    def one_kind(self) -> Range:
        """Check that the entry of a swept parameter gives exactly one of a number, a list, a grid or a distribution."""
        named = {n for n in ("value", "values", "low", "high", "count", "mean", "std") if getattr(self, n) is not None}
        if named not in ({"value"}, {"values"}, {"low", "high", "count"}, {"low", "high"}, {"mean", "std"}):
            raise ValueError("give a number; or values; or low, high and count; or low and high; or mean and std")
        if self.low is not None and self.high is not None and self.low >= self.high:
            raise ValueError(f"low {self.low} is not below high {self.high}")
        if self.values == []:
            raise ValueError("values is empty: give at least one")
        return self

    def grid(self) -> Array | None:
        """Return the values of a parameter given as a list or a grid; None for a distribution or a single number."""
        if self.values is not None:
            return np.array(self.values, dtype=float)
        return np.linspace(self.low or 0.0, self.high or 0.0, self.count) if self.count else None

    def draw(self, rng: np.random.Generator) -> float:
        """Return one random value from the parameter's distribution, or from its list or grid."""
        grid = self.grid()
        if grid is not None:
            return float(rng.choice(grid))
        if self.mean is not None:
            return float(rng.normal(self.mean, self.std or 0.0))
        return float(rng.uniform(self.low or 0.0, self.high or 0.0))


class Sweep(BaseModel):
    """The [sweep] table of a study file: kind of sweep, swept parameters and number of samples."""

    model_config = ConfigDict(extra="forbid")
    kind: Literal["design", "monte_carlo", "bootstrap", "multi_start"]
    samples: int | None = Field(None, ge=1, le=10_000_000)  # not for a design, whose grid sets the number
    seed: int = Field(0, ge=0)
    chunk: int | None = Field(None, ge=1)  # samples in a chunk; see `together`
    parameters: dict[str, Range] = {}  # of the model, and level, start and width of the pulses; SI
    fit: str | None = None  # for bootstrap and multi_start: name of a fit of the study; default the first
    duration: float = Field(4.0, gt=0)  # s
    rate: float = Field(75.0, gt=0)  # Hz, output rate
    time_step: float | None = Field(None, gt=0)  # s; None: chosen for the given model, at most 1 ms
    block: float = Field(0.25, gt=0)  # s, length of a bootstrap's residual blocks

    @model_validator(mode="after")
    def whole(self) -> Sweep:
        """Check that a design sweep has a grid, and that any other sweep has a number of samples."""
        ranges = self.varied
        if self.kind in ("design", "monte_carlo") and not ranges:
            raise ValueError(f"a {self.kind} sweep needs parameters that vary")
        if self.kind in ("bootstrap", "multi_start") and self.parameters:
            raise ValueError(f"a {self.kind} sweep takes its parameters from the fit: leave parameters out")
        if self.kind == "design":
            if self.samples is not None:
                raise ValueError("a design has as many samples as its grid: leave samples out")
            if unknown := [name for name, r in ranges.items() if r.grid() is None]:
                raise ValueError(f"a design sweep needs, for {unknown[0]}, values, or low, high and count")
        elif self.samples is None:
            raise ValueError(f"a {self.kind} sweep needs samples")
        return self

    @property
    def varied(self) -> dict[str, Range]:
        """Return the parameters that vary between samples, by name."""
        return {name: r for name, r in self.parameters.items() if r.value is None}

    @property
    def together(self) -> int:
        """Return the number of samples in a chunk: `chunk` if set, else 1 for fits, or 128 to 4096 for simulations."""
        if self.chunk is not None:
            return self.chunk
        return 1 if self.kind in ("bootstrap", "multi_start") else int(np.clip(self.size // 32, 128, 4096))

    @property
    def size(self) -> int:
        """Return the total number of samples in the sweep."""
        if self.samples is not None:
            return self.samples
        grids = [r.grid() for r in self.varied.values()]
        return int(np.prod([g.size for g in grids if g is not None]))


def generator(seed: int, sample: int) -> np.random.Generator:
    """Return the random generator of one sample. It depends only on `seed` and the index of the sample."""
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(sample,)))


def table(sweep: Sweep, first: int, last: int) -> dict[str, Array]:
    """Return the values (last - first,) of each varied parameter, by name, for the samples `first` to `last - 1`."""
    varied = sweep.varied
    if sweep.kind == "design":
        grids = [r.grid() for r in varied.values()]
        rows = itertools.islice(itertools.product(*[g for g in grids if g is not None]), first, last)
        columns = np.array(list(rows)).T
        return dict(zip(varied, columns, strict=True))
    values: dict[str, list[float]] = {name: [] for name in varied}
    for sample in range(first, last):
        rng = generator(sweep.seed, sample)
        for name, r in varied.items():
            values[name].append(r.draw(rng))
    return {name: np.array(v) for name, v in values.items()}


def fixed(sweep: Sweep) -> dict[str, float]:
    """Return the values of the parameters that are the same in every sample, by name."""
    return {name: r.value for name, r in sweep.parameters.items() if r.value is not None}


def sweep_from(content: dict[str, Any]) -> Sweep:
    """Return the `Sweep` from the content of a [sweep] table; raise InputError for an invalid entry."""
    from pydantic import ValidationError

    from pliant.errors import explain_validation

    try:
        return Sweep.model_validate(content)
    except ValidationError as error:
        raise explain_validation(error, "[sweep]", Sweep) from None
    except TypeError:
        raise InputError(f"[sweep] must be a table, got {content!r:.60}") from None
