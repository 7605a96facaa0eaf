"""The models of this folder, from free pulses of the virtual actuators and one recording with known pushes (seed 1).

    python benchmarks/models/identify.py b -o b.json

Least squares in the joint angles over six free pulses, slow triangles and `PUSHES`: forces at the tip as of a weight on
a thread, at rest and under 119 kPa. A free pulse shows how far a joint bends, which is its gain over its stiffness; a
known force tells the two apart. Prints the latency [s] that benchmarks/state.py takes.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from state import LINKS, pushed, seen

from pliant.compiler.choose import twin
from pliant.errors import SimulationError
from pliant.estimation import Noise, kalman_loops
from pliant.estimation.measurement import measurement_of
from pliant.estimation.offline import chain_of, input_of
from pliant.estimation.symbols import FilterNoise, FilterState
from pliant.estimation.workspace import make_workspace
from pliant.model import Model, save_model
from pliant.model.memory import Memory
from pliant.simulation import state
from pliant.simulation.drive import drive
from pliant.testbed.scenarios import Command, Scenario, scenario

FREE = ("pulse_60", "pulse_119", "pulse_180", "pulse_240", "pulse_119_short", "pulse_180_medium", "triangle")
PUSHED = Scenario("known_pushes", "", 7.4, Command("steps", ((2.7, 119e3), (6.5, 0.0))))
PUSHES = ((0.4, 1.1, 0.5), (1.5, 2.2, -0.5), (4.2, 4.9, 0.5), (5.3, 6.0, -0.5))  # s, s, N along x
RISE = 0.05  # s, of a push
CREEP_TIME, SLIP_ANGLE = (0.05, 0.5, 5.0), (0.008, 0.025, 0.08, 0.25)
SIZES = {  # of the parameters: how many, where they begin, their bounds, what is known of them and how well
    "log_stiffness": (5, np.log([0.85, 0.75, 0.65, 0.7, 0.75]), -3.0, 3.0, None, np.inf),
    "gain": (5, 1.0, 0.3, 1.7, 1.0, 0.5),
    "torque": (2, (1.0, 0.2), -5.0, 5.0, None, np.inf),  # uN m/Pa, pN m/Pa^2
    "stiffening": (1, -0.3, -0.6, 0.6, 0.0, 1.0),
    "log_loss": (1, np.log(4.0), -3.0, 4.0, None, np.inf),  # ms, damping over stiffness
    "latency": (1, 4.5, 0.0, 20.0, None, np.inf),  # ms
    "cap": (1, 7.0, 2.0, 15.0, 7.0, 1.0),  # g
    "log_creep": (3, np.log(0.05), np.log(1e-3), np.log(0.5), np.log(0.03), 2.5),
    "log_slip": (4, np.log(0.03), np.log(1e-3), np.log(0.5), np.log(0.03), 2.5),
}
DOUBT = 0.2  # mrad that a prior is worth at one standard deviation
ALIKE = 0.2  # standard deviation of the logarithms of the joints' stiffnesses


def column(which):
    return np.concatenate([np.broadcast_to(np.asarray(row[which], dtype=float), row[0]) for row in SIZES.values()])


def named(p):
    """The parameters by name."""
    edges = np.cumsum([0] + [row[0] for row in SIZES.values()])
    return {name: p[a:b] for name, a, b in zip(SIZES, edges[:-1], edges[1:], strict=True)}


def model_of(p, rest, name):
    v = named(p)
    stiffness = np.exp(v["log_stiffness"])
    return Model(
        link_length=LINKS, link_mass=0.069 * LINKS / 0.17, stiffness=stiffness, stiffening=v["stiffening"],
        damping=1e-3 * np.exp(v["log_loss"][0]) * stiffness, joint_gain=v["gain"],
        torque=v["torque"] * (1e-6, 1e-12), rest_angle=rest, tip_mass=1e-3 * v["cap"][0], base_length=0.017, name=name,
        memory=Memory(tuple(np.exp(v["log_creep"])), CREEP_TIME, tuple(np.exp(v["log_slip"])), SLIP_ANGLE),
    )


def push(time):
    """Force along x at the tip, N."""
    return sum(f * np.clip((time - a) / RISE, 0, 1) * np.clip((b - time) / RISE, 0, 1) for a, b, f in PUSHES)


def arms(angle):
    """Torques (T, n) at the joints of 1 N along x at the tip, from measured joint angles (T, n)."""
    rise = np.cos(np.cumsum(angle, axis=1)) * LINKS
    return -np.cumsum(rise[:, ::-1], axis=1)[:, ::-1]


def predicted(chain, body, sight, latency, arm=None):
    """Joint angles (T, n) under the measured pressure, and under the known pushes where the arms (T, n) are given."""
    source, held = input_of(body, chain, None)
    times = sight.time - latency
    plan = drive(held, source, times, 5e-3)
    n, (T, _) = chain.n, sight.value.shape
    q = state.equilibrium(held, plan.initial)
    phi, d, known = state.absolute(held, q), np.zeros(n), np.zeros((2 * n, 2 * n))
    own = FilterState(phi, np.zeros(n), d, known, state.relaxed(held, q))
    quiet = FilterNoise(np.zeros(n), 0.0, np.zeros(n), 0.0, np.zeros(1))
    predict, workspace, frame, out = twin(kalman_loops.predict, n), make_workspace(held, 2 * n, n), 0, np.empty((T, n))
    chain_now, middle = chain_of(held), times[0] + np.cumsum(plan.h) - 0.5 * plan.h
    force = push(middle)
    out[0] = phi
    for k in range(plan.h.size):
        if arm is not None:
            d[:] = force[k] * arm[frame]
        if predict(own, chain_now, plan.h[k], plan.torque[k], quiet, workspace) < 0:
            raise SimulationError("a link turns by more than a radian in a step")
        if plan.keep[k] >= 0:
            frame = plan.keep[k]
            out[frame] = phi
    return np.diff(out, axis=1, prepend=held.base_angle)


def identified(name):
    """Model and latency [s] of least squares, and the root mean square of what is left of each recording, mrad."""
    bodies = [seen(scenario(case), name)[0] for case in FREE]
    bodies.append(pushed(PUSHED, name, lambda t: np.stack([push(t), np.zeros_like(t)], axis=1)))
    start, low, high, known, sure = (column(k) for k in range(1, 6))
    sights = [measurement_of(body, model_of(start, np.zeros(5), name), Noise()) for body in bodies]
    rest = np.nanmean(np.concatenate([s.value[s.time < 0.11] for s in sights]), axis=0)
    held = np.isfinite(sights[-1].value).all(axis=1)
    filled = np.stack([np.interp(sights[-1].time, sights[-1].time[held], c[held]) for c in sights[-1].value.T], axis=1)
    arm = [None] * len(FREE) + [arms(filled)]

    def misfits(p):
        chain, late = model_of(p, rest, name), 1e-3 * named(p)["latency"][0]
        return [1e3 * np.nan_to_num(predicted(chain, b, s, late, a) - s.value) / np.sqrt(s.value.size)
                for b, s, a in zip(bodies, sights, arm, strict=True)]

    def residuals(p):
        doubts = DOUBT * (p - np.nan_to_num(known)) / sure
        mean = 100.0 * (named(p)["gain"].mean() - 1.0)  # the torque law has a scale of its own
        apart = DOUBT * (named(p)["log_stiffness"] - named(p)["log_stiffness"].mean()) / ALIKE
        return np.concatenate([m.ravel() for m in misfits(p)] + [doubts, apart, [mean]])

    p = least_squares(residuals, start, bounds=(low, high), x_scale=0.1, diff_step=1e-4, max_nfev=30).x
    left = [float(np.sqrt(np.sum(m**2))) for m in misfits(p)]
    return model_of(p, rest, name), 1e-3 * float(named(p)["latency"][0]), left


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("actuator", choices=["a", "b", "c"])
    parser.add_argument("-o", "--output", type=Path, required=True, help="model file to write")
    args = parser.parse_args()
    chain, latency, left = identified(args.actuator)
    source = {"all": f"benchmarks/models/identify.py {args.actuator}: free pulses and known pushes of the virtual "
                     "actuator, seed 1"}  # fmt: skip
    save_model(chain.with_(source=source), args.output)
    print(f"{args.actuator}: latency {1e3 * latency:.3f} ms; left over, mrad: {np.round(left, 2)}")


if __name__ == "__main__":
    main()
