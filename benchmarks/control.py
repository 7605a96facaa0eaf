"""Measure closed control loops on the virtual actuators a, b and c.

All settings were tuned on actuator a and on variants of it; b and c are run with a's model and their own rest shape.
Settling: the true tip stays within 2 % of a step of 25 mm. Error: mean of the last 0.4 s. Path: a sine between 7 and
23 mm at 1 Hz, on a. Estimators: LQR on a reference, with the fibre's errors, means over five seeds of the sensors.

    python benchmarks/control.py controllers --figure docs/figures/control_step
"""

from __future__ import annotations

import sys
from functools import cache, partial
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
from harness import Case, measured
from speed.timing import in_turn

from pliant.control import Limits, SupplyValve, Task, Tuning, prepare_control
from pliant.control.rehearsal import command_activity, settling_time
from pliant.loop import Bounds, ControlLoop, VirtualActuator, VirtualClock, Watchdog
from pliant.mechanics import mechanics_of
from pliant.model import load_model
from pliant.testbed.plant import Plant

Array = np.ndarray
MODELS = Path(__file__).parents[1] / "examples" / "control"
VALVE = SupplyValve(9.01, 6.46, 0.765, 8.12e-3)  # of the rig, found by examples/control/identify.py
PERIOD, HIGHEST, STEP = 4e-3, 190e3, 0.025
KINDS: dict[str, dict[str, Any]] = {
    "PI, shaped, memory inverted": {"feedback": "pid"},
    "LQR": {"planned": False, "ramp": 0.0},
    "LQR on a reference": {},
    "MPC on a reference": {"feedback": "mpc"},
    "MPC, a tenth of the effort": {"feedback": "mpc", "tuning": Tuning(effort=0.03, damping_time=0.05)},
}
SEEDS = range(1, 6)  # of the fibre and the gauge


class Loop:
    """A loop on a virtual actuator, with the model of actuator a."""

    def __init__(self, body: str, perfect: bool, seed: int = 1, estimator: str = "observer", **task: Any) -> None:
        self.plant, late = Plant(body, perfect=perfect, seed=seed), 0 if perfect else 1
        frames = np.array([self.plant.advance(0.0).shape for _ in range(50)])
        self.ready = prepare_control(
            load_model(MODELS / "model_a.json"), self.plant.arc_length, frames, Task(**task), Limits(HIGHEST), PERIOD,
            late=late, supply=VALVE, estimator=estimator,
        )  # fmt: skip
        self.clock = VirtualClock()
        arm = VirtualActuator(self.plant, self.clock)
        self.loop = ControlLoop(
            [arm], arm, self.ready.pipeline, Watchdog(Bounds(1.15 * HIGHEST)), PERIOD, self.clock
        )
        self.rest, self.deadline = self.plant.tip, 0

    def tip(self) -> Array:
        """Return the estimated tip, m."""
        return mechanics_of(self.ready.body).tips(self.ready.estimator.state(0.0).angle)[-1]

    def go(self, seconds: float) -> Array:
        """Return the true displacement [m] and the command [Pa] of each period."""
        rows = []
        for _ in range(round(seconds / PERIOD)):
            self.clock.sleep_until(self.deadline)
            self.loop.period(self.deadline, self.deadline)
            self.deadline += round(PERIOD * 1e9)
            rows.append((np.linalg.norm(self.plant.tip - self.rest), *self.loop.command))
        return np.array(rows).T


@cache
def stepped(body: str, kind: str, seed: int | None = None, estimator: str = "observer") -> tuple[Array, Array]:
    """Return displacement and command of a step; with a seed, with the errors of the fibre."""
    run = Loop(body, seed is None, seed or 1, estimator, time=[0.0], displacement=[STEP], duration=1.6, **KINDS[kind])
    return tuple(run.go(1.6))


def settled(moved: Array) -> float | str:
    """Return the settling time, s."""
    found = settling_time(np.arange(moved.size) * PERIOD, moved, STEP, STEP)
    return "not in 1.6 s" if found is None else round(found, 2)


def controller(kind: str) -> dict[str, Any]:
    """Return the row of a controller, on the actuators a / b / c with perfect sensors."""
    moved = [stepped(body, kind)[0] for body in "abc"]
    row: dict[str, Any] = {
        "2 % settling on a / b / c (s)": tuple(map(settled, moved)),
        "overshoot (%)": tuple(round(100 * (m.max() / STEP - 1)) for m in moved),
        "steady error (mm)": tuple(round(1e3 * (m[-100:].mean() - STEP), 2) for m in moved),
    }
    if kind != "LQR":
        clock = np.arange(0.0, 2.0, PERIOD)
        wanted = 0.015 - 0.008 * np.cos(2 * np.pi * clock) - 0.007 * np.clip(1 - clock / 0.25, 0, 1)
        run = Loop("a", True, time=clock, displacement=wanted, duration=2.0, path=True, **KINDS[kind])
        row["path, RMSE on a (mm)"] = 1e3 * float(np.sqrt(np.mean((run.go(2.0)[0] - wanted)[125:] ** 2)))
    return row


def estimator_row(estimator: str) -> dict[str, Any]:
    """Return the row of an estimator: noise of the command and of the tip at rest, and settling without noise."""
    kind, rows = "LQR on a reference", []
    for body in "abc":
        runs = [stepped(body, kind, seed, estimator) for seed in SEEDS]
        clock = np.arange(runs[0][0].size) * PERIOD
        wanted = np.where(clock < 0.5, 0.0, STEP)  # at rest from one second on
        sd = np.mean([command_activity(clock, wanted, command)["command_sd_rest"] for _, command in runs])
        off = np.sqrt(np.mean([np.mean((moved[250:] - STEP) ** 2) for moved, _ in runs]))
        rows.append((round(1e-3 * sd, 2), round(1e3 * off, 2), settled(stepped(body, kind, None, estimator)[0])))
    names = ("command at rest, sd (kPa)", "true tip at rest, rms (mm)", "settling (s)")
    return dict(zip(names, zip(*rows, strict=True), strict=True))


def frame_time(estimator: str) -> dict[str, Any]:
    """Return the median time of a frame called from Python, and of the regulator alone."""
    run = Loop("a", True, estimator=estimator, time=[0.0], displacement=[STEP], duration=1.0)
    run.go(0.3)
    seen, control, points, now = run.ready.estimator, run.ready.control, run.plant.advance(0.0).shape, [0.3]

    def frame() -> None:
        now[0] += PERIOD
        seen.push_pressure(now[0], 6e4)
        seen.push_frame(now[0], *run.ready.link_angles.frame(points))
        control.step(now[0], seen.state(now[0]), 6e4)

    whole = np.median(in_turn([frame], 3000, clock=perf_counter))
    known = seen.state(now[0])
    alone = np.median(in_turn([lambda: control.step(now[0], known, 6e4)], 3000, clock=perf_counter))
    return {"a frame (µs)": 1e6 * float(whole), "LQR alone (µs)": 1e6 * float(alone)}


def figure(path: Path) -> None:
    """Draw the steps of all controllers."""
    from pliant.plotting import new_figure, style

    looks = ((":", 0.9, "0.45"), ("--", 0.9, "0.35"), ("-", 1.4, "0.0"), ("-.", 1.0, "0.0"), ((0, (1, 1)), 1.2, "0.2"))
    with style():
        drawn, panels = new_figure(2, 3, height=3.8, sharex=True, sharey="row")
        for column, body in enumerate("abc"):
            for kind, (line, width, grey) in zip(KINDS, looks, strict=True):
                (moved, command), look = stepped(body, kind), {"linestyle": line, "linewidth": width, "color": grey}
                clock = np.arange(1, moved.size + 1) * PERIOD
                panels[0, column].plot(clock, 1e3 * moved, label=kind, **look)
                panels[1, column].step(clock - PERIOD, 1e-3 * command, where="post", **look)
            panels[0, column].axhspan(24.5, 25.5, color="0.88", zorder=0)
            panels[0, column].set(title=f"actuator {body}", xlim=(0.0, 0.7))
            panels[1, column].set(xlabel="time (s)")
        panels[0, 0].set_ylabel("true tip displacement (mm)")
        panels[1, 0].set_ylabel("command (kPa)")
        panels[0, 2].legend(loc="lower right", fontsize="x-small")
        for ending in (".png", ".svg"):
            drawn.savefig(path.with_suffix(ending), dpi=200)


if __name__ == "__main__":
    if "--figure" in sys.argv:
        k = sys.argv.index("--figure")
        figure(Path(sys.argv.pop(k + 1)))
        del sys.argv[k]
    measured(__doc__, {
        "controllers": [Case(kind, partial(controller, kind)) for kind in KINDS],
        "estimators": [Case(name, partial(estimator_row, name)) for name in ("observer", "filter")],
        "times": [Case(f"frame, {name}", partial(frame_time, name)) for name in ("observer", "filter")],
    })  # fmt: skip
