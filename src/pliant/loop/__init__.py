"""The control loop in real time: sensor readings come in, commands go out, and a watchdog vents after a fault."""

from pliant.loop.clock import SystemClock, Timing, VirtualClock
from pliant.loop.keyed import new_key, read_key
from pliant.loop.log import LoopLog, read_log
from pliant.loop.network import UdpSink, UdpSource, ZmqSink, ZmqSource
from pliant.loop.receiver import ValveReceiver, receiver_of
from pliant.loop.run import COLUMNS, ControlLoop, log_columns
from pliant.loop.sample import Sample, Sender, Sink, Source, connection, sample
from pliant.loop.virtual import Playback, VirtualActuator
from pliant.loop.watchdog import Bounds, Watchdog

__all__ = [
    "COLUMNS", "Bounds", "ControlLoop", "LoopLog", "Playback", "Sample", "Sender", "Sink", "Source", "SystemClock",
    "Timing", "UdpSink", "UdpSource", "ValveReceiver", "VirtualActuator", "VirtualClock", "Watchdog", "ZmqSink",
    "ZmqSource", "connection", "log_columns", "new_key", "read_key", "read_log", "receiver_of",
    "sample",
]
