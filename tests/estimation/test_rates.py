"""Joint rates from a fibre's shape, beside what a laboratory does today: differences and a low-pass."""

from __future__ import annotations

import numpy as np
import pytest
from bodies import NOISE, fitted, laid_bare
from scipy.signal import butter, lfilter

from pliant.estimation import estimate
from pliant.estimation.measurement import measurement_of
from pliant.testbed.laboratory import Laboratory, record, run_rod
from pliant.testbed.rod import actuator
from pliant.testbed.scenarios import scenario
from pliant.testbed.truth import joint_rates

RATE = 75.0


def true_rates(motion, model, at):
    """Joint rates (T, n) of the chain whose nodes lie on the rod."""
    return joint_rates(motion, model.base_length + np.append(0.0, np.cumsum(model.link_length)), at)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "latency"), [("b", 4.317e-3), ("c", 4.673e-3)])
def test_rates_beat_differences_behind_a_low_pass(name, latency):
    """Noise tuned on actuator a; the models are those of b and c."""
    case, rod, lab, model = scenario("pulse_119"), actuator(name), Laboratory(), fitted(name)
    motion = run_rod(case, rod, lab)
    at = np.arange(0.0, case.duration - 5e-4, 1 / RATE)
    seen = laid_bare(record(motion, rod, lab, at, seed=1, attrs={"scenario": "pulse_119"}))
    truth = true_rates(motion, model, at)
    found = estimate(seen, model, noise=NOISE, latency=latency)
    angle = measurement_of(seen, model, NOISE).value
    gaps = np.isnan(angle)
    angle[gaps] = np.interp(np.flatnonzero(gaps.T.ravel()), np.flatnonzero(~gaps.T.ravel()), angle.T[~gaps.T])
    differences = np.diff(angle, axis=0, prepend=angle[:1]) * RATE
    usual = min(
        np.sqrt(np.mean((lfilter(*butter(2, cut / (0.5 * RATE)), differences, axis=0) - truth)[20:] ** 2))
        for cut in (8, 10, 15, 20, 25, 30)
    )
    ours = np.sqrt(np.mean((found.joint_rate.values - truth)[20:] ** 2))
    later = np.sqrt(np.mean((found.smooth_joint_rate.values - truth)[20:] ** 2))
    assert usual / ours > 6.0
    assert later < 0.9 * ours
    assert 0.8 < found.attrs["nis_ratio"] < 1.25
    assert abs(found.attrs["innovation_correlation"]) < 0.12
