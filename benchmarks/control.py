"""Measure closed control loops on the virtual actuators: one table and one figure.

    python benchmarks/control.py -o benchmarks/results/control.json --figure docs/figures/control_step

All settings were tuned on actuator a and on variants of it; b and c are run with a's model and their own rest shape.
`python benchmarks/control.py --speed` measures only the time of a frame. Settling: the true tip stays within 2 % of a
step of 25 mm; there is no settling time if the last fifth of the run is not inside. Error: mean of the last 0.4 s, of
the true and of the estimated tip. Push: 50 mN at the cap, and the error 0.5 s later. Path: a sine between 7 and 23 mm
at 1 Hz. Activity: change of the command from period to period, in the first half second and after one second. Fibre:
means over five seeds of the sensors, with observer and filter.
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path

import numpy as np

from pliant.control import Limits, SupplyValve, Task, Tuning, prepare_control
from pliant.control.rehearsal import command_activity, settling_time
from pliant.loop import Bounds, ControlLoop, VirtualActuator, VirtualClock, Watchdog
from pliant.mechanics import mechanics_of
from pliant.model import load_model
from pliant.testbed.plant import Plant

MODELS = Path(__file__).parents[1] / "examples" / "control"
VALVE = SupplyValve(9.01, 6.46, 0.765, 8.12e-3)  # of the rig, found by examples/control/identify.py
PERIOD, HIGHEST, STEP = 4e-3, 190e3, 0.025
KINDS = {
    "PI, shaped (ZVD), memory inverted": {"feedback": "pid"},
    "LQR": {"planned": False, "ramp": 0.0},
    "LQR on a planned reference": {},
    "MPC on a planned reference": {"feedback": "mpc"},
    "MPC, a tenth of the effort": {"feedback": "mpc", "tuning": Tuning(effort=0.03, damping_time=0.05)},
}
SEEDS = range(1, 6)  # of the fibre and the gauge


class Loop:
    def __init__(self, body, model, perfect, seed=1, estimator="observer", **task):
        self.plant, late = Plant(body, perfect=perfect, seed=seed), 0 if perfect else 1
        frames = np.array([self.plant.advance(0.0).shape for _ in range(50)])
        self.ready = prepare_control(
            load_model(MODELS / f"model_{model}.json"), self.plant.arc_length, frames, Task(**task), Limits(HIGHEST),
            PERIOD, late=late, supply=VALVE, estimator=estimator,
        )
        self.clock = VirtualClock()
        arm = VirtualActuator(self.plant, self.clock)
        self.loop = ControlLoop(
            [arm], arm, self.ready.pipeline, Watchdog(Bounds(1.15 * HIGHEST)), PERIOD, self.clock
        )
        self.rest, self.body, self.deadline = self.plant.tip, self.ready.body, 0
        self.still = mechanics_of(self.body).tips(self.ready.estimator.state(0.0).angle)[-1]

    def go(self, seconds):
        """Return true and estimated displacement, command, and processor time [s] of each period."""
        rows = []
        for _ in range(round(seconds / PERIOD)):
            self.clock.sleep_until(self.deadline)
            self.loop.period(self.deadline, self.deadline)
            self.deadline += round(PERIOD * 1e9)
            seen = np.linalg.norm(mechanics_of(self.body).tips(self.ready.estimator.state(0.0).angle)[-1] - self.still)
            rows.append((np.linalg.norm(self.plant.tip - self.rest), seen, *self.loop.command))
        return np.array(rows).T


def measure(body, model, kind, perfect, **how):
    run = Loop(body, model, perfect, time=[0.0], displacement=[STEP], duration=1.6, **how, **KINDS[kind])
    moved, seen, command = run.go(1.6)
    clock = np.arange(moved.size) * PERIOD
    settled = settling_time(clock, moved, STEP, STEP)
    wanted = np.where(clock < 0.5, 0.0, STEP)  # in motion for half a second, at rest from one second on
    row = {
        "actuator": body, "model": model, "controller": kind, "sensors": "perfect" if perfect else "fibre", **how,
        "settling_s": "did not settle" if settled is None else settled,
        **{f"{name}_kpa": 1e-3 * value for name, value in command_activity(clock, wanted, command).items()},
        "overshoot_percent": 100 * (moved.max() / STEP - 1),
        "highest_kpa": 1e-3 * command.max(), "error_true_mm": 1e3 * (moved[-100:].mean() - STEP),
        "error_seen_mm": 1e3 * (seen[-100:].mean() - STEP),
    }
    if perfect:
        run.plant.push(0.05)
        pushed = run.go(0.6)[0]
        row["push_largest_mm"] = 1e3 * float(np.abs(pushed - STEP).max())
        row["push_left_mm"] = 1e3 * float(np.abs(pushed[-25:] - STEP).max())
    row["fault"] = run.loop.watchdog.fault
    return row, moved, command


def quiet(body, estimator):
    """Run the loop with the fibre's errors over several seeds, and add the settling time with perfect sensors."""
    kind = "LQR on a planned reference"
    ideal = measure(body, "a", kind, perfect=True, estimator=estimator)[0]
    rows = [measure(body, "a", kind, perfect=False, seed=s, estimator=estimator) for s in SEEDS]
    rest = [moved[250:] - STEP for _, moved, _ in rows]  # from one second on
    return {
        "actuator": body, "estimator": estimator, "sensors": f"fibre, {len(rows)} seeds",
        "settling_without_noise_s": ideal["settling_s"], "overshoot_without_noise_percent": ideal["overshoot_percent"],
        **{k: float(np.mean([row[k] for row, _, _ in rows])) for k in (
            "command_change_rest_kpa", "command_change_motion_kpa", "command_sd_rest_kpa", "overshoot_percent")},
        **{k: float(np.mean([abs(row[k]) for row, _, _ in rows])) for k in ("error_seen_mm", "error_true_mm")},
        "error_true_rms_mm": 1e3 * float(np.sqrt(np.mean(np.square(rest)))),
        "tip_sd_mm": 1e3 * float(np.mean([r.std() for r in rest])),
        "fault": [row["fault"] for row, _, _ in rows if row["fault"]],
    }  # fmt: skip


def tracking(body, kind):
    clock = np.arange(0.0, 2.0, PERIOD)
    wanted = 0.015 - 0.008 * np.cos(2 * np.pi * clock) - 0.007 * np.clip(1 - clock / 0.25, 0, 1)
    run = Loop(body, "a", True, time=clock, displacement=wanted, duration=2.0, path=True, **KINDS[kind])
    moved = run.go(2.0)[0]
    return 1e3 * float(np.sqrt(np.mean((moved - wanted)[125:] ** 2)))


def spent(call, frames=1, calls=300):
    """Return the median time of a frame, us."""
    clock, took = time.perf_counter_ns, []
    for _ in range(calls):
        began = clock()
        call()
        took.append((clock() - began) / frames)
    return 1e-3 * float(np.median(took))


def speed():
    """Measure the time [us] of a frame called from Python, with observer or filter, and of the regulator's step alone.
    """
    found = {}
    for estimator in ("observer", "filter"):
        run = Loop("a", "a", True, time=[0.0], displacement=[STEP], duration=1.0, estimator=estimator)
        run.go(0.3)
        seen, control, angles = run.ready.estimator, run.ready.control, run.ready.link_angles
        points, now = run.plant.advance(0.0).shape, [0.3]

        def frame(seen=seen, control=control, angles=angles, points=points, now=now):
            now[0] += PERIOD
            seen.push_pressure(now[0], 6e4)
            seen.push_frame(now[0], *angles.frame(points))
            control.step(now[0], seen.state(now[0]), 6e4)

        found[f"{estimator}_lqr_us"] = spent(frame, calls=3000)
    known = seen.state(now[0])
    return found | {"lqr_step_us": spent(lambda: control.step(now[0], known, 6e4), calls=3000)}


def figure(traces, path):
    from pliant.plotting import new_figure, style

    kinds = ((":", 0.9, "0.45"), ("--", 0.9, "0.35"), ("-", 1.4, "0.0"), ("-.", 1.0, "0.0"), ((0, (1, 1)), 1.2, "0.2"))
    looks = dict(zip(KINDS, kinds, strict=True))
    with style():
        made, panels = new_figure(2, 3, height=3.8, sharex=True, sharey="row")
        for kind, body, moved, command in traces:
            clock, column, (line, width, grey) = np.arange(1, moved.size + 1) * PERIOD, "abc".index(body), looks[kind]
            look = {"linestyle": line, "linewidth": width, "color": grey}
            panels[0, column].plot(clock, 1e3 * moved, label=kind, **look)
            panels[1, column].step(clock - PERIOD, 1e-3 * command, where="post", **look)
        for column, body in enumerate("abc"):
            panels[0, column].axhspan(24.5, 25.5, color="0.88", zorder=0)
            panels[0, column].set(title=f"actuator {body}", xlim=(0.0, 0.7))
            panels[1, column].set(xlabel="time (s)")
        panels[0, 0].set_ylabel("true tip displacement (mm)")
        panels[1, 0].set_ylabel("command (kPa)")
        panels[0, 2].legend(loc="lower right", fontsize="x-small")
        for ending in (".png", ".svg"):
            made.savefig(path.with_suffix(ending), dpi=200)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("benchmarks/results/control.json"))
    parser.add_argument("--figure", type=Path, help="path without ending")
    parser.add_argument("--speed", action="store_true", help="only the time of a frame")
    args = parser.parse_args()
    if args.speed:
        print(json.dumps(speed(), indent=1))
        return
    rows, traces = [], []
    began = time.process_time()
    for kind in KINDS:
        for body in "abc":
            row, moved, command = measure(body, "a", kind, perfect=True)
            if body == "a" and kind != "LQR":
                row["path_rmse_mm"] = tracking(body, kind)
            rows.append(row)
            traces.append((kind, body, moved, command))
            print(json.dumps(row), flush=True)
    kind = "LQR on a planned reference"
    for body in "bc":
        rows.append(measure(body, body, kind, perfect=True)[0])
        print(json.dumps(rows[-1]), flush=True)
    for estimator in ("observer", "filter"):
        for body in "abc":
            rows.append(quiet(body, estimator))
            print(json.dumps(rows[-1]), flush=True)
    rows.append(speed())
    print(json.dumps(rows[-1]), flush=True)
    args.output.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
    print(f"{time.process_time() - began:.0f} s of processor")

    if args.figure:
        figure(traces, args.figure)


if __name__ == "__main__":
    main()
