"""Measure how much of a recording lies within its 95 % band where inputs differ from those of training.

    python benchmarks/other_inputs.py --first 300 --bodies 12

The bodies are those of `benchmarks/strangers.py`, with one chamber or two. Rows state the fractions of the working
pressure in the recordings of training, and in the recording that is predicted.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
import strangers

from pliant.errors import PliantError
from pliant.identification import Experiment, Parameter, fit, predict_held_out
from pliant.identification.prediction_bands import TrainingResiduals, prediction_band

Levels = tuple[float, ...]


class Case(NamedTuple):
    """Levels of one or two chambers in recordings of training, and in those that are predicted."""

    train: tuple[Levels, ...]
    held_out: tuple[Levels, ...]


CASES = {
    "one chamber": Case(((0.33,), (1.0,)), ((0.15,), (0.66,), (1.3,), (2.0,))),
    "one at a time": Case(((1.0, 0.0), (0.0, 1.0)), ((0.7, 0.8), (1.4, 0.0), (1.4, 1.2))),
    "two levels of each": Case(((0.5, 0.0), (1.0, 0.0), (0.0, 0.5), (0.0, 1.0)), ((0.7, 0.8), (1.4, 0.0), (1.0, 1.0))),
    "smaller motions": Case(((1.0, 0.0), (0.0, 1.0), (0.7, 0.8)), ((0.2, 0.0), (0.0, 0.3), (0.2, 0.1))),
    "one hardly moves": Case(((1.0, 0.0), (0.7, 0.1)), ((0.0, 0.6), (0.7, 0.8))),
}


def recorded(seed: int, case: Case) -> dict[Levels, Experiment]:
    """Return the recordings of a case of the body of a seed, by the levels of its chambers."""
    levels = (*case.train, *case.held_out)
    rod, experiments = strangers.recorded_at(seed, {f"r{k}": row for k, row in enumerate(levels)})
    assert len(rod.chambers) == len(case.train[0])
    return dict(zip(levels, experiments, strict=True))


def coverage(seed: int, case: Case) -> list[float]:
    """Return the part [%] of each predicted recording within its band."""
    recordings = recorded(seed, case)
    train = [recordings[row] for row in case.train]
    rod = strangers.drawn(seed)[0]
    result = fit(train, strangers.chain(rod), [Parameter(n) for n in strangers.truth(rod)], starts=1)
    left, parts = TrainingResiduals.of(train, result), []
    for row in case.held_out:
        exp = recordings[row]
        predicted, refit = predict_held_out(exp, result)
        band = prediction_band(exp, result, noise=left.noise(exp, predicted["compared"]), own=refit, training=train,
                               reach=left.reach())  # fmt: skip
        parts.append(100.0 * band.holds(exp.compared))
    return parts


def computed(seeds: Sequence[int], case: Case) -> Iterator[list[float]]:
    """Yield the coverage of each body whose fit is not refused."""
    for seed in seeds:
        try:
            yield coverage(seed, case)
        except PliantError as error:
            print(f"seed {seed}: {error}")


def main() -> None:
    """Print the coverage of each case."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--first", type=int, default=300, help="the first seed")
    parser.add_argument("--bodies", type=int, default=12, help="number of bodies")
    parser.add_argument("--case", choices=list(CASES), action="append", help="default: all")
    args = parser.parse_args()
    for name in args.case or CASES:
        even = args.first + args.first % 2  # seeds of bodies with one chamber
        seeds = range(even, even + 2 * args.bodies, 2) if name == "one chamber" else range(
            even + 1, even + 2 * args.bodies, 2)  # fmt: skip
        every = np.array(list(computed(seeds, CASES[name])))
        for row, parts in zip(CASES[name].held_out, every.T, strict=True):
            print(f"{name:<20} {row}: {len(parts)} bodies, median {np.median(parts):.0f} %, 92 % and more in "
                  f"{100 * np.mean(parts >= 92):.0f} %, 85 % and more in {100 * np.mean(parts >= 85):.0f} %, least "
                  f"{parts.min():.0f} %", flush=True)  # fmt: skip


if __name__ == "__main__":
    main()
