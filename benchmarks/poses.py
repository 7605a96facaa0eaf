"""Evaluate settled poses of a robot and of a tentacle with tendons: example studies, pooled errors, and a figure.

    PLIANT_DATA=../shared/data python benchmarks/poses.py robot
    PLIANT_DATA=../shared/data python benchmarks/poses.py tentacle --figure tentacle.png

Errors are root mean squares of the distance over all poses and stations, of training poses and of poses that a fit did
not see. The fits of the tentacle leave out one pose each.
"""

from __future__ import annotations

import argparse
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


def drawn(outcome: StudyOutcome, path: Path) -> None:
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


def main() -> None:
    """Run a study and print its errors."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("study", choices=STUDIES)
    parser.add_argument("--figure", type=Path, help="file for a figure of the tentacle")
    given = parser.parse_args()
    outcome, unseen = run_study(load_study(EXAMPLES / f"{STUDIES[given.study]}.toml")), []
    for fit in outcome.fits:
        for role in ("train", "held_out"):
            if (off := distances(fit, role)).size:
                print(f"{fit.name}, {role}: {off.size} places, {1e3 * np.sqrt(np.mean(off**2)):.2f} mm rms")
        unseen.append(distances(fit, "held_out"))
        print("  " + ", ".join(f"{p.name} {p.value:.4g}" for p in fit.result.parameters if p.value is not None))
    if (off := np.concatenate(unseen)).size:
        print(f"unseen poses of all fits: {off.size} places, {1e3 * np.sqrt(np.mean(off**2)):.2f} mm rms")
    if given.figure:
        drawn(outcome, given.figure)


if __name__ == "__main__":
    main()
