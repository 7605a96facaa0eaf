"""Whoever sends to the valve's port, over real sockets of this machine: the valve obeys one sender, and every vent."""

from __future__ import annotations

import socket
import struct
import threading
import time

import numpy as np
import pytest

from pliant.errors import InputError
from pliant.loop import SystemClock, UdpSink, UdpSource, ValveReceiver, VirtualClock, ZmqSink, ZmqSource, sample
from pliant.loop.keyed import ANSWER, MOST_SESSIONS, TAG, WINDOW, Sealer, Sessions, new_key, read_key
from pliant.loop.network import refuse_open_host
from pliant.loop.sample import pack

KEY, OTHER_KEY = bytes(range(32)), bytes(range(1, 33))
HOUR, MS, FOREVER = 3600 * 10**9, 10**6, 2**63 - 1  # ns
HIGHEST, LONG = 1e5, 0.4  # Pa, s


class Rig:
    """A receiver at a real port, and everything that its valve was set to."""

    def __init__(self, key=None, highest=HIGHEST):
        self.source, self.clock, self.valve = UdpSource(key=key), SystemClock(shared=True), []
        self.receiver = ValveReceiver(self.source, lambda p: self.valve.extend(p.tolist()), highest, self.clock)
        self.sinks = []

    def sender(self, key=None):
        self.sinks.append(UdpSink(self.source.address, key))
        return self.sinks[-1]

    def send(self, sink, pressure, stamp=None, hold=LONG, unit=None):
        sink.write(sample("command", pressure, self.clock.now() if stamp is None else stamp, unit, hold=hold))
        return self.receiver.poll()

    def opened(self, key, pressure=3e4):
        """A sender in force; its first packet only asks for the challenge."""
        sink = self.sender(key)
        assert self.send(sink, pressure) == 0.0
        assert self.send(sink, pressure) == pressure
        return sink

    def wait_for_vent(self):
        deadline = time.monotonic() + 10.0
        while np.any(self.receiver.poll()) and time.monotonic() < deadline:
            time.sleep(1e-3)
        assert not np.any(self.receiver.command)

    def close(self):
        self.source.close()
        for sink in self.sinks:
            sink.close()


@pytest.fixture
def rig():
    rig = Rig()
    yield rig
    rig.close()


@pytest.fixture
def keyed():
    rig = Rig(KEY)
    yield rig
    rig.close()


# ---- without a key: one sender at a time, stamps and holds within bounds


def test_a_packet_of_the_far_future_that_holds_for_ever_is_over_in_half_a_second(rig):
    """It comes to an idle valve, so that it is obeyed; it neither stops the loop's vent nor its later commands."""
    loop = rig.sender()
    assert rig.send(rig.sender(), HIGHEST, FOREVER, hold=4294.0) == HIGHEST
    assert rig.receiver.shortened == 1
    assert rig.send(loop, 0.0) == 0.0, "the vent wins"
    assert rig.send(loop, 3e4) == 0.0, "the other sender's time is not over"
    deadline = time.monotonic() + 5.0
    while rig.send(loop, 3e4) == 0.0 and time.monotonic() < deadline:
        time.sleep(1e-3)
    assert rig.receiver.command == 3e4
    assert set(rig.valve) == {HIGHEST, 0.0, 3e4}


def test_it_is_over_without_any_vent_too(rig):
    rig.send(rig.sender(), HIGHEST, FOREVER, hold=4294.0)
    rig.wait_for_vent()
    assert rig.receiver.vented == 1


@pytest.mark.parametrize("ahead", [2 * MS, HOUR, FOREVER])
def test_stamps_ahead_from_another_sender_take_nothing_over(rig, ahead):
    loop, stranger = rig.sender(), rig.sender()
    for _ in range(20):
        assert rig.send(loop, 3e4) == 3e4
        assert rig.send(stranger, 9e4, min(rig.clock.now() + ahead, FOREVER)) == 3e4
    assert (rig.receiver.foreign, rig.receiver.late, rig.receiver.ahead) == (20, 0, 0)
    assert set(rig.valve) == {3e4}


def test_a_stamp_ahead_from_the_sender_itself_does_not_block_its_later_commands(rig):
    loop = rig.sender()
    rig.send(loop, 3e4)
    assert rig.send(loop, 9e4, rig.clock.now() + HOUR) == 3e4
    assert rig.send(loop, 9e4, FOREVER) == 3e4
    assert rig.send(loop, 2e4) == 2e4
    assert (rig.receiver.ahead, rig.receiver.late) == (2, 0)


@pytest.mark.parametrize("offset", [-HOUR, HOUR])
def test_a_sender_whose_clock_is_an_hour_off_is_obeyed_and_blocks_nobody(rig, offset):
    wrong, right = rig.sender(), rig.sender()
    for k in range(20):
        assert rig.send(wrong, 1e4 + k, rig.clock.now() + offset) == 1e4 + k
    rig.wait_for_vent()
    assert rig.send(right, 2e4) == 2e4
    assert (rig.receiver.late, rig.receiver.ahead, rig.receiver.foreign) == (0, 0, 0)


@pytest.mark.parametrize("stamp", [-(2**63), 0, FOREVER])
def test_a_vent_wins_whatever_its_stamp(rig, stamp):
    loop = rig.sender()
    rig.send(loop, 3e4)
    assert rig.send(loop, 0.0, stamp) == 0.0
    assert rig.send(loop, 2e4) == 2e4, "and does not block what the sender commands next"


def test_another_senders_vent_wins_and_keeps_the_valve_vented_for_its_time(rig):
    loop, operator = rig.sender(), rig.sender()
    rig.send(loop, 3e4)
    rig.send(operator, 0.0, FOREVER, hold=0.2)
    held = 0
    deadline = time.monotonic() + 5.0
    while rig.send(loop, 3e4) == 0.0 and time.monotonic() < deadline:
        held += 1
        time.sleep(1e-3)
    assert held > 1
    assert rig.receiver.command == 3e4, "the loop is still the one sender: a vent takes nothing over"
    assert rig.send(operator, 9e4) == 3e4


@pytest.mark.parametrize("pressure", [np.nan, np.inf, -np.inf, -1.0, np.nextafter(HIGHEST, np.inf), 1e300, []])
def test_what_is_no_pressure_neither_drives_nor_prolongs(rig, pressure):
    loop = rig.sender()
    rig.send(loop, 3e4, hold=0.1)
    deadline = time.monotonic() + 5.0
    while rig.send(loop, pressure, hold=0.5) and time.monotonic() < deadline:
        time.sleep(1e-3)
    assert rig.receiver.command == 0.0, "silence vents although packets keep coming"
    assert set(rig.valve) == {3e4, 0.0}
    assert rig.receiver.rejected > 1


def test_a_limit_in_another_unit(rig):
    loop = rig.sender()
    assert rig.send(loop, 99.0, unit="kPa") == pytest.approx(99e3)
    rig.send(loop, 101.0, unit="kPa")
    rig.send(loop, 1.0, unit="V")
    assert (rig.receiver.rejected, rig.receiver.command) == (2, pytest.approx(99e3))


def test_a_command_of_another_number_of_chambers_is_none(rig):
    loop = rig.sender()
    rig.send(loop, 3e4)
    assert rig.send(loop, [3e4, 2e4]) == 3e4
    assert rig.receiver.rejected == 1
    assert all(isinstance(p, float) for p in rig.valve)
    assert rig.send(loop, [0.0, 0.0]) == 0.0, "a vent is one, for however many chambers"


def test_chambers_have_limits_of_their_own():
    rig = Rig(highest=[1e5, 5e4])
    try:
        loop = rig.sender()
        np.testing.assert_array_equal(rig.send(loop, [9e4, 4e4]), [9e4, 4e4])
        for wrong in (3e4, [9e4, 6e4], [9e4, 4e4, 1e4], [9e4, np.nan], [[9e4, 4e4], [9e4, 4e4]]):
            np.testing.assert_array_equal(rig.send(loop, wrong), [9e4, 4e4])
        assert rig.receiver.rejected == 5
        np.testing.assert_array_equal(rig.send(loop, 0.0), [0.0, 0.0])
        assert rig.receiver.command.shape == (2,)
    finally:
        rig.close()


def test_repeated_and_reordered_packets_are_late(rig):
    loop = rig.sender()
    now = rig.clock.now()
    rig.send(loop, 3e4, now)
    for stamp in (now, now - 1, now - MS):
        assert rig.send(loop, 9e4, stamp) == 3e4
    assert rig.receiver.late == 3


@pytest.mark.parametrize("data", [
    b"", b"P", b"PLN2", b"\0" * 65507, b"PLN2" + b"\xff" * 65503, pack(sample("command", 9e4, 1, hold=1.0))[:-1],
    pack(sample("command", 9e4, 1, hold=1.0)) + b"\0", struct.pack("<4sqIBBB", b"PLN2", 1, 1, 0, 0, 1) + b"\xff" * 4,
], ids=len)
def test_short_and_oversized_packets_are_counted(rig, data):
    loop = rig.sender()
    rig.send(loop, 3e4)
    loop._socket.sendto(data, rig.source.address)
    assert rig.receiver.poll() == 3e4
    assert rig.source.rejected == 1


@pytest.mark.parametrize("kind", ["garbage", "commands"])
def test_a_flood_neither_drives_the_valve_nor_keeps_it_under_pressure(rig, kind):
    """Somebody fills the port as fast as it goes: nothing but the loop's command or a vent reaches the valve."""
    loop, over = rig.sender(), threading.Event()
    rig.send(loop, 3e4, hold=0.1)
    port = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)

    def flood():
        deadline = time.monotonic() + 20.0
        while not over.is_set() and time.monotonic() < deadline:
            data = pack(sample("command", 9e4, rig.clock.now(), hold=0.5)) if kind == "commands" else b"\xff" * 200
            port.sendto(data, rig.source.address)

    thread = threading.Thread(target=flood)
    thread.start()
    try:
        for _ in range(20):
            rig.send(loop, 3e4, hold=0.1)
            time.sleep(1e-3)
        stopped = len(rig.valve)
        deadline = time.monotonic() + 5.0
        while 3e4 in rig.valve[-1:] and time.monotonic() < deadline:
            rig.receiver.poll()
        assert rig.valve[-1] != 3e4, "the loop is silent: its command ends although the port is never empty"
    finally:
        over.set()
        thread.join()
        port.close()
    assert set(rig.valve[:stopped]) <= {3e4, 0.0} if kind == "garbage" else set(rig.valve) <= {3e4, 0.0, 9e4}
    rig.wait_for_vent()
    deadline = time.monotonic() + 5.0
    while rig.send(loop, 2e4) != 2e4 and time.monotonic() < deadline:
        time.sleep(1e-3)
    assert rig.receiver.command == 2e4


def test_a_sender_that_starts_anew_waits_for_the_end_of_its_last_command(rig):
    """Its clock starts at 0 again and its port is another one."""
    before, after = rig.sender(), rig.sender()
    rig.send(before, 3e4, hold=0.2)
    assert rig.send(after, 2e4, 0) == 3e4
    rig.wait_for_vent()
    assert rig.send(after, 2e4, 2 * MS) == 2e4


# ---- clocks that drift, packets that are held back: on a clock of the test


class Wire:
    def __init__(self):
        self.queue, self.finished = [], False

    def read(self):
        return self.queue.pop(0) if self.queue else None


@pytest.mark.parametrize("rate", [1.0 - 2e-4, 1.0 + 2e-4])
def test_clocks_may_drift(rate):
    """160 s at 200 ppm are more than the hold: no command is lost, and silence vents after the hold alone."""
    wire, clock = Wire(), VirtualClock()
    end = ValveReceiver(wire, lambda _p: None, HIGHEST, clock)
    for _ in range(8_000):
        clock.sleep_until(clock.now() + 20 * MS)
        wire.queue.append(sample("command", 3e4, clock.now() * rate, hold=0.025))
        end.poll()
    assert (end.vented, end.late, end.ahead, end.command) == (0, 0, 0, 3e4)
    last = clock.now()
    while end.poll():
        clock.sleep_until(clock.now() + MS)
    assert clock.now() - last <= 25 * MS


def test_commands_held_back_more_and_more_are_stale():
    """Somebody lets the packets pass a tenth slower than they were sent: the valve does not follow the past."""
    wire, clock = Wire(), VirtualClock()
    end = ValveReceiver(wire, lambda _p: None, HIGHEST, clock)
    lag = []
    for k in range(200):
        clock.sleep_until(round(k * 4.4 * MS))
        wire.queue.append(sample("command", 3e4 + k, k * 4 * MS, hold=0.02))
        if end.poll():
            lag.append(clock.now() - 4 * MS * (round(end.command[0]) - 30_000))
        if end.vented:
            break
    assert end.vented == 1
    assert max(lag) <= 20 * MS


# ---- with a key


def test_a_key_is_needed_to_command_or_to_vent(keyed):
    loop = keyed.opened(KEY)
    for key in (None, OTHER_KEY):
        stranger = keyed.sender(key)
        for pressure in (9e4, 0.0, 9e4, 0.0):
            assert keyed.send(stranger, pressure, FOREVER) == 3e4
    assert keyed.source.rejected == 8 + 1
    assert keyed.send(loop, 2e4) == 2e4
    assert set(keyed.valve) == {0.0, 3e4, 2e4}


def test_a_source_without_a_key_reads_no_packet_under_one(rig):
    assert rig.send(rig.sender(KEY), 3e4) == 0.0
    assert rig.source.rejected == 1


class Tap:
    """A sender's socket whose packets somebody records."""

    def __init__(self, sink):
        self.socket, self.sent = sink._socket, []
        self.recv, self.close = self.socket.recv, self.socket.close
        sink._socket = self

    def sendto(self, data, address):
        self.sent.append(data)
        self.socket.sendto(data, address)


def test_recorded_packets_are_read_once(keyed):
    loop = keyed.opened(KEY)
    tap = Tap(loop)
    for k in range(5):
        keyed.send(loop, 1e4 + k)
    keyed.send(loop, 0.0)
    keyed.send(loop, 2e4)
    for thief in (tap.socket, keyed.sender()._socket):  # from its address and from another
        for data in tap.sent:
            thief.sendto(data, keyed.source.address)
            assert keyed.receiver.poll() == 2e4
    assert keyed.source._sessions.replayed == 14
    assert keyed.send(loop, 3e4) == 3e4


def test_a_recorded_session_opens_nothing_after_its_end(keyed):
    loop = keyed.opened(KEY)
    tap = Tap(loop)
    for _ in range(5):
        keyed.send(loop, 3e4)
    keyed.wait_for_vent()
    again = Rig(KEY)  # the same key, started anew
    try:
        for end in (keyed, again):
            for data in tap.sent:
                tap.socket.sendto(data, end.source.address)
                assert end.receiver.poll() == 0.0
        assert again.source.rejected == 5
    finally:
        again.close()
    deadline = time.monotonic() + 5.0
    while keyed.send(loop, 2e4) == 0.0 and time.monotonic() < deadline:
        pass
    assert keyed.receiver.command == 2e4, "the sender itself goes on in a new session"


def test_packets_held_back_until_the_valve_has_vented_are_refused(keyed):
    loop = keyed.opened(KEY)
    sent, tap = keyed.source.address, Tap(loop)
    loop._address = ("127.0.0.1", 9)  # somebody keeps them
    for _ in range(3):
        loop.write(sample("command", 9e4, keyed.clock.now(), hold=LONG))
    keyed.wait_for_vent()
    for data in tap.sent:
        tap.socket.sendto(data, sent)
        assert keyed.receiver.poll() == 0.0


def test_a_queue_of_old_commands_is_not_played(keyed):
    """The receiver's program was stopped for longer than what waited for it holds."""
    loop = keyed.opened(KEY)
    loop.write(sample("command", 5e4, keyed.clock.now(), hold=0.01))
    time.sleep(LONG + 0.1)
    assert keyed.receiver.poll() == 0.0
    assert 5e4 not in keyed.valve


def test_a_vent_that_was_overtaken_wins_once(keyed):
    loop = keyed.opened(KEY)
    tap, address = Tap(loop), keyed.source.address
    loop._address = ("127.0.0.1", 9)
    loop.write(sample("command", 0.0, keyed.clock.now(), hold=LONG))
    loop.write(sample("command", 9e4, keyed.clock.now(), hold=LONG))
    loop._address = address
    assert keyed.send(loop, 2e4) == 2e4
    vent, command = tap.sent[:2]
    tap.socket.sendto(command, address)
    assert keyed.receiver.poll() == 2e4
    assert keyed.receiver.late == 1
    tap.socket.sendto(vent, address)
    assert keyed.receiver.poll() == 0.0
    assert keyed.send(loop, 2e4) == 2e4
    tap.socket.sendto(vent, address)
    assert keyed.receiver.poll() == 2e4


def test_two_that_hold_the_key(keyed):
    """The first one commands; the second one may vent, and is let in when the first one is silent."""
    loop, second = keyed.opened(KEY), keyed.sender(KEY)
    keyed.send(second, 9e4)
    assert keyed.send(second, 9e4) == 3e4
    assert keyed.receiver.foreign == 1
    assert keyed.send(second, 0.0, hold=0.05) == 0.0
    deadline = time.monotonic() + 5.0
    while keyed.send(loop, 3e4) == 0.0 and time.monotonic() < deadline:
        pass
    assert keyed.receiver.command == 3e4
    keyed.wait_for_vent()
    assert keyed.send(second, 2e4) == 2e4


def test_no_bit_of_a_packet_can_be_changed():
    sessions, sealer = Sessions(KEY), Sealer(KEY)
    answer = sessions.open(sealer.seal(b"x" * 40)).answer
    assert not any(sealer.take_challenge(changed(answer, k)) for k in range(len(answer)))
    assert sealer.take_challenge(answer)
    data = sealer.seal(b"x" * 40)
    assert not any(sessions.open(changed(data, k)).packet for k in range(len(data)))
    assert sessions.open(data).packet == b"x" * 40
    data = sealer.seal(b"x" * 40)
    assert not any(sessions.open(changed(data, k)).packet for k in range(len(data)))
    assert not any(sessions.open(data[:k]).packet for k in range(len(data)))
    assert sessions.open(data).packet == b"x" * 40


def changed(data, k):
    return data[:k] + bytes([data[k] ^ 1]) + data[k + 1 :]


def test_a_challenge_counts_once_and_answers_what_was_asked():
    """Recorded challenges cannot lead a sender astray, and no answer is longer than what asked for it."""
    sessions, sealer, other = Sessions(KEY), Sealer(KEY), Sealer(KEY)
    asked = sealer.seal(b"x" * 40)
    answer = sessions.open(asked).answer
    assert len(answer) <= len(asked)
    assert not other.take_challenge(answer)
    assert sealer.take_challenge(answer)
    assert not sealer.take_challenge(answer)
    assert sessions.open(sealer.seal(b"y" * 40)).packet == b"y" * 40
    assert sessions.open(b"PLN3" + bytes(ANSWER.size + TAG - 5)) == (b"", b"", b""), "too short for an answer"


def test_packets_in_any_order_are_read_once_within_the_window():
    sessions, sealer = Sessions(KEY), Sealer(KEY)
    sealer.take_challenge(sessions.open(sealer.seal(b"x" * 40)).answer)
    sent = [sealer.seal(b"%040d" % k) for k in range(200)]
    order = np.random.default_rng(3).permutation(WINDOW)
    assert [sessions.open(sent[k]).packet for k in order] == [b"%040d" % k for k in order]
    assert not any(sessions.open(sent[k]).packet for k in order)
    assert sessions.open(sent[199]).packet
    assert not sessions.open(sent[199 - WINDOW]).packet
    assert sessions.open(sent[200 - WINDOW]).packet
    assert not sessions.open(sent[200 - WINDOW]).packet
    assert sessions.replayed == WINDOW + 2


def test_sessions_are_few_and_the_one_in_use_stays():
    """Only those that hold the key start any; strangers cannot keep a dead one alive."""
    sessions, loop = Sessions(KEY), Sealer(KEY)

    def starts(sealer):
        sealer.take_challenge(sessions.open(sealer.seal(b"x" * 40)).answer)
        return sessions.open(sealer.seal(b"x" * 40))

    assert starts(loop).packet
    dead = Sealer(KEY)
    starts(dead)
    for _ in range(3 * MOST_SESSIONS):
        assert starts(Sealer(KEY)).packet
        sessions.open(changed(dead.seal(b"x" * 40), 60))
        assert sessions.open(loop.seal(b"x" * 40)).packet
        assert len(sessions._sessions) <= MOST_SESSIONS
    assert not sessions.open(dead.seal(b"x" * 40)).packet


# ---- who may listen where, and keys


@pytest.mark.parametrize(("host", "sentence"), [
    ("0.0.0.0", "machines of all networks can send"), ("", "machines of all networks can send"),
    ("192.0.2.7", "other machines can reach 192.0.2.7"), ("no such host", "cannot resolve the host"),
])
def test_a_port_that_others_reach_asks_for_a_key(host, sentence):
    with pytest.raises(InputError, match=sentence):
        UdpSource((host, 0))


def test_a_key_or_a_private_link_opens_it():
    UdpSource(("0.0.0.0", 0), KEY).close()
    refuse_open_host("192.0.2.7", private_link=True)
    with pytest.raises(InputError, match="machines of all networks can send"):
        UdpSource(("0.0.0.0", 0), private_link=True)
    with pytest.raises(InputError, match=r"cannot listen at 127\.0\.0\.1:70000"):
        UdpSource(("127.0.0.1", 70000))
    with pytest.raises(InputError, match=r"other machines can reach 192\.0\.2\.7"):
        ZmqSource("tcp://192.0.2.7:5555")


@pytest.mark.parametrize("endpoint", [
    "ipc:///tmp/shape", "inproc://shape", "pgm://eth0;239.192.1.1:5555", "epgm://239.192.1.1:5555", "udp://127.0.0.1:5555",
    "ws://127.0.0.1:5555", "TCP://127.0.0.1:5555", "127.0.0.1:5555", "tcp://127.0.0.1", "tcp://:5555",
    "tcp://127.0.0.1:0", "tcp://127.0.0.1:70000", "tcp://127.0.0.1:*", "",
])  # fmt: skip
@pytest.mark.parametrize("kind", [ZmqSource, ZmqSink])
def test_zeromq_takes_tcp_alone(kind, endpoint):
    with pytest.raises(InputError, match=r"must be tcp://HOST:PORT.* other transports"):
        kind(endpoint)


def test_two_publishers_at_one_port_are_refused():
    pytest.importorskip("zmq")
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        with pytest.raises(InputError, match="cannot publish at tcp"):
            ZmqSink(f"tcp://127.0.0.1:{taken.getsockname()[1]}")


def test_keys_in_files(tmp_path):
    path = tmp_path / "valve.key"
    key = new_key(path)
    assert read_key(path) == key
    assert len(key) == 32
    with pytest.raises(InputError, match="exists already"):
        new_key(path)
    path.chmod(0o640)
    with pytest.raises(InputError, match=r"other users may read .*chmod 600"):
        read_key(path)
    path.chmod(0o600)
    for text in ("", "00" * 15, "key", "00" * 2000, "\xff"):
        path.write_text(text, encoding="latin-1")
        with pytest.raises(InputError, match=r"has no key|at least 16"):
            read_key(path)
    with pytest.raises(InputError, match="cannot read the key file"):
        read_key(tmp_path / "none")
    with pytest.raises(InputError, match="at least 16 random bytes"):
        UdpSource(key=b"short")


@pytest.mark.parametrize(("options", "sentence"), [
    ({"longest_hold": 5.1}, r"longest_hold <= 5 s"), ({"hold": 0.6}, "longest_hold"), ({"hold": 0.0}, "0 < hold"),
    ({"hold": np.nan}, "0 < hold"), ({"highest": []}, "each chamber"), ({"highest": [1e5, 0.0]}, "each chamber"),
    ({"highest": [[1e5]]}, "each chamber"), ({"highest": np.inf}, "each chamber"),
])
def test_limits_of_a_receiver(options, sentence):
    highest = options.pop("highest", HIGHEST)
    with pytest.raises(InputError, match=sentence):
        ValveReceiver(Wire(), print, highest, VirtualClock(), **options)
