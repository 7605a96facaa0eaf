"""The band in which a springpot that is fitted holds: what the recordings can show."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pliant.errors import InputError
from pliant.identification.experiment import Experiment
from pliant.identification.parameters import Parameter, shared_name

MOST_BAND = 1e6  # high over low


def band_of_springpot(parameters: Sequence[Parameter], experiments: Sequence[Experiment]) -> list[Parameter]:
    """The band in which a springpot holds, where one is among the parameters and nobody gave it; fixed."""
    names = {p.name for p in parameters}
    if not {shared_name(name) for name in names} & {"fractional_share", "fractional_order"}:
        return []
    band = springpot_band([e.time for e in experiments])
    if moving := [p.name for p in parameters if p.free and shared_name(p.name) in band]:
        raise InputError(f"parameter {moving[0]}: the band of a springpot is chosen, not fitted: give it free = false")
    told = "the recordings' lengths and rates"
    return [Parameter(name, value, free=False, source=told) for name, value in band.items() if name not in names]


def springpot_band(times: Sequence[np.ndarray]) -> dict[str, float]:
    """The band of recordings with these times [s]: from one period in the longest to half the highest frame rate."""
    low = 1.0 / max(float(np.ptp(t)) for t in times)
    high = 0.5 / min(float(np.median(np.diff(t))) for t in times)
    return {"fractional_low": low, "fractional_high": min(high, MOST_BAND * low)}
