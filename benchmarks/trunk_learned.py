"""Compare learned models of the tendon-driven trunk with pliant's, on the same recordings, seen and unseen.

    python benchmarks/trunk_learned.py --data ../shared/data/spatial_tendon_trunk

All models run without feedback from measurements: their inputs are the six motor angles and, for a dynamic model, the
first measured frames. The program prints the root mean square distance [mm] of the middle disk and of the tip. Models
fitted to all of controlled_1 are evaluated there, under another command, and under a payload that no learned model has
a parameter for. For "left out", each fifth of the blocks of 7.5 s is predicted by models fitted to the others. Orders
and regularisation are chosen on one in four of the training blocks, never on test data. Frozen frames are left out and
held angles are replaced by lines, as in studies.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import combinations_with_replacement, product
from pathlib import Path
from typing import NamedTuple

import numpy as np
from harness import parser_of

from pliant.preprocessing.detectors import without_spikes
from pliant.preprocessing.held import leave_out_frozen, lines_between_changes
from pliant.recording import read

Array = np.ndarray
MAPPING = {
    "header": True, "rate_hz": 100.0, "length_unit": "m",
    "stations": {f"disk{k}": {"position": [f"{axis}{k}" for axis in "xyz"]} for k in (1, 2, 3)},
    "inputs": {"columns": [f"phi{k}" for k in range(1, 7)], "kind": "angle", "unit": "deg"},
}  # fmt: skip
EVERY, BLOCK, FOLDS = 5, 150, 5  # models run at 20 Hz, as the angles were updated; a block of 7.5 s
MIDDLE, TIP = slice(3, 6), slice(6, 9)
RIDGES = (1e-6, 1e-4, 1e-3, 1e-2, 1e-1)


class Run(NamedTuple):
    """One recording at 20 Hz."""

    angles: Array  # (T, 6) rad
    places: Array  # (T, 9) mm, NaN where a disk was not seen


def load(folder: Path, name: str) -> Run:
    """Read a recording, without spikes and frozen frames, with lines through held angles; lengths in mm."""
    seen = lines_between_changes(leave_out_frozen(read(folder / f"observations_{name}.csv", mapping=MAPPING)))
    places = without_spikes(seen["position"].values)
    return Run(seen["actuation"].values[::EVERY], 1e3 * places.reshape(len(places), 9)[::EVERY])


def monomials(degree: int, values: Array) -> Array:
    """Return all monomials of the columns (T, K) up to a degree, the constant first."""
    columns = [np.ones(len(values))]
    for d in range(1, degree + 1):
        chosen_columns = combinations_with_replacement(range(values.shape[1]), d)
        columns += [values[:, list(some)].prod(axis=1) for some in chosen_columns]
    return np.column_stack(columns)


def shifted(values: Array, lags: Sequence[int]) -> Array:
    """Return the columns at each lag side by side, (T, K * lags); before the beginning, the first row."""
    rows = np.arange(len(values))[:, None] - np.array(lags)
    return values[np.maximum(rows, 0)].reshape(len(values), -1)


def ridge(design: Array, wanted: Array, size: float) -> Array:
    """Solve least squares with a penalty on all but the first column, in units of each column's spread."""
    known = np.isfinite(wanted).all(axis=1) & np.isfinite(design).all(axis=1)
    spread = design[known].std(axis=0)
    spread[spread == 0] = 1.0
    scaled = design[known] / spread
    penalty = size * known.sum() * np.eye(scaled.shape[1])
    penalty[0, 0] = 0.0
    return np.linalg.solve(scaled.T @ scaled + penalty, scaled.T @ wanted[known]) / spread[:, None]


class Static:
    """A map from the angles, now and at earlier times, to the positions."""

    def __init__(self, degree: int, lags: Sequence[int], size: float) -> None:
        self.degree, self.lags, self.size = degree, lags, size

    def design(self, angles: Array) -> Array:
        """Return monomials of the angles now, and the earlier angles themselves."""
        now = monomials(self.degree, angles)
        return np.column_stack([now, shifted(angles, self.lags)]) if self.lags else now

    def fit(self, run: Run, used: Array) -> Static:
        """Fit to the frames `used` (T,)."""
        self.weight = ridge(self.design(run.angles)[used], run.places[used], self.size)
        return self

    def predict(self, run: Run) -> Array:
        """Return places (T, 9)."""
        return self.design(run.angles) @ self.weight


class Linear:
    """DMD with control on delayed positions, of a given rank, with one more delay in the angles; ARX at full rank.

    The input may be monomials of the angles (a Hammerstein model).
    """

    def __init__(self, delays: int, rank: int, degree: int, size: float) -> None:
        self.delays, self.rank, self.degree, self.size = delays, rank, degree, size

    def inputs(self, angles: Array) -> Array:
        """Return monomials of the angles of this and the last frame, without the constant."""
        return shifted(monomials(self.degree, angles)[:, 1:], (0, 1))

    def fit(self, run: Run, used: Array) -> Linear:
        """Fit one step to the frames `used` (T,) whose delayed places are known."""
        self.mean = np.nanmean(run.places[used], axis=0)
        centred = run.places - self.mean
        delayed = shifted(centred, range(1, self.delays + 1))
        usable = used & shifted(used[:, None], range(1, self.delays + 1)).all(axis=1)
        usable[: self.delays] = False
        usable &= np.isfinite(delayed).all(axis=1) & np.isfinite(centred).all(axis=1)
        self.basis = np.linalg.svd(delayed[usable], full_matrices=False)[2][: self.rank]
        design = np.column_stack([np.ones(len(centred)), delayed @ self.basis.T, self.inputs(run.angles)])
        self.weight = ridge(design[usable], centred[usable], self.size)
        return self

    def predict(self, run: Run) -> Array:
        """Return places (T, 9), run freely from the first frames that are all known."""
        inputs, known = self.inputs(run.angles), np.isfinite(run.places).all(axis=1)
        start = next(k for k in range(self.delays, len(known)) if known[k - self.delays : k].all())
        found = np.full_like(run.places, np.nan)
        found[start - self.delays : start] = run.places[start - self.delays : start] - self.mean
        for k in range(start, len(found)):
            past = found[k - self.delays : k][::-1].ravel()
            row = np.concatenate([[1.0], self.basis @ past, inputs[k]])
            found[k] = np.clip(row @ self.weight, -1e4, 1e4)
        return found + self.mean


Model = Static | Linear
FAMILIES: dict[str, list[Callable[[], Model]]] = {
    "static, linear (7 numbers a coordinate)": [lambda: Static(1, (), 0.0)],
    "static, cubic (84)": [lambda: Static(3, (), 0.0)],
    "static, cubic, ridge": [lambda s=s: Static(3, (), s) for s in RIDGES],
    "linear with earlier angles (FIR)": [
        lambda n=n, s=s: Static(1, tuple(range(1, n + 1)), s) for n, s in product((4, 10, 20, 40), RIDGES)
    ],
    "cubic with earlier angles": [
        lambda n=n, s=s: Static(3, tuple(range(1, n + 1)), s) for n, s in product((4, 10, 20), RIDGES)
    ],
    "ARX": [lambda d=d, s=s: Linear(d, 9 * d, 1, s) for d, s in product((1, 2, 3, 5, 8), RIDGES)],
    "DMDc with delays": [
        lambda d=d, r=r, s=s: Linear(d, r, 1, s) for d, r, s in product((2, 4, 8, 16), (4, 6, 9, 14), RIDGES[:3])
    ],
    "DMDc with delays, cubic inputs": [
        lambda d=d, r=r, s=s: Linear(d, r, 3, s) for d, r, s in product((1, 2, 4, 8), (4, 6, 9), RIDGES)
    ],
}  # fmt: skip


def off(found: Array, run: Run, used: Array) -> tuple[float, float]:
    """Return the root mean square distance [mm] of the middle disk and the tip in the frames `used`."""
    both = []
    for disk in (MIDDLE, TIP):
        square = ((found[used, disk] - run.places[used, disk]) ** 2).sum(axis=1)
        both.append(float(np.sqrt(np.nanmean(square))))
    return both[0], both[1]


def chosen(makers: list[Callable[[], Model]], run: Run, train: Array, block: Array) -> Model:
    """Return the member of a family with the smallest error on one in four training blocks, fitted to all of them."""
    inner = train & (np.searchsorted(np.unique(block[train]), block) % 4 == 1)
    best = min(makers, key=lambda make: off(make().fit(run, train & ~inner).predict(run), run, inner)[1]) \
        if len(makers) > 1 else makers[0]
    return best().fit(run, train)


def main() -> None:
    """Fit all families, run them without feedback, and print the table."""
    parser = parser_of(__doc__)
    parser.add_argument("--data", type=Path, required=True)
    given = parser.parse_args()
    first, third, loaded = (load(given.data, name) for name in ("controlled_1", "controlled_3", "controlled_1_100g"))
    block = np.arange(len(first.angles)) // BLOCK
    everything = [np.ones(len(run.angles), dtype=bool) for run in (first, third, loaded)]
    columns = ("in sample", "left out", "controlled_3", "100 g")
    print(f"{'middle / tip, mm rms':42}" + "".join(f"{c:>16}" for c in columns))
    for title, makers in FAMILIES.items():
        left_out = np.full_like(first.places, np.nan)
        for fold in range(FOLDS):
            judged = block % FOLDS == fold
            left_out[judged] = chosen(makers, first, ~judged, block).predict(first)[judged]
        model = chosen(makers, first, everything[0], block)
        runs = zip((first, third, loaded), everything, strict=True)
        scores = [off(model.predict(run), run, used) for run, used in runs]
        scores.insert(1, off(left_out, first, everything[0]))
        print(f"{title:42}" + "".join(f"{m:9.1f} /{t:5.1f}" for m, t in scores), flush=True)


if __name__ == "__main__":
    main()
