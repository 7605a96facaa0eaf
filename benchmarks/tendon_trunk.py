"""Fit a trunk in space with six motors to a part of a public recording, and predict other recordings and a payload.

    PLIANT_DATA=../shared/data python benchmarks/tendon_trunk.py

Model, recordings and start values are in examples/spatial_tendon_trunk.toml, which `pliant run` takes as well; here the
fit stops after a few evaluations. Errors leave out the first second of each recording, because the model begins at rest
and the trunk moves.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np

from pliant.identification.fit import fit, parameters_from
from pliant.identification.initial_guess import prepare
from pliant.identification.prediction import predict
from pliant.study import load_study
from pliant.study.run import prepare_all

Array = np.ndarray
STUDY = Path(__file__).parents[1] / "examples" / "spatial_tendon_trunk.toml"
SETTLED = 1.0  # s


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
    parser.add_argument("--figure", type=Path, help="file for a figure of the tip")
    given = parser.parse_args()
    study = load_study(STUDY)
    ready = prepare_all(study, print)
    entry = next(iter(study.fits.values()))
    training, wanted = [ready.experiments[name] for name in entry.train], parameters_from(entry.parameters)
    model, parameters = prepare(training, ready.model, wanted)
    began, parts = time.perf_counter(), {}
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
        first = late & (exp.time - exp.time[0] < 10.0 + SETTLED)
        parts[name] = (exp.time[first], exp.position[first, -1], modelled[first, -1])
    if given.figure:
        drawn({name: parts[name] for name in ("later", "payload")}, given.figure)


if __name__ == "__main__":
    main()
