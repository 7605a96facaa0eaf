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


@pytest.mark.parametrize(("left", "released"), [(0.4, True), (0.6, False)])
def test_a_pull_is_clear_from_twice_what_is_left_at_the_end(left, released):
    noisy = torques(np.where(TIME < 0.8, 1.0, np.where(np.arange(200) % 2, left, -left)))
    if released:
        assert release_of(noisy).after == pytest.approx(left)
    else:
        with pytest.raises(InputError, match="times that at the end"):
            release_of(noisy)


def test_a_pull_that_ends_halfway_or_too_early_for_a_filter():
    steps = torques(np.where(TIME < 0.5, 1.0, np.where(TIME < 0.9, 0.5, 0.0)))
    told = release_of(steps)  # one half is not below a half
    np.testing.assert_allclose([told.begin, told.half, told.gone], [0.49, 0.90, 0.90])
    with pytest.raises(InputError, match="20 frames"):
        release_of(steps.isel(time=slice(19)))
    ends = torques(np.where(TIME < 0.5, 1.0, 0.3))
    with pytest.raises(InputError, match="does not end within the recording"):
        release_of(ends)
