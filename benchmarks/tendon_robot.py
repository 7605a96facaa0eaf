"""A robot with nine tendons in space: fitted to some blocks of poses of a public recording, judged on others.

    python benchmarks/tendon_robot.py --data ../shared/data/spatial_tendon_robot/v4_train.csv

The recording holds a pose every 0.6 s: nine displacements of tendons and the tip. The model has two links for each of
three segments, a tendon law with slack, and no friction. Of every three blocks of 60 poses one is never fitted.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np

from pliant.identification import Experiment
from pliant.identification.fit import fit
from pliant.identification.prediction import predict
from pliant.model import Model, Space, Station, Tendon, chain_model
from pliant.simulation import Trace

Array = np.ndarray
SEGMENTS, PER_SEGMENT = np.array([0.060, 0.0625, 0.064]), 2  # m, as the robot's authors state them; links
AZIMUTHS = (3.27, 3.73, 4.22)  # rad, of the first tendon of each segment: where a first look starts
LEVER, BLOCK, INTERVAL, STEP = 4.5e-3, 60, 0.6, 4e-3  # m, poses, s, s
NAMES = tuple(f"t{k}" for k in range(9))


def robot() -> Model:
    """The chain before the fit. Tendons are 1 N/mm: without a known force only ratios of stiffness show."""
    lengths = np.repeat(SEGMENTS / PER_SEGMENT, PER_SEGMENT)
    link = np.append((lengths[1:] + lengths[:-1]) / 2, lengths[-1] / 2)
    cord = {"driven_by": "displacement", "lever": LEVER, "line_stiffness": 1e3, "pretension": 0.2}
    tendons = [
        Tendon.at_azimuth(AZIMUTHS[s] + 2 * np.pi * j / 3, np.arange(link.size) < PER_SEGMENT * (s + 1),
                          name=NAMES[3 * s + j], **cord)
        for s in range(3) for j in range(3)
    ]  # fmt: skip
    K = np.repeat([7.5e-3, 8.5e-3, 11.7e-3], PER_SEGMENT)
    model = chain_model(length=float(link.sum()), mass=2e-4, links=link.size, stiffness=K, damping=1e-3,
                        chambers=tendons, space=Space())  # fmt: skip
    return model.with_(link_length=link, link_mass=2e-4 * link / link.sum(), base_length=float(lengths[0] / 2),
                       stations=[Station("tip", link.size - 1, float(link[-1]) + 5e-3)])  # fmt: skip


def blocks(path: Path) -> list[Experiment]:
    """The recording in blocks of poses, each from the rest under its first displacements."""
    rows = np.genfromtxt(path, delimiter=",", skip_header=1)
    drawn, tip = 1e-3 * rows[:, 2:11], 1e-3 * rows[:, 11:]
    made = []
    for first in range(0, len(rows), BLOCK):
        these = slice(first, first + BLOCK)
        moment = INTERVAL * np.arange(len(rows[these]))
        drives = {name: Trace(moment, column) for name, column in zip(NAMES, drawn[these].T, strict=True)}
        made.append(Experiment(f"b{first}", moment, tip[these, None], ("tip",), "trace", drives=drives))
    return made


def main() -> None:
    """Fit, predict, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, required=True)
    every = blocks(parser.parse_args().data)
    seen = [b for k, b in enumerate(every) if k % 3 != 2][::2]
    unseen = every[2::3]
    wanted = ["stiffness", *(f"base_{k}" for k in ("x", "y", "z", "tilt_x", "tilt_y")),
              *(f"tip.{k}" for k in ("along", "across", "aside")),
              *(f"{name}.{k}" for name in NAMES for k in ("pretension", "gain_x", "gain_y"))]  # fmt: skip
    began = time.perf_counter()
    found = fit(seen, robot(), wanted, step=STEP, starts=1, max_evaluations=25)
    print(f"{len(wanted)} parameters, {len(seen)} blocks of poses: {time.perf_counter() - began:.0f} s")
    values = {p.name: p.value for p in found.parameters if p.value is not None}
    for title, some in (("fitted", seen), ("unseen", unseen)):
        off = [predict(robot(), b, values, STEP)["position"] - b.position for b in some]
        square = np.concatenate([np.sum(d**2, axis=-1).ravel() for d in off])
        print(f"{title}: {square.size} poses, tip {1e3 * np.sqrt(square.mean()):.2f} mm rms")


if __name__ == "__main__":
    main()
