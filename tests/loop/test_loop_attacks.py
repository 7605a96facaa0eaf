"""Whatever comes in, the valve is let go: stamps, units, sizes, frozen sensors, full disks, signals, a silent wire."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import numpy as np
import pytest
from test_loop_faults import PERIOD, Bench

from pliant.errors import InputError
from pliant.loop import LoopLog, SystemClock, UdpSink, UdpSource, ValveReceiver, VirtualClock, read_log, sample
from pliant.loop.sample import HEAD, pack, unpack

NS = round(PERIOD * 1e9)


class Fed(Bench):
    """A loop whose samples are what the test puts in."""

    def __init__(self, **options):
        super().__init__(**options)
        self.loop.sources, self.queue, self.count = [self], [], 0
        self.finished = False

    def read(self):
        return self.queue.pop(0) if self.queue else None

    def feed(self, periods, shape=True, pressure=True):
        for _ in range(periods):
            self.count += 1
            now = self.clock.now()
            if shape:
                self.queue.append(sample("shape", np.full((5, 2), 1e-2 + 1e-9 * self.count), now))
            if pressure:
                self.queue.append(sample("pressure", 3e4 + 1e-3 * self.count, now))
            self.periods(1)


def put(bench, *samples):
    bench.queue += samples


@pytest.mark.parametrize("kinds", [("shape",), ("pressure",), ("shape", "pressure")])
def test_stamps_of_the_future_do_not_keep_a_reading_fresh(kinds):
    bench = Fed()
    bench.feed(10)
    assert bench.loop.command == 3e4
    for kind in kinds:
        value = np.full((5, 2), 0.01) if kind == "shape" else 3e4
        put(bench, sample(kind, value, bench.clock.now() + 3600 * 10**9))
    bench.feed(10, *(kind not in kinds for kind in ("shape", "pressure")))
    assert bench.loop.command == 0.0
    assert "stale" in bench.loop.watchdog.fault
    counted = bench.loop.summary()
    assert sum(counted.get(f"{name}_ahead", 0) for name in ("shapes", "pressures")) == len(kinds)


def test_a_shape_of_the_future_does_not_make_good_ones_late():
    bench = Fed()
    bench.feed(5)
    put(bench, sample("shape", np.full((5, 2), 0.01), bench.clock.now() + 3600 * 10**9))
    bench.feed(50)
    assert bench.loop.shapes.late == 0
    assert bench.loop.command == 3e4


def test_a_stamp_a_little_ahead_ages_from_its_arrival():
    bench = Fed()
    bench.feed(5)
    put(bench, sample("shape", np.full((5, 2), 0.011), bench.clock.now() + 4_000_000))
    bench.feed(5, shape=False)
    assert not bench.loop.watchdog.fault
    bench.feed(2, shape=False)
    assert "stale shape" in bench.loop.watchdog.fault, "20 ms after it arrived, not after its stamp"


def test_known_units_are_converted_and_others_rejected():
    bench = Fed()
    bench.feed(3)
    now = bench.clock.now()
    put(bench, sample("shape", np.full((5, 2), 12.0), now - 1, "mm"), sample("pressure", 33.0, now - 1, "kPa"))
    bench.feed(0)
    bench.periods(1)
    assert bench.loop.pressure == pytest.approx(33e3)
    assert bench.loop._state is not None
    put(bench, sample("pressure", 33.0, now + NS, "furlong"), sample("shape", np.ones((5, 2)), now + NS, "V"))
    bench.feed(1)
    assert (bench.loop.summary()["pressures_rejected"], bench.loop.summary()["shapes_rejected"]) == (1, 1)
    assert bench.loop.pressure == pytest.approx(3e4, rel=1e-3)


@pytest.mark.parametrize("size", [(0, 2), (3,), (5, 3), (4, 2), (1, 5, 2)])
def test_shapes_of_another_size_are_no_frames(size):
    bench = Fed()
    bench.feed(5)
    frames = bench.loop.frames
    for _ in range(8):
        put(bench, sample("shape", np.zeros(size), bench.clock.now()))
        bench.feed(1, shape=False)
    assert bench.loop.frames == frames
    assert bench.loop.summary()["shapes_rejected"] == 8
    assert "stale shape" in bench.loop.watchdog.fault


def test_an_older_pressure_does_not_take_the_place_of_a_newer_one():
    bench = Fed()
    bench.feed(5)
    put(bench, sample("pressure", 9e4, bench.clock.now() - 3 * NS))
    bench.feed(1)
    assert bench.loop.pressure < 4e4
    assert bench.loop.summary()["pressures_late"] == 1


def test_a_pressure_that_is_no_number_is_seen_although_a_good_one_follows():
    bench = Fed()
    bench.feed(5)
    put(bench, sample("pressure", np.nan, bench.clock.now() - NS // 2))
    bench.feed(1)
    assert "pressure reading is nan" in bench.loop.watchdog.fault
    assert bench.loop.command == 0.0


@pytest.mark.parametrize(("kind", "most"), [("shape", 25), ("pressure", 250)])
def test_a_frozen_sensor_vents_after_as_many_readings_as_stated(kind, most):
    bench = Fed()
    bench.feed(5)
    value = np.full((5, 2), 0.02) if kind == "shape" else 3.1e4
    put_in = 0
    while put_in < most + 3:
        put_in += 1
        put(bench, sample(kind, value, bench.clock.now()))
        bench.feed(1, shape=kind != "shape", pressure=kind != "pressure")
        if bench.loop.watchdog.fault:
            break
    assert f"frozen {kind}" in bench.loop.watchdog.fault
    assert put_in == most + 2, "the first of them is none that repeats"


def test_bounds_that_are_none():
    from pliant.loop import Bounds

    with pytest.raises(InputError, match="clock_skew must not be negative"):
        Bounds(1e5, clock_skew=-1.0)


# ---- packets


@pytest.mark.parametrize("dimensions", [9, 64, 65, 255])
def test_packets_of_many_dimensions_are_rejected(dimensions):
    data = HEAD.pack(b"PLN2", 1, 0, 0, 0, dimensions) + b"\x01\0\0\0" * dimensions + bytes(8)
    with pytest.raises(InputError, match="is not a sample"):
        unpack(data)


def test_no_packet_at_all_raises_anything_else():
    rng = np.random.default_rng(9)
    whole = pack(sample("shape", np.arange(10.0).reshape(5, 2), 77, hold=0.02))
    refused = 0
    for _ in range(20_000):
        data = bytearray(whole)
        for place in rng.integers(0, 24, rng.integers(1, 5)):
            data[place] = rng.integers(0, 256)
        data = data[: rng.integers(0, len(data) + 1)] if rng.random() < 0.3 else data
        try:
            unpack(bytes(data))
        except InputError:
            refused += 1
    assert refused > 5000


def test_a_packet_says_how_long_it_holds():
    assert unpack(pack(sample("command", 3e4, 5, hold=0.02))).hold == pytest.approx(0.02)
    without = HEAD.pack(b"PLN2", 5, 0, 1, 0, 1) + b"x" + b"\x01\0\0\0" + np.array([2.0]).tobytes()
    assert unpack(without).hold == 0.0
    assert unpack(without).array.tolist() == [2.0]
    with pytest.raises(InputError, match="hold time of a sample must be"):
        pack(sample("command", 1.0, 5, hold=-1.0))


# ---- the receiver


class Wire:
    def __init__(self):
        self.queue, self.finished = [], False

    def read(self):
        return self.queue.pop(0) if self.queue else None


def receiver():
    wire, clock, valve = Wire(), VirtualClock(), []
    return wire, clock, valve, ValveReceiver(wire, lambda p: valve.extend(p.tolist()), 1e5, clock, hold=0.1)


def test_silence_vents_the_valve_within_the_time_that_the_command_holds():
    wire, clock, valve, end = receiver()
    for k in range(5):
        wire.queue.append(sample("command", 3e4, k * NS, hold=0.02))
        assert end.poll() == 3e4
        clock.sleep_until(clock.now() + NS)
    last = clock.now() - NS
    while end.poll() > 0:
        clock.sleep_until(clock.now() + 10**6)
    assert clock.now() - last == 20 * 10**6
    assert (valve[-1], end.vented) == (0.0, 1)
    wire.queue.append(sample("command", 2e4, 0, hold=0.02))  # a sender that starts anew has a younger clock
    assert end.poll() == 2e4


def test_what_is_no_command_is_counted():
    wire, _, _, end = receiver()
    wire.queue += [sample("command", 3e4, 10, hold=0.02), sample("command", 1e4, 9, hold=0.02)]
    wire.queue += [sample("command", v, 20) for v in (np.nan, -1.0, 2e5, np.inf, [])]
    wire.queue += [sample("command", 1.0, 21, "V"), sample("shape", 9.0, 22)]
    assert end.poll() == 3e4
    assert (end.late, end.rejected) == (1, 6)


def test_the_virtual_actuator_vents_when_nobody_commands():
    bench = Bench()
    bench.periods(5)
    assert bench.plant.commands[-1] == 3e4
    bench.clock.sleep_until(bench.clock.now() + 10 * NS)
    bench.arm.read()
    assert bench.plant.commands[-1] == 0.0
    assert bench.plant.commands.count(0.0) >= 4


# ---- the log


DISK = """
import resource, sys, time
from pliant.loop import LoopLog
resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))
log = LoopLog(sys.argv[1], ["time_s", "x"])
for k in range(1500):
    log.write((float(k), 1.0 / 3.0))
    time.sleep(1e-3)
log.close()
print(log.dropped, "|", log.fault)
"""


@pytest.mark.skipif(os.name != "posix", reason="no limit of a file's size")
def test_a_disk_that_takes_no_more_is_told_and_counted(tmp_path):
    path = tmp_path / "a.csv"
    done = subprocess.run([sys.executable, "-c", DISK, path], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr
    dropped, _, fault = done.stdout.partition(" | ")
    assert "lost rows" in fault
    table = read_log(path)
    assert table.attrs["cut_off"] == 0
    assert len(table) + int(dropped) == 1500


@pytest.mark.parametrize("needed", [False, True])
def test_a_log_that_stops_vents_only_where_it_is_needed(tmp_path, caplog, needed):
    log = LoopLog(tmp_path / "a.csv", ["x"])
    bench = Bench()
    bench.loop.log, bench.loop._log_needed, bench.loop._write = log, needed, lambda *_: None
    bench.periods(5)
    log.fault, log.dropped = "the log a.csv lost rows: No space left on device", 7
    bench.periods(3)
    log.close()
    assert bench.loop.command == (0.0 if needed else 3e4)
    assert caplog.text.count("lost rows") == 1
    assert bench.loop.summary()["log_rows_missing"] == 7


# ---- signals, in real time


LOOP = """
import sys, time
import numpy as np
from pliant.loop import ControlLoop, SystemClock, UdpSink
sys.path.insert(0, {folder!r})
from test_loop_faults import Bench
bench = Bench()
bench.clock = bench.loop.clock = bench.arm._clock = SystemClock()
bench.arm._done = bench.arm._start = 0
bench.loop.sink = UdpSink(("127.0.0.1", {port}))
write = bench.loop.sink.write
def both(sample):
    bench.arm.write(sample)
    write(sample)
bench.loop.sink.write = both
bench.loop.run(duration=30.0)
"""
CAUGHT = ["SIGTERM", "SIGHUP", "SIGINT", "SIGQUIT", "SIGUSR1", "SIGALRM", "SIGTSTP"]


@pytest.mark.skipif(os.name != "posix", reason="signals of another kind")
@pytest.mark.parametrize("name", [
    "SIGTERM", "SIGKILL", *(pytest.param(name, marks=pytest.mark.slow) for name in (*CAUGHT[1:], "SIGSTOP")),
])
def test_whatever_signal_ends_the_loop_the_valve_is_let_go(name):
    """A loop in another process drives a valve here; what is caught vents by its last command, the rest by silence."""
    source, valve = UdpSource(), []
    clock = SystemClock()
    end = ValveReceiver(source, lambda p: valve.extend(p.tolist()), 1e5, clock)
    folder = str(Path(__file__).parent)
    code = textwrap.dedent(LOOP).format(folder=folder, port=source.address[1])
    child = subprocess.Popen([sys.executable, "-c", code], stderr=subprocess.PIPE, start_new_session=True)
    try:
        deadline = time.monotonic() + 60
        while not (valve and valve[-1] == 3e4) and time.monotonic() < deadline:
            end.poll()
            time.sleep(1e-3)
        assert valve[-1] == 3e4
        end.vented = 0
        child.send_signal(getattr(signal, name))
        sent = time.monotonic()
        while end.poll() > 0 and time.monotonic() < sent + 5:
            time.sleep(1e-3)
        assert valve[-1] == 0.0
        assert time.monotonic() - sent < 2.0, "20 ms, and the moods of a busy machine"
        if name in CAUGHT:
            assert child.wait(20) in (130, 1, -2, 128 + getattr(signal, name))
    finally:
        child.kill()
        child.wait()
        child.stderr.close()
        source.close()


def test_udp_rejects_malformed_packets_without_raising():
    source = UdpSource()
    raw = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    sink = UdpSink(source.address)
    try:
        raw.sendto(HEAD.pack(b"PLN2", 1, 0, 0, 0, 65) + b"\x01\0\0\0" * 65 + bytes(8), source.address)
        sink.write(sample("pressure", 5e4, 7))
        got, deadline = None, time.monotonic() + 5
        while got is None and time.monotonic() < deadline:
            got = source.read()
        assert got is not None
        assert source.rejected == 1
    finally:
        raw.close()
        sink.close()
        source.close()
