"""Fit a trunk in space with six motors to a part of a public recording, and predict other recordings and a payload.

    PLIANT_DATA=../shared/data python benchmarks/tendon_trunk.py

Model, recordings and start values are in examples/spatial_tendon_trunk.toml, which `pliant run` takes as well; here the
fit stops after a few evaluations. Errors leave out the first second of each recording, because the model begins at rest
and the trunk moves. With `--left`, the program shows what is left of the error in the 30 s after the training, and how
much of the error frames with nearly equal motor angles share.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Sequence
from itertools import combinations_with_replacement, pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.signal import butter, sosfiltfilt
from scipy.spatial import cKDTree

from pliant.identification.fit import fit, parameters_from
from pliant.identification.initial_guess import prepare
from pliant.identification.prediction import predict
from pliant.study import load_study
from pliant.study.run import prepare_all

Array = np.ndarray
STUDY = Path(__file__).parents[1] / "examples" / "spatial_tendon_trunk.toml"
SETTLED = 1.0  # s


BANDS = (0.0, 0.3, 0.8, 4.5, 50.0)  # Hz
RIDGE = 0.03  # of the maps' normalised columns
ALIKE = {"angles": (3e-3, 0.0), "angles and rates": (8e-3, 0.1)}  # m of the tip's motion, and weight of rates, s
APART = 500  # frames between two frames that are compared, at least


class Shown(NamedTuple):
    """A recording after its first second: motor angles (T, 6) [rad], positions (T, 3, 3) [m] and the model's."""

    angle: Array
    seen: Array
    modelled: Array

    @property
    def off(self) -> Array:
        """Error (T, 9) [m], nan where a disk is missing."""
        return (self.seen - self.modelled).reshape(len(self.seen), 9)


def rate(values: Array) -> Array:
    """Return the change (T, M) of values from one frame to the next."""
    return np.gradient(values, axis=0)


def products(values: Array, degree: int) -> Array:
    """Return all products of up to `degree` of the columns of values (T, M)."""
    columns = range(values.shape[1])
    chosen = [c for d in range(1, degree + 1) for c in combinations_with_replacement(columns, d)]
    return np.column_stack([values[:, list(c)].prod(axis=1) for c in chosen])


def play(values: Array, width: float) -> Array:
    """Return what values (T, M) leave of themselves behind play of +- width."""
    held = values.copy()
    for k in range(1, len(values)):
        held[k] = np.clip(held[k - 1], values[k] - width, values[k] + width)
    return values - held


def of_positions(one: Shown) -> Array:
    """Return the modelled positions with their first two changes (T, 27)."""
    flat = one.modelled.reshape(len(one.modelled), 9)
    return np.column_stack([flat, rate(flat), rate(rate(flat))])


MAPS: dict[str, Callable[[Shown], Array]] = {
    "motor angles, linear": lambda s: s.angle,
    "up to squares": lambda s: products(s.angle, 2),
    "up to cubes": lambda s: products(s.angle, 3),
    "rates": lambda s: rate(s.angle),
    "signs of the rates": lambda s: np.tanh(rate(s.angle) / 1e-3),
    "up to 0.4 s earlier": lambda s: np.column_stack([np.roll(s.angle, k, axis=0) for k in (0, 10, 20, 40)]),
    "play of 3 and 11 degrees": lambda s: np.column_stack([play(s.angle, w) for w in (0.05, 0.2)]),
    "modelled positions, rates, accelerations": of_positions,
}


def sizes(off: Array) -> str:
    """Return the root mean square of errors (T, 9) [m] at the three disks as text."""
    mean = 1e3 * np.sqrt(np.nanmean(np.sum(off.reshape(-1, 3, 3) ** 2, axis=2), axis=0))
    return ", ".join(f"{size:.2f} mm" for size in mean)


def shared(parts: Sequence[Shown], within: float, reach: float) -> tuple[int, float, float]:
    """Return how much of the tip's error frames with nearly equal motor angles share: the number of pairs of frames,
    the error's root mean square in these frames, and the root of its mean product over a pair [m].

    A law of the angles alone can at best remove the shared part. Two frames are nearly equal if their angles, each
    weighted by the tip's mean motion under it, and their changes in the time `reach` [s] differ by less than `within`
    [m].
    """
    angle, off, tip = (np.concatenate(a) for a in zip(*((p.angle, p.off[:, 6:], p.modelled[:, 2]) for p in parts),
                                                      strict=True))  # fmt: skip
    turned = angle - angle.mean(axis=0)
    size = np.linalg.norm(np.linalg.lstsq(turned, tip - tip.mean(axis=0), rcond=None)[0], axis=1)
    change = np.concatenate([gaussian_filter1d(rate(p.angle), 2.0, axis=0) for p in parts]) * 100.0 * reach
    place = np.column_stack([angle * size, change * size])
    frames = np.flatnonzero(np.isfinite(off).all(axis=1))[::2]
    a, b = frames[cKDTree(place[frames]).query_pairs(within, output_type="ndarray")].T
    a, b = a[b - a > APART], b[b - a > APART]
    off = off - off[frames].mean(axis=0)
    whole = np.sqrt(np.mean(np.sum(off[a] ** 2 + off[b] ** 2, axis=1)) / 2.0)
    return len(a), whole, float(np.sqrt(max(np.mean(np.sum(off[a] * off[b], axis=1)), 0.0)))


def left(train: Shown, later: Shown) -> None:
    """Print the tip's error in each band, and the errors that maps fitted to the training leave later."""
    whole = [np.isfinite(one.off).all(axis=1) for one in (train, later)]
    frames = np.arange(len(later.off))
    tips = later.off[:, 6:], later.seen[:, 2] - np.nanmean(later.seen[:, 2], axis=0)
    error, motion = (np.column_stack([np.interp(frames, frames[whole[1]], a[whole[1], k]) for k in range(3)])
                     for a in tips)  # fmt: skip
    for low, high in pairwise(BANDS):
        edges = [e for e in (low, high) if 0.0 < e < BANDS[-1]]
        kind = "bandpass" if len(edges) == 2 else "lowpass" if low == 0.0 else "highpass"
        filtered = [sosfiltfilt(butter(4, edges if len(edges) == 2 else edges[0], kind, fs=100.0, output="sos"), a,
                                axis=0) for a in (error, motion)]  # fmt: skip
        values = [1e3 * np.sqrt(np.mean(np.sum(a[whole[1]] ** 2, axis=1))) for a in filtered]
        print(f"{low} to {high} Hz: error of the tip {values[0]:.1f} mm, motion {values[1]:.1f} mm")
    for name, (within, reach) in ALIKE.items():
        pairs, size, common = shared((train, later), within, reach)
        print(f"nearly equal {name}: {pairs} pairs, error of the tip {1e3 * size:.1f} mm, shared {1e3 * common:.1f} mm")
    print("no map:", sizes(later.off[whole[1]]))
    for name, columns in MAPS.items():
        a, b = columns(train), columns(later)
        middle, spread = a[whole[0]].mean(axis=0), a[whole[0]].std(axis=0)
        A, B = (np.column_stack([np.ones(len(x)), (x - middle) / spread]) for x in (a, b))
        A, B = A[whole[0]], B[whole[1]]
        W = np.linalg.solve(A.T @ A + RIDGE * len(A) * np.eye(A.shape[1]), A.T @ train.off[whole[0]])
        print(f"{name}, {A.shape[1]} coefficients:", sizes(later.off[whole[1]] - B @ W))


def drawn(parts: dict[str, tuple[Array, Array, Array]], path: Path) -> None:
    """Draw the tip in two recordings, measured thick and grey, modelled thin and dark."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(2, len(parts), figsize=(7.2, 3.2), sharex="col", squeeze=False, layout="constrained")
    for column, (name, (moments, seen, modelled)) in zip(axes.T, parts.items(), strict=True):
        for ax, axis, k in zip(column, "xy", (0, 1), strict=True):
            ax.plot(moments, 1e3 * seen[:, k], color="0.7", lw=2.5)
            ax.plot(moments, 1e3 * modelled[:, k], color="0.1", lw=0.8)
            ax.set_ylabel(f"tip {axis} (mm)")
            ax.spines[["top", "right"]].set_visible(False)
        column[-1].set_xlabel(f"time (s), {name}")
    figure.savefig(path, dpi=160)


def main() -> None:
    """Fit, predict and print the errors."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--evaluations", type=int, default=6, help="0: the start values as they are")
    parser.add_argument("--left", action="store_true", help="bands and maps of the error after the training")
    parser.add_argument("--figure", type=Path, help="file for a figure of the tip")
    given = parser.parse_args()
    study = load_study(STUDY)
    ready = prepare_all(study, print)
    entry = next(iter(study.fits.values()))
    training, wanted = [ready.experiments[name] for name in entry.train], parameters_from(entry.parameters)
    model, parameters = prepare(training, ready.model, wanted)
    began, parts, shown = time.perf_counter(), {}, {}
    if given.evaluations:
        parameters = list(fit(training, ready.model, wanted, time_step=study.time_step, starts=1,
                              max_evaluations=given.evaluations).parameters)  # fmt: skip
    values = {p.name: p.value for p in parameters if p.value is not None}
    print(f"{sum(p.free for p in parameters)} parameters: {time.perf_counter() - began:.0f} s")
    for name, exp in ready.experiments.items():
        modelled = predict(model, exp, values, study.time_step)["position"]
        late = exp.time - exp.time[0] >= SETTLED
        size = 1e3 * np.sqrt(np.nanmean(np.sum((modelled - exp.position)[late] ** 2, axis=-1), axis=0))
        print(name, ", ".join(f"{s} {e:.1f} mm" for s, e in zip(exp.stations, size, strict=True)))
        angle = np.column_stack([exp.driving(name)(exp.time) for name in ready.model.actuation.names])
        shown[name] = Shown(angle[late], exp.position[late], modelled[late])
        first = late & (exp.time - exp.time[0] < 10.0 + SETTLED)
        parts[name] = (exp.time[first], exp.position[first, -1], modelled[first, -1])
    if given.left:
        left(shown["training"], shown["later"])
    if given.figure:
        drawn({name: parts[name] for name in ("later", "payload")}, given.figure)


if __name__ == "__main__":
    main()
