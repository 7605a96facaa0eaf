"""Judging and aligning a recording takes less than three times the memory that the recording itself takes."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest

from pliant.preprocessing.align import align
from pliant.preprocessing.clusters import assemble
from pliant.preprocessing.quality import quality
from pliant.recording import make_recording


@pytest.fixture(scope="module", params=[False, True], ids=["with pressure", "with drop-outs"])
def dense(request):
    """2000 frames of 64 points of a body that bends after a second of rest."""
    t, s = np.arange(2000) / 250, np.linspace(1e-4, 0.17, 64)
    kappa = 8 * np.clip(t - 1, 0, 1)[:, None] + 1e-4
    noise = np.random.default_rng(3)
    points = np.stack([(np.cos(kappa * s) - 1) / kappa, np.sin(kappa * s) / kappa, 0 * kappa * s], axis=2)
    points += 1e-5 * noise.standard_normal(points.shape)
    if request.param:
        points[noise.random(points.shape[:2]) < 0.01] = np.nan
        return make_recording(t, points)
    return make_recording(t, points, pressure=1e4 * kappa[:, 0], pressure_time=t)


@pytest.mark.parametrize("step", [quality, align])
def test_less_than_three_times_the_recording(step, dense):
    step(dense.isel(time=slice(0, 500)))  # what is imported on the way does not count
    tracemalloc.start()
    try:
        step(dense)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 3 * dense["position"].nbytes


def test_clusters_take_less_than_three_times_the_markers():
    place = np.random.default_rng(4).normal(0, 0.02, (6, 4, 3))
    points = place.reshape(24, 3) + 1e-5 * np.random.default_rng(5).standard_normal((1500, 24, 3))
    markers = [f"{k}.{i}" for k in range(6) for i in range(4)]
    ds = make_recording(np.arange(1500) / 100, points, station=markers)
    groups = {f"s{k}": [f"{k}.*"] for k in range(6)}
    assemble(ds.isel(time=slice(0, 20)), groups)
    tracemalloc.start()
    try:
        assemble(ds, groups)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 3 * ds["position"].nbytes
