"""The models of this folder, from free pulses of the virtual actuators (seed 1).

    python benchmarks/models/identify.py b -o b.json

First joint angles by least squares over six pulses, without offsets of the gain between joints; then one scale each of
stiffness with torque, damping, creep and slip, latency and softening on the likelihood of the filter over five of them.
Prints the latency [s] and the softening [1/(N m)] that benchmarks/state.py takes. The committed files
come back within 0.2 %.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares, minimize

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from state import seen

from pliant.errors import SimulationError
from pliant.model import Model, save_model
from pliant.model.memory import Memory
from pliant.runtime import Noise
from pliant.runtime.estimation import input_of, run
from pliant.runtime.sight import sight_of
from pliant.simulation import Trace, simulate
from pliant.simulation.drive import drive
from pliant.testbed.scenarios import scenario

PULSES = ("pulse_60", "pulse_119", "pulse_180", "pulse_240", "pulse_119_short", "pulse_180_medium")
LENGTH = np.array([0.034] * 4 + [0.017])  # m, after a base of 17 mm: joints at mid-segment
CREEP_TIME, SLIP_ANGLE = (0.05, 0.5, 5.0), (0.008, 0.025, 0.08, 0.25)
NOISE = Noise(angle=1.5e-3, torque=5e-5, wander=0.02, pressure=92.0, initial_disturbance=0.01)
START = np.concatenate([np.full(5, np.log(1.1)), [np.log(1.3), 1.0, np.log(5.0), 4.0], np.log([0.05] * 3 + [0.02] * 4)])


def model_of(p, rest, name):
    """Parameters: logarithms of 5 stiffnesses, torque law, damping over stiffness [ms], latency [ms], memory."""
    stiffness = np.exp(p[:5])
    return Model(
        link_length=LENGTH, link_mass=0.069 * LENGTH / 0.17, stiffness=stiffness,
        damping=1e-3 * np.exp(p[7]) * stiffness,
        torque=[np.exp(p[5]) * 1e-6, p[6] * 1e-12], rest_angle=rest, tip_mass=0.007, base_length=0.017, name=name,
        memory=Memory(tuple(np.exp(p[9:12])), CREEP_TIME, tuple(np.exp(p[12:16])), SLIP_ANGLE),
    )


def least(name, bodies):
    """Model of least squares in the joint angles."""
    sights = [sight_of(body, model_of(START, np.zeros(5), name), Noise()) for body in bodies]
    rest = np.nanmean(np.concatenate([s.value[s.time < 0.11] for s in sights]), axis=0)

    def residuals(p):
        chain, out = model_of(p, rest, name), []
        for body, s in zip(bodies, sights, strict=True):
            pressure = Trace(body["pressure_time"].values, body["pressure"].values)
            motion = simulate(chain, pressure, times=s.time - p[8] * 1e-3, step=2.5e-3)
            out.append(np.nan_to_num(motion["joint_angle"].values + rest - s.value).ravel() / np.sqrt(s.time.size))
        return np.concatenate([1e3 * np.concatenate(out), 0.02 * (p[9:] - np.log(0.03))])

    low, high = np.full(16, -np.inf), np.full(16, np.inf)
    low[9:], high[9:] = np.log(1e-3), np.log(0.5)
    found = least_squares(residuals, START, bounds=(low, high), x_scale=0.1, diff_step=1e-4, max_nfev=25)
    return model_of(found.x, rest, name)


def scaled(chain, z):
    """Logarithmic factors of stiffness with torque (0), damping (1), creep (4) and slip (5)."""
    memory = replace(
        chain.memory, creep_share=tuple(np.exp(z[4]) * np.array(chain.memory.creep_share)),
        slip_share=tuple(np.exp(z[5]) * np.array(chain.memory.slip_share)),
    )
    factor = np.exp(z[0])
    return chain.with_(
        stiffness=factor * chain.stiffness, torque=factor * chain.torque, damping=np.exp(z[1]) * chain.damping,
        memory=memory,
    )


def refined(chain, bodies):
    """Model, latency and softening of the highest likelihood of the filter's innovations."""
    ready = [(sight_of(body, chain, NOISE), input_of(body, chain, None, 8e-3)[0]) for body in bodies]

    def cost(z):
        total, held = 20.0 * (z[4] ** 2 + z[5] ** 2), scaled(chain, z)
        for sight, source in ready:
            try:
                out = run(held, sight, drive(held, source, sight.time - 1e-3 * z[2], 5e-3), NOISE, max(0.0, z[3]))
            except SimulationError:
                return 1e9
            total += 0.5 * float(np.sum(out.score[1:, 1:3]))
        return total

    start = np.array([0.0, 0.0, 4.0, 0.3, 0.0, 0.0])
    simplex = np.vstack([start, start + np.diag([0.04, 0.1, 1.0, 0.2, 0.3, 0.3])])
    z = minimize(cost, start, method="Nelder-Mead", options={"maxfev": 200, "initial_simplex": simplex}).x
    return scaled(chain, z), 1e-3 * z[2], max(0.0, z[3])


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("actuator", choices=["a", "b", "c"])
    parser.add_argument("-o", "--output", type=Path, required=True, help="model file to write")
    args = parser.parse_args()
    bodies = [seen(scenario(name), args.actuator)[0] for name in PULSES]
    chain, latency, softening = refined(least(args.actuator, bodies), bodies[:5])
    source = {"all": f"benchmarks/models/identify.py {args.actuator}: free pulses of the virtual actuator, seed 1"}
    save_model(chain.with_(source=source), args.output)
    print(f"{args.actuator}: latency {1e3 * latency:.3f} ms, softening {softening:.3f} 1/(N m)")


if __name__ == "__main__":
    main()
