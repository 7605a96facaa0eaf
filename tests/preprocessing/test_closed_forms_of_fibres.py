"""Caps, cuts and curvatures of fibres against closed forms: averaged steps, polynomials, brute-force searches."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import BarycentricInterpolator

from pliant.errors import InputError
from pliant.preprocessing import curvature as curvature_fit
from pliant.preprocessing.cap import CapTemplate, find_tip
from pliant.preprocessing.curvature import _Model, curvature_of, fit_curvature, savgol_curvature
from pliant.preprocessing.cut import cut_body
from pliant.recording import make_recording

S = np.arange(200) * 1e-3


def averaged(tip, *, width, cap_length, levels, s=S):
    """Mean over `width` of a curvature that steps from body to cap to tail; `levels` are the three."""
    ends = (-9.0, tip, tip + cap_length, 9.0)
    return sum(
        level * np.clip(np.minimum(s + width / 2, b) - np.maximum(s - width / 2, a), 0.0, None) / width
        for level, a, b in zip(levels, ends[:-1], ends[1:], strict=True)
    )


@pytest.mark.parametrize("levels", [(5.0, 20.0, 1.0), (-30.0, 20.0, -25.0), (35.0, 20.0, 60.0), (5.0, -20.0, 90.0)])
@pytest.mark.parametrize(("width", "cap_length"), [(1e-3, 0.03), (4.3e-3, 0.0305), (2e-3, 0.004), (1e-3, 0.002)])
def test_a_tip_is_found_to_rounding_between_the_samples(levels, width, cap_length):
    template = CapTemplate(1e-3, levels[1], cap_length, width, levels[2])
    for tip in (0.1, 0.1003, 0.1005, 0.1 + 7e-4):
        place, (body, plateau, tail, error) = template.locate(
            averaged(tip, width=width, cap_length=cap_length, levels=levels)[None]
        )
        assert place[0] == pytest.approx(tip, abs=1e-10)
        assert (body[0], plateau[0], tail[0]) == pytest.approx(levels, abs=0.1)
        assert body[0] == pytest.approx(levels[0], abs=1e-8)
        assert error[0] < 0.1


def test_the_window_of_a_template_rounds_up_to_whole_samples():
    template = CapTemplate(1e-3, 20.0, 0.0305, 4e-3, 0.0)
    assert (template.before, template.samples) == (20, 2 * 20 + 31 + 1)  # 15.25 + 4 samples, and 30.5 of the cap


def test_the_tip_of_a_noisy_fibre_is_the_best_of_a_dense_search():
    """Least squares over every place, with the mean of the body that fits it best."""
    rng = np.random.default_rng(8)
    levels, width, cap_length = (6.0, 20.0, 3.0), 2e-3, 0.012
    clean = averaged(0.1004, width=width, cap_length=cap_length, levels=levels)
    kappa = clean + 0.5 * rng.normal(size=200)
    template = CapTemplate(1e-3, 20.0, cap_length, width, 3.0)
    place, (mean, plateau, end, error) = template.locate(kappa[None])
    first = round(place[0] / 1e-3) - template.before
    window, s = kappa[first : first + template.samples], S[first : first + template.samples]
    cost = []
    for tip in np.arange(0.0985, 0.1020, 2e-6):
        body = averaged(tip, width=width, cap_length=cap_length, levels=(1.0, 0.0, 0.0), s=s)
        rest = averaged(tip, width=width, cap_length=cap_length, levels=(0.0, 20.0, 3.0), s=s)
        best = (window - rest) @ body / (body @ body)
        cost.append((((window - rest - best * body) ** 2).sum(), tip, best))
    assert place[0] == pytest.approx(min(cost)[1], abs=3e-6)
    assert mean[0] == pytest.approx(min(cost)[2], abs=1e-3)
    body, tail = (
        averaged(place[0], width=width, cap_length=cap_length, levels=one, s=s) for one in ((1.0, 0, 0), (0, 0, 1.0))
    )
    inside, behind = window[body + tail < 1e-3], window[tail > 0.999]
    assert (plateau[0], end[0]) == pytest.approx((inside.mean(), behind.mean()))
    squares = ((inside - inside.mean()) ** 2).sum() + ((behind - behind.mean()) ** 2).sum()
    freedom = inside.size + behind.size - 2
    assert error[0] == pytest.approx(np.sqrt(squares / freedom / inside.size))


def test_a_template_may_fill_the_whole_fibre():
    levels, options = (5.0, 20.0, 1.0), {"width": 1e-3, "cap_length": 0.03}
    template = CapTemplate(1e-3, 20.0, 0.03, 1e-3, 1.0)
    assert template.samples == 63
    for count in (63, 64, 65, 66):
        kappa = averaged(0.0163, s=S[:count], levels=levels, **options)
        assert template.locate(kappa[None])[0][0] == pytest.approx(0.0163, abs=1e-10)
        found = find_tip(kappa[None], 1e-3, cap_curvature=20.0, cap_length=0.03, tail_curvature=1.0)
        assert found.arc_length == pytest.approx(0.0163, abs=1e-10)
    with pytest.raises(InputError, match="62 samples, but body, cap and tail need 63"):
        find_tip(kappa[None, :62], 1e-3, cap_curvature=20.0, cap_length=0.03)


def noisy(levels, sigma):
    """A cap of 10 samples on a fibre whose cap and tail scatter by `sigma` (+ and - in turn, so about the levels)."""
    kappa = averaged(0.0995, width=1e-3, cap_length=0.01, levels=levels)
    kappa[100:] += sigma * (-1.0) ** np.arange(100)
    return kappa[None]


@pytest.mark.parametrize(
    ("levels", "capped", "clear"),
    [
        ((0.0, 27.0, 0.0), True, True),  # 5 and 3 standard errors are allowed
        ((0.0, 30.0, 0.0), False, False),
        ((0.0, 20.0, 7.0), True, True),
        ((0.0, 20.0, 10.0), False, False),
        ((13.0, 20.0, 0.0), True, True),  # 3 and 3 standard errors are needed
        ((15.4, 20.0, 0.0), True, False),
    ],
)
def test_noise_of_the_plateau_widens_what_is_allowed(levels, capped, clear):
    """A scatter of 2.9 on ten samples: a standard error of 0.93 to 0.97."""
    sigma = 2.9
    found = find_tip(noisy(levels, sigma), 1e-3, cap_curvature=20.0, cap_length=0.01)
    assert (found.frames_without_cap, found.frames_ambiguous) == (int(not capped), int(capped and not clear))


@pytest.mark.parametrize("tail", [-7.0, 9.0])
def test_a_tail_may_be_bent_itself(tail):
    kappa = averaged(0.12, width=1e-3, cap_length=0.03, levels=(5.0, 20.0, tail))[None]
    found = find_tip(kappa, 1e-3, cap_curvature=20.0, cap_length=0.03, tail_curvature=tail)
    assert found.arc_length == pytest.approx(0.12, abs=1e-9)
    wrong = find_tip(kappa, 1e-3, cap_curvature=20.0, cap_length=0.03, tail_curvature=-tail)
    assert wrong.frames_without_cap == 1
    assert (wrong.frames_used, wrong.frames_rejected, wrong.confidence) == (0, 0, 0.0)


def test_frames_with_a_missing_sample_have_no_cap_and_the_gauge_half_of_it_at_most():
    kappa = np.tile(averaged(0.12, width=1e-3, cap_length=0.03, levels=(5.0, 20.0, 0.0)), (2, 1))
    kappa[1, 3] = np.nan
    found = find_tip(kappa, 1e-3, cap_curvature=20.0, cap_length=0.03)
    assert np.isnan(found.per_frame).tolist() == [False, True]
    assert found.frames_without_cap == 1
    find_tip(kappa, 1e-3, cap_curvature=20.0, cap_length=0.03, gauge_length=0.015)
    with pytest.raises(InputError, match=r"a cap of 30 mm cannot be resolved by a gauge of 15\.1 mm"):
        find_tip(kappa, 1e-3, cap_curvature=20.0, cap_length=0.03, gauge_length=0.0151)


# cutting


def fibre(s):
    """A polynomial of the fourth order, which a cubic does not meet: which four stations it takes shows."""
    place = np.stack([1e3 * s**4, s], axis=1)
    return make_recording(np.arange(2.0), np.tile(place, (2, 1, 1)), frame="planar", arc_length=s)


@pytest.mark.parametrize(
    ("base", "tip", "low", "high"),
    [(0.034, 0.077, 2, 6), (0.0, 0.0991, 0, 7), (0.004, 0.1, 0, 7), (0.011, 0.094, 0, 7), (0.02, 0.0899, 0, 7)],
)
def test_new_ends_lie_on_the_cubic_through_the_two_stations_to_each_side(base, tip, low, high):
    s = np.linspace(0.0, 0.1, 11)
    cut = cut_body(fibre(s), base, tip)
    x = cut["position"].values[1, :, 0]
    for at, first, found in ((base, low, x[0]), (tip, high, x[-1])):
        around = s[first : first + 4]
        assert found == pytest.approx(float(BarycentricInterpolator(around, 1e3 * around**4)(at)), rel=1e-9, abs=1e-15)
    inner = s[(s > base + 1e-6) & (s < tip - 1e-6)]
    np.testing.assert_allclose(x[1:-1], 1e3 * inner**4, rtol=1e-12)


def test_a_station_within_a_nanometre_of_an_end_is_part_of_the_body():
    s = np.linspace(0.0, 0.1, 11)
    lines = {}
    for off in (0.6e-9, 1.3e-9):
        cut = cut_body(fibre(s), 0.02 + off, 0.08 - off)
        lines[off] = cut.attrs["history"].split("\n")[-1]
        assert cut.sizes["station"] == 7  # those within, or two fewer and two new ends
    assert lines[0.6e-9].endswith("2 station(s) of lead, 2 of tail")
    assert lines[1.3e-9].endswith("3 station(s) of lead, 3 of tail")
    assert cut_body(fibre(s), 0.05, 0.1 + 0.9e-9).sizes["station"] == 6
    for base, tip in ((0.05, 0.1 + 1.2e-9), (-1e-12, 0.1), (np.nan, 0.1), (0.0, np.inf), (0.0, np.nan)):
        with pytest.raises(InputError, match="must be within"):
            cut_body(fibre(s), base, tip)


@pytest.mark.parametrize(("short", "added"), [(0.8e-6, 0), (1.3e-6, 1)])
def test_an_end_is_added_where_the_last_station_is_a_millionth_away(short, added):
    s = np.linspace(0.0, 0.1, 11)
    assert cut_body(fibre(s), 0.0, 0.08 * (1 + short)).sizes["station"] == 9 + added
    assert cut_body(fibre(s), 0.02 - 0.08 * short, 0.08).sizes["station"] == 7 + added


# curvature


def circle(s, kappa, frames=3):
    k = kappa * np.linspace(1.0, 1.2, frames)[:, None]
    return np.stack([(np.cos(k * s) - 1) / k, np.sin(k * s) / k], axis=2)


@pytest.mark.parametrize("method", ["savgol", "spline", "basis"])
def test_curvature_does_not_depend_on_where_the_body_lies(method):
    s = np.linspace(0.0, 0.1, 61)
    place = circle(s, 8.0) + np.array([0.31, -0.2])
    found = curvature_of(make_recording(np.arange(3.0), place, frame="planar", arc_length=s), method=method)
    exact = np.array([[8.0], [8.8], [9.6]])
    np.testing.assert_allclose(found.values[:, 5:-5], np.tile(exact, (1, 51)), rtol=1e-3)
    np.testing.assert_allclose(savgol_curvature(place, s), savgol_curvature(place, s, 51))


@pytest.mark.parametrize(("window", "said"), [(5, None), (61, None), (3, "above 4"), (63, "at most 61"), (6, "odd")])
def test_a_window_is_odd_above_four_and_within_the_body(window, said):
    s = np.linspace(0.0, 0.1, 61)
    if said is None:
        np.testing.assert_allclose(savgol_curvature(circle(s, 8.0), s, window)[0], 8.0, rtol=4e-3)
        return
    with pytest.raises(InputError, match=said):
        savgol_curvature(circle(s, 8.0), s, window)


@pytest.mark.parametrize(("terms", "allowed"), [(1, True), (0, False), (16, True), (17, False)])
def test_a_fit_has_one_term_at_least_and_as_many_numbers_as_coordinates_but_one(terms, allowed):
    s = np.linspace(0.0, 0.1, 10)
    if allowed:
        assert fit_curvature(circle(s, 8.0), s, terms=terms, smoothing=1e-12).terms == terms
        return
    with pytest.raises(InputError, match=f"between 1 and 16, not {terms}"):
        fit_curvature(circle(s, 8.0), s, terms=terms, smoothing=0.0)


@pytest.mark.parametrize(("stations", "terms"), [(10, 4), (20, 5), (80, 20), (84, 20)])
def test_a_quarter_of_the_stations_is_the_number_of_terms(stations, terms):
    s = np.linspace(0.0, 0.1, stations)
    assert fit_curvature(circle(s, 8.0, 1), s, smoothing=0.0).terms == terms


def test_frames_that_do_not_settle_are_counted_over_all_chunks(monkeypatch):
    s = np.linspace(0.0, 0.1, 12)
    place = np.tile(circle(s, 30.0, 1), (130, 1, 1))
    place[::2] = circle(s, 1e-9, 1)  # straight: the start is the answer
    place[::2, :, 0] = 0.0
    monkeypatch.setattr(curvature_fit, "ITERATIONS", 1)
    assert fit_curvature(place, s, smoothing=0.0).unsettled == 65
    monkeypatch.undo()
    settled = fit_curvature(place, s, smoothing=0.0)
    assert settled.unsettled == 0
    np.testing.assert_allclose(settled.curvature[1::2], 30.0, rtol=1e-4)


def test_the_distance_of_a_fit_is_that_of_points_off_a_line():
    """Points that lie in turn to both sides of a line, by more and more: no curvature may follow with one term."""
    s = np.linspace(0.0, 0.1, 41)
    place = np.zeros((2, 41, 2))
    place[..., 1] = s
    place[..., 0] = 1e-5 * np.array([[1.0], [2.0]]) * (-1.0) ** np.arange(41)
    found = fit_curvature(place, s, terms=1, smoothing=0.0)
    assert found.rms_distance == pytest.approx(1e-5 * np.sqrt((1 + 4) / 2), rel=0.1)
    assert np.abs(found.curvature).max() < 0.05


def test_the_smoothing_has_the_least_score_of_cross_validation(monkeypatch):
    """The score by its definition: n |r|^2 / (n - trace of the influence of the points on the fit)^2.

    The influence is differentiated numerically, one coordinate after another.
    """
    monkeypatch.setattr(curvature_fit, "FINEST", 14)  # two intervals from station to station are enough
    s, fine = np.linspace(0.0, 0.1, 8), np.linspace(0.0, 0.1, 2001)
    turn = 6 * fine + 0.1 / np.pi * 10 * np.sin(2 * np.pi * fine / 0.1)
    way = np.cumsum(np.stack([-np.sin(turn), np.cos(turn)], axis=1), axis=0) * 5e-5
    middle = np.stack([np.interp(s, fine, way[:, k]) for k in (0, 1)], axis=1)
    place = middle + 4e-4 * np.random.default_rng(5).normal(size=(2, 8, 2))
    model = _Model(s, 7)
    chosen = model.cross_validated(place)

    def fitted(points, smoothing):
        parameters, distance, _ = model.solve(points, smoothing)
        residual, _ = model.linearised(parameters, points)
        return residual + points.transpose(0, 2, 1).reshape(len(points), -1), np.square(distance).sum()

    def score(smoothing):
        usual, squared = fitted(place, smoothing)
        trace = 0.0
        for k in range(16):
            moved = place.copy()
            moved[:, k % 8, k // 8] += 1e-7
            trace += ((fitted(moved, smoothing)[0] - usual)[:, k] / 1e-7).mean()
        return squared / (1 - trace / 16) ** 2

    assert chosen > 0
    scores = {step: score(chosen * 10.0**step) for step in (-0.5, 0.0, 0.5)}
    assert min(scores, key=lambda step: scores[step]) == 0.0
