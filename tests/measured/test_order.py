"""Order selection on a measured fibre of 302.5 mm: 20 stations, 5812 frames, unequal spacing."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from pliant.preprocessing.align import align, alignment_of
from pliant.recording import make_recording
from pliant.reduction import links_of, select_order

INDEPENDENT = {  # largest / mean mm for n = 2 ... 8
    "natural": ([53.7, 31.7, 16.8, 7.81, 6.1, 3.8, 2.93], [9.6, 3.7, 1.7, 0.94, 0.57, 0.37, 0.27]),
    "not-a-knot": ([55.9, 39.0, 16.0, 10.01, 8.9, 4.9, 4.15], [10.1, 4.6, 2.2, 1.10, 0.63, 0.39, 0.28]),
}


@pytest.fixture(scope="module")
def fibre(shared_data):
    points = np.loadtxt(shared_data / "fiber_shape" / "label.txt").reshape(-1, 20, 3) * 1e-3
    return make_recording(np.arange(len(points)) / 32.0, points)


@pytest.mark.parametrize("boundary", INDEPENDENT)
def test_independent_numbers(fibre, boundary):
    rows = select_order(fibre, boundary=boundary).to_dict()["orders"].values()
    largest, mean = INDEPENDENT[boundary]
    for row, a, b in zip(rows, largest, mean, strict=True):
        assert row["max_mm"] == pytest.approx(a, abs=0.051 if a > 10.1 or a in (6.1, 3.8, 8.9, 4.9) else 0.0051)
        assert row["mean_mm"] == pytest.approx(b, abs=0.051 if b > 1.11 else 0.0051)


def test_five_links_do_not_hold_three_millimetres(fibre):
    for boundary in ("natural", "not-a-knot", "clamped+not-a-knot"):
        result = select_order(fibre, bound=3e-3, boundary=boundary)
        assert result.max_error[3].max() > 7e-3
        assert result.frames == 5812
        assert result.stations == 20
        assert result.chosen in (8, None)
        assert "too few to judge" in result.reason


def test_best_placement_on_the_fibre(fibre):
    equal = select_order(fibre, bound=3e-3)
    best = select_order(fibre, bound=3e-3, placement="best")
    assert (best.max_error.max(axis=1) <= equal.max_error.max(axis=1)).all()
    assert equal.chosen is None
    assert best.chosen == 8
    assert best.max_error[-1].max() * 1e3 == pytest.approx(2.33, abs=0.01)


def test_rows_in_space_and_their_chain(shared_data):
    points = np.loadtxt(shared_data / "fiber_shape" / "label.txt", skiprows=2100)[::8].reshape(-1, 20, 3) * 1e-3
    raw = make_recording(np.arange(len(points)) / 4.0, points)
    body = align(raw, base="s000", tangent="clamp", rest=[0, 0.5], space=True)
    assert alignment_of(body).out_of_plane_share > 0.5
    found = select_order(body, bound=5e-3, boundary="natural")
    s, place = body["arc_length"].values, body["position"].values
    for knots, errors in zip(found.node_arc_length, found.max_error, strict=True):  # another program's spline
        spline = CubicSpline(knots, place[:, np.searchsorted(s, knots)], axis=1, bc_type="natural")
        np.testing.assert_allclose(np.linalg.norm(spline(s) - place, axis=-1).max(axis=1), errors, atol=1e-12)
    assert found.chosen == 7
    few, many = links_of(body, 5), links_of(body, 8)
    assert many.residual[:, -1].mean() < 0.6 * few.residual[:, -1].mean()
    assert 1e3 * np.sqrt((many.residual[:, -1] ** 2).mean()) < 3.1
    raw_chords = np.linalg.norm(np.diff(points[:2], axis=1), axis=-1).mean(axis=0)  # the rest: two frames
    assert many.link_length.sum() == pytest.approx(raw_chords.sum(), rel=0.01)
