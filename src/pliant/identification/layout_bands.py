"""The band in which a springpot or Payne's curve that is fitted holds: what the recordings can show."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pliant.errors import InputError
from pliant.identification.experiment import Experiment
from pliant.identification.memory_parameters import LAYOUTS
from pliant.identification.parameters import Parameter, shared_name
from pliant.model import Model
from pliant.numerics.swings import LEAST

MOST_BAND = 1e6  # high over low


def bands_of_layouts(
    parameters: Sequence[Parameter], experiments: Sequence[Experiment], model: Model,
) -> list[Parameter]:
    """The bands of the laws that lay out branches, where one is among the parameters and nobody gave it; fixed."""
    names = {p.name for p in parameters}
    chosen = {"fractional": lambda: band_of_rates(experiments), "payne": lambda: band_of_swings(experiments, model)}
    found = []
    for law, band in chosen.items():
        ends = [f"{law}_low", f"{law}_high"]
        if not {shared_name(name) for name in names} & {f"{law}_{f}" for f in LAYOUTS[law][1]} - {*ends}:
            continue
        if moving := [p.name for p in parameters if p.free and shared_name(p.name) in ends]:
            raise InputError(f"parameter {moving[0]}: the band of {law}_* is chosen, not fitted: give it free = false")
        found += [Parameter(name, value, free=False, source="the recordings' span")
                  for name, value in zip(ends, band(), strict=True) if name not in names]
    return found


def band_of_rates(experiments: Sequence[Experiment]) -> tuple[float, float]:
    """From one period in the longest recording to half the highest frame rate, Hz."""
    low = 1.0 / max(float(np.ptp(e.time)) for e in experiments)
    high = 0.5 / min(float(np.median(np.diff(e.time))) for e in experiments)
    return low, min(high, MOST_BAND * low)


def band_of_swings(experiments: Sequence[Experiment], model: Model) -> tuple[float, float]:
    """Amplitudes of a joint, rad, from the smallest swings that are counted to twice its turn in the longest travel.

    As of a body bent evenly, whose end moves by half its angle times its length.
    """
    turns = [e.travel if e.without_positions else 2.0 * e.travel / model.length for e in experiments]
    joint = max(turns) / model.n
    return LEAST * joint, 2.0 * joint
