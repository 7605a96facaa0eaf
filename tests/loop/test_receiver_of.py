"""The limits of the receiver at the valve, from its task file: checked when it is read, kept over a real port."""

from __future__ import annotations

import socket
import time

import numpy as np
import pytest

from pliant.control import read_task
from pliant.errors import InputError
from pliant.loop import SystemClock, UdpSink, UdpSource, VirtualClock, new_key, receiver_of, sample

TASK = "highest_kpa = 90.0\n[[setpoint]]\ntime_s = 0\ndisplacement_mm = 10\n"


def free_port():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


@pytest.fixture
def rig(tmp_path):
    """Makes a receiver of a task with these entries, a sink to it, and what its valve was set to."""
    opened = []

    def make(entries, task=TASK, key=None):
        port, valve = free_port(), []
        (tmp_path / "task.toml").write_text(f"{task}[receiver]\nport = {port}\n{entries}")
        receiver = receiver_of(tmp_path / "task.toml", lambda p: valve.extend(p.tolist()), SystemClock(shared=True))
        sink = UdpSink(("127.0.0.1", port), key)
        opened.extend((receiver._source, sink))
        return receiver, sink, valve

    yield make
    for one in opened:
        one.close()


def send(receiver, sink, pressure, hold=0.4, ahead=0):
    sink.write(sample("command", pressure, SystemClock(shared=True).now() + ahead, hold=hold))
    deadline = time.monotonic() + 0.05
    while not np.any(receiver.poll()) and time.monotonic() < deadline:
        time.sleep(1e-3)
    return receiver.command


def test_the_pressure_is_that_of_the_task_unless_the_receiver_has_its_own(rig):
    receiver, sink, valve = rig("")
    assert send(receiver, sink, 91e3) == 0.0
    assert receiver.rejected == 1
    assert send(receiver, sink, 89e3) == 89e3
    assert set(valve) == {0.0, 89e3}
    receiver, sink, _ = rig("highest_kpa = 20.0")
    assert send(receiver, sink, 21e3) == 0.0
    assert send(receiver, sink, 19e3) == 19e3


@pytest.mark.parametrize(("entries", "task"), [
    ("chambers = 3", TASK), ("highest_kpa = [90, 90, 90]", TASK), ("", TASK.replace("90.0", "[90, 90, 90]")),
])
def test_as_many_inputs_as_chambers(rig, entries, task):
    receiver, sink, _ = rig(entries, task)
    assert not np.any(send(receiver, sink, 5e3))
    assert not np.any(send(receiver, sink, np.full(2, 5e3)))
    assert receiver.rejected == 2
    assert send(receiver, sink, np.full(3, 5e3)).tolist() == [5e3] * 3


def test_holds_and_the_window_are_those_of_the_task(rig):
    receiver, sink, _ = rig("hold_ms = 30\nlongest_hold_ms = 300\nwindow_ms = 20")
    assert send(receiver, sink, 5e3, hold=3.0) == 5e3
    assert receiver.shortened == 1
    assert send(receiver, sink, 6e3, ahead=10**9) == 5e3, "a second ahead is beyond the window"
    assert receiver.ahead >= 1
    start = time.monotonic()
    while receiver.poll() and time.monotonic() < start + 5:
        time.sleep(1e-3)
    assert receiver.command == 0.0
    assert receiver.vented == 1


def test_only_senders_of_the_list_are_heard(rig):
    receiver, sink, _ = rig('senders = ["127.0.0.2"]')
    assert send(receiver, sink, 5e3) == 0.0
    assert receiver._source.rejected == 1
    receiver, sink, _ = rig('senders = ["127.0.0.2", "127.0.0.1"]')
    assert send(receiver, sink, 5e3) == 5e3


def test_the_key_lies_beside_the_task(rig, tmp_path):
    key = new_key(tmp_path / "valve.key")
    receiver, sink, _ = rig('key_file = "valve.key"', key=key)
    assert send(receiver, sink, 5e3) == 0.0  # asks for a session
    assert send(receiver, sink, 5e3) == 5e3
    receiver, sink, _ = rig('key_file = "valve.key"')
    assert send(receiver, sink, 5e3) == 0.0
    assert receiver._source.rejected == 1


@pytest.mark.parametrize(("entries", "sentence"), [
    ("longest_hold_ms = 5001", "longest_hold_ms <= 5000"), ("hold_ms = 600", "hold_ms <= longest_hold_ms"),
    ("hold_ms = 0", "must be a positive number"), ("hold_ms = inf", "larger than 1e"),
    ("window_ms = 6000", "window_ms"), ("window_ms = -1", "window_ms"), ("highest_kpa = 0", "highest_kpa"),
    ("highest_kpa = []", "highest_kpa"), ("chambers = 0", "chambers"), ("port = 0", "port"), ("port = 70000", "port"),
    ("highest_kpa = [1, 2]\nchambers = 3", "2 pressures in highest_kpa for 3 chambers"), ("held_ms = 3", "held_ms"),
    ('senders = ["everybody"]', "address of a machine"), ('senders = "127.0.0.1"', "senders"),
    ('private_link = "yes"', "true or false"),
])
def test_what_is_no_limit_is_refused_when_the_task_is_read(tmp_path, entries, sentence):
    (tmp_path / "task.toml").write_text(f"{TASK}[receiver]\n{entries}\n")
    with pytest.raises(InputError, match=sentence) as caught:
        read_task(tmp_path / "task.toml")
    assert "\n" not in str(caught.value)


def test_what_the_machine_does_not_give_is_refused(tmp_path):
    for entries, sentence in (
        ("", r"has no table \[receiver\]"), ('[receiver]\nkey_file = "none.key"', "cannot read the key file"),
        ('[receiver]\nhost = "0.0.0.0"', "give a key"), ("[receiver]\nchambers = 2", "but highest_kpa lists 3"),
    ):
        task = TASK.replace("90.0", "[90, 90, 90]") if "chambers" in entries else TASK
        (tmp_path / "task.toml").write_text(task + entries)
        with pytest.raises(InputError, match=sentence):
            receiver_of(tmp_path / "task.toml", print, VirtualClock())


def test_a_source_hears_whom_it_names():
    source = UdpSource(senders=["127.0.0.3"])
    sink = UdpSink(source.address)
    sink.write(sample("command", 1.0, 0))
    time.sleep(0.01)
    assert source.read() is None
    assert source.rejected == 1
    source.close()
    sink.close()
