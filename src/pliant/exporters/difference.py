"""Distance between the tips of an original model and of its exported version under the same reference input."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from pliant.model import Model
from pliant.simulation import Pulse, simulate
from pliant.simulation.state import typical_pressure
from pliant.units import in_words

START, WIDTH, DURATION, STEP = 0.1, 1.0, 2.0, 1e-3  # s, of the reference input and of its simulation


class Difference(NamedTuple):
    """Distance between the tips of two models, the original and the exported one, under a reference input."""

    level: float  # Pa, height of the pulse; 0: both are released from joints bent by 0.1 rad
    travel: float  # m, peak displacement of the first model's tip
    largest: float  # m, largest distance between both tips
    rms: float  # m, root mean square of this distance
    unit: str = "Pa"  # unit of the pulse

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
            return f"release from 0.1 rad at every joint, {DURATION:g} s"
        return f"a pulse of {in_words(self.level, self.unit)} from {START:g} s for {WIDTH:g} s, {DURATION:g} s"

    def __str__(self) -> str:
        return (
            f"on the reference input ({self.input}) the tip differs by at most {1e3 * self.largest:.3g} mm, "
            f"{1e3 * self.rms:.3g} mm RMS, for a peak displacement of {1e3 * self.travel:.3g} mm"
        )


def difference(one: Model, other: Model) -> Difference:
    """Simulate two models under the same reference input, and return the distance between their tips. The input is a
    pressure pulse. Models without actuation are released from a bent shape instead.
    """
    level = typical_pressure(one)
    start = None if level else np.full(one.size, 0.1)

    def tip(model: Model) -> np.ndarray:
        inputs = [Pulse(level, START, WIDTH), *[Pulse(0.0)] * (model.actuation.count - 1)]
        run = simulate(model, inputs, duration=DURATION, time_step=STEP, initial_angle=start, check=False)
        return np.asarray(run.tip_position.values[:, -1])

    return of_tips(level, tip(one), tip(other))._replace(unit=one.actuation.units[0])


def of_tips(level: float, one: np.ndarray, other: np.ndarray) -> Difference:
    """Return the distance between the tips of two models as a `Difference`, from their tip paths (T, 2) or (T, 3) [m]
    over T time steps under a pressure pulse of height `level` [Pa].
    """
    apart = np.linalg.norm(one - other, axis=1)
    travel = np.linalg.norm(one - one[0], axis=1).max()
    return Difference(level, float(travel), float(apart.max()), float(np.sqrt(np.mean(apart**2))))


