"""Scenarios of the virtual laboratory: commanded pressures, obstacles and frame rates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pliant.errors import InputError

Array = np.ndarray


RIGID = 4.0e3  # N/m per 5 mm of touching body: the silicone yields before the post
SLIP_SPEED = 1.0e-3  # m/s, below which friction is viscous


@dataclass(frozen=True)
class Circle:
    """A round post; a low `stiffness` makes it a soft spring."""

    centre: tuple[float, float]  # m
    radius: float  # m
    stiffness: float = RIGID  # N/m per 5 mm of body
    friction: float = 0.3

    def row(self) -> list[float]:
        """Return seven numbers that describe the post to the compiled time loop: kind, geometry (3), stiffness,
        friction, slip speed.
        """
        return [0.0, *self.centre, self.radius, self.stiffness, self.friction, SLIP_SPEED]


@dataclass(frozen=True)
class Wall:
    """A solid half-plane ``normal . x <= offset``."""

    normal: tuple[float, float]
    offset: float  # m
    stiffness: float = RIGID
    friction: float = 0.3

    def row(self) -> list[float]:
        """Return seven numbers that describe the wall to the compiled time loop: kind, geometry (3), stiffness,
        friction, slip speed.
        """
        return [1.0, *self.normal, self.offset, self.stiffness, self.friction, SLIP_SPEED]


def obstacle_rows(obstacles: Sequence[Circle | Wall]) -> Array:
    """Return an (O, 7) array of O obstacles. A row holds kind, geometry (3 numbers), stiffness, friction coefficient
    and slip speed.

    Raises
    ------
    InputError
        When a normal is not of unit length or a radius or stiffness is not positive.
    """
    for item in obstacles:
        if isinstance(item, Wall) and abs(float(np.hypot(*item.normal)) - 1.0) > 1e-9:
            raise InputError(f"a wall's normal must have unit length, got {item.normal}")
        if item.stiffness <= 0 or item.friction < 0 or (isinstance(item, Circle) and item.radius <= 0):
            raise InputError(f"an obstacle needs radius and stiffness > 0 and friction >= 0, got {item}")
    return np.array([item.row() for item in obstacles], dtype=float).reshape(-1, 7)


@dataclass(frozen=True)
class Command:
    """A commanded gauge pressure as a function of time.

    Attributes
    ----------
    wave : "steps", "triangle", "chirp" or "multisine"
    points : pairs of (s, Pa)
        For steps: the pressure from each time on. For a triangle: its corners, joined by straight lines.
    mean, amplitude : float, Pa
        Mean and amplitude of a chirp or multisine.
    band : (float, float), Hz
        First and last frequency of a chirp or multisine.
    start, stop : float, s
        Times between which the chirp or multisine is added to `mean`; `mean` itself is held from 0.2 s on.
    """

    wave: str
    points: tuple[tuple[float, float], ...] = ()
    mean: float = 0.0
    amplitude: float = 0.0
    band: tuple[float, float] = (0.1, 15.0)
    start: float = 1.0
    stop: float = 1.0

    def __call__(self, time: Array) -> Array:
        """Return the commanded gauge pressure (T,) [Pa] at the times `time` (T,) [s]."""
        if self.wave in ("steps", "triangle"):
            times, level = np.array(self.points, dtype=float).T
            if self.wave == "triangle":
                return np.asarray(np.interp(time, times, level))
            return np.asarray(np.append(0.0, level)[np.searchsorted(times, time, side="right")])
        inside = (time >= self.start) & (time < self.stop)
        wave = self._sweep(time - self.start) if self.wave == "chirp" else self._lines(time - self.start)
        levels = np.where(time >= 0.2, self.mean, 0.0)
        return np.asarray(levels + np.where(inside, self.amplitude * wave, 0.0))

    def scaled(self, share: float) -> Command:
        """Return a copy of the command with every pressure multiplied by the factor `share`."""
        return replace(self, points=tuple((t, p * share) for t, p in self.points), mean=self.mean * share,
                       amplitude=self.amplitude * share)  # fmt: skip

    def _sweep(self, t: Array) -> Array:
        ratio = np.log(self.band[1] / self.band[0])
        span = self.stop - self.start
        return np.asarray(np.sin(2.0 * np.pi * self.band[0] * span / ratio * np.expm1(ratio * t / span)))

    def _lines(self, t: Array) -> Array:
        """Return a multisine with unit peak: equal amplitudes at odd multiples of the lowest frequency, Schroeder
        phases.
        """
        lines = np.arange(self.band[0], self.band[1], 2.0 * self.band[0])
        k = np.arange(lines.size)
        phase = -np.pi * k * (k + 1) / lines.size

        def total(at: Array) -> Array:
            return np.asarray(sum(np.cos(2.0 * np.pi * f * at + p) for f, p in zip(lines, phase, strict=True)))

        return total(t) / float(np.abs(total(np.linspace(0.0, 1.0 / self.band[0], 4001))).max())


@dataclass(frozen=True)
class Scenario:
    """One experiment: command, duration, obstacles, frame rate and time step of the rod (SI units).

    A body with several chambers applies a single command to all of them. A tuple gives one command for each chamber.
    """

    name: str
    summary: str
    duration: float
    command: Command | tuple[Command, ...]
    obstacles: tuple[Circle | Wall, ...] = ()
    gravity: tuple[float, float] = (0.0, 0.0)
    rate: float = 75.0
    time_step: float = 2.5e-4
    pushes: tuple[tuple[float, float, float], ...] = ()  # s, N, N: force on the tip, straight lines between


def pulse(level: float, width: float, *, start: float = 0.12) -> Command:
    """Return a rectangular pulse of gauge pressure `level` [Pa] that lasts `width` [s] and begins at `start` [s]."""
    return Command("steps", ((start, level), (start + width, 0.0)))


def _pulses() -> list[Scenario]:
    points = []
    for kpa in (60, 119, 180, 240):
        for suffix, width, duration in (("", 2.76, 4.5), ("_medium", 1.5, 3.5), ("_short", 0.5, 2.5)):
            text = f"{kpa} kPa for {width} s" + (", the paper's pulse" if (kpa, suffix) == (119, "") else "")
            points.append(Scenario(f"pulse_{kpa}{suffix}", text, duration, pulse(kpa * 1e3, width)))
    return points


def _ramps(corners: list[float], rate: float) -> Command:
    """Return a triangle wave through the pressures `corners` [Pa] at the slope `rate` [Pa/s], starting at 0.5 s."""
    time = 0.5 + np.append(0.0, np.cumsum(np.abs(np.diff(corners)))) / rate
    return Command("triangle", tuple(zip(time.tolist(), corners, strict=True)))


TRIANGLE = [0.0, 180e3, 0.0, 120e3, 40e3, 120e3, 0.0]
POST = Circle((-0.081, 0.117), 0.008)
WALL = Wall((1.0, 0.0), -0.085)
SPRING = Circle((-0.095, 0.110), 0.022, stiffness=40.0, friction=0.1)

PUSHES = tuple(
    corner for start, end, newton in ((0.4, 1.1, 0.5), (1.5, 2.2, -0.5), (4.2, 4.9, 0.5), (5.3, 6.0, -0.5))
    for corner in ((start, 0.0, 0.0), (start + 0.05, newton, 0.0), (end - 0.05, newton, 0.0), (end, 0.0, 0.0))
)

SCENARIOS: dict[str, Scenario] = {
    s.name: s
    for s in (
        *_pulses(),
        Scenario("step_240", "240 kPa from 0.5 s to 4 s, the paper's step", 6.0, pulse(240e3, 3.5, start=0.5)),
        Scenario("triangle", "slow triangles with a minor loop, 40 kPa/s, 25 Hz", 17.5,
                 _ramps(TRIANGLE, 40e3), rate=25.0),
        Scenario("triangle_slow", "the same triangles at 15 kPa/s", 46.0, _ramps(TRIANGLE, 15e3), rate=25.0),
        Scenario("chirp", "100 +- 40 kPa, 0.1 to 15 Hz in 18 s", 20.0,
                 Command("chirp", mean=100e3, amplitude=40e3, start=1.0, stop=19.0)),
        Scenario("multisine", "100 +- 60 kPa, odd lines of 0.1 Hz up to 8 Hz, two periods", 22.0,
                 Command("multisine", mean=100e3, amplitude=60e3, band=(0.1, 8.0), start=1.5, stop=21.5)),
        Scenario("creep_hold", "119 kPa held for 30 s, then 10 s of recovery", 41.0, pulse(119e3, 30.0, start=0.5)),
        Scenario("still", "no pressure: the noise floor", 5.0, Command("steps", ((0.0, 0.0),))),
        Scenario("known_pushes", "a thread pulls at the tip with 0.5 N, at rest and under 119 kPa", 7.4,
                 Command("steps", ((2.7, 119e3), (6.5, 0.0))), pushes=PUSHES),
        Scenario("pulse_119_hanging", "119 kPa, gravity along the rest tangent", 4.5, pulse(119e3, 2.76),
                 gravity=(0.0, 9.81)),
        Scenario("pulse_119_sideways", "119 kPa, gravity across the rest tangent", 4.5, pulse(119e3, 2.76),
                 gravity=(9.81, 0.0)),
        Scenario("pulse_119_250hz", "the paper's pulse at the fibre's full rate", 4.5, pulse(119e3, 2.76), rate=250.0),
        Scenario("contact_circle", "150 kPa against a rigid round post", 4.5, pulse(150e3, 2.76), (POST,),
                 time_step=1e-4),
        Scenario("contact_wall", "150 kPa against a rigid wall", 4.5, pulse(150e3, 2.76), (WALL,), time_step=1e-4),
        Scenario("contact_spring", "150 kPa into a soft ball: a spring at a known place", 4.5,
                 pulse(150e3, 2.76), (SPRING,), time_step=1e-4),
        Scenario("in_turn", "two chambers: 120 kPa for 1.2 s in the first, then in the second", 5.0,
                 (pulse(120e3, 1.2), pulse(120e3, 1.2, start=2.3))),
        Scenario("overlapping", "two chambers: 120 kPa in the first; 100 kPa in the second 0.7 s later", 4.5,
                 (pulse(120e3, 1.5), pulse(100e3, 1.5, start=0.82))),
    )
}  # fmt: skip


def scenario(name: str) -> Scenario:
    """Return a scenario by its name.

    Any other pulse is named ``pulse_<kPa>_<width in ms>ms``, or ``pulse_120+60_500ms`` for a body with two chambers.

    Raises
    ------
    InputError
        For an unknown name.
    """
    if name in SCENARIOS:
        return SCENARIOS[name]
    parts = name.removesuffix("ms").split("_")
    levels = parts[1].split("+") if len(parts) == 3 else []
    if name.startswith("pulse_") and name.endswith("ms") and levels and all(p.isdigit() for p in (*levels, parts[2])):
        kpa, ms = [int(level) for level in levels], int(parts[2])
        if 0 < max(kpa) <= 300 and 0 < ms <= 60_000:
            each = tuple(pulse(level * 1e3, ms / 1e3) for level in kpa)
            text = f"{' and '.join(levels)} kPa for {ms} ms"
            return Scenario(name, text, 0.12 + ms / 1e3 + 2.0, each if len(each) > 1 else each[0])
    raise InputError(
        f"unknown scenario {name!r}: use one of {', '.join(SCENARIOS)}, or pulse_<kPa>_<ms>ms up to 300 kPa, or "
        "with a pressure for each of several chambers, e.g. pulse_120+60_500ms"
    )
