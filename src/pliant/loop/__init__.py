"""The loop: sources, sinks, clocks, watchdog and log; the receiver at the valve."""

from pliant.loop.clock import SystemClock, Timing, VirtualClock
from pliant.loop.log import LoopLog, read_log
from pliant.loop.network import UdpSink, UdpSource, ZmqSink, ZmqSource
from pliant.loop.playback import Playback
from pliant.loop.receiver import ValveReceiver
from pliant.loop.run import COLUMNS, ControlLoop, log_columns
from pliant.loop.sample import Sample, Sink, Source, connection, sample
from pliant.loop.virtual import VirtualActuator
from pliant.loop.watchdog import Bounds, Watchdog

__all__ = [
    "COLUMNS", "Bounds", "ControlLoop", "LoopLog", "Playback", "Sample", "Sink", "Source", "SystemClock", "Timing",
    "UdpSink", "UdpSource", "ValveReceiver", "VirtualActuator", "VirtualClock", "Watchdog", "ZmqSink", "ZmqSource",
    "connection", "log_columns", "read_log", "sample",
]
