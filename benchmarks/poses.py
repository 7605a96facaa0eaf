"""Evaluate settled poses of a robot and of a tentacle with tendons: example studies, pooled errors, and a figure.

    PLIANT_DATA=../shared/data python benchmarks/poses.py robot
    PLIANT_DATA=../shared/data python benchmarks/poses.py tentacle --figure tentacle.png

Errors are root mean squares of the distance over all poses and stations, of training poses and of poses that a fit did
not see. The fits of the tentacle leave out one pose each.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np

from pliant.study import load_study, run_study
from pliant.validation.outcome import FitOutcome, StudyOutcome

Array = np.ndarray
EXAMPLES = Path(__file__).parents[1] / "examples"
STUDIES = {"robot": "spatial_tendon_robot", "tentacle": "spatial_tentacle"}


def distances(fit: FitOutcome, role: str) -> Array:
    """Return distances of modelled from measured stations in all poses of a role, m."""
    parts = [r.modelled - r.experiment.position for r in fit.records if r.role == role]
    return np.concatenate([np.linalg.norm(part, axis=-1).ravel() for part in parts] or [np.zeros(0)])


def drawn(outcome: StudyOutcome, name: str, path: Path) -> None:
    """Draw the poses, measured thick and grey, modelled thin and dark."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, 2, figsize=(7.2, 3.4), layout="constrained")
    first = outcome.fits[0]
    wanted = "held_out" if name == "robot" else "train"
    views = ((0, 1, "x", "y"), (0, 2, "x", "z"))
    for ax, (a, b, across, up) in zip(axes, views, strict=True):
        for r in (r for r in first.records if r.role == wanted):
            seen, shown = 1e3 * r.experiment.position, 1e3 * r.modelled
            for s in range(seen.shape[1]):
                ax.plot(seen[:, s, a], seen[:, s, b], "o", color="0.7", ms=4 if name == "robot" else 7, mec="none")
                ax.plot(*(np.stack([seen[:, s, k], shown[:, s, k]]) for k in (a, b)), color="0.3", lw=0.7)
                ax.plot(shown[:, s, a], shown[:, s, b], "o", color="0.1", ms=1.5 if name == "robot" else 2.5)
            if r.body is not None and name == "tentacle":
                ax.plot(*(1e3 * r.body[0, :, k] for k in (a, b)), color="0.1", lw=0.8)
        ax.set(xlabel=f"{across} (mm)", ylabel=f"{up} (mm)", aspect="equal")
        ax.spines[["top", "right"]].set_visible(False)
        if name == "tentacle" and up == "z":
            ax.invert_yaxis()  # it hangs
    figure.savefig(path, dpi=160)


def main() -> None:
    """Run a study and print its errors."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("study", choices=STUDIES)
    parser.add_argument("--fits", nargs="*", help="names of the fits to make; default: all")
    parser.add_argument("--figure", type=Path, help="file for a figure")
    given = parser.parse_args()
    study = load_study(EXAMPLES / f"{STUDIES[given.study]}.toml")
    if given.fits:
        study = study.model_copy(update={"fits": {name: study.fits[name] for name in given.fits}})
    began = time.perf_counter()
    outcome = run_study(study)
    unseen = []
    for fit in outcome.fits:
        for role in ("train", "held_out"):
            if (off := distances(fit, role)).size:
                print(f"{fit.name}, {role}: {off.size} places, {1e3 * np.sqrt(np.mean(off**2)):.2f} mm rms")
        unseen.append(distances(fit, "held_out"))
        print("  " + ", ".join(f"{p.name} {p.value:.4g}" for p in fit.result.parameters if p.value is not None))
    if (off := np.concatenate(unseen)).size:
        print(f"unseen poses of all fits: {off.size} places, {1e3 * np.sqrt(np.mean(off**2)):.2f} mm rms")
    print(f"{time.perf_counter() - began:.0f} s")
    if given.figure:
        drawn(outcome, given.study, given.figure)


if __name__ == "__main__":
    main()
