import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pliant.errors import InputError
from pliant.recording import make_recording, write
from pliant.sensing import (
    CoreLayout,
    curvature_from_strain,
    planar_curve,
    read_shape,
    shape_from_strain,
    spatial_curve,
    tip_sigma,
)

RADIUS = 35e-6
S = np.linspace(0, 0.17, 213)


def strain_of(layout, curvature, common, twist, s):
    """Strain (T, C, G) of every core, one core and gauge at a time; curvature (T, G, 2) in Bishop's frame."""
    spin = np.zeros_like(twist)
    for g in range(1, s.size):
        spin[:, g] = spin[:, g - 1] + (twist[:, g] + twist[:, g - 1]) / 2 * (s[g] - s[g - 1])
    strain = np.empty((len(curvature), layout.radius.size, s.size))
    for c, (r, theta) in enumerate(zip(layout.radius, layout.angle, strict=True)):
        turn = 0 if layout.pitch is None else 2 * np.pi / layout.pitch
        for g in range(s.size):
            at = theta + turn * s[g] + spin[:, g]
            bend = curvature[:, g, 0] * np.cos(at) + curvature[:, g, 1] * np.sin(at)
            strain[:, c, g] = common[:, g] - r * bend + turn * r**2 / (1 + (turn * r) ** 2) * twist[:, g]
    return strain


@settings(max_examples=30, deadline=None)
@given(kappa=st.floats(-500, 500), stations=st.integers(3, 400))
def test_constant_curvature_closes_its_circle(kappa, stations):
    kappa = kappa if abs(kappa) > 1 else 7.0
    s = np.linspace(0, 2 * np.pi / abs(kappa), stations)
    points = planar_curve(np.full((1, stations), kappa), s)[0]
    assert np.abs(points[-1]).max() < 1e-14 * max(1.0, s[-1])
    space, frames = spatial_curve(np.full((1, stations, 2), [kappa, 0.0]), s)
    assert np.abs(space[0, -1]).max() < 1e-13 * max(1.0, s[-1])
    np.testing.assert_allclose(space[0, :, :2], points, atol=1e-13 * max(1.0, s[-1]))
    np.testing.assert_allclose(frames[0, -1], np.eye(3), atol=1e-12)


def test_planar_points_lie_on_the_circle_and_positive_bends_to_negative_x():
    kappa = 12.0
    points = planar_curve(np.full((1, S.size), kappa), S)[0]
    np.testing.assert_allclose(points, np.stack([np.cos(kappa * S) - 1, np.sin(kappa * S)], axis=1) / kappa, atol=1e-15)
    assert points[-1, 0] < 0


def test_base_angle_turns_the_curve():
    kappa = 4 + 30 * S[None]
    straight, turned = planar_curve(kappa, S)[0], planar_curve(kappa, S, base_angle=0.4)[0]
    c, w = np.cos(0.4), np.sin(0.4)
    np.testing.assert_allclose(turned, straight @ np.array([[c, w], [-w, c]]), atol=1e-15)


def helix(radius, pitch, s):
    """Helix from the origin along +y, its Bishop curvature, by its closed form."""
    speed = np.hypot(radius, pitch)
    kappa, torsion = radius / speed**2, pitch / speed**2
    return kappa, np.stack([kappa * np.cos(torsion * s), kappa * np.sin(torsion * s)], axis=1)


def test_helix_keeps_its_frames_orthonormal_and_its_radius():
    s = np.linspace(0, 0.5, 2001)
    kappa, bishop = helix(0.02, 0.01, s)
    points, frames = spatial_curve(bishop[None], s)
    identity = np.broadcast_to(np.eye(3), (s.size, 3, 3))
    np.testing.assert_allclose(frames[0] @ frames[0].transpose(0, 2, 1), identity, atol=1e-12)
    t = frames[0, :, :, 1]
    normal = (frames[0, :, :, 0] * -bishop[:, :1] + frames[0, :, :, 2] * bishop[:, 1:]) / kappa
    axis_points = points[0] + 0.02 * normal
    direction = axis_points[-1] - axis_points[0]
    direction /= np.linalg.norm(direction)
    off = axis_points - axis_points[0]
    off -= np.outer(off @ direction, direction)
    assert np.abs(off).max() < 1e-7
    np.testing.assert_allclose(t @ direction, 0.01 / np.hypot(0.02, 0.01), atol=1e-6)


@pytest.mark.parametrize("kind", ["bishop", "material"])
def test_fourth_order(kind):
    from scipy.integrate import solve_ivp

    def rates(x):
        return np.array([20 * np.sin(15 * x), 12 * np.cos(22 * x), 9 * np.sin(8 * x) if kind == "material" else 0])

    def slope(x, y):
        k1, k2, tau = rates(x)
        R = y[3:].reshape(3, 3)
        hat = np.array([[0, -k1, tau], [k1, 0, -k2], [-tau, k2, 0]])
        return np.concatenate((R[:, 1], (R @ hat).ravel()))

    y0 = np.concatenate((np.zeros(3), np.eye(3).ravel()))
    exact = solve_ivp(slope, (0, 0.2), y0, rtol=1e-12, atol=1e-13, method="DOP853").y[:3, -1]
    errors = []
    for count in (11, 21, 41):
        # curvature linear between stations costs second order: sample finely, keep the steps coarse
        s = np.linspace(0, 0.2, count)
        k = np.array([rates(x) for x in s])
        found, _ = spatial_curve(k[None, :, :2], s, twist=k[None, :, 2])
        errors.append(np.linalg.norm(found[0, -1] - exact))
    slopes = np.diff(np.log(errors)) / np.log(0.5)
    assert (slopes > 1.8).all()
    linear = np.linspace(0, 0.2, 11)
    ends = np.array([[3.0, -8.0], [25.0, 14.0]])
    coarse = ends[0] + (ends[1] - ends[0]) * linear[:, None] / 0.2
    fine = np.linspace(0, 0.2, 2001)
    dense = ends[0] + (ends[1] - ends[0]) * fine[:, None] / 0.2
    a = spatial_curve(coarse[None], linear)[0][0, -1]
    b = spatial_curve(coarse[None, ::2], linear[::2])[0][0, -1]
    c = spatial_curve(dense[None], fine)[0][0, -1]
    assert np.linalg.norm(b - c) / np.linalg.norm(a - c) > 12


@settings(max_examples=25, deadline=None)
@given(
    seed=st.integers(0, 2**31),
    outer=st.integers(3, 6),
    centre=st.booleans(),
    pitch=st.sampled_from([None, 0.05, -0.03]),
    method=st.sampled_from(["centre", "least-squares"]),
)
def test_strain_there_and_back(seed, outer, centre, pitch, method):
    rng = np.random.default_rng(seed)
    layout = CoreLayout.symmetric(outer, RADIUS, centre=centre, first_angle=rng.uniform(0, 6), pitch=pitch)
    if method == "centre" and not centre:
        with pytest.raises(InputError, match="needs a core at radius 0"):
            curvature_from_strain(np.zeros((1, outer, 5)), np.arange(5.0), layout, common_mode="centre")
        return
    s = np.linspace(0, 0.1, 30)
    sees_twist = pitch is not None and centre
    curvature = rng.uniform(-20, 20, (3, 30, 2))
    common, twist = rng.uniform(-1e-3, 1e-3, (3, 30)), rng.uniform(-30, 30, (3, 30)) * sees_twist
    strain = strain_of(layout, curvature, common, twist, s)
    found = curvature_from_strain(strain, s, layout, common_mode=method)
    assert found.sees_twist == sees_twist
    np.testing.assert_allclose(found.curvature, curvature, atol=1e-8)
    np.testing.assert_allclose(found.common, common, atol=1e-13)
    np.testing.assert_allclose(found.twist, twist, atol=1e-5)
    np.testing.assert_allclose(found.residual, 0, atol=1e-14)


def test_formula_for_symmetric_cores_and_noise_gain():
    layout = CoreLayout.symmetric(3, RADIUS)
    rng = np.random.default_rng(0)
    strain = rng.normal(size=(4, 4, 7)) * 1e-6
    found = curvature_from_strain(strain, np.arange(7.0), layout, common_mode="centre")
    difference = strain[:, 1:] - strain[:, :1]
    unit = np.stack([np.cos(layout.angle[1:]), np.sin(layout.angle[1:])], axis=1)
    formula = -2 / (3 * RADIUS) * np.einsum("tcg,ca->tga", difference, unit)
    np.testing.assert_allclose(found.curvature, formula, rtol=1e-9, atol=1e-12)
    assert found.curvature_gain == pytest.approx(np.sqrt(2 / 3) / RADIUS)
    assert found.curvature_gain * 1e-6 == pytest.approx(0.023, abs=0.001)


def test_one_over_metre_is_35_microstrain():
    layout = CoreLayout.symmetric(4, RADIUS)
    strain = strain_of(layout, np.full((1, 5, 2), [1.0, 0.0]), np.zeros((1, 5)), np.zeros((1, 5)), np.arange(5.0))
    assert np.abs(strain).max() == pytest.approx(35e-6)
    assert strain[0, 1, 0] < 0


def test_layouts_that_cannot_work():
    line = CoreLayout([0, RADIUS, RADIUS], [0, 0, np.pi])
    with pytest.raises(InputError, match="are not on one line"):
        curvature_from_strain(np.zeros((1, 3, 4)), np.arange(4.0), line)
    with pytest.raises(InputError, match="must not be negative"):
        CoreLayout([-1.0], [0.0])
    with pytest.raises(InputError, match="radius and angle must be finite"):
        CoreLayout([1.0], [0.0, 1.0])
    layout = CoreLayout.symmetric(3, RADIUS)
    with pytest.raises(InputError, match="4 cores, 5 gauges"):
        curvature_from_strain(np.zeros((1, 3, 5)), np.arange(5.0), layout)
    with pytest.raises(InputError, match="one of centre, least-squares"):
        curvature_from_strain(np.zeros((1, 4, 5)), np.arange(5.0), layout, common_mode="mean")


def test_tip_sigma_formula_and_monte_carlo():
    ds = 0.8e-3
    s = np.arange(0, 0.17 + ds / 2, ds)
    assert tip_sigma(1.0, ds, 0.17) == pytest.approx(1.13e-3 * np.sqrt(0.8e-3 / 0.8e-3), rel=0.02)
    rng = np.random.default_rng(0)
    points = planar_curve(0.1 * rng.normal(size=(4000, s.size)), s)
    assert points[:, -1, 0].std() == pytest.approx(tip_sigma(0.1, ds, s[-1]), rel=0.05)


def strain_recording(kappa, rng=None, noise=0.0, **more):
    layout = CoreLayout.symmetric(3, RADIUS)
    curvature = np.zeros((*kappa.shape, 2))
    curvature[..., 0] = kappa
    strain = strain_of(layout, curvature, np.full(kappa.shape, 2e-4), np.zeros(kappa.shape), S)
    if noise:
        strain = strain + noise * rng.normal(size=strain.shape)
    return layout, make_recording(np.arange(len(kappa)) / 75, strain=strain, gauge_position=S + 0.3, **more)


def test_recording_of_strain_becomes_a_recording_of_shape(rng):
    kappa = np.linspace(1, 10, 6)[:, None] * (1 + 3 * S)
    layout, recording = strain_recording(kappa, rng, 1e-6, pressure=np.linspace(0, 1e5, 6), source="fibre.tsv")
    shape = shape_from_strain(recording, layout)
    expected = planar_curve(kappa, S)
    error = np.linalg.norm(shape["position"].values[..., :2] - expected, axis=2)
    assert error.max() < 0.2e-3
    np.testing.assert_allclose(shape["arc_length"].values, S)
    np.testing.assert_allclose(shape["pressure"].values, recording["pressure"].values)
    assert shape.attrs["source"] == "fibre.tsv"
    assert "shape from strain: 4 cores" in shape.attrs["history"]
    assert "twist not measured" in shape.attrs["history"]
    assert shape.attrs["tip_sigma_m"] == pytest.approx(tip_sigma(0.0233, S[1], 0.17), rel=0.1)


def test_gaps_are_bridged_when_asked_and_counted():
    kappa = np.full((4, S.size), 6.0)
    layout, recording = strain_recording(kappa)
    recording["strain"][1, 2, 50:52] = np.nan
    recording["strain"][2, :, 100:110] = np.nan
    shape = shape_from_strain(recording, layout, bridge=3, sigma_strain=1e-6)
    assert np.isfinite(shape["position"].values[[0, 1, 3]]).all()
    assert np.isfinite(shape["position"].values[2, :100]).all()
    assert np.isnan(shape["position"].values[2, 100:]).all()
    assert "2 missing strain value(s) interpolated, 1 frame(s) unknown" in shape.attrs["history"]
    assert np.isnan(recording["strain"].values).sum() == 42
    with pytest.raises(InputError, match="holds none"):
        shape_from_strain(shape, layout)
    with pytest.raises(InputError, match="must be 0 or a positive number"):
        shape_from_strain(recording, layout, bridge=-1)


def test_files_of_single_cores_keep_the_pressure_of_the_first(tmp_path):
    time, gauges = np.arange(20) * 0.02, np.linspace(0.0, 0.15, 16)
    strain = 1e-4 * np.cos(2 * np.pi * np.arange(3) / 3)
    for core in range(3):
        write(make_recording(
            time, strain=np.full((20, 1, 16), -strain[core]), gauge_position=gauges, core=[f"c{core}"],
            **({"pressure": 1e3 * time} if core == 0 else {}),
        ), tmp_path / f"push_core{core}.nc")  # fmt: skip
    cores = {"radius_um": 50, "centre": False, "files": ["core0", "core1", "core2"]}
    shape = read_shape(tmp_path / "push_core0.nc", {"cores": cores})
    np.testing.assert_allclose(shape["pressure"], 1e3 * time)
    turned = np.arccos((shape["position"][0, -1] - shape["position"][0, -2])[1] / 0.01)
    assert turned == pytest.approx(2.0 * 0.145, rel=1e-2)  # 1/m of the strain over the radius, times the way
