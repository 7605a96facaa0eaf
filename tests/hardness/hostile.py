"""Test malicious model files and studies, free motions of random chains, faults of a real-time loop, and costs of
checks.
"""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import tempfile
import time
import warnings
from collections.abc import Callable
from itertools import count
from pathlib import Path

import numpy as np

import pliant
from pliant.actuators import chen2018
from pliant.errors import PliantError
from pliant.loop import Bounds, SystemClock, UdpSink, UdpSource, ValveReceiver, Watchdog, sample
from pliant.loop.run import streams
from pliant.loop.sample import pack, unpack
from pliant.mechanics import mechanics_of
from pliant.model import Model, load_model, save_model
from pliant.model.model import check_physical
from pliant.simulation.balance import in_play, stored_energy
from pliant.simulation.time_step import AccuracyWarning
from pliant.study import load_study

NUMBERS = (0, -0.0, -1, 1, 1e-320, 5e-324, 1e-30, 1e30, 1e150, 1e308, -1e308, 10**400, float("nan"), float("inf"), True,
           None, "1", [], {}, [[1.0]], "a" * 5000, "\0")  # fmt: skip
STUDY = """
name = "small"
seed = 1
[actuator]
length = 0.12
mass = 0.05
links = 2
stiffness = [0.5, 0.4]
[alignment.options]
tangent = [0.0, 1.0, 0.0]
[recordings.a]
file = "a.csv"
nominal_pressure = 20000
[fits.first]
train = ["a"]
parameters = { stiffness = "free", damping = { value = 1e-3, upper = 1.0 } }
"""
Result = tuple[str, str]


def judged(attempt: Callable[[], str]) -> Result:
    """Return the outcome of an attempt: its result, a refusal with one sentence, or a crash."""
    try:
        return attempt(), ""
    except PliantError as error:
        return ("crash" if "\n" in str(error) or len(str(error)) > 2000 else "refused"), str(error)
    except BaseException as error:
        return "crash", f"{type(error).__name__}: {error}"


def model_file(rng: np.random.Generator, folder: Path) -> Result:
    """Test a model file with replaced entries or flipped bits; a model that loads must have an equilibrium and modes
    and move.
    """
    path = save_model(chen2018.model(links=2), folder / "m.json")
    if rng.random() < 0.3:
        data = bytearray(path.read_bytes())
        for place in rng.integers(0, len(data), rng.integers(1, 4)):
            data[place] ^= 1 << int(rng.integers(8))
        path.write_bytes(bytes(data))
    else:
        content = json.loads(path.read_text())
        content.pop("checksum")
        for _ in range(rng.integers(1, 4)):
            _replace(content, rng)
        path.write_text(json.dumps(content))

    def attempt() -> str:
        model = load_model(path)
        shape = pliant.equilibrium(model, 1e4)
        frequency = pliant.modes(model)[0]
        step = min(1e-3, 0.05 / float(frequency[0]))
        motion = pliant.simulate(model, pliant.Step(1e4), duration=20 * step, time_step=step)
        finite = all(np.isfinite(v).all() for v in (shape, frequency, motion.tip_position.values))
        return "right" if finite else "silent"

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", AccuracyWarning)
        return judged(attempt)


def _replace(content: dict, rng: np.random.Generator) -> None:
    """Replace one entry of a model file, at any depth, by another object or another plausible number."""
    if rng.random() < 0.6:
        name = str(rng.choice(["link_length", "link_mass", "stiffness", "damping", "torque", "rest_angle", "gravity"]))
        if isinstance(content[name], list):
            content[name] = [10 ** rng.uniform(-12, 12) * rng.choice([-1, 1, 1, 1]) for _ in content[name]]
        return
    name = str(rng.choice(list(content)))
    value = NUMBERS[int(rng.integers(len(NUMBERS)))]
    inner = content[name]
    if isinstance(inner, list) and inner and rng.random() < 0.7:
        inner[int(rng.integers(len(inner)))] = value
    elif isinstance(inner, dict) and inner and rng.random() < 0.9:
        inner[str(rng.choice(list(inner)))] = value
    else:
        content[name] = value


def study(rng: np.random.Generator, folder: Path) -> Result:
    """Test a study file with damaged text, a replaced entry, or endless nesting."""
    text, kind = STUDY, rng.random()
    if kind < 0.5:
        data = bytearray(text.encode())
        for place in rng.integers(0, len(data), rng.integers(1, 4)):
            data[place] = int(rng.integers(256))
        data = data[: int(rng.integers(1, len(data)))] if rng.random() < 0.2 else data
    elif kind < 0.9:
        lines = text.split("\n")
        row = int(rng.choice([i for i, line in enumerate(lines) if " = " in line]))
        long, deep = '"' + "a" * 5000 + '"', "[" * 5000 + "]" * 5000
        value = str(rng.choice([long, deep, "nan", "inf", "-inf", "1e400", "1" + "0" * 400, "[]", "{}", "true",
                                "-1", "0", '"\\u0000"', '"?"', "1979-05-27"]))  # fmt: skip
        lines[row] = lines[row].split(" = ")[0] + " = " + value
        data = "\n".join(lines).encode()
    else:
        data = (text + f"[{'.'.join('a' * int(rng.integers(1, 3000)))}]\nb = 1\n").encode()
    path = folder / "s.toml"
    path.write_bytes(bytes(data))
    return judged(lambda: "right" if load_study(path) else "silent")


def packet(rng: np.random.Generator, _folder: Path) -> Result:
    """Test a packet with changed, missing or added bytes: the result is a sample or a refusal."""
    data = bytearray(pack(sample("shape", rng.normal(size=(5, 2)), int(rng.integers(2**62)), hold=0.02)))
    for place in rng.integers(0, min(len(data), 40), rng.integers(1, 6)):
        data[place] = int(rng.integers(256))
    data = data[: int(rng.integers(0, len(data)))] if rng.random() < 0.2 else data
    return judged(lambda: "right" if unpack(bytes(data)) else "silent")


def free_motion(rng: np.random.Generator, _folder: Path) -> Result:
    """Test the release of a random chain: no unreported gain of energy, and agreement with the reference."""
    n = int(rng.integers(1, 5))
    model = Model(
        link_length=rng.uniform(0.01, 0.08, n), link_mass=10 ** rng.uniform(-3, 0, n),
        stiffness=10 ** rng.uniform(-1, 1, n), damping=float(rng.choice([0.0, 1e-4, 1e-2])), torque=[1e-6],
        tip_mass=float(10 ** rng.uniform(-3, 0.3)), gravity=[0.0, float(rng.choice([0.0, 9.81]))],
    )
    bent = rng.uniform(-0.7, 0.7, n)

    def attempt() -> str:
        frequencies = pliant.modes(model)[0]
        step = min(1e-3, 0.1 / float(frequencies[0]))
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            motion = pliant.simulate(model, pliant.Step(0.0), duration=1.0, time_step=step, initial_angle=bent)
        told = any(issubclass(w.category, AccuracyWarning) for w in caught)
        q, dq = motion.joint_angle.values, motion.joint_rate.values
        if not np.isfinite(q).all():
            return "silent"
        if told:
            return "told"
        none = np.zeros((n, 1))
        forms = np.array([stored_energy(model, mechanics_of(model).coordinates(a), np.cumsum(b), none)
                          for a, b in zip(q, dq, strict=True)])  # fmt: skip  # worked out anew
        gained = float(np.sum(forms[-1] - forms[0]))
        if gained > 0.11 * in_play(forms.min(axis=0), forms.max(axis=0), 0.0):
            return "silent"
        if rng.random() > 0.1:
            return "right"
        same = {"times": [0.0, 0.05], "initial_angle": bent}
        fine = pliant.simulate(model, pliant.Step(0.0), **same, method="LSODA").tip_position
        short = min(step / 8, 0.01 / float(frequencies[-1]))  # the fastest mode is to keep its phase too
        mine = pliant.simulate(model, pliant.Step(0.0), **same, time_step=short).tip_position
        return "right" if abs(fine - mine).max() < 0.02 * model.length else "silent"

    return judged(attempt)


ATTEMPTS = {"model files": model_file, "studies": study, "packets": packet, "free motions": free_motion}

# ---- the loop, in real time: a child runs it, this process is the valve

CHILD = """
import sys, numpy as np
from pliant.control.contract import Pipeline
from pliant.estimation.contract import Frame, State
from pliant.loop import Bounds, ControlLoop, LoopLog, SystemClock, UdpSink, Watchdog, sample
fault, port, folder = sys.argv[1], int(sys.argv[2]), sys.argv[3]
clock, sink = SystemClock(), UdpSink(("127.0.0.1", port))
class Body:
    finished, count = False, 0
    target = error = 0.0
    saturated, chambers, fault = 0, 1, ""
    def __init__(self):
        self.queue, self.last = [], 0
    def read(self):
        now = clock.now()
        if now - self.last >= 4_000_000:
            self.last, self.count = now, self.count + 1
            self.feed(now, self.count > 250)
        return self.queue.pop(0) if self.queue else None
    def feed(self, now, bad):
        noise = 1e-9 * self.count
        shape = sample("shape", np.full((5, 2), 0.01 + noise), now)
        pressure = sample("pressure", 3e4 * (1 + noise), now)
        if self.count == 251:
            sink.write(sample("fault", 0.0, now))
        if not bad:
            self.queue += [shape, pressure]
        elif fault == "future shape, then silence":
            self.queue += [sample("shape", shape.array, now + 3600 * 10**9), pressure]
        elif fault == "future pressure, then silence":
            self.queue += [shape, sample("pressure", 3e4, now + 3600 * 10**9)]
        elif fault == "frozen shape":
            self.queue += [sample("shape", np.full((5, 2), 0.02), now), pressure]
        elif fault == "shape lost":
            self.queue += [sample("shape", np.full((5, 2), np.nan), now), pressure]
        elif fault == "shape of no points":
            self.queue += [sample("shape", np.zeros((0, 2)), now), pressure]
        elif fault == "pressure NaN, then good":
            self.queue += [shape, sample("pressure", np.nan, now - 1), pressure]
        elif fault == "pressure in volts":
            self.queue += [shape, sample("pressure", 3.0, now, "V")]
        elif fault == "pressure too high":
            self.queue += [shape, sample("pressure", 2e5, now)]
        elif fault == "silence":
            pass
        elif fault == "source raises":
            raise OSError("by design")
        else:
            self.queue += [shape, pressure]
    def measure(self, shape):
        return Frame(np.zeros((5, 4)), shape[:, 0].copy(), np.full(5, 1e-8))
    def push_pressure(self, time, pressure): pass
    def push_frame(self, *frame): pass
    def reset(self): pass
    def state(self, time):
        wrong = np.nan if fault == "estimate NaN" and self.count > 250 else 0.1
        return State(time, np.full(3, wrong), np.zeros(3), np.zeros(3), np.zeros(3), np.eye(6), fault="")
    def step(self, time, state, pressure):
        if self.count > 250 and fault == "controller raises":
            raise RuntimeError("by design")
        return np.nan if self.count > 250 and fault == "command NaN" else 3e4
body = Body()
ControlLoop([body], sink, Pipeline(body.measure, body, body), Watchdog(Bounds(1e5)), 4e-3, clock).run(60.0)
"""
INSIDE = (
    "future shape, then silence", "future pressure, then silence", "silence", "frozen shape", "shape lost",
    "shape of no points", "pressure NaN, then good", "pressure in volts", "pressure too high", "source raises",
    "estimate NaN", "controller raises", "command NaN",
)
SIGNALS = ("SIGTERM", "SIGHUP", "SIGINT", "SIGQUIT", "SIGUSR1", "SIGALRM", "SIGTSTP", "SIGSTOP", "SIGKILL", "SIGSEGV")


class Marked:
    """A source that records its commands and the time at which its fault begins."""

    def __init__(self, source: UdpSource) -> None:
        self._source, self.finished, self.at = source, False, 0.0

    def read(self):
        """Return the next command."""
        while (arrived := self._source.read()) is not None and arrived.name == "fault":
            self.at = time.perf_counter()
        return arrived


def loop_fault(fault: str) -> tuple[float, float]:
    """Return the pressure [Pa] at which a fault leaves the valve, and the time [ms] until the valve vents."""
    source, clock, seen = UdpSource(), SystemClock(), []
    marked = Marked(source)
    valve = ValveReceiver(marked, lambda p: seen.append((time.perf_counter(), p.max())), 1e5, clock)
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-c", CHILD, fault, str(source.address[1]), folder]
        child = subprocess.Popen(command, stderr=subprocess.DEVNULL, start_new_session=True)
        try:
            end = time.perf_counter() + 120
            while not (seen and seen[-1][1] > 0) and time.perf_counter() < end:
                valve.poll()
                time.sleep(5e-4)
            began = time.perf_counter()
            while time.perf_counter() < (marked.at or began + 10.0) + 1.0:
                valve.poll()
                time.sleep(5e-4)
                if fault in SIGNALS and not marked.at and time.perf_counter() > began + 0.3:
                    child.send_signal(getattr(signal, fault))
                    marked.at = time.perf_counter()
            up = [t for t, p in seen if p > 0]
            return float(seen[-1][1]), 1e3 * (up[-1] - marked.at)
        finally:
            child.kill()
            child.wait()
            source.close()


def loop_table() -> str:
    """Run every fault in real time; return the pressure at the valve and the time until it vents."""
    lines = ["", "| fault | valve left at (kPa) | vented after (ms) |", "|---|---|---|"]
    for fault in (*INSIDE, *SIGNALS):
        left, after = loop_fault(fault)
        lines.append(f"| {fault} | {left / 1e3:g} | {max(after, 0.0):.1f} |")
    return "\n".join(lines)


# ---- prices


def each(function: Callable[[], object], seconds: float = 0.5) -> float:
    """Return the least time of one call, s, over runs that together take about the given time."""
    began, calls = time.perf_counter(), 0
    while time.perf_counter() - began < 0.1:
        function()
        calls += 1
    best = np.inf
    for _ in range(max(1, round(10 * seconds))):
        began = time.perf_counter()
        for _ in range(calls):
            function()
        best = min(best, (time.perf_counter() - began) / calls)
    return float(best)


def sent_and_obeyed(key: bytes | None) -> float:
    """Return the time of one command, s, from the loop's socket to the driver of the valve."""
    source, clock = UdpSource(key=key), SystemClock(shared=True)
    sink, valve = UdpSink(source.address, key), ValveReceiver(source, lambda _p: None, 1e5, clock)

    def once() -> None:
        sink.write(sample("command", 3e4, clock.now(), hold=0.4))
        valve.poll()

    price = each(once)
    if valve.command.tolist() != [3e4]:
        raise RuntimeError("the valve did not obey")
    sink.close()
    source.close()
    return price


def prices() -> str:
    """Return the costs of the checks: microseconds per period and step, milliseconds per file."""
    import mutations

    shape, stream = np.random.default_rng(0).normal(size=(212, 2)), streams(5_000_000, -1)[0]
    numbers, dog, stepper, model = count(), Watchdog(Bounds(1e5)), pliant.Stepper(chen2018.model()), chen2018.model()
    watched = each(lambda: stepper.step(1e4))
    stepper._watch = type("Nobody", (), {"look": lambda *_: None, "total": np.zeros(3)})()
    rows = {
        "a shape of 212 points judged": each(lambda: stream.accept(_frame(shape, next(numbers)), 10**15)),
        "repeats looked at": each(lambda: dog.frozen(0, 1, 1)),
        "a command packed with its hold": each(lambda: pack(sample("command", 1.0, 1, hold=0.02))),
        "a command sent and obeyed at the valve": sent_and_obeyed(None),
        "the same under a key": sent_and_obeyed(bytes(range(32))),
        "a step whose energy is balanced": watched,
        "the same step unwatched": each(lambda: stepper.step(1e4)),
        "all numbers of a model judged": each(lambda: check_physical(model, vars(model))),
    }
    lines = ["", "| guard | us |", "|---|---|", *(f"| {name} | {1e6 * price:.2f} |" for name, price in rows.items())]
    lines += ["", "| file read whole | ms |", "|---|---|"]
    with tempfile.TemporaryDirectory() as name:
        for original in mutations.originals(Path(name)):
            path = Path(name) / f"price{original.suffix}"
            path.write_bytes(original.data)
            price = each(lambda p=path, o=original: pliant.read(p, mapping=o.mapping))
            lines.append(f"| {original.name} | {1e3 * price:.1f} |")
    return "\n".join(lines)


def _frame(shape: np.ndarray, number: int):
    return sample("shape", shape + number, number)


