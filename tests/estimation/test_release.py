"""A pull that ends, without a filter."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

from pliant.errors import InputError
from pliant.estimation import release_of

TIME = 0.01 * np.arange(200)


def torques(share):
    return xr.Dataset({"disturbance": (("time", "joint"), np.outer(share, [0.8, -0.4]))}, {"time": TIME})


def test_a_pull_that_fades_is_told_by_its_shares():
    told = release_of(torques(np.clip(1.0 - (TIME - 0.5) / 0.2, 0.0, 1.0)))
    np.testing.assert_allclose([told.begin, told.half, told.gone], [0.52, 0.60, 0.68], atol=0.011)
    np.testing.assert_allclose(told.held, [0.8, -0.4])
    assert told.after == 0.0


def test_a_pull_that_never_was_or_never_ends_is_refused():
    with pytest.raises(InputError, match="still held"):
        release_of(torques(np.ones(200)))
    with pytest.raises(InputError, match="still held"):
        release_of(torques(np.zeros(200)))
    with pytest.raises(InputError, match="disturbance torques"):
        release_of(torques(np.ones(200)).drop_vars("disturbance"))
