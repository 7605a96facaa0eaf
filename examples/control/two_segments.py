"""The tip of a body of two segments around a loop in the plane, on a body unlike its model.

    python examples/control/two_segments.py -o results/two_segments

Writes the model, a body that is softer and creeps, and the report of the run, and prints how near the tip came.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np

import pliant
from pliant.control import TaskFile
from pliant.control.model_plant import ModelPlant
from pliant.loop.task import TaskResult, run_task
from pliant.model import Memory, Valve

PERIOD = 4e-3  # s
HIGHEST = np.array([200e3, 180e3])  # Pa


def two_segments() -> pliant.Model:
    """Segments that bend to opposite sides, each behind a valve of its own."""
    valves = [Valve(natural_frequency=8.0, damping_ratio=0.8, dead_time=8e-3),
              Valve(natural_frequency=11.0, damping_ratio=0.9, dead_time=5e-3)]  # fmt: skip
    low = pliant.Chamber(torque=[3e-6], joint_gain=[1.0, 1.0, 0.0, 0.0], valve=valves[0], name="low")
    high = pliant.Chamber(torque=[3e-6], joint_gain=[0.0, 0.0, -1.0, -1.0], valve=valves[1], name="high")
    body = pliant.chain_model(length=0.16, mass=0.06, links=4, stiffness=1.2, damping=15e-3, torque=[0.0])
    return body.with_(chambers=(low, high), name="two segments")


def unlike(model: pliant.Model) -> pliant.Model:
    """Another specimen: softer, one chamber weaker, and it creeps."""
    low, high = model.chambers
    creep = Memory(creep_share=(0.05,), creep_time=(0.3,))
    return model.with_(
        stiffness=0.92 * model.stiffness, chambers=(low, replace(high, torque=0.95 * high.torque)), memory=creep,
        name="another specimen",
    )


def loop_of_the_tip(model: pliant.Model, duration: float) -> dict[str, list[float]]:
    """A path of the tip that the model can reach: that of pressures which change slowly, a quarter of a turn apart."""
    clock = np.arange(0.0, duration, PERIOD)
    turn, share = 2 * np.pi * clock / 1.5, np.clip(clock / 0.6, 0.0, 1.0)
    pressure = np.stack([100e3 + 50e3 * np.sin(turn), 90e3 + 50e3 * np.cos(turn)], axis=1)
    rests = [pliant.equilibrium(model, p) for p in (share * share * (3 - 2 * share))[:, None] * pressure]
    angle = np.cumsum(rests, axis=1)
    tip = 1e3 * np.stack([-np.sin(angle) @ model.link_length, (np.cos(angle) - 1.0) @ model.link_length])
    return {"time_s": clock.tolist(), "tip_x_mm": tip[0].tolist(), "tip_y_mm": tip[1].tolist()}


def follow(output: Path, feedback: str = "lqr", estimator: str = "observer", duration: float = 3.6) -> TaskResult:
    """Follow the path for a while [s], the files into a folder, which is made."""
    output.mkdir(parents=True, exist_ok=True)
    model = two_segments()
    body = unlike(model)
    pliant.save_model(model, output / "model.json")
    pliant.save_model(body, output / "body.json")
    task = TaskFile.model_validate({
        "duration_s": duration, "highest_kpa": (1e-3 * HIGHEST).tolist(), "feedback": feedback,
        "path": loop_of_the_tip(model, duration),
    })
    return run_task(model, ModelPlant(body), task, output, estimator=estimator)


def off_path(done: TaskResult) -> np.ndarray:
    """Distance [mm] of the tip, as estimated, from where it is wanted, at each period from 0.6 s on."""
    return 1e3 * np.hypot(done.log["error_tip_x_m"], done.log["error_tip_y_m"]).to_numpy()[round(0.6 / PERIOD) :]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("results/two_segments"))
    parser.add_argument("--feedback", choices=["lqr", "mpc"], default="lqr")
    parser.add_argument("--estimator", choices=["observer", "filter", "differences"], default="observer")
    args = parser.parse_args()
    done = follow(args.output, args.feedback, args.estimator)
    off = off_path(done)
    print(f"{done.summary['fault'] or 'no fault'}; from 0.6 s on the tip, as estimated, is "
          f"{np.sqrt(np.mean(off**2)):.2f} mm rms and {off.max():.2f} mm at most from where it is wanted")


if __name__ == "__main__":
    main()
