"""Measure estimated joint rates of virtual actuators beside methods without a model, and the time of a frame.

The models in examples/state come from free pulses of each actuator and known external forces, by the study in the same
folder (identify.py). The last two pulses are not training data. The noise parameters are those of actuator a. Each
method without a model has the setting with the smallest error on one more pulse whose true rates are known: an engineer
does not have this information, so these methods are as good as possible.

    python benchmarks/state.py a
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import xarray as xr
from harness import Case, measured
from scipy.signal import butter, lfilter, savgol_coeffs, savgol_filter
from speed.timing import in_turn

from pliant.compiler.choose import twin
from pliant.equations import observation
from pliant.estimation import Noise, estimate, kalman_loops
from pliant.estimation.measurement import measurement_of
from pliant.estimation.offline import chain_of, frame_of
from pliant.estimation.symbols import FilterNoise, FilterState, Prediction, make_workspace
from pliant.mechanics import mechanics_of
from pliant.model import Model, load_model
from pliant.simulation import state
from pliant.study.dense import body_of_fibre
from pliant.study.schema import Fibre
from pliant.testbed.laboratory import Laboratory, generate, record, run_rod
from pliant.testbed.rod import actuator
from pliant.testbed.scenarios import Scenario, scenario
from pliant.testbed.truth import joint_rates

Array = np.ndarray
NOISE = Noise(angle=9.5e-4, torque=5e-7, random_walk=1e-3, motion_growth=8.0, initial_disturbance=0.01)
LATENCY = {"a": 4.351e-3, "b": 4.317e-3, "c": 4.673e-3}  # s, fitted with each model
FIBRE = Fibre(body_length=0.17, cap_curvature=50.0, cap_length=0.03, gauge_length=2.4e-3)
RATE = 75.0  # Hz
TUNED_ON = "pulse_150_1200ms"  # sets the windows of the methods without a model
REST = (0.0, 0.2)  # s, before anything happens
CASES = (
    "pulse_60", "pulse_119", "pulse_180", "pulse_240", "pulse_119_short", "pulse_90_1000ms", "pulse_210_2000ms",
)  # fmt: skip


def model(name: str) -> Model:
    """Return the model of an actuator."""
    return load_model(Path(__file__).parents[1] / "examples" / "state" / f"model_{name}.json")


def seen_body(case: Scenario, name: str) -> tuple[xr.Dataset, xr.Dataset]:
    """Return the body as the fibre measures a scenario, and the truth."""
    virtual = generate(case, name, 1)
    return body_of_fibre(virtual.recording, FIBRE)[0], virtual.truth


def lowpass(angle: Array, cutoff: float | None) -> Array:
    """Return differences behind a Butterworth low-pass filter of second order; None: without filter."""
    raw = np.diff(angle, axis=0, prepend=angle[:1]) * RATE
    return raw if cutoff is None else np.asarray(lfilter(*butter(2, cutoff / (0.5 * RATE)), raw, axis=0))


def causal_polynomial(angle: Array, window: int, order: int) -> Array:
    """Return the slope at the last of `window` frames of the polynomial that fits them best."""
    taps = savgol_coeffs(window, order, deriv=1, delta=1.0 / RATE, pos=window - 1, use="dot")
    padded = np.concatenate([np.repeat(angle[:1], window - 1, axis=0), angle])
    return np.asarray(np.lib.stride_tricks.sliding_window_view(padded, window, axis=0) @ taps)


def constant_acceleration(angle: Array, jerk: float) -> Array:
    """Return rates of a Kalman filter of angle, rate and acceleration; `jerk`: density over the angles' variance."""
    h = 1.0 / RATE
    F = np.array([[1.0, h, 0.5 * h * h], [0.0, 1.0, h], [0.0, 0.0, 1.0]])
    Q = jerk * np.array([[h**5 / 20, h**4 / 8, h**3 / 6], [h**4 / 8, h**3 / 3, h * h / 2], [h**3 / 6, h * h / 2, h]])
    P, x = np.diag([1.0, 1e4, 1e8]), np.zeros((3, angle.shape[1]))
    x[0] = angle[0]
    out = np.empty_like(angle)
    for k, row in enumerate(angle):
        if k:
            x, P = F @ x, F @ P @ F.T + Q
        gain = P[:, 0] / (P[0, 0] + 1.0)
        x = x + np.outer(gain, row - x[0])
        P = P - np.outer(gain, P[0])
        out[k] = x[1]
    return out


def centred_polynomial(angle: Array, window: int, order: int) -> Array:
    """Return the slope in the middle of a symmetric window (Savitzky and Golay)."""
    return np.asarray(savgol_filter(angle, window, order, deriv=1, delta=1.0 / RATE, axis=0, mode="nearest"))


CAUSAL = [
    [partial(lowpass, cutoff=f) for f in (None, 8.0, 12.0, 16.0, 20.0, 30.0)],
    [partial(causal_polynomial, window=w, order=o) for o in (1, 2, 3) for w in range(o + 1, 22)],
    [partial(constant_acceleration, jerk=10.0**e) for e in np.arange(6.0, 16.1, 0.5)],
]
CENTRED = [[partial(centred_polynomial, window=w, order=o) for o in (2, 4) for w in range(o + 1, 32, 2) if w % 2]]


def rms(rates: Array, truth: Array) -> float:
    """Return the root mean square error after the first 20 frames, rad/s."""
    return float(np.sqrt(np.mean((rates - truth)[20:] ** 2)))


def recorded(case: Scenario, chain: Model, name: str) -> tuple[xr.Dataset, Array, Array]:
    """Return the recording of a scenario, its link angles without gaps, and the true rates of the chain on the rod."""
    rod, lab = actuator(name), Laboratory()
    motion, times = run_rod(case, rod, lab), np.arange(0.0, case.duration - 5e-4, 1 / RATE)
    body = body_of_fibre(record(motion, rod, lab, times, seed=1, attrs={"scenario": case.name}), FIBRE)[0]
    angle = measurement_of(body, chain, NOISE).value
    for column in angle.T:
        gap = np.isnan(column)
        column[gap] = np.interp(np.flatnonzero(gap), np.flatnonzero(~gap), column[~gap])
    nodes = chain.base_length + np.append(0.0, np.cumsum(chain.link_length))
    return body, angle, joint_rates(motion, nodes, times)


def rates(name: str) -> dict[str, object]:
    """Return ranges over the pulses: errors of the best method without a model over pliant's, and innovations."""
    chain, rows = model(name), []
    _, angle, truth = recorded(scenario(TUNED_ON), chain, name)
    causal, centred = (
        [min(kind, key=lambda method: rms(method(angle), truth)) for kind in kinds] for kinds in (CAUSAL, CENTRED)
    )
    for case in map(scenario, CASES):
        body, angle, truth = recorded(case, chain, name)
        result = estimate(body, chain, noise=NOISE, latency=LATENCY[name])
        rows.append((
            min(rms(method(angle), truth) for method in causal) / rms(result.joint_rate.values, truth),
            min(rms(method(angle), truth) for method in centred) / rms(result.smooth_joint_rate.values, truth),
            result.attrs["nis_ratio"], result.attrs["innovation_correlation"],
        ))  # fmt: skip
    names = ("filter, against the best causal method", "smoother, against a centred polynomial",
             "normalised innovation", "its correlation")  # fmt: skip
    return {n: f"{min(v):.2f} to {max(v):.2f}" for n, v in zip(names, zip(*rows, strict=True), strict=True)}


def frame_time(steps: int = 3) -> dict[str, object]:
    """Return the time of a compiled frame of so many model steps, with and without hysteresis."""
    found = []
    for chain in (model("a"), model("a").with_(memory=type(model("a").memory)())):
        n, rows = chain.n, np.array([(observation.JOINT, i, 0.0, 0.0) for i in range(chain.n)])
        workspace, P, rest = make_workspace(chain, NOISE.states(chain), n), NOISE.initial(chain), np.zeros(n)
        start = mechanics_of(chain).coordinates(rest)
        begin = FilterState(start, np.zeros(n), np.zeros(n), P, state.relaxed(chain, rest))
        noise = FilterNoise(*NOISE.densities(chain), np.zeros(1))
        frame = frame_of(chain, rows, chain.rest_angle.copy(), np.full(n, NOISE.angle**2))
        many: Callable[..., None] = twin(kalman_loops.many_frames, n)
        call = begin, chain_of(chain), Prediction(steps, 1.0 / RATE / steps, np.full(n, 0.05), noise), frame, workspace
        many(1, *call)
        spent = in_turn([partial(many, 50, *call)], 200) / 50
        found.append(round(1e6 * float(np.median(spent)), 1))
    return {"a frame, with / without hysteresis (µs)": tuple(found)}


if __name__ == "__main__":
    cases = [Case(name, partial(rates, name)) for name in "abc"]
    measured(__doc__, {"state": cases, "frame": [Case("frame of the filter", frame_time)]})
