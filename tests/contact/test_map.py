"""Maps: what was touched is solid, what was swept is free, the rest undecided; the touched circle lies where it is."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

from pliant.contact import map_contacts
from pliant.contact.occupancy_map import ProbingContacts, fused, save_map
from pliant.errors import InputError

CENTRE, RADIUS = np.array([-0.08, 0.12]), 0.03


def poke(rng, sd=3e-4, toward=0.0, stiffness=None):
    """A straight body that comes down on a circle from above, and the points where it touches."""
    angle = np.pi / 2 + toward + np.linspace(-0.3, 0.3, 12)
    normal = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    point = CENTRE + RADIUS * normal + sd * rng.standard_normal((12, 2))
    height = np.linspace(0.22, 0.152, 30)
    curve = np.stack([np.stack([np.linspace(-0.12, -0.02, 25), np.full(25, y)], axis=1) for y in height])
    force = np.full(12, 0.5)
    if stiffness:
        depth = np.linspace(0, 3e-3, 12)
        normal = np.tile([0.0, 1.0], (12, 1))
        point = CENTRE + np.array([0.0, RADIUS]) - depth[:, None] * normal
        force = 0.1 + stiffness * depth + 0.002 * rng.standard_normal(12)
    return ProbingContacts(curve, point, normal, np.full(12, sd), force)


def test_touched_is_solid_swept_is_free_the_rest_undecided(rng):
    chart = map_contacts([poke(rng)])
    at = lambda x, y: float(chart.probability.sel(x=x, y=y, method="nearest"))  # noqa: E731
    assert at(-0.08, 0.149) > 0.7
    assert at(-0.06, 0.2) < 0.4
    assert at(-0.08, 0.11) == pytest.approx(0.5, abs=1e-3)
    assert float(chart.entropy.max()) == pytest.approx(1.0)


def test_pokes_fuse_and_grow_surer(rng):
    pokes = [poke(rng, toward=t) for t in (-0.6, 0.0, 0.6)]
    chart = map_contacts(pokes)
    assert chart.sizes["touch"] == 36
    alone = map_contacts(pokes[1:2])
    assert float(chart.entropy.sum()) / chart.entropy.size < float(alone.entropy.sum()) / alone.entropy.size
    radial = np.linalg.norm(chart.surface.values - CENTRE, axis=1) - RADIUS
    assert np.sqrt(np.mean(radial**2)) < 1e-3
    assert fused(pokes).point.shape == (36, 2)


def test_stiffness_of_a_spring_and_of_a_rock(rng):
    chart = map_contacts([poke(rng, stiffness=200.0) for _ in range(3)])
    assert chart.attrs["stiffness"] == pytest.approx(200.0, rel=0.05)
    assert abs(chart.attrs["stiffness"] - 200.0) < 4 * chart.attrs["stiffness_sd"]
    normal = np.tile([0.0, 1.0], (9, 1))
    still = ProbingContacts(poke(rng).curve, np.zeros((9, 2)), normal, np.full(9, 1e-3), np.ones(9))
    assert np.isnan(map_contacts([still]).attrs["stiffness"])


def test_export(rng, tmp_path):
    chart = map_contacts([poke(rng)], cell=2e-3)
    for ending in ("nc", "csv", "png"):
        assert save_map(chart, tmp_path / f"chart.{ending}").stat().st_size > 500
    with xr.open_dataset(tmp_path / "chart.nc", engine="h5netcdf") as again:
        np.testing.assert_allclose(again.probability.values, chart.probability.values)
    table = np.loadtxt(tmp_path / "chart.csv", delimiter=",", skiprows=1)
    assert table.shape == (chart.probability.size, 3)
    with pytest.raises(InputError, match=r"\.nc, \.csv or \.png"):
        save_map(chart, tmp_path / "chart.xyz")
    with pytest.raises(InputError, match="a map needs the contacts of at least one recording"):
        map_contacts([])
