"""Curvature from points. The synthetic family: 40 bodies of 168.8 mm and 212 stations,

kappa(s) = a (1 + .25 sin(2 pi x + u) + .15 cos(4 pi x + v) + .1 sin(7 pi x + w)), x = s / L, with a from 5 to
12 1/m and phases at random; root mean square 8.9 1/m; white noise on every coordinate.
"""

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import savgol_filter

from pliant.errors import InputError
from pliant.preprocessing.curvature import curvature_of, differences, savgol_curvature
from pliant.recording import make_recording

LENGTH = 0.1688
S = np.linspace(0, LENGTH, 212)


def integrated(kappa, s):
    """Points (T, S, 2) of curvatures (T, G) given on a grid ten times finer than the stations."""
    fine = np.linspace(0, s[-1], kappa.shape[1])
    h = fine[1]
    phi = np.concatenate((np.zeros((len(kappa), 1)), np.cumsum((kappa[:, 1:] + kappa[:, :-1]) / 2 * h, axis=1)), axis=1)
    middle = (phi[:, 1:] + phi[:, :-1]) / 2
    steps = np.stack([-np.sin(middle), np.cos(middle)], axis=-1) * h
    points = np.concatenate((np.zeros((len(kappa), 1, 2)), np.cumsum(steps, axis=1)), axis=1)
    return points[:, :: (fine.size - 1) // (s.size - 1)]


@pytest.fixture(scope="module")
def family():
    rng = np.random.default_rng(1)
    x = np.linspace(0, 1, 2111)
    a = rng.uniform(5, 12, 40)[:, None]
    u, v, w = rng.uniform(0, 6, (3, 40, 1))
    kappa = a * (1 + 0.25 * np.sin(2 * np.pi * x + u) + 0.15 * np.cos(4 * np.pi * x + v))
    kappa = kappa + 0.1 * a * np.sin(7 * np.pi * x + w)
    return kappa[:, ::10], integrated(kappa, S)


def rms_error(family, noise, **options):
    kappa, points = family
    noisy = points + noise * np.random.default_rng(2).normal(size=points.shape)
    found = curvature_of(
        make_recording(np.arange(40) / 75, noisy, arc_length=S, frame="planar"), **options
    )
    return float(np.sqrt(np.square(found.values - kappa).mean())), found


@pytest.fixture(scope="module")
def basis_error(family):
    """`rms_error` of the fit in a basis, once for each noise."""
    return cache(lambda noise: rms_error(family, noise))


@pytest.mark.parametrize(("noise", "largest"), [(0, 0.05), (2e-5, 0.3), (1e-4, 0.65), (3e-4, 1.2)])
def test_basis_fit(basis_error, noise, largest):
    error, found = basis_error(noise)
    assert error < largest
    assert "frames_not_converged" not in found.attrs
    assert found.attrs["rms_distance_m"] == pytest.approx(noise * np.sqrt(2), rel=0.05, abs=2e-6)


@pytest.mark.parametrize("noise", [2e-5, 1e-4, 3e-4])
def test_basis_fit_beats_savitzky_golay_and_that_beats_differences(family, basis_error, noise):
    basis, _ = basis_error(noise)
    filtered, _ = rms_error(family, noise, method="savgol", window=51)
    kappa, points = family
    noisy = points + noise * np.random.default_rng(2).normal(size=points.shape)
    phi = np.unwrap(np.arctan2(-np.diff(noisy[..., 0]), np.diff(noisy[..., 1])), axis=1)
    raw = np.sqrt(np.square(np.diff(phi, axis=1) / S[1] - kappa[:, 1:-1]).mean())
    assert basis < filtered < raw


@settings(max_examples=10, deadline=None)
@given(kappa=st.floats(-20, 20), turn=st.floats(-3, 3), method=st.sampled_from(["basis", "savgol"]))
def test_a_circle_has_one_curvature_wherever_it_lies(kappa, turn, method):
    kappa = kappa if abs(kappa) > 1e-3 else 0.0
    z = 1j * S if kappa == 0 else (np.exp(1j * kappa * S) - 1) / kappa
    z = z * np.exp(1j * turn) + (0.3 - 0.2j)
    recording = make_recording([0.0], np.stack([z.real, z.imag], axis=1)[None], arc_length=S, frame="planar")
    tolerance = 1e-6 if method == "basis" else 1e-8 + 3e-8 * abs(kappa) ** 5  # the filter is of order 4
    np.testing.assert_allclose(curvature_of(recording, method=method).values, kappa, atol=tolerance)


def test_unevenly_spaced_sparse_stations():
    s = np.sort(np.concatenate(([0, 0.3], np.random.default_rng(0).uniform(0.01, 0.29, 18))))
    kappa = 6 + 20 * s
    fine = np.linspace(0, 0.3, 30001)
    phi = 6 * fine + 10 * fine**2
    h = fine[1]
    points = np.stack([np.cumsum(-np.sin(phi)) * h, np.cumsum(np.cos(phi)) * h], axis=1)
    at = np.stack([np.interp(s, fine, points[:, a]) for a in range(2)], axis=1)
    recording = make_recording([0.0], at[None], arc_length=s, frame="planar")
    np.testing.assert_allclose(curvature_of(recording).values[0], kappa, atol=0.05)
    with pytest.raises(InputError, match="evenly spaced"):
        curvature_of(recording, method="savgol", window=7)


@pytest.mark.parametrize(("stations", "window"), [(296, 15), (120, 51), (51, 51), (9, 5)])
def test_differences_are_those_of_scipy(stations, window):
    values = np.cumsum(np.random.default_rng(window).standard_normal((3, stations, 2)), axis=1)
    for order, rows in enumerate(differences(stations, window, 1.3e-3), start=1):
        wanted = savgol_filter(values, window, 4, deriv=order, delta=1.3e-3, axis=1)
        np.testing.assert_allclose(rows @ values, wanted, rtol=0, atol=1e-10 * np.abs(wanted).max())


def test_magnitude_in_three_dimensions():
    radius, pitch = 0.03, 0.02
    length = np.hypot(radius, pitch)
    t = np.linspace(0, 4, 300)
    helix = np.stack([radius * np.cos(t), radius * np.sin(t), pitch * t], axis=1)
    kappa = savgol_curvature(helix[None], length * t, 31)
    np.testing.assert_allclose(kappa, radius / length**2, rtol=3e-4)
    recording = make_recording([0.0], helix[None])
    with pytest.raises(InputError, match="needs a planar recording"):
        curvature_of(recording)
    assert curvature_of(recording, method="savgol").attrs["units"] == "1/m"


def test_frames_with_missing_stations_are_counted(family):
    points = family[1][:5].copy()
    points[2, 7] = np.nan
    found = curvature_of(make_recording(np.arange(5.0), points, arc_length=S, frame="planar"))
    assert found.sizes["time"] == 4
    assert found.attrs["frames_left_out"] == 1
    assert np.isfinite(found.values).all()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"method": "wavelet"}, "one of basis, savgol, spline"),
        ({"method": "savgol", "window": 50}, "must be odd"),
        ({"method": "savgol", "window": 301}, "at most 212 stations"),
        ({"terms": 0}, "terms must be between"),
        ({"smoothing": -1.0}, "must not be negative"),
    ],
)
def test_bad_options(family, options, message):
    with pytest.raises(InputError, match=message):
        rms_error(family, 0, **options)


def test_the_spline_through_the_stations_knows_a_helix_of_uneven_stations():
    s = np.cumsum(0.004 + 0.002 * np.sin(np.arange(80)))
    radius, rise = 0.05, 0.3  # curvature radius / (radius^2 + c^2), c the rise per radian
    c = rise * radius
    turn = s / np.hypot(radius, c)
    points = np.stack([radius * np.cos(turn), radius * np.sin(turn), c * turn], -1)[None]
    found = curvature_of(make_recording([0.0], points, arc_length=s), method="spline").values
    np.testing.assert_allclose(found[0, 5:-5], radius / (radius**2 + c**2), rtol=2e-3)
    flat = points[..., :2] * [1, -1]
    arc = np.linalg.norm(np.diff(flat[0], axis=0), axis=1)
    flat = make_recording([0.0], flat, arc_length=np.append(0, np.cumsum(arc)), frame="planar")
    np.testing.assert_allclose(curvature_of(flat, method="spline").values[0, 5:-5], -1 / radius, rtol=5e-3)
