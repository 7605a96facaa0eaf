"""The definition of a campaign: the [sweep] table of a study file, and the values of every sample."""

from __future__ import annotations

import itertools
from typing import Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

from pliant.errors import InputError

Array = np.ndarray
PULSE = ("level", "start", "width")  # of the pressure; a sweep may vary them like parameters, NAME.level of a chamber


class Range(BaseModel):
    """The values of one parameter: one number, a list, a grid from `low` to `high`, or a distribution; SI."""

    model_config = ConfigDict(extra="forbid")
    value: float | None = None  # of every sample
    values: list[float] | None = None
    low: float | None = None
    high: float | None = None
    count: int | None = Field(None, ge=2, le=100_000)  # of a grid; without it low ... high is a uniform distribution
    mean: float | None = None
    std: float | None = Field(None, gt=0)

    @model_validator(mode="before")
    @classmethod
    def number(cls, entry: Any) -> Any:
        """A bare number is the value of every sample."""
        return {"value": entry} if isinstance(entry, (int, float)) else entry

    @model_validator(mode="after")
    def one_kind(self) -> Range:
        """A list, a grid, or a distribution, and nothing in between."""
        given = {n for n in ("value", "values", "low", "high", "count", "mean", "std") if getattr(self, n) is not None}
        if given not in ({"value"}, {"values"}, {"low", "high", "count"}, {"low", "high"}, {"mean", "std"}):
            raise ValueError("give a number, values, or low, high and count, or low and high, or mean and std")
        if self.low is not None and self.high is not None and self.low >= self.high:
            raise ValueError(f"low {self.low} is not below high {self.high}")
        if self.values == []:
            raise ValueError("values are empty")
        return self

    def grid(self) -> Array | None:
        """The values of a list or a grid; None of a distribution."""
        if self.values is not None:
            return np.array(self.values, dtype=float)
        return np.linspace(self.low or 0.0, self.high or 0.0, self.count) if self.count else None

    def draw(self, rng: np.random.Generator) -> float:
        """One value of the distribution, or of the list."""
        grid = self.grid()
        if grid is not None:
            return float(rng.choice(grid))
        if self.mean is not None:
            return float(rng.normal(self.mean, self.std or 0.0))
        return float(rng.uniform(self.low or 0.0, self.high or 0.0))


class Sweep(BaseModel):
    """The [sweep] table of a study file."""

    model_config = ConfigDict(extra="forbid")
    kind: Literal["design", "monte_carlo", "bootstrap", "multi_start"]
    samples: int | None = Field(None, ge=1, le=10_000_000)  # not of a design, whose grid says how many
    seed: int = Field(0, ge=0)
    chunk: int | None = Field(None, ge=1)  # samples that are worked on and written together; see `together`
    parameters: dict[str, Range] = {}  # of the model, and level, start and width of the pulses; SI
    fit: str | None = None  # of bootstrap and multi_start: which fit of the study; default the first
    duration: float = Field(4.0, gt=0)  # s
    rate: float = Field(75.0, gt=0)  # Hz, of what is kept
    step: float | None = Field(None, gt=0)  # s; none: what the model needs before its parameters vary, at most 1 ms
    block: float = Field(0.25, gt=0)  # s, of the blocks in which a bootstrap moves residuals

    @model_validator(mode="after")
    def whole(self) -> Sweep:
        """A design needs a grid, everything else a number of samples."""
        ranges = self.varied
        if self.kind in ("design", "monte_carlo") and not ranges:
            raise ValueError(f"a {self.kind} sweep needs parameters that vary")
        if self.kind in ("bootstrap", "multi_start") and self.parameters:
            raise ValueError(f"a {self.kind} sweep takes its parameters from the fit")
        if self.kind == "design":
            if self.samples is not None:
                raise ValueError("a design has as many samples as its grid: leave samples out")
            if unknown := [name for name, r in ranges.items() if r.grid() is None]:
                raise ValueError(f"a design needs values, or low, high and count, of {unknown[0]}")
        elif self.samples is None:
            raise ValueError(f"a {self.kind} sweep needs samples")
        return self

    @property
    def varied(self) -> dict[str, Range]:
        """The parameters that are not one number."""
        return {name: r for name, r in self.parameters.items() if r.value is None}

    @property
    def together(self) -> int:
        """Samples of a chunk: as asked; else one fit, or enough simulations for a worker to be busy with."""
        if self.chunk is not None:
            return self.chunk
        return 1 if self.kind in ("bootstrap", "multi_start") else int(np.clip(self.size // 32, 128, 4096))

    @property
    def size(self) -> int:
        """Number of samples."""
        if self.samples is not None:
            return self.samples
        grids = [r.grid() for r in self.varied.values()]
        return int(np.prod([g.size for g in grids if g is not None]))


def generator(seed: int, sample: int) -> np.random.Generator:
    """The random numbers of one sample: child `sample` of the seed, whoever works on it and with which others."""
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(sample,)))


def table(sweep: Sweep, first: int, last: int) -> dict[str, Array]:
    """Values (last - first,) of every parameter that varies, of the samples first ... last - 1."""
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
    """The parameters that every sample shares."""
    return {name: r.value for name, r in sweep.parameters.items() if r.value is not None}


def sweep_from(content: dict[str, Any]) -> Sweep:
    """A sweep from the table of a study file; InputError says which entry is wrong."""
    from pydantic import ValidationError

    from pliant.errors import explain_validation

    try:
        return Sweep.model_validate(content)
    except ValidationError as error:
        raise explain_validation(error, "[sweep]") from None
    except TypeError:
        raise InputError(f"[sweep] must be a table, got {content!r:.60}") from None
