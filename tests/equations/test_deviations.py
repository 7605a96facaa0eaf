"""Each entry of docs/deviations.md has a test here that carries its number; code cites no entry that is absent."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from oracles.chains import PAPER_GAIN, paper_chain, workspace
from test_chain import run_forward
from test_modes_statics import frequencies
from test_velocity import run_velocities

from pliant import basic
from pliant.actuators import chen2018
from pliant.equations.chain import link_transform, tips
from pliant.equations.chamber import bladder_area
from pliant.equations.motion import acceleration
from pliant.mechanics import mechanics_of
from pliant.recording import make_recording

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "deviations.md").read_text(encoding="utf-8")
ENTRIES = re.findall(r"^## (D\d+)\. ", PAGE, re.MULTILINE)


def turn(axis, angle):
    """Rotation (3, 3) about x, y or z, by Rodrigues."""
    k = np.eye(3)["xyz".index(axis)]
    cross = np.array([[0, -k[2], k[1]], [k[2], 0, -k[0]], [-k[1], k[0], 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def pulse_tip(model):
    import pliant

    result = pliant.simulate(model, pliant.Pulse(119e3, 0.0, 1.0), duration=0.05)
    return result.tip_position.sel(link=result.link[-1]).to_numpy()


def test_entries_are_numbered_without_gaps():
    assert [f"D{i + 1}" for i in range(len(ENTRIES))] == ENTRIES


def test_every_entry_has_its_test():
    tests = {name.split("_")[1].upper() for name in globals() if re.match(r"test_d\d+_", name)}
    assert tests == set(ENTRIES)


def test_every_citation_has_its_entry():
    files = [*(ROOT / "src").rglob("*.py"), *(ROOT / "tests").rglob("*.py")]
    cited = {d for f in files for d in re.findall(r"# (D\d+)\b", f.read_text(encoding="utf-8"))}
    assert cited <= set(ENTRIES), "cited in code without an entry in docs/deviations.md"
    assert {"D1", "D2", "D3", "D6"} <= cited


def test_d1_rotation_about_z_link_along_y():
    R, p, angle = np.zeros((2, 2)), np.zeros(2), 0.4
    link_transform(angle, 0.0, 0.05, R, p)
    assert pytest.approx(turn("z", angle)[:2, :2], abs=1e-16) == R
    assert p == pytest.approx((turn("z", angle) @ [0, 0.05, 0])[:2], abs=1e-17)
    printed = turn("y", angle) @ [0, 0, 0.05]
    assert printed[1] == 0.0  # as printed the link leaves the x-y plane
    assert printed[2] != 0.0


def test_d2_product_ends_at_i():
    q, l = np.array([0.1, 0.2, 0.3]), np.full(3, 0.05)
    _, _, _, whole = run_forward(q, 0 * q, l)
    _, _, _, first = run_forward(q[:1], 0 * q[:1], l[:1])
    assert whole[0] == pytest.approx(first[0], abs=1e-17)
    other = q + np.array([0.0, 0.5, 0.5])
    assert run_forward(other, 0 * q, l)[3][0] == pytest.approx(whole[0], abs=1e-17)


def test_d3_angular_velocity_is_the_element_21():
    chain, q, dq = paper_chain(), np.full(5, 0.1), np.full(5, 2.0)
    Omega, _ = basic.body_velocities(q, dq, basic.paper())
    omega, _ = run_velocities(q, dq, chain)
    assert omega == pytest.approx(Omega[:, 1, 0])
    assert omega == pytest.approx(-Omega[:, 0, 1])
    assert omega[0] > 0.0  # a joint that opens turns its link the same way
    rate = (turn("y", 1e-6) - np.eye(3)) / 1e-6
    assert rate[0, 2] == pytest.approx(1.0)  # in the (x, z) plane the printed element would be right


def test_d4_positive_pressure_bends_to_minus_x_and_recordings_are_turned_to_it():
    import pliant

    tip = pulse_tip(chen2018.model(rest_angle=0.05))
    assert tip[-1, 0] < tip[0, 0] < 0.0
    still = 300  # frames at rest before the pressure
    tip = np.concatenate([np.repeat(tip[:1], still, axis=0), tip])
    time = np.arange(len(tip)) / 1e3
    for side in (1.0, -1.0):
        seen = make_recording(time, tip[:, None] * [side, 1.0], station=["tip"], frame="planar",
                                     pressure=np.where(time > time[still], 119e3, 0.0))  # fmt: skip
        np.testing.assert_array_equal(pliant.align(seen)["position"].values[:, 0], tip)
        np.testing.assert_array_equal(pliant.align(seen, bend=None)["position"], seen["position"])


@pytest.mark.parametrize(("unit", "expected"), [(1.0, 5.006), (180 / np.pi, 38.0), (1e-3, 0.158)])
def test_d5_only_newton_metre_per_radian_rings_at_five_hertz(unit, expected):
    chain = paper_chain()
    assert frequencies(chain._replace(K=chain.K * unit))[0] == pytest.approx(expected, rel=5e-3)


def test_d5_values_at_every_joint():
    model = chen2018.model()
    assert model.stiffness == pytest.approx(np.full(5, 1.6067))
    assert model.damping == pytest.approx(np.full(5, 8e-3))


def test_d6_area_is_that_of_the_chamber():
    inner, outer = chen2018.INNER_RADIUS, chen2018.OUTER_RADIUS
    assert bladder_area(inner) == pytest.approx(np.pi * inner**2 / 2)
    assert bladder_area(outer) > 1.9 * bladder_area(inner)  # what "cross-section" would say
    assert chen2018.model().torque == pytest.approx([PAPER_GAIN])


def test_d7_the_captions_errors_lie_within_the_texts_bounds():
    text, caption = (3.0, 1.3), (2.4, 1.2)
    assert all(c < t for c, t in zip(caption, text, strict=True))
    entry = PAGE.split("## D7.")[1].split("## D8.")[0]
    assert all(f"{x:g}" in entry for x in (*text, *caption))


def test_d8_n_segments_have_n_plus_one_nodes():
    from pliant.reduction.placement import equal_nodes

    arc_length = np.linspace(0.0, 0.1688, 212)
    for n in range(2, 6):
        nodes = equal_nodes(arc_length, n)
        assert len(nodes) == n + 1
        assert (nodes[0], nodes[-1]) == (0.0, arc_length[-1])


def test_d9_ten_millimetres_is_a_radius():
    from pliant.equations.chain import angles_from_tips

    radius = 0.010
    t = np.arange(1, 40) * 0.8e-3 / radius
    p = radius * np.column_stack([np.cos(t) - 1, np.sin(t)])
    l, phi = np.zeros(39), np.zeros(39)
    angles_from_tips(p, 0.0, 0.0, l, phi)
    assert np.diff(phi) / 0.8e-3 == pytest.approx(np.full(38, 100.0))  # 1/m


def test_d10_points_of_the_fibre_span_less_than_the_actuator():
    span = (chen2018.POINTS - 1) * chen2018.SPACING
    assert span == pytest.approx(0.1688)
    assert chen2018.model().length == pytest.approx(0.17)
    assert chen2018.LENGTH - span == pytest.approx(1.2e-3)


def test_d11_mass_at_the_tips_is_what_rings_at_five_hertz():
    assert chen2018.model().mass_at == "tip"
    assert frequencies(paper_chain("tip"))[0] == pytest.approx(5.006, abs=5e-4)
    assert frequencies(paper_chain("rod"))[0] == pytest.approx(5.916, abs=5e-4)
    assert frequencies(paper_chain("rod", m_tip=7.5e-3))[0] == pytest.approx(5.00, abs=5e-3)


def test_d12_gravity_is_an_option():
    assert chen2018.model().gravity == pytest.approx([0.0, 0.0])
    chain, a = paper_chain(), np.ones(5)
    rest = np.zeros(5)
    acceleration(rest, rest, 0.0 * rest, chain.body(), chain.joints(), workspace(5), a)
    assert np.array_equal(a, np.zeros(5))
    sideways = chain._replace(gx=9.81)
    acceleration(rest, rest, 0.0 * rest, sideways.body(), sideways.joints(), workspace(5), a)
    assert a[0] < 0.0  # pulled to +x


def test_d13_recorded_at_75_hertz():
    assert pytest.approx(75.0) == chen2018.FRAME_RATE


def test_d15_springs_are_straight_unless_told_otherwise():
    model = chen2018.model()
    assert np.array_equal(model.stiffening, np.zeros(5))
    assert np.array_equal(mechanics_of(model).joints.hardening, np.zeros((2, 5)))


def test_d14_the_default_rule_follows_the_stiff_reference():
    import pliant

    model, pulse = chen2018.model(), pliant.Pulse(119e3, 0.12, 2.76)
    runs = [
        pliant.simulate(model, pulse, duration=0.4, time_step=2.5e-4, method=method).tip_position.to_numpy()
        for method in ("midpoint", "BDF")
    ]
    assert np.abs(runs[0] - runs[1]).max() < 5e-6
    p = np.zeros((5, 2))
    tips(np.zeros(5), model.link_length, 0.0, 0.0, p)
    assert runs[0][0] == pytest.approx(p)
