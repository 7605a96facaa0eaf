"""Measure how much of each held-out public recording lies within the 95 % band of its prediction.

    python benchmarks/held_out_bands.py                        # all; or the names of some studies of examples/

Each case fits a model of an example to some recordings and predicts others: of the arm under pulses each inner level,
of the two-segment arm each trial from one and from two others, and of the fabric arm in space each recording of a
session from the others. The recordings are those of `pliant data`; the fabric arm's lie in the same folder PLIANT_DATA.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from pliant.study import load_study
from pliant.study.fits import run_fit
from pliant.study.run import prepare_all
from pliant.study.schema import Fit, Study

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"
SPATIAL = ("e1", "e2", "e4", "e5", "e8")


class Case(NamedTuple):
    """A fit of an example, and the recordings on which it trains and which judge it."""

    fit: str
    train: tuple[str, ...]
    held_out: tuple[str, ...]


CASES = {
    "pneumatic_arm_pulses": [
        Case(fit, train, held) for fit in ("quadratic_between", "inflating_between")
        for train, held in ((("p100", "p300"), ("p200",)), (("p100", "p300", "p400"), ("p200",)),
                            (("p100", "p200", "p400"), ("p300",)))
    ],
    "planar_two_segment_arm": [
        *(Case("one_pressure", (one,), tuple(n for n in ("first", "second", "third") if n != one))
          for one in ("first", "second", "third")),
        *(Case("one_pressure", tuple(n for n in ("first", "second", "third") if n != one), (one,))
          for one in ("first", "second", "third")),
    ],
    "spatial_pneumatic_arm": [
        *(Case("linear", tuple(n for n in SPATIAL if n != one), (one,)) for one in SPATIAL),
        Case("linear", ("e4", "e5"), ("e1", "e2", "e8")),
    ],
}  # fmt: skip


def study_of(name: str) -> Study:
    """Return the study of an example with further trials and thinned frames."""
    study = load_study(EXAMPLES / f"{name}.toml")
    recordings = dict(study.recordings)
    if name == "planar_two_segment_arm":
        first = recordings["first"]
        recordings["third"] = first.model_copy(update={"file": first.file.replace("_1.txt", "_3.txt")})
    if name == "spatial_pneumatic_arm":
        folder = Path(os.environ.get("PLIANT_DATA", EXAMPLES))
        recordings = {n: r.model_copy(update={"every": 32, "file": str(folder / r.file)})
                      for n, r in recordings.items()}  # fmt: skip
    return study.model_copy(update={"recordings": recordings})


def held_out(name: str) -> Iterator[tuple[Case, str, float, float]]:
    """Yield each case of an example with a held-out recording, its error [% of the peak displacement] and the part of
    it [%] within the band.
    """
    study = study_of(name)
    ready = prepare_all(study, lambda _line: None)
    for case in CASES[name]:
        entry: Any = study.fits[case.fit].model_copy(update={
            "train": list(case.train), "held_out": list(case.held_out), "starts": 1})
        whole = study.model_copy(update={"fits": {case.fit: Fit.model_validate(entry.model_dump(exclude_none=True))}})
        outcome = run_fit(whole, case.fit, ready.experiments, ready.model, lambda _line: None, {})
        for record in outcome.records:
            if record.role == "held_out":
                yield (case, record.name, record.metrics["rmse_percent_of_travel"],
                       record.metrics.get("within_band_percent", np.nan))  # fmt: skip


def main(names: list[str]) -> None:
    """Print the coverage of each held-out recording."""
    every = []
    for name in names or list(CASES):
        for case, record, error, held in held_out(name):
            every.append(held)
            print(f"{name:<24} {case.fit:<18} {' '.join(case.train):<12} -> {record:<7} error {error:5.1f} %, "
                  f"{held:5.1f} % within the band", flush=True)  # fmt: skip
    held = np.array(every)
    print(f"{held.size} recordings: 92 to 98 % in {100 * np.mean((held >= 92) & (held <= 98)):.0f} %, 92 % and more in "
          f"{100 * np.mean(held >= 92):.0f} %, least {held.min():.0f} %")  # fmt: skip


if __name__ == "__main__":
    main(sys.argv[1:])
