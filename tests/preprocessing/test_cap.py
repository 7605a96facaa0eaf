import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pliant.errors import InputError
from pliant.preprocessing.cap import find_tip
from pliant.preprocessing.cut import cut_body
from pliant.recording import make_recording

SPACING, SAMPLES, CAP = 0.8e-3, 300, 0.03
S = np.arange(SAMPLES) * SPACING


def seen(body, tip, cap_curvature, gauge, noise=0.0, lead=0.02, rng=None):
    """Curvatures (T, S) of straight lead, body (T,), cap, straight tail, averaged over the gauge exactly."""

    def share(edge):  # of the gauge that lies behind the edge
        return np.clip((S + gauge / 2 - edge) / gauge, 0, 1)

    body = np.atleast_1d(np.asarray(body, dtype=float))[:, None]
    kappa = body * (share(lead) - share(tip)) + cap_curvature * (share(tip) - share(tip + CAP))
    return kappa if noise == 0 else kappa + noise * rng.normal(size=kappa.shape)


@settings(max_examples=40, deadline=None)
@given(
    offset=st.floats(-0.5, 0.5),
    gauge=st.sampled_from([0.8e-3, 1.6e-3, 4.8e-3]),
    cap=st.sampled_from([-30.0, 25.0, 40.0]),
    body=st.floats(-10, 12),
)
def test_exact_without_noise_between_samples(offset, gauge, cap, body):
    tip = S[230] + offset * SPACING
    found = find_tip(
        seen([body] * 3, tip, cap, gauge), SPACING, cap_curvature=cap, cap_length=CAP, gauge_length=gauge
    )
    assert found.found
    assert found.arc_length == pytest.approx(tip, abs=1e-9)
    assert found.confidence > 0.99


@pytest.mark.parametrize("gauge", [2.4e-3, 4.8e-3])
@pytest.mark.parametrize("cap", [15.0, 40.0])
@pytest.mark.parametrize("noise", [0.5, 1.0])
def test_accuracy_with_noise(cap, noise, gauge, rng):
    tip = S[236] + 0.31e-3
    kappa = seen(rng.uniform(1, 10, 200), tip, cap, gauge, noise, rng=rng)
    found = find_tip(kappa, SPACING, cap_curvature=cap, cap_length=CAP, gauge_length=gauge)
    assert found.found
    assert found.arc_length == pytest.approx(tip, abs=0.03e-3)
    error = np.abs(found.per_frame - tip)
    assert np.nanmedian(error) < 0.2e-3
    assert np.nanpercentile(error, 99) < 0.7e-3


def test_refused_when_the_body_bends_like_the_cap(rng):
    kappa = seen([20.0] * 9, S[230], 20.0, 2.4e-3, 0.3, rng=rng)
    found = find_tip(kappa, SPACING, cap_curvature=20, cap_length=CAP, gauge_length=2.4e-3)
    assert not found.found
    assert found.confidence == 0
    assert np.isnan(found.arc_length)
    assert "the body is curved like the cap" in found.status
    assert found.frames_ambiguous == 9


def test_frames_that_pass_through_the_caps_curvature_are_left_out(rng):
    tip = S[233] + 0.2e-3
    kappa = seen(np.linspace(2, 25, 50), tip, 15.0, 2.4e-3, 0.3, rng=rng)
    found = find_tip(kappa, SPACING, cap_curvature=15, cap_length=CAP, gauge_length=2.4e-3)
    assert found.found
    assert 3 < found.frames_ambiguous < 25
    assert found.arc_length == pytest.approx(tip, abs=0.05e-3)


def test_refused_without_a_cap(rng):
    kappa = seen([8.0] * 9, S[230], 8.0, 2.4e-3, 0.3, rng=rng)
    found = find_tip(kappa, SPACING, cap_curvature=25, cap_length=CAP)
    assert not found.found
    assert "there is no cap" in found.status
    assert found.frames_without_cap == 9


def test_outlying_and_broken_frames_are_counted_and_do_not_move_the_tip(rng):
    tip = S[230] + 0.1e-3
    kappa = np.concatenate(
        (seen([6.0] * 20, tip, 30.0, 1.6e-3, 0.2, rng=rng), seen([6.0] * 3, tip + 0.004, 30.0, 1.6e-3, 0.2, rng=rng))
    )
    kappa[4, 17] = np.nan
    before = kappa.copy()
    found = find_tip(kappa, SPACING, cap_curvature=30, cap_length=CAP, gauge_length=1.6e-3)
    assert found.found
    assert found.arc_length == pytest.approx(tip, abs=0.05e-3)
    assert found.frames_rejected == 3
    assert found.frames_without_cap == 1
    assert found.confidence < 0.9
    np.testing.assert_array_equal(kappa, before)


def test_disagreeing_frames_are_refused(rng):
    kappa = np.concatenate([seen([6.0], tip, 30.0, 1.6e-3) for tip in S[100:240:10]])
    found = find_tip(kappa, SPACING, cap_curvature=30, cap_length=CAP, gauge_length=1.6e-3)
    assert not found.found
    assert "do not agree" in found.status


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"cap_curvature": 0.0}, "cap_curvature must not be 0"),
        ({"cap_length": 1e-3}, "at least twice as long"),
        ({"cap_length": 0.2}, "too short"),
        ({"cap_length": np.nan}, "must be finite"),
        ({"spacing": 0.0}, "spacing of the curvature samples must be above 0 m"),
    ],
)
def test_bad_caps(options, message):
    arguments = {"spacing": SPACING, "cap_curvature": 20.0, "cap_length": CAP} | options
    spacing = arguments.pop("spacing")
    with pytest.raises(InputError, match=message):
        find_tip(np.zeros((3, SAMPLES)), spacing, **arguments)
    with pytest.raises(InputError, match="time, station"):
        find_tip(np.zeros(SAMPLES), SPACING, cap_curvature=20, cap_length=CAP)


def circle_recording(**more):
    kappa = np.linspace(3, 9, 6)[:, None]
    s = S[:200]
    z = (np.exp(1j * kappa * s) - 1) / kappa
    points = np.stack([z.real, z.imag], axis=2)
    return make_recording(np.arange(6.0), points, arc_length=s, frame="planar", **more), kappa


def test_cut_to_exact_ends():
    recording, kappa = circle_recording()
    recording["position"][2, 150] = np.nan
    before = recording.copy(deep=True)
    cut = cut_body(recording, 10.3e-3, 100.5e-3)
    s = cut["arc_length"].values
    assert s[0] == 0
    assert s[-1] == pytest.approx(90.2e-3)
    z = (np.exp(1j * kappa * (s + 10.3e-3)) - 1) / kappa
    np.testing.assert_allclose(cut["position"].values, np.stack([z.real, z.imag], axis=2), atol=1e-9)
    assert str(cut["station"].values[0]) == "base"
    assert str(cut["station"].values[-1]) == "tip"
    assert "cut to the body from 10.30 to 100.50 mm: 13 station(s) of lead, 74 of tail" in cut.attrs["history"]
    assert recording.identical(before)


def test_cut_at_stations_and_with_orientations():
    recording, _ = circle_recording(angle=np.zeros((6, 200)))
    cut = cut_body(recording, 10.3e-3, 100.5e-3)
    assert cut.sizes["station"] == 113
    assert cut["arc_length"].values[0] == 0
    same = cut_body(circle_recording()[0], S[10], S[100])
    assert same.sizes["station"] == 91
    with pytest.raises(InputError, match="must be within"):
        cut_body(recording, 0.1, 0.5)
    with pytest.raises(InputError, match="four are needed"):
        cut_body(recording, 0.1, 0.1012)
