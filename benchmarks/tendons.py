"""Evaluate the models of three robots with tendons on public recordings: errors, and a figure.

    PLIANT_DATA=../shared/data python benchmarks/tendons.py robot
    PLIANT_DATA=../shared/data python benchmarks/tendons.py tentacle --figure tentacle.png
    PLIANT_DATA=../shared/data python benchmarks/tendons.py trunk --evaluations 0

Models, recordings and start values are in the studies of examples/, which `pliant run` takes as well. Settled poses of
the robot and the tentacle: errors are root mean squares of the distance over all poses and stations, of training poses
and of poses that a fit did not see; the fits of the tentacle leave out one pose each. The trunk has six motors: its
model is fitted to a part of a recording by a few evaluations, and predicts other recordings and a payload. Errors leave
out the first second of each recording, because the model begins at rest and the trunk moves.
"""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
from harness import parser_of

from pliant.identification.fit import fit, parameters_from
from pliant.identification.initial_guess import prepare
from pliant.identification.prediction import predict
from pliant.study import Study, load_study, run_study
from pliant.study.run import prepare_all
from pliant.validation.outcome import FitOutcome, StudyOutcome

Array = np.ndarray
EXAMPLES = Path(__file__).parents[1] / "examples"
STUDIES = {"robot": "spatial_tendon_robot", "tentacle": "spatial_tentacle", "trunk": "spatial_tendon_trunk"}
SETTLED = 1.0  # s


def distances(fit: FitOutcome, role: str) -> Array:
    """Return distances of modelled from measured stations in all poses of a role, m."""
    parts = [r.modelled - r.experiment.position for r in fit.records if r.role == role]
    return np.concatenate([np.linalg.norm(part, axis=-1).ravel() for part in parts] or [np.zeros(0)])


def draw_poses(outcome: StudyOutcome, path: Path) -> None:
    """Draw the fitted poses of the hanging tentacle, measured thick and grey, modelled thin and dark."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, 2, figsize=(7.2, 3.4), layout="constrained")
    for ax, b, up in zip(axes, (1, 2), "yz", strict=True):
        for r in (r for r in outcome.fits[0].records if r.role == "train"):
            seen, shown = 1e3 * r.experiment.position, 1e3 * r.modelled
            for s in range(seen.shape[1]):
                ax.plot(seen[:, s, 0], seen[:, s, b], "o", color="0.7", ms=7, mec="none")
                ax.plot(*(np.stack([seen[:, s, k], shown[:, s, k]]) for k in (0, b)), color="0.3", lw=0.7)
                ax.plot(shown[:, s, 0], shown[:, s, b], "o", color="0.1", ms=2.5)
            if r.body is not None:
                ax.plot(*(1e3 * r.body[0, :, k] for k in (0, b)), color="0.1", lw=0.8)
        ax.set(xlabel="x (mm)", ylabel=f"{up} (mm)", aspect="equal")
        ax.spines[["top", "right"]].set_visible(False)
        if up == "z":
            ax.invert_yaxis()  # it hangs
    figure.savefig(path, dpi=160)


def draw_tips(parts: dict[str, tuple[Array, Array, Array]], path: Path) -> None:
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


def rms_mm(off: Array) -> str:
    """Return the number of distances [m] and their root mean square as text."""
    return f"{off.size} places, {1e3 * np.sqrt(np.mean(off**2)):.2f} mm rms"


def poses(study: Study, figure: Path | None) -> None:
    """Run a study of settled poses, and print its errors."""
    outcome, unseen = run_study(study), []
    for each in outcome.fits:
        for role in ("train", "held_out"):
            if (off := distances(each, role)).size:
                print(f"{each.name}, {role}: {rms_mm(off)}")
        unseen.append(distances(each, "held_out"))
        print("  " + ", ".join(f"{p.name} {p.value:.4g}" for p in each.result.parameters if p.value is not None))
    if (off := np.concatenate(unseen)).size:
        print(f"unseen poses of all fits: {rms_mm(off)}")
    if figure:
        draw_poses(outcome, figure)


def trunk(study: Study, evaluations: int, figure: Path | None) -> None:
    """Fit the model of the trunk, predict all recordings, and print the errors."""
    ready = prepare_all(study, print)
    entry = next(iter(study.fits.values()))
    training, wanted = [ready.experiments[name] for name in entry.train], parameters_from(entry.parameters)
    model, parameters = prepare(training, ready.model, wanted)
    began, parts = time.perf_counter(), {}
    if evaluations:
        parameters = list(fit(training, ready.model, wanted, time_step=study.time_step, starts=1,
                              max_evaluations=evaluations).parameters)  # fmt: skip
    values = {p.name: p.value for p in parameters if p.value is not None}
    print(f"{sum(p.free for p in parameters)} parameters: {time.perf_counter() - began:.0f} s")
    for name, exp in ready.experiments.items():
        modelled = predict(model, exp, values, study.time_step)["position"]
        late = exp.time - exp.time[0] >= SETTLED
        size = 1e3 * np.sqrt(np.nanmean(np.sum((modelled - exp.position)[late] ** 2, axis=-1), axis=0))
        print(name, ", ".join(f"{s} {e:.1f} mm" for s, e in zip(exp.stations, size, strict=True)))
        first = late & (exp.time - exp.time[0] < 10.0 + SETTLED)
        parts[name] = (exp.time[first], exp.position[first, -1], modelled[first, -1])
    if figure:
        draw_tips({name: parts[name] for name in ("later", "payload")}, figure)


def main() -> None:
    """Evaluate one of the studies."""
    parser = parser_of(__doc__, evaluations=6, figure=Path)  # 0 evaluations: the start values as they are
    parser.add_argument("study", choices=STUDIES)
    given = parser.parse_args()
    study = load_study(EXAMPLES / f"{STUDIES[given.study]}.toml")
    if given.study == "trunk":
        trunk(study, given.evaluations, given.figure)
    else:
        poses(study, given.figure)


if __name__ == "__main__":
    main()
