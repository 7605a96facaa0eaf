"""Frequency range of a fitted springpot and amplitude range of a fitted Payne curve, from the recordings."""

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
    """Return fixed parameters for the ends of the ranges of the springpot and Payne's curve, unless they are given."""
    names = {p.name for p in parameters}
    chosen = {"fractional": lambda: band_of_rates(experiments), "payne": lambda: band_of_swings(experiments, model)}
    found = []
    for law, band in chosen.items():
        ends = [f"{law}_low", f"{law}_high"]
        if not {shared_name(name) for name in names} & {f"{law}_{f}" for f in LAYOUTS[law][1]} - {*ends}:
            continue
        if moving := [p.name for p in parameters if p.free and shared_name(p.name) in ends]:
            raise InputError(
                f"parameter {moving[0]} bounds the range of {law}_* and cannot be fitted: give it free = false"
            )
        found += [Parameter(name, value, free=False, source="the recordings' span")
                  for name, value in zip(ends, band(), strict=True) if name not in names]
    return found


def band_of_rates(experiments: Sequence[Experiment]) -> tuple[float, float]:
    """Return the frequency range [Hz] of the recordings: one period in the longest to half the highest frame rate."""
    low = 1.0 / max(float(np.ptp(e.time)) for e in experiments)
    high = 0.5 / min(float(np.median(np.diff(e.time))) for e in experiments)
    return low, min(high, MOST_BAND * low)


def band_of_swings(experiments: Sequence[Experiment], model: Model) -> tuple[float, float]:
    """Return the range of joint amplitudes [rad] of the recordings, up to twice the joint's peak rotation.

    The peak rotation of a joint follows from the peak displacement of the tip, for a body bent evenly: the tip moves by
    half its angle times the length.
    """
    turns = [e.travel if e.without_positions else 2.0 * e.travel / model.length for e in experiments]
    joint = max(turns) / model.n
    return LEAST * joint, 2.0 * joint
