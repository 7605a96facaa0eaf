"""The loop's parts, and every fault injected: the command is 0 within one period."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import textwrap
import time
from types import SimpleNamespace

import numpy as np
import pytest

from pliant import plugins
from pliant.control import Pipeline
from pliant.errors import InputError
from pliant.estimation import Frame, State
from pliant.loop import (
    COLUMNS,
    Bounds,
    ControlLoop,
    LoopLog,
    Playback,
    SystemClock,
    Timing,
    UdpSink,
    UdpSource,
    VirtualActuator,
    VirtualClock,
    Watchdog,
    ZmqSink,
    ZmqSource,
    connection,
    log_columns,
    read_log,
    sample,
)
from pliant.loop.sample import pack, unpack
from pliant.loop.task import make_plant
from pliant.recording import make_recording

PERIOD = 4e-3


class Plant:
    """A plant whose every reading can be spoiled."""

    period = PERIOD

    def __init__(self):
        self.time, self.spoil, self.commands = 0.0, {}, []

    def advance(self, command):
        self.time += self.period
        self.commands.append(command)
        noise = 1e-9 * (len(self.commands) % 7)  # a sensor that is not frozen
        shape = self.spoil.get("shape", np.full((5, 2), 0.01 + noise))
        return self.time - self.spoil.get("age", 0.0), shape, self.spoil.get("pressure", 5e4 * (1.0 + noise))


def measure(shape):
    """The x of every point."""
    return Frame(np.zeros((5, 4)), shape[:, 0].copy(), np.full(5, 1e-8))


class Estimator:
    def __init__(self):
        self.fault, self.spoil, self.rate, self.wrong, self.pushed = "", 0.0, 0.0, False, []

    def push_pressure(self, time, pressure):
        self.pushed.append(pressure)

    def push_frame(self, time, rows, values, variance):
        if self.wrong:
            raise ZeroDivisionError("by design")

    def state(self, time):
        none = np.zeros(3)
        return State(
            time, np.full(3, 0.1 + self.spoil), np.full(3, self.rate), none, none, np.eye(6), fault=self.fault
        )


class Controller:
    target = error = 0.0
    saturated, fault = 0, ""

    def __init__(self, chambers=1):
        self.answer, self.wrong, self.chambers, self.seen = 3e4, False, chambers, []

    def step(self, time, state, pressure):
        self.seen.append(pressure)
        if self.wrong:
            raise RuntimeError("by design")
        return self.answer

    def reset(self):
        pass


class Bench:
    def __init__(self, log=None, chambers=1):
        self.clock, self.plant = VirtualClock(), Plant()
        self.arm = VirtualActuator(self.plant, self.clock)
        self.estimator, self.controller = Estimator(), Controller(chambers)
        watchdog = Watchdog(Bounds(1e5, shape_age=0.02, pressure_age=0.02))
        self.loop = ControlLoop(
            [self.arm], self.arm, Pipeline(measure, self.estimator, self.controller), watchdog, PERIOD, self.clock, log
        )

    def periods(self, count):
        for _ in range(count):
            now = self.clock.now()
            self.loop.period(now, now)
            self.clock.sleep_until(now + round(PERIOD * 1e9))


def freeze_sources(bench):
    bench.loop.sources = []


def only(bench, name):
    read = bench.arm.read

    def filtered():
        while (got := read()) is not None:
            if got.name == name:
                return got
        return None

    bench.arm.read = filtered


def stall(bench, part, method):
    """Let a method of a part of the loop take a second, once."""
    owner = getattr(bench, part)
    quick = getattr(owner, method)

    def slow(*given):
        setattr(owner, method, quick)
        bench.clock.sleep_until(bench.clock.now() + 1_000_000_000)
        return quick(*given)

    setattr(owner, method, slow)


FAULTS = {
    "stale shape": (lambda b: only(b, "pressure"), 6, "stale shape"),
    "stale pressure": (lambda b: only(b, "shape"), 6, "stale pressure"),
    "both stale": (freeze_sources, 6, "stale"),
    "shape lost": (lambda b: b.plant.spoil.update(shape=np.full((5, 2), np.nan)), 6, "stale shape"),
    "pressure not a number": (lambda b: b.plant.spoil.update(pressure=np.nan), 1, "pressure reading is nan"),
    "pressure too high": (lambda b: b.plant.spoil.update(pressure=1.2e5), 1, "outside"),
    "pressure far below zero": (lambda b: b.plant.spoil.update(pressure=-9e4), 1, "outside"),
    "estimate not a number": (lambda b: setattr(b.estimator, "spoil", np.nan), 1, "estimate is not a number"),
    "turned too far": (lambda b: setattr(b.estimator, "spoil", 4.0), 1, "3 rad allowed"),
    "too fast": (lambda b: setattr(b.estimator, "rate", 1e3), 1, "100 rad/s allowed"),
    "inconsistent": (lambda b: setattr(b.estimator, "fault", "it slipped"), 1, "consistency: it slipped"),
    "estimator raises": (lambda b: setattr(b.estimator, "wrong", True), 1, "ZeroDivisionError"),
    "controller raises": (lambda b: setattr(b.controller, "wrong", True), 1, "RuntimeError"),
    "estimator stalls": (lambda b: stall(b, "estimator", "state"), 1, "the estimator took 1000.0 ms in one period"),
    "estimator stalls in an update": (
        lambda b: stall(b, "estimator", "push_frame"), 1, "sources and updating the estimator took 1000.0 ms"
    ),
    "controller stalls": (lambda b: stall(b, "controller", "step"), 1, "the controller took 1000.0 ms"),
    "sink stalls": (lambda b: stall(b, "arm", "write"), 2, "sending the command and logging took 1000.0 ms"),
    "command not a number": (lambda b: setattr(b.controller, "answer", np.nan), 1, "command is nan"),
    "command too high": (lambda b: setattr(b.controller, "answer", 2e5), 1, "is outside 0 ..."),
    "command negative": (lambda b: setattr(b.controller, "answer", -1.0), 1, "is outside 0 ..."),
}


@pytest.mark.parametrize("name", FAULTS)
def test_every_fault_vents(name):
    inject, periods, sentence = FAULTS[name]
    bench = Bench()
    bench.periods(20)
    assert bench.loop.command == 3e4
    assert not bench.loop.watchdog.fault
    inject(bench)
    vented = None
    for k in range(10):
        bench.periods(1)
        if bench.loop.command == 0.0:
            vented = k + 1
            break
    assert vented is not None
    assert vented <= periods, "a stale reading is seen in the period in which its age passes the bound, others at once"
    assert sentence in bench.loop.watchdog.fault
    bench.periods(3)
    assert bench.loop.command == 0.0, "it stays vented"
    assert bench.arm._command == 0.0, "and the valve knows"


def test_a_slow_estimator_within_the_bound_is_no_fault():
    bench = Bench()
    quick = bench.estimator.state

    def slow(time):
        bench.clock.sleep_until(bench.clock.now() + 3_000_000)
        return quick(time)

    bench.estimator.state = slow
    bench.periods(20)
    assert not bench.loop.watchdog.fault


def test_further_chambers_are_counted_and_told():
    """A controller of one chamber gets the first pressure; how many others came stands in the summary."""
    bench = Bench()
    bench.plant.spoil["pressure"] = np.array([5e4, 6e4, 7e4])
    bench.periods(5)
    assert not bench.loop.watchdog.fault
    assert {float(p) for (p,) in (*bench.controller.seen, *bench.estimator.pushed)} == {5e4}
    read = len(bench.estimator.pushed)
    told = bench.loop.summary()
    assert (told["chambers_left_out"], told["pressures_left_out"]) == (2, 2 * read)
    assert read >= 4


def test_a_controller_of_several_chambers(tmp_path):
    """Pressures and commands as arrays, each under the watchdog, each in the log; too few are a fault."""
    log = LoopLog(tmp_path / "two.csv", log_columns(3, 2))
    bench = Bench(log, chambers=2)
    bench.controller.answer = np.array([3e4, 2e4])
    bench.plant.spoil["pressure"] = np.array([5e4, 6e4])
    bench.periods(5)
    np.testing.assert_array_equal(bench.loop.command, [3e4, 2e4])
    np.testing.assert_array_equal(bench.estimator.pushed[-1], [5e4, 6e4])
    assert "pressures_left_out" not in bench.loop.summary()
    bench.plant.spoil["pressure"] = np.array([5e4, 1.2e5])
    bench.periods(1)
    assert "120.0 kPa is outside" in bench.loop.watchdog.fault
    np.testing.assert_array_equal(bench.loop.command, [0.0, 0.0])
    log.close()
    last = read_log(tmp_path / "two.csv").iloc[-2]
    assert (last["pressure_2_pa"], last["command_1_pa"], last["phi_3_rad"]) == (6e4, 3e4, 0.1)
    bench.loop.watchdog.reset()
    bench.plant.spoil["pressure"] = 5e4
    bench.periods(1)
    assert "a pressure sample has 1 chamber(s), the controller needs 2" in bench.loop.watchdog.fault


def test_a_controller_that_commands_another_number_of_chambers_vents():
    bench = Bench()
    bench.periods(5)
    bench.controller.answer = np.array([3e4, 2e4])
    bench.periods(1)
    assert "the controller returned 2 command(s) for 1 chamber(s)" in bench.loop.watchdog.fault
    assert (bench.loop.command.tolist(), bench.arm._command.tolist()) == ([0.0], [0.0])


def test_one_lost_frame_is_borne():
    bench = Bench()
    bench.periods(5)
    bench.plant.spoil["shape"] = np.full((5, 2), np.nan)
    bench.periods(2)
    del bench.plant.spoil["shape"]
    bench.periods(5)
    assert bench.loop.command == 3e4
    assert bench.loop.lost == 2


def test_late_and_doubled_frames_are_counted_and_left_out():
    bench = Bench()
    bench.periods(5)
    bench.plant.spoil["age"] = 0.006
    bench.periods(1)
    assert bench.loop.shapes.late == 1


def test_reset_after_a_fault():
    bench = Bench()
    bench.periods(3)
    bench.plant.spoil["pressure"] = np.nan
    bench.periods(1)
    bench.plant.spoil.clear()
    bench.loop.watchdog.reset()
    bench.periods(2)
    assert bench.loop.command == 3e4


def test_run_ends_vented_and_counts(tmp_path):
    log = LoopLog(tmp_path / "run.csv", [*COLUMNS, "phi_1", "phi_2", "phi_3"])
    bench = Bench(log)
    fault = bench.loop.run(duration=0.4)
    log.close()
    assert fault == ""
    assert bench.arm._command == 0.0
    summary = bench.loop.summary()
    assert (summary["periods"], summary["overruns"]) == (100, 0)
    table = read_log(tmp_path / "run.csv")
    assert len(table) == 100
    assert table["command_pa"].iloc[-1] == 3e4


def test_a_fault_of_the_controller_is_told_and_vents_when_it_lasts(tmp_path):
    """Three periods without a command of its own are named; the 26th in a row vents, and the first reason stays."""
    log = LoopLog(tmp_path / "run.csv", [*COLUMNS, "phi_1", "phi_2", "phi_3"])
    bench = Bench(log)
    bench.periods(10)
    for count, fault in ((3, "no solution"), (2, ""), (1, "no solution"), (4, "")):
        bench.controller.fault = fault
        bench.periods(count)
    assert (bench.loop.command, bench.loop.watchdog.fault) == (3e4, "")
    summary = bench.loop.summary()
    assert (summary["fault"], summary["controller_faults"]) == ("in 4 periods no solution", 4)
    assert summary["fault_time_s"] == pytest.approx(10 * PERIOD)
    bench.controller.fault = "no solution"
    bench.periods(25)
    assert bench.loop.command == 3e4
    bench.periods(1)
    log.close()
    assert bench.loop.command == 0.0
    assert bench.loop.summary()["fault"] == "in 26 periods in a row no solution"
    remarks = read_log(tmp_path / "run.csv").attrs["remarks"]
    assert [r.split(": ")[1] for r in remarks] == ["no solution"] * 3 + ["in 26 periods in a row no solution"]
    bench.loop.watchdog.reset()
    assert bench.loop.summary()["fault"] == ""


def test_rows_that_the_log_lost_are_told(tmp_path):
    log = LoopLog(tmp_path / "run.csv", [*COLUMNS, "phi_1", "phi_2", "phi_3"])
    bench = Bench(log)
    bench.periods(2)
    log.dropped = 3
    log.close()
    assert bench.loop.summary()["log_rows_missing"] == 3
    assert "lost rows: the disk fell behind" in bench.loop.summary()["log_fault"]


def test_in_real_time():
    """A quarter of a second by the machine's clock: all periods begin, on time but for the machine's moods."""
    bench = Bench()
    bench.clock = bench.loop.clock = bench.arm._clock = SystemClock()
    bench.arm._done = bench.arm._start = 0
    began = time.perf_counter()
    bench.loop.run(duration=0.25)
    assert 0.2 < time.perf_counter() - began < 2.0
    timing = bench.loop.timing
    assert timing.periods + timing.skipped >= 62
    assert timing.latest < 1e9


def test_overruns_are_counted():
    timing = Timing(4_000_000)
    timing.begin(0, 100)
    assert timing.end(100, 0, 9_000_000) == 12_000_000
    timing.begin(12_000_000, 12_000_000)
    assert timing.end(12_000_000, 12_000_000, 13_000_000) == 16_000_000
    assert (timing.overruns, timing.skipped, timing.longest) == (1, 2, 8_999_900)
    assert timing.summary()["worst_lateness_us"] == 0.1


def test_a_killed_program_keeps_its_log(tmp_path):
    path = tmp_path / "killed.csv"
    code = f"""
    import time
    from pliant.loop import LoopLog
    log = LoopLog({str(path)!r}, ["time_s", "x"])
    start = time.time()
    while True:
        log.write((time.time(), 1.0 / 3.0))
        time.sleep(0.004)
    """
    child = subprocess.Popen([sys.executable, "-c", textwrap.dedent(code)])
    try:
        deadline = time.time() + 20
        while not (path.exists() and path.stat().st_size > 2000) and time.time() < deadline:
            time.sleep(0.05)
        time.sleep(0.8)
        killed = time.time()
        os.kill(child.pid, signal.SIGKILL)
    finally:
        child.wait()
    table = read_log(path)
    assert killed - table["time_s"].iloc[-1] < 1.0
    assert (table["x"] == 1.0 / 3.0).all()


def test_a_cut_row_is_left_out_and_counted(tmp_path):
    log = LoopLog(tmp_path / "a.csv", ["a", "b"])
    log.write((1.0, 2.0))
    log.close()
    with (tmp_path / "a.csv").open("a") as file:
        file.write("3.0,")
    table = read_log(tmp_path / "a.csv")
    assert len(table) == 1
    assert table.attrs["cut_off"] == 1
    with pytest.raises(InputError, match="exists already"):
        LoopLog(tmp_path / "a.csv", ["a"])
    (tmp_path / "b.csv").write_text("time\n1\n")
    with pytest.raises(InputError, match="is not a log"):
        read_log(tmp_path / "b.csv")


def test_udp_loopback():
    source = UdpSource()
    sink = UdpSink(source.address)
    try:
        sent = sample("shape", np.arange(424.0).reshape(212, 2), 123_456_789)
        sink.write(sent)
        sink._socket.sendto(b"not a sample", source.address)
        sink.write(sample("pressure", 5e4, 7))
        got = []
        deadline = time.monotonic() + 5.0
        while len(got) < 2 and time.monotonic() < deadline:
            if (new := source.read()) is not None:
                got.append(new)
        assert [g.name for g in got] == ["shape", "pressure"]
        np.testing.assert_array_equal(got[0].array, sent.array)
        assert (got[0].time_ns, got[0].unit, source.rejected) == (123_456_789, "m", 1)
    finally:
        source.close()
        sink.close()


@pytest.mark.parametrize("data", [b"", b"PLN1", pack(sample("x", [1.0, 2.0], 1, "m"))[:-3], b"\xff" * 40])
def test_packets_that_are_none(data):
    with pytest.raises(InputError, match="is not a sample"):
        unpack(data)


def test_a_packet_too_large():
    with pytest.raises(InputError, match="fewer points"):
        pack(sample("shape", np.zeros((5000, 2)), 0))


def test_zmq_is_asked_for_by_name(monkeypatch):
    monkeypatch.setitem(sys.modules, "zmq", None)
    with pytest.raises(InputError, match="pip install"):
        ZmqSink("tcp://127.0.0.1:5999")


def test_zmq_loopback():
    pytest.importorskip("zmq", reason="the extra zmq is not installed")
    port = socket.socket()
    port.bind(("127.0.0.1", 0))
    endpoint = f"tcp://127.0.0.1:{port.getsockname()[1]}"
    port.close()
    sink, source = ZmqSink(endpoint), ZmqSource(endpoint)
    try:
        got, deadline = [], time.monotonic() + 10.0
        while len(got) < 2 and time.monotonic() < deadline:  # a publisher drops what nobody has subscribed to yet
            sink._socket.send(b"not a sample")
            sink.write(sample("shape", np.arange(424.0).reshape(212, 2), 123_456_789))
            if (new := source.read()) is not None:
                got.append(new)
            time.sleep(0.002)
        np.testing.assert_array_equal(got[0].array, np.arange(424.0).reshape(212, 2))
        assert (got[0].time_ns, got[0].unit) == (123_456_789, "m")
        assert source.rejected >= 1
    finally:
        source.close()
        sink.close()


def test_a_plant_of_another_package(monkeypatch):
    """An entry point of the group pliant.plants is found by its name."""
    monkeypatch.setitem(sys.modules, "their_package", SimpleNamespace(Plant=Plant))
    plants = {"pliant.plants": {"bench": "their_package:Plant"}}
    monkeypatch.setattr(plugins, "installed", lambda group: plants.get(group, {}))
    assert make_plant("bench").period == PERIOD
    with pytest.raises(InputError, match="unknown plant 'other': use one of bench"):
        make_plant("other")


def test_unknown_connection():
    with pytest.raises(InputError, match="unknown source 'nonesuch': no installed package offers one"):
        connection("source", "nonesuch")


def test_playback_at_its_rate():
    time_s = 2.0 + np.arange(5) * 0.1
    position = np.arange(20.0).reshape(5, 2, 2) * 1e-3
    recording = make_recording(
        time_s, position, station=["mid", "tip"], pressure=np.full(10, 3e4), pressure_time=2.0 + np.arange(10) * 0.05,
        source="test", source_format="test", history="made", attrs={"frame": "planar"},
    )
    clock = VirtualClock()
    play = Playback(recording, clock)
    names = []
    while not play.finished:
        while (got := play.read()) is not None:
            assert got.time_ns <= clock.now()
            names.append(got.name)
        clock.sleep_until(clock.now() + 10_000_000)
    assert (names.count("shape"), names.count("pressure")) == (5, 10)
    assert clock.now() >= 450_000_000


def test_a_playback_sends_recorded_tensions_in_newtons():
    time_s = np.arange(5) * 0.1
    pulls = np.stack([np.arange(5.0), 2.0 * np.arange(5)], axis=1)
    position = np.arange(15.0).reshape(5, 1, 3) * 1e-3
    given = {"station": ["tip"], "frame": "spatial", "input_time": time_s, "input_names": ["a", "b"]}
    recording = make_recording(time_s, position, actuation=pulls, input_kind=["tension", "tension"], **given)
    clock = VirtualClock()
    play = Playback(recording, clock)
    clock.sleep_until(1_000_000_000)
    sent = []
    while not play.finished:
        sent.append(play.read())
    readings = [one for one in sent if one.name == "pressure"]
    assert {one.unit for one in readings} == {"N"}
    np.testing.assert_array_equal([one.array for one in readings], pulls)
    assert {one.unit for one in sent if one.name == "shape"} == {"m"}
    mixed = make_recording(time_s, position, actuation=pulls, input_kind=["tension", "angle"], **given)
    with pytest.raises(InputError, match="sends inputs of one unit, and this recording has N, rad: drop actuation"):
        Playback(mixed, clock)
