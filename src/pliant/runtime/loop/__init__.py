"""The loop: sources, sinks, clocks, watchdog and log."""

from pliant.runtime.loop.clock import SystemClock, Timing, VirtualClock
from pliant.runtime.loop.log import LoopLog, read_log
from pliant.runtime.loop.network import UdpSink, UdpSource, ZmqSink, ZmqSource
from pliant.runtime.loop.playback import Playback
from pliant.runtime.loop.run import COLUMNS, ControlLoop
from pliant.runtime.loop.sample import Sample, Sink, Source, connection, sample
from pliant.runtime.loop.virtual import VirtualActuator
from pliant.runtime.loop.watchdog import Bounds, Watchdog

__all__ = [
    "COLUMNS", "Bounds", "ControlLoop", "LoopLog", "Playback", "Sample", "Sink", "Source", "SystemClock", "Timing",
    "UdpSink", "UdpSource", "VirtualActuator", "VirtualClock", "Watchdog", "ZmqSink", "ZmqSource", "connection",
    "read_log", "sample",
]
