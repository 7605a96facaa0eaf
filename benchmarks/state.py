"""Measure rates and filter times on virtual actuators, for docs/benchmarks.md.

    python benchmarks/state.py rates      # filter and smoother compared with the best methods without a model
    python benchmarks/state.py speed      # compiled time of a frame, and of one call of the running filter

The models in examples/state come from free pulses of each actuator and known external forces, by the study in the same
folder (identify.py). The last two pulses of `rates` are not training data. The noise parameters are those of actuator
a.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np
from rate_baselines import CAUSAL, CENTRED, errors, span, tuned

from pliant.estimation import KalmanFilter, Noise, estimate, rows_of
from pliant.estimation.measurement import measurement_of
from pliant.mechanics import mechanics_of
from pliant.model import load_model
from pliant.study.dense import body_of_fibre
from pliant.study.schema import Fibre
from pliant.testbed.laboratory import RECORD, SUPPLY_STEP, Laboratory, generate, record, run_rod
from pliant.testbed.rod import actuator
from pliant.testbed.scenarios import scenario
from pliant.testbed.stepping import simulate
from pliant.testbed.truth import joint_rates
from pliant.testbed.valve import supply_pressure

NOISE = Noise(angle=9.5e-4, torque=5e-7, random_walk=1e-3, motion_growth=8.0, initial_disturbance=0.01)
LATENCY = {"a": 4.351e-3, "b": 4.317e-3, "c": 4.673e-3}  # s, fitted with each model
FIBRE = Fibre(body_length=0.17, cap_curvature=50.0, cap_length=0.03, gauge_length=2.4e-3)
RATE = 75.0  # Hz
TUNED_ON = "pulse_150_1200ms"  # sets the windows of what needs no model, with its true rates; in no other table
REST = (0.0, 0.2)  # s, before anything happens
LINKS = np.array([0.034] * 4 + [0.017])  # m, after a base of 17 mm: joints at mid-segment
CASES = (
    "pulse_60", "pulse_119", "pulse_180", "pulse_240", "pulse_119_short", "pulse_90_1000ms", "pulse_210_2000ms",
)  # fmt: skip


def model(name):
    return load_model(Path(__file__).parents[1] / "examples" / "state" / f"model_{name}.json")


def true_rates(motion, chain, at):
    """Return joint rates (T, n) of the chain whose nodes are on the rod."""
    return joint_rates(motion, chain.base_length + np.append(0.0, np.cumsum(chain.link_length)), at)


def recorded(case, chain, rod, lab):
    """Return the recording of a scenario, its link angles without gaps, and the true rates."""
    motion = run_rod(case, rod, lab)
    at = np.arange(0.0, case.duration - 5e-4, 1 / RATE)
    seen = body_of_fibre(record(motion, rod, lab, at, seed=1, attrs={"scenario": case.name}), FIBRE)[0]
    angle = measurement_of(seen, chain, NOISE).value
    for column in angle.T:
        gap = np.isnan(column)
        column[gap] = np.interp(np.flatnonzero(gap), np.flatnonzero(~gap), column[~gap])
    return seen, angle, true_rates(motion, chain, at)


def missed(found, truth):
    return float(np.sqrt(np.mean((found - truth)[20:] ** 2)))


def rates():
    for name in "abc":
        chain, rod, lab = model(name), actuator(name), Laboratory()
        _, angle, truth = recorded(scenario(TUNED_ON), chain, rod, lab)
        causal, centred = (tuned(kinds, angle, truth, RATE, missed) for kinds in (CAUSAL, CENTRED))
        print(f"{name} tuned on {TUNED_ON}: {({k: s for k, (_, s) in (causal | centred).items()})}")
        over = {"filter": [], "smoother": []}
        for case in map(scenario, CASES):
            seen, angle, truth = recorded(case, chain, rod, lab)
            found = estimate(seen, chain, noise=NOISE, latency=LATENCY[name])
            usual, ahead = errors(causal, angle, truth, RATE, missed), errors(centred, angle, truth, RATE, missed)
            mine = missed(found.joint_rate.values, truth), missed(found.smooth_joint_rate.values, truth)
            over["filter"].append(min(usual.values()) / mine[0])
            over["smoother"].append(min(ahead.values()) / mine[1])
            print(f"{name} {case.name:<16} " + ", ".join(f"{k} {v:.3f}" for k, v in (usual | ahead).items())
                  + f" rad/s; filter {mine[0]:.3f}, smoother {mine[1]:.3f}; best causal over filter "
                  f"{over['filter'][-1]:.2f}, centred over smoother {over['smoother'][-1]:.2f}, "
                  f"NIS {found.attrs['nis_ratio']:.2f}, correlation {found.attrs['innovation_correlation']:+.2f}",
                  flush=True)
        print(f"{name}: " + ", ".join(f"{k} {span(v)} times better" for k, v in over.items()), flush=True)


def speed():
    from pliant.compiler.choose import twin
    from pliant.equations import observation
    from pliant.estimation import kalman_loops
    from pliant.estimation.offline import chain_of, frame_of
    from pliant.estimation.symbols import FilterNoise, FilterState, Prediction, make_workspace
    from pliant.simulation import state

    for name, chain in (("with memory", model("a")), ("without", model("a").with_(memory=type(model("a").memory)()))):
        n, rows = chain.n, np.array([(observation.JOINT, i, 0.0, 0.0) for i in range(chain.n)])
        workspace, P, rest = make_workspace(chain, NOISE.states(chain), n), NOISE.initial(chain), np.zeros(n)
        start = mechanics_of(chain).coordinates(rest)
        own = FilterState(start, np.zeros(n), np.zeros(n), P, state.relaxed(chain, rest))
        noise, many = FilterNoise(*NOISE.densities(chain), np.zeros(1)), twin(kalman_loops.many_frames, n)
        frame = frame_of(chain, rows, chain.rest_angle.copy(), np.full(n, NOISE.angle**2))
        for steps in (1, 2, 3):
            ahead = Prediction(steps, 1.0 / RATE / steps, np.full(n, 0.05), noise)
            call = own, chain_of(chain), ahead, frame, workspace
            many(1, *call)
            spent = []
            for _ in range(200):
                began = time.process_time()
                many(50, *call)
                spent.append((time.process_time() - began) / 50)
            print(f"{name}: frame of {steps} steps and {n} angles: median {1e6 * np.median(spent):.1f} us, "
                  f"least {1e6 * min(spent):.1f} us")
    filter_ = KalmanFilter(model("a"), NOISE, latency=4e-3)
    rows, spent = rows_of(model("a"), model("a").points[-2:]), []
    for k in range(2000):
        began = time.perf_counter()
        filter_.push_frame(k / RATE, rows, np.full(len(rows), np.nan) if not len(rows) else seen_at_rest(rows),
                           np.full(len(rows), 1e-7))
        spent.append(time.perf_counter() - began)
    print(f"one call of the running filter, from Python: median {1e6 * np.median(spent[100:]):.0f} us")


def seen_at_rest(rows):
    from pliant.equations.observation import observe_rows
    from pliant.estimation.offline import frame_of

    chain = model("a") if not hasattr(seen_at_rest, "chain") else seen_at_rest.chain
    seen_at_rest.chain = chain
    seen, slopes = np.empty(len(rows)), np.empty((len(rows), chain.n))
    at_rest = mechanics_of(chain).coordinates(np.zeros(chain.n))
    observe_rows(at_rest, frame_of(chain, rows, seen, seen), mechanics_of(chain).sight(np.complex128), seen, slopes)
    return seen


def seen(case, name):
    made = generate(case, name, 1)
    return body_of_fibre(made.recording, FIBRE)[0], made.truth


def pushed(case, name, force, rate=RATE):
    """Return the shape under a scenario's pressure and a force (T, 2) [N] at the tip, a function of time; free at
    first.
    """
    rod, lab = actuator(name), Laboratory()
    fine = max(1, round(case.time_step / SUPPLY_STEP))
    t = np.arange(round(case.duration / case.time_step) * fine + 1) * case.time_step / fine
    loads = np.zeros(((t.size - 1) // fine, 4))
    loads[:, 0] = supply_pressure(case.command, t, lab.valve)[fine::fine]
    loads[:, 1:3] = force(t[fine::fine])
    motion = simulate(rod, loads, case.time_step, stride=max(1, round(RECORD / case.time_step)))
    at = np.arange(0.0, case.duration - 0.5 * RECORD, 1 / rate)
    recording = record(motion, rod, lab, at, seed=1, attrs={"scenario": case.name})
    return body_of_fibre(recording, FIBRE.model_copy(update={"rest": REST}))[0]


if __name__ == "__main__":
    {"rates": rates, "speed": speed}[sys.argv[1] if len(sys.argv) > 1 else "rates"]()
