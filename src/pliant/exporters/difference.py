"""Distance between the tips of an original model and of its exported version under the same reference inputs."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from pliant.errors import SimulationError
from pliant.model import Model
from pliant.shapes import Float
from pliant.simulation import Pulse, simulate
from pliant.simulation.state import equilibrium, first_alone, typical_pressure
from pliant.simulation.time_step import shared_step
from pliant.units import in_words

Array = np.ndarray
START, WIDTH, LONGEST = 0.1, 1.0, 10.0  # s, of a pulse: its start, and its shortest and longest width
PARTS = (1.0, 0.5, 0.125)  # of the highest level: a dead band shows at low levels, a law that saturates at high ones
SLOW = 3.0  # widths of a pulse over the time constant of what was left out
LESS, TRIES = 0.8, 30  # a level that a model cannot bear is lowered by this factor, this many times


class Difference(NamedTuple):
    """Distance between the tips of two models, the original and the exported one, under a reference input."""

    level: float  # Pa, height of the pulse; 0: both are released from joints bent by 0.1 rad
    travel: float  # m, peak displacement of the first model's tip
    largest: float  # m, largest distance between both tips
    rms: float  # m, root mean square of this distance
    unit: str = "Pa"  # unit of the pulse
    name: str = ""  # of the input, where there are several
    width: float = WIDTH  # s, of the pulse

    def to_dict(self) -> dict[str, Any]:
        """Return the largest and the RMS distance between the tips of the original and the exported model as a dict
        whose keys name the units. It also holds the reference input in words and the peak displacement of the original
        tip.
        """
        return {
            "input": self.input, "tip_travel_mm": 1e3 * self.travel, "largest_tip_difference_mm": 1e3 * self.largest,
            "rms_tip_difference_mm": 1e3 * self.rms,
        }

    @property
    def input(self) -> str:
        """Description of the reference input in words."""
        if not self.level:
            return f"release from 0.1 rad at every joint, {2.0 * self.width:g} s"
        where = f" in {self.name}" if self.name else ""
        level = in_words(self.level, self.unit)
        return f"a pulse of {level}{where} from {START:g} s for {self.width:g} s, {2.0 * self.width:g} s"

    def __str__(self) -> str:
        return (
            f"on the reference input ({self.input}) the tip differs by at most {1e3 * self.largest:.3g} mm, "
            f"{1e3 * self.rms:.3g} mm RMS, for a peak displacement of {1e3 * self.travel:.3g} mm"
        )


def difference(one: Model, other: Model, highest: Float[Array, " C"] | None = None) -> Difference:
    """Simulate two models under the same reference inputs, and return the largest distance between their tips.

    Each input in turn takes pulses while the others are 0. Their levels are `highest` [SI] (default: `default_levels`),
    lowered as far as both models can bear it, a half and an eighth of it. The pulse lasts 1 s, or three times the
    longest time constant that the second model lacks, at most 10 s. Models that no input moves are released from a bent
    shape instead.
    """
    levels = default_levels(one) if highest is None or not np.any(highest) else highest
    lost = set(slow_times(one)) - set(slow_times(other))
    width = float(f"{np.clip(SLOW * max(lost, default=0.0), WIDTH, LONGEST):.2g}")
    pulses = [(c, float(level), part) for c, level in enumerate(levels) if level > 0.0 for part in PARTS]
    each = (under_pulse(one, other, c, float(f"{part * level:.3g}"), width) for c, level, part in pulses)
    compared = [d for d in each if d is not None]
    return max(compared, key=lambda d: d.largest) if compared else released(one, other, width)


def under_pulse(one: Model, other: Model, which: int, level: float, width: float) -> Difference | None:
    """Return the difference under a pulse of at most `level` [SI] in the input `which`; None if it is beyond both
    models.
    """
    name = one.actuation.names[which] if one.actuation.count > 1 else ""
    for _ in range(TRIES):
        try:
            equilibrium(one, first_alone(one, level, which))
            tips = (tip_under(model, which, level, width) for model in (one, other))
            return of_tips(level, *tips)._replace(unit=one.actuation.units[which], name=name, width=width)
        except SimulationError:  # the law has no equilibrium there, or a link turns too fast
            level = float(f"{LESS * level:.2g}")
    return None


def tip_under(model: Model, which: int, level: float, width: float) -> Array:
    """Return the path of the tip under a pulse in the input `which`. A model that has lost this input stays at rest."""
    inputs = [Pulse(level if c == which else 0.0, START, width) for c in range(model.actuation.count)]
    return tip_path(model, width, inputs, None)


def released(one: Model, other: Model, width: float) -> Difference:
    """Return the difference of two models that are released from joints bent by 0.1 rad."""
    tips = [tip_path(m, width, [Pulse(0.0)] * m.actuation.count, np.full(m.size, 0.1)) for m in (one, other)]
    return of_tips(0.0, *tips)._replace(unit=one.actuation.units[0], width=width)


def tip_path(model: Model, width: float, inputs: list[Pulse], start: Array | None) -> Array:
    """Return the path of the tip, (T, 2) or in space (T, 3) [m], at every millisecond for twice the `width` [s]."""
    times = np.linspace(0.0, 2.0 * width, round(2e3 * width) + 1)
    step = shared_step([model])
    run = simulate(model, inputs, times=times, time_step=step, initial_angle=start, check=False)
    return np.asarray(run.tip_position.values[:, -1])


def of_tips(level: float, one: Array, other: Array) -> Difference:
    """Return the distance between the tips of two models as a `Difference`, from their tip paths (T, 2) or (T, 3) [m]
    over T time steps under a pressure pulse of height `level` [Pa].
    """
    apart = np.linalg.norm(one - other, axis=1)
    travel = np.linalg.norm(one - one[0], axis=1).max()
    return Difference(level, float(travel), float(apart.max()), float(np.sqrt(np.mean(apart**2))))


def default_levels(model: Model) -> Float[Array, " C"]:
    """Return the level (C,) [SI] up to which the controls of C inputs reach by default: twice the typical level of the
    first input of the same unit that bends the body, see `typical_pressure`.
    """
    levels: dict[str, float] = {}
    for c, unit in enumerate(model.actuation.units):
        if not levels.get(unit):
            levels[unit] = 2.0 * typical_pressure(model, c)
    return np.array([levels[unit] for unit in model.actuation.units])


def slow_times(model: Model) -> list[float]:
    """Return the time constants [s] of a model's valves, walls and creep."""
    times = [*model.memory.creep_time, *model.memory.axial_creep_time]
    for chamber in model.chambers:
        valve = chamber.valve
        times += [valve.rise_time, valve.fall_time, valve.opening_time, valve.dead_time]
        times += [valve.settle_time] * bool(valve.settle_share) + [chamber.swell_time] * bool(chamber.swell_share)
        times += [chamber.inflation_time] * bool(chamber.inflation_limit)
    return times
