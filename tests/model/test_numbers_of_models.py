"""Numbers of a model against closed forms, and each of its limits from just below and just above."""

from __future__ import annotations

import numpy as np
import pytest

from pliant.equations.laws import POLYNOMIAL
from pliant.equations.spring_terms import in_words
from pliant.errors import InputError
from pliant.model import Chamber, Extension, Memory, Model, Station, Tendon, Valve, chain_model
from pliant.model.actuation import Actuation, chambers_of
from pliant.model.chamber import grown, remembering
from pliant.model.checks import check_numbers, numbers, one_number
from pliant.model.elastic_wall import coefficients, start
from pliant.model.extensible import extensible_inertia, joints_inside, least_inertia
from pliant.model.extension import shares
from pliant.model.inertia import inertia_constants
from pliant.model.memory import payne, springpot
from pliant.model.parts import declared
from pliant.model.space import Space, rows_of, space_of
from pliant.model.summary import bending_stiffness, joint_placement, segments
from pliant.model.torque_law import laid_torque, unfinished_law

LIMITS = {d.name: d.quantity for d in declared() if np.isfinite(d.quantity.most)}
SIZES = {"link_length": [0.1, 0.2], "link_mass": [0.02, 0.03], "stiffness": [1.5, 2.0], "damping": 0.01}
PLAIN = Model(**SIZES, torque=[1e-6])


def test_zero_is_a_size_of_all_but_what_divides():
    """Lengths, springs and times; an exponent begins at 1."""
    refused = {name for name, limit in LIMITS.items() if limit.least > 0 and not limit.zero}
    for name in refused:
        with pytest.raises(InputError) as caught:
            LIMITS[name].check_limit("model", name, 0.0)
        assert "or be 0" not in str(caught.value)
    for name in set(LIMITS) - refused:
        LIMITS[name].check_limit("model", name, 0.0)
    assert refused == {"link_length", "stiffness", "axial_stiffness", "swell_time", "inflation_time",
                       "valve_settle_time", "creep_time", "slip_angle", "axial_creep_time", "axial_slip_strain",
                       "slip_rate", "boucwen_exponent"}  # fmt: skip
    with pytest.raises(InputError, match=r"1 to 1e\+12 Pa, or be 0, got 0\.5: check"):
        LIMITS["inflation_limit"].check_limit("model", "inflation_limit", 0.5)
    with pytest.raises(InputError, match=r"size of 0 to 1e\+06, got 2e\+06"):
        LIMITS["creep_share"].check_limit("model", "creep_share", 2e6)


@pytest.mark.parametrize(
    ("kind", "value", "said"),
    [
        ("positive", 0.0, "must be positive"),
        ("positive", 1e-13, "must have a size"),
        ("positive", np.nan, "must be finite"),
        ("not_negative", -1e-9, "must not be negative"),
        ("not_negative", np.inf, "must be finite"),
        ("free", -2e9, "size"),
        ("free", 2e9, "size"),
        ("free", -np.inf, "finite"),
        ("not_negative", 0.0, None),
        ("free", -1e8, None),
    ],
)
def test_signs_and_sizes_of_numbers(kind, value, said):
    name = {"positive": "stiffness", "not_negative": "damping", "free": "cubic_stiffening"}[kind]
    for given in (value, np.array([1.0, value]), np.array([value])):
        of = object.__new__(Model)
        of.__dict__[name] = given
        if said is None:
            check_numbers(of, "model", (name,))
            continue
        with pytest.raises(InputError, match=f"model {name} .*{said}"):
            check_numbers(of, "model", (name,))
    with pytest.raises(InputError, match=r"one row of numbers, got shape \(1, 2\)"):
        numbers("gravity", [[1, 2]])
    with pytest.raises(InputError, match="must be one number, got 2"):
        one_number("tip_mass", [1, 2])
    assert one_number("tip_mass", [3]) == 3.0


def test_a_wall_in_proportion_to_its_pressure_in_closed_form():
    a, c = 2e-6, 3e-7
    p = np.linspace(0, 2e5, 9)
    law = coefficients(a, c)
    np.testing.assert_allclose(np.polyval([*law[::-1], 0.0], p), a * p * (1 + c * p) ** 3, rtol=1e-12)
    found = start(p, a * p * (1 + c * p) ** 3)
    assert (found["lever"], found["compliance"]) == (pytest.approx(a), pytest.approx(c))
    assert start(np.array([0.0, 1e5, 1e5]), np.array([9.0, 0.1, 0.1])) == {
        "lever": pytest.approx(1e-6),
        "compliance": 0.0,
    }


def test_a_torque_law_needs_all_of_its_numbers():
    laid = laid_torque({"elastic_wall_lever": 1e-6, "elastic_wall_compliance": 1e-7})
    assert laid["law"] == POLYNOMIAL
    assert laid["torque"] == pytest.approx(coefficients(1e-6, 1e-7))
    assert laid_torque({"stiffness": 1.0}) == {}
    with pytest.raises(InputError, match="elastic_wall_compliance is missing"):
        laid_torque({"elastic_wall_lever": 1e-6})
    with pytest.raises(InputError, match=r"one torque law: leave out all but one of elastic_wall_\*, torque_<k>"):
        laid_torque({"elastic_wall_lever": 1e-6, "elastic_wall_compliance": 0.0, "torque_1": 1.0})
    assert unfinished_law("elastic_wall_lever", {"elastic_wall_compliance"})
    assert unfinished_law("near.elastic_wall_lever", {"elastic_wall_compliance"})
    assert not unfinished_law("elastic_wall_lever", {"stiffness"})
    assert not unfinished_law("stiffness", {"elastic_wall_compliance"})


@pytest.mark.parametrize("exponent", [0.2, 0.5])
def test_slip_elements_make_a_polygon_of_paynes_curve(exponent):
    """At the amplitudes of the band, three a decade, first loading has the curve's torque and slope."""
    share, angle, low, high = 0.7, 0.02, 1e-3, 1e-1
    laid = payne(share, angle, exponent, low, high)
    assert len(laid.slip_share) == 7

    def curve(x):
        return share * x / (1 + (x / angle) ** (2 * exponent))

    def polygon(x):
        elements = zip(laid.slip_share, laid.slip_angle, strict=True)
        return laid.spring * x + sum(s * min(x, a) for s, a in elements)

    def slope(f, x):
        return (f(x * (1 + 1e-6)) - f(x * (1 - 1e-6))) / (2e-6 * x)

    for x in np.geomspace(low, high, 7):
        assert polygon(x) == pytest.approx(curve(x), rel=1e-9)
        assert slope(polygon, x) == pytest.approx(slope(curve, x), rel=1e-5)
    assert slope(polygon, 1e-9) == pytest.approx(share)
    assert len(payne(share, angle, exponent, 1e-6, 1e-1).slip_share) == 16
    with pytest.raises(InputError, match="needs 17 slip elements, but a Memory has at most 16"):
        payne(share, angle, exponent, 1e-6, 1.2e-1)


def test_branches_of_a_springpot_follow_its_power_over_the_band():
    laid = springpot(0.4, 0.3, 0.1, 100.0)
    assert len(laid.creep_share) == 2 * 4 + 1
    for hertz in np.geomspace(0.1, 100.0, 9):
        s = 2j * np.pi * hertz
        found = laid.spring + sum(
            a * s * t / (1 + s * t) for a, t in zip(laid.creep_share, laid.creep_time, strict=True)
        )
        assert abs(found / (0.4 * s**0.3) - 1) < 0.045
    assert len(springpot(0.4, 0.3, 0.1, 0.1 * 10**6.5).creep_share) == 16
    with pytest.raises(InputError, match="needs 17 branches, but a Memory has at most 16"):
        springpot(0.4, 0.3, 0.1, 0.1 * 10**6.6)


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"creep_share": (0.1,)}, r"creep_share and creep_time must have the same length, got 1 and 0"),
        ({"slip_share": (0.1,), "slip_angle": (0.0,)}, "slip_angle must be positive"),
        ({"creep_share": (0.1,) * 17, "creep_time": (1.0,) * 17}, "at most 16 branches of a kind, got 17"),
        ({"slip_share": (0.1,) * 17, "slip_angle": (1.0,) * 17}, "at most 16 branches of a kind, got 17"),
        ({"boucwen_beta": 1.0, "boucwen_gamma": 1.1}, "at least"),
        ({"boucwen_beta": 1.0, "boucwen_gamma": -1.1}, "at least"),
        ({"boucwen_beta": 1.0, "boucwen_gamma": -1.0}, "their sum positive"),
        ({"boucwen_exponent": 0.99}, "at least 1"),
        ({"creep_share": [[0.1]]}, "a row of numbers"),
        ({"boucwen_share": [0.1]}, "one number"),
        ({"creep_share": (-0.1,), "creep_time": (1.0,)}, "not negative"),
        ({"creep_share": "ab"}, "must be numbers"),
    ],
)
def test_memories_that_cannot_be(values, said):
    with pytest.raises(InputError, match=said):
        Memory(**values)


def test_memories_that_can_be():
    Memory(boucwen_share=0.1, boucwen_beta=1.0, boucwen_gamma=1.0, boucwen_exponent=1.0)
    Memory(boucwen_share=0.1, boucwen_beta=1.0, boucwen_gamma=-0.9)
    Memory((0.1,) * 16, (1.0,) * 16, (0.1,) * 16, (1.0,) * 16)
    memory = Memory((0.1, 0.2), (1.0, 2.0), (0.3,), (0.01,), boucwen_share=0.4)
    assert memory.labels == ("creep_1", "creep_2", "slip_1", "boucwen")
    assert memory.instantaneous == pytest.approx(1.0)
    assert [
        bool(m) for m in (Memory(), Memory((0.1,), (1.0,)), Memory((), (), (0.1,), (1.0,)), Memory(boucwen_share=0.1))
    ] == [False, True, True, True]


@pytest.mark.parametrize(
    ("values", "good"),
    [
        ({"settle_share": 1.0, "settle_time": 0.5}, True),
        ({"settle_share": 1.01}, False),
        ({"settle_time": 0.0}, False),
        ({"settle_share": 0.5, "settle_time": 1e-7}, False),
        ({"natural_frequency": 5.0, "damping_ratio": 0.0}, False),
        ({"damping_ratio": 0.0}, True),
        ({"rise_time": -0.1}, False),
        ({"dead_time": np.nan}, False),
        *(({"natural_frequency": 5.0, k: 1.0}, False) for k in ("rise_time", "fall_time", "rise_rate", "fall_rate")),
        ({"natural_frequency": 5.0, "dead_time": 0.1, "dead_band": 10.0}, True),
        ({"dead_band": 2e7}, False),
        ({"opening_time": 0.1, "rise_time": 0.1}, True),
        ({"opening_time": 1e-7}, False),
    ],
)
def test_valves_that_can_and_cannot_be(values, good):
    if good:
        Valve(**values)
        return
    with pytest.raises(InputError, match="valve"):
        Valve(**values)


# joints and sections


@pytest.mark.parametrize(
    ("links", "stub", "placement"),
    [
        ([0.1, 0.1, 0.05], 0.05, "midsegment"),
        ([0.1, 0.1, 0.05], 0.0546, "midsegment"),
        ([0.1, 0.1, 0.05], 0.0556, "base"),
        ([0.1, 0.1, 0.05], 0.0454, "midsegment"),
        ([0.1, 0.1, 0.05], 0.0444, "base"),
        ([0.1, 0.1, 0.05], 0.0, "base"),
        ([0.056, 0.1, 0.05], 0.05, "midsegment"),
        ([0.054, 0.1, 0.05], 0.05, "base"),
        ([0.1], 0.1, "midsegment"),
        ([0.1], 0.0, "base"),
        ([0.1, 0.1], 0.1, "base"),
    ],
)
def test_joints_sit_in_the_middle_where_stub_and_last_link_are_alike(links, stub, placement):
    model = Model(link_length=links, link_mass=[0.01] * len(links), stiffness=2.0, damping=0.01, torque=[1e-6],
                  base_length=stub)  # fmt: skip
    assert joint_placement(model) == placement
    assert segments(model).sum() == pytest.approx(sum(links) + (stub if placement == "midsegment" else 0.0))
    if placement == "midsegment" and len(links) == 3:
        joints = stub + np.array([0.0, links[0], links[0] + links[1]])
        borders = [0.0, (joints[0] + joints[1]) / 2, (joints[1] + joints[2]) / 2, stub + sum(links)]
        np.testing.assert_allclose(bending_stiffness(model), 2.0 * np.diff(borders))


@pytest.mark.parametrize(
    ("length", "mass", "links", "said"),
    [
        (0.0, 1.0, 2, "positive"),
        (1.0, 0.0, 2, "positive"),
        (np.inf, 1.0, 2, "positive"),
        (1.0, np.nan, 2, "positive"),
        (1.0, 1.0, 0, "at least one link, got 0"),
    ],
)
def test_uniform_bodies(length, mass, links, said):
    with pytest.raises(InputError, match=said):
        chain_model(length=length, mass=mass, links=links, stiffness=1.0, damping=0.01, torque=[1e-6])
    body = chain_model(length=0.3, mass=0.6, links=3, stiffness=1.0, damping=0.01, torque=[1e-6],
                       joint_placement="midsegment", base_length=0.02)  # fmt: skip
    np.testing.assert_allclose(body.link_length, [0.1, 0.1, 0.05])
    np.testing.assert_allclose(body.link_mass, [0.2, 0.2, 0.1])
    assert (body.base_length, body.length) == (pytest.approx(0.07), pytest.approx(0.32))
    with pytest.raises(InputError, match="'base' or 'midsegment', got 'tip'"):
        chain_model(length=0.3, mass=0.6, stiffness=1.0, damping=0.01, torque=[1e-6], joint_placement="tip")
    assert chain_model(length=0.3, mass=0.6, stiffness=1.0, damping=0.01, torque=[1e-6]).n == 5


def test_inertia_of_two_rods_in_closed_form():
    """B of links at their centres, m l^2 / 12 about them, first moments m l / 2 and what hangs behind."""
    (a, b), (m, k), tip = (0.1, 0.2), (0.02, 0.03), 0.01
    B, rotary, h = inertia_constants(np.array([a, b]), np.array([m, k]), tip, rod=True)
    off = a * (k * b / 2 + tip * b)
    np.testing.assert_allclose(B, [[m * a**2 / 4 + (k + tip) * a**2, off], [off, k * b**2 / 4 + tip * b**2]])
    np.testing.assert_allclose(rotary, [m * a**2 / 12, k * b**2 / 12])
    np.testing.assert_allclose(h, [m * a / 2 + (k + tip) * a, k * b / 2 + tip * b])
    B, rotary, h = inertia_constants(np.array([a, b]), np.array([m, k]), tip, rod=False)
    np.testing.assert_allclose(B, [[(m + k + tip) * a**2, (k + tip) * a * b], [(k + tip) * a * b, (k + tip) * b**2]])
    assert not rotary.any()
    np.testing.assert_allclose(h, [(m + k + tip) * a, (k + tip) * b])


def test_inertia_of_a_body_that_lengthens():
    """The stub before the first joint has no mass of its own; a strain moves each place by its distance."""
    model = PLAIN.with_(base_length=0.05, extensions=(Extension(50.0),))
    B, h = extensible_inertia(model)
    plain, rotary, first = inertia_constants(np.array([0.05, 0.1, 0.2]), np.array([0.0, 0.02, 0.03]), 0.0, rod=True)
    np.testing.assert_allclose(B, plain + np.diag(rotary))
    np.testing.assert_allclose(np.diag(B)[1:], np.diag(plain)[1:] + rotary[1:])
    np.testing.assert_allclose(rotary[1:], [0.02 * 0.1**2 / 12, 0.03 * 0.2**2 / 12])
    np.testing.assert_allclose(h, first)
    whole = np.ones((3, 1))
    from_base = 0.02 * (0.05**2 + 0.05 * 0.1 + 0.1**2 / 3) + 0.03 * (0.15**2 + 0.15 * 0.2 + 0.2**2 / 3)
    assert (whole.T @ B @ whole)[0, 0] == pytest.approx(from_base)
    assert least_inertia(B, whole) == pytest.approx(1.0)
    two = np.array([[1.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    axial = two.T @ B @ two
    assert least_inertia(B, two) == pytest.approx(1 - axial[0, 1] / np.sqrt(axial[0, 0] * axial[1, 1]))
    assert least_inertia(B, np.array([[1.0, 0], [1, 0], [1, 0]])) == 0.0  # nothing moves by the second


def test_segments_hold_parts_of_links_and_joints():
    found = shares(np.array([0.1, 0.2]), 0.05, (Extension(1.0, 0.0, 0.0, 0.1), Extension(1.0, 0.0, 0.1, None)))
    np.testing.assert_allclose(found, [[1, 0], [0.5, 0.5], [0, 1]])
    assert shares(np.array([0.1]), 0.0, (Extension(1.0, 0.0, 0.0, 0.1 + 5e-11),))[1, 0] == 1.0
    assert shares(np.array([0.1]), 0.0, (Extension(1.0, 0.0, 0.1 - 5e-11, 0.3),))[1, 0] == 0.0
    ends = (Extension(50.0, 0.0, 0.0, 0.05, "a"), Extension(50.0, 0.0, 0.05, None, "b"))
    model = PLAIN.with_(base_length=0.05, extensions=ends)
    assert joints_inside(model) == ((), (0, 1))
    np.testing.assert_allclose(model.segment_length, [0.05, 0.3])
    assert model.size == 4
    later = (Extension(50.0, 0.0, 0.0, 0.15, "a"), Extension(50.0, 0.0, 0.15, None, "b"))
    assert joints_inside(model.with_(extensions=later)) == ((0,), (1,))
    for pair, said in (
        ((Extension(50.0, 0.0, 0.0, 0.2, "a"), Extension(50.0, 0.0, 0.1, None, "b")), "must not overlap, but a, b do"),
        ((Extension(50.0, name="a"), Extension(50.0, 0.0, 0.4, 0.5, "a")), "but .a. is the name of 2 of 2"),
        ((Extension(50.0, 0.0, 0.4, 0.5, "far"),), r"'far' lies beyond the body, which is 0\.35 m long"),
        (
            tuple(Extension(50.0, 0.0, 0.01 * k, 0.01 * (k + 1), f"e{k}") for k in range(4)),
            "cannot follow 4 independent",
        ),
    ):
        with pytest.raises(InputError, match=said):
            model.with_(extensions=pair)
    with pytest.raises(InputError, match=r"axial_gain must be one number or 2 .*, got 3"):
        model.with_(chambers=(Chamber([1e-6], axial_gain=[1.0, 2, 3]),))
    for values in ({"stiffness": 0.0}, {"stiffness": -1.0}, {"stiffness": 1.0, "damping": -1e-3},
                   {"stiffness": 1.0, "start": 0.2, "stop": 0.2}, {"stiffness": 1.0, "start": -0.1},
                   {"stiffness": 1.0, "stop": np.nan}):  # fmt: skip
        with pytest.raises(InputError, match="extension 'body'"):
            Extension(**values)


# chambers and inputs


def two_chambers(**more):
    near = Chamber([1e-6, 2e-12], joint_gain=[1.0, 0.0], axial_gain=[3.0], name="near", **more)
    return near, Chamber([-5e-7], joint_gain=[0.0, 1.0], axial_gain=[0.0], name="far")


def test_gains_of_joints_and_of_segments():
    ends = ((0,), (1,))
    near, far = two_chambers()
    both = Actuation((near, far), 2, (0.1, 0.2), ends)
    np.testing.assert_allclose(both.gain, [[1, 0, 3 * 0.1, 0], [0, 1, 0, 0]])  # where it turns a joint
    free = Chamber([1e-6], joint_gain=[0.0], axial_gain=[2.0], name="x")
    np.testing.assert_allclose(Actuation((free,), 2, (0.1, 0.2), ends).gain, [[0, 0, 0.2, 0.4]])
    each = Chamber([1e-6], joint_gain=[1.0, 0.0], axial_gain=[2.0, 5.0], name="x")
    np.testing.assert_allclose(Actuation((each,), 2, (0.1, 0.2), ends).gain, [[1, 0, 0.2, 1.0]])
    np.testing.assert_allclose(Actuation((near, far), 2).gain, [[1, 0], [0, 1]])
    assert both.labels("pressure") == ["pressure_near", "pressure_far"]
    assert Actuation((near,), 2).labels("pressure") == ["pressure"]
    assert (both.count, both.names, both.listing, both.units) == (2, ("near", "far"), "near, far", ("Pa", "Pa"))
    assert not both.remembers
    assert Actuation(two_chambers(swell_share=0.1), 2).remembers
    assert Actuation(two_chambers(inflation_limit=1e6), 2).remembers
    np.testing.assert_allclose(both.kernel().law, [[1e-6, 2e-12], [-5e-7, 0.0]])
    across = Chamber([1e-6], joint_gain=[1.0, 2.0], cross_gain=[3.0, 4.0], name="x")
    for turns in (2, 3):
        np.testing.assert_allclose(Actuation((across,), 2, turns=turns).gain, [[1, 3, 2, 4, *[0] * 2 * (turns - 2)]])


def test_tendons_take_a_row_for_their_command():
    pulled = Tendon(joint_gain=[1.0, 0.5], lever=0.01, line_stiffness=1e4, name="line") if Tendon else None
    both = Actuation((Chamber([1e-6], name="c"), pulled), 2, turns=2)
    assert both.tendons == (1,)
    assert both.columns.tolist() == [[1.0, 0, 1.0, 0, 0], [0, 0, 0, 0, 1.0]]
    np.testing.assert_allclose(both.gain[1], [0.01, 0, 0.005, 0])
    assert Actuation((Chamber([1e-6]),), 2).columns.shape == (1, 2)


def test_pressures_of_several_inputs():
    both = Actuation(two_chambers(), 2)
    np.testing.assert_allclose(both.pressures(0), [0, 0])
    np.testing.assert_allclose(both.pressures([1e4, 2e4]), [1e4, 2e4])
    for wrong in (1.0, [1.0, 2, 3], [[1.0, 2]]):
        with pytest.raises(InputError, match=r"expected 2 pressure\(s\) in Pa, one for each chamber \(near, far\)"):
            both.pressures(wrong)
    torque = [1e-6 * 1e4 + 2e-12 * 1e8, -5e-7 * 2e4]
    np.testing.assert_allclose(both.torques([1e4, 2e4]), torque)
    np.testing.assert_allclose(both.joint_torques([1e4, 2e4]), torque)
    p = np.array([[1e4, 2e4], [0.0, 1e4]])
    np.testing.assert_allclose(both.torques_over(p), [torque, [0, -5e-3]])
    np.testing.assert_allclose(both.joint_torques_over(p), [torque, [0, -5e-3]])
    np.testing.assert_allclose(Actuation(two_chambers()[1:], 2).torques_over([1e4, 2e4]), [[-5e-3], [-1e-2]])
    with pytest.raises(InputError, match=r"expected pressures \(T, 2\): 2 pressure\(s\) in Pa"):
        both.torques_over([1e4, 2e4])
    one = Actuation(two_chambers()[:1], 2)
    with pytest.raises(InputError, match=r"got shape \(1, 1, 1\)"):
        one.torques_over(np.zeros((1, 1, 1)))


def test_a_soft_wall_multiplies_the_torque_at_rest():
    soft = Chamber([1e-6, 2e-12], inflation_limit=1e5, name="soft")
    hard = Chamber([1e-6, 2e-12])
    for p, growth in ((5e4, 2.0), (9e4, 10.0)):
        assert soft.growth_at(p) == pytest.approx(growth)
        ratio = soft.torque_at(p) / hard.torque_at(p)
        assert ratio == pytest.approx(growth**0.75)  # the lever grows with the cube of the stretch
        np.testing.assert_allclose(soft.rest_state(p), [p, growth])
    assert soft.no_rest(9e4) == hard.no_rest(2e5) == ""
    said = soft.no_rest(1e5)
    assert "no equilibrium at 100000 Pa: its wall expands without bound from its inflation_limit of 100000 Pa" in said
    assert Actuation((soft,), 1).no_rest([1e5]) == soft.no_rest(1e5)
    with pytest.raises(InputError, match="do not support a hyperelastic wall"):
        soft.torque_slope(1e4)
    values = {"inflation_limit": np.array([1e5, 0.0]), "swell_share": np.zeros(2), "inflation_jm": np.zeros(2)}
    np.testing.assert_allclose(grown(np.ones(2), np.full(2, 5e4), values), [2.0**0.75, 1.0])
    assert remembering(values).tolist() == [True, False]
    assert remembering({"inflation_limit": np.zeros(2), "swell_share": np.array([0.0, 0.1])}).tolist() == [False, True]


def test_the_slope_of_a_law_holds_the_part_that_swells():
    for share in (0.0, 0.25, 1.0):
        made = Chamber([1e-6, 2e-12, 3e-18], swell_share=share)
        p = 5e4
        lever, rise = 1e-6 + 2e-12 * p + 3e-18 * p**2, 2e-12 + 6e-18 * p
        assert made.torque_slope(p) == pytest.approx(lever + p * (1 - share) * rise)
        assert made.lever_at(p) == pytest.approx(lever)
        assert (made.swells, made.plain) == (share > 0, share == 0)


def test_the_key_of_a_chamber_is_all_that_its_torque_depends_on():
    base = {"torque": [1e-6, 2e-12], "valve": Valve(rise_time=0.1), "swell_share": 0.1, "swell_time": 2.0,
            "inflation_limit": 1e6, "inflation_time": 0.2}  # fmt: skip
    changes = {"torque": [1e-6, 3e-12], "valve": Valve(rise_time=0.2), "swell_share": 0.2, "swell_time": 3.0,
               "inflation_limit": 2e6, "inflation_time": 0.3}  # fmt: skip
    for name, value in changes.items():
        assert Chamber(**base).key != Chamber(**{**base, name: value}).key, name
    assert Chamber(**base).key == Chamber(**base, joint_gain=[0.5]).key
    assert len({Chamber(**base).key, Chamber(**base).key}) == 1


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"torque": []}, "at least one coefficient"),
        ({"torque": [1e-6] + [0.0] * 16}, "at most 16 numbers, got 17"),
        ({"torque": [1e4]}, "torque must have a size"),
        ({"torque": [1e-6], "swell_share": 1.01}, "at most 1"),
        ({"torque": [1e-6], "joint_gain": [2e6]}, "joint_gain must have a size"),
        ({"torque": [1e-6], "valve": 3}, "must be a Valve"),
        ({"torque": [1e-6], "cross_gain": [np.nan]}, "cross_gain must be finite"),
        ({"torque": [1e-6], "law": "x"}, "law must be one of"),
        ({"torque": [1e-6], "axial_gain": [2e6]}, "axial_gain must have a size"),
        ({"torque": [1e-6], "swell_time": 0.0}, "positive"),
    ],
)
def test_chambers_that_cannot_be(values, said):
    with pytest.raises(InputError, match=said):
        Chamber(**values)
    Chamber([1e-6] + [0.0] * 15, swell_share=1.0)
    assert Chamber.at_offset(2e-4, -0.01, [1.0, 1.0]).joint_gain.tolist() == [-1.0, -1.0]
    assert Chamber.at_offset(2e-4, -0.01, [1.0]).torque == pytest.approx([2e-6])
    assert Chamber.at_offset(2e-4, -0.01, [1.0]).axial_gain == pytest.approx([100.0])
    for area, offset in ((0.0, 0.01), (-1e-4, 0.01), (1e-4, 0.0), (np.inf, 0.01)):
        with pytest.raises(InputError, match="a positive area"):
            Chamber.at_offset(area, offset, [1.0])


def test_a_model_has_chambers_or_the_numbers_of_one():
    near, far = two_chambers()
    assert chambers_of({}, [near, far]) == (near, far)
    for values, given, said in (
        ({"torque": [1e-6]}, (near,), "not both"), ({}, (near, near), "but .near. is the name of 2 of 2"),
        ({}, (), "needs a torque law"),
    ):
        with pytest.raises(InputError, match=said):
            chambers_of(values, given)
    assert PLAIN.with_(tip_mass=0.01).mass == pytest.approx(0.06)
    assert [p.along for p in PLAIN.points] == [0.1, 0.2]
    np.testing.assert_allclose(
        PLAIN.with_(base_length=0.1, base_angle=0.3).first_joint, 0.1 * np.array([-np.sin(0.3), np.cos(0.3)])
    )


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"mass_at": "middle"}, "'rod' or 'tip'"),
        ({"stiffening_bound": 1.0}, "must be below 1"),
        ({"link_mass": [0.0, 0.1]}, "positive for every link"),
        ({"link_mass": [0.1, 0.0]}, "positive for every link"),
        ({"link_mass": [0.1, 1e-13]}, "must have a size"),
        ({"gravity": [0.0, 0.0, -9.81]}, r"must be 2 numbers"),
        ({"stations": [Station("a", 2, 0.0)]}, r"must sit on a link 0\.\.1 or the base"),
        ({"stations": [Station("a", -2, 0.0)]}, "must sit on a link"),
        ({"stations": [Station("a", 0, 2e3)]}, "station along"),
        ({"stations": [Station("a", 0, 0.1), Station("a", 1, 0.1)]}, "must have different names"),
        ({"stations": [Station("a", 0, 0.1, 0.0, 0.1)]}, "out of the bending plane"),
        ({"stations": [Station("a", 0, np.nan)]}, "must sit"),
        ({"stations": [Station(f"s{k}", 0, 0.0) for k in range(4097)]}, "at most 4096 stations, got 4097"),
    ],
)
def test_bodies_that_cannot_be(changes, said):
    with pytest.raises(InputError, match=said):
        PLAIN.with_(**changes)


def test_bodies_that_can_be():
    PLAIN.with_(stations=[Station("a", -1, 0.1), Station("b", 1, 0.0)])
    PLAIN.with_(stations=[Station(f"s{k}", 0, 0.0) for k in range(4096)])
    PLAIN.with_(link_mass=[0.1, 0.0], tip_mass=1e-12)
    PLAIN.with_(stiffening_bound=0.99)
    assert in_words(1) == "K q (1 + s q)"
    assert in_words(2) == "K q (1 + s q + a q^2)"


@pytest.mark.parametrize(
    ("values", "good"),
    [
        ({"stiffness_ratio": 0.0}, False),
        ({"stiffness_ratio": 9.9e3}, True),
        ({"stiffness_ratio": 1.1e4}, False),
        ({"twist_ratio": 9.9e3, "radius": 0.01}, True),
        ({"twist_ratio": 1.1e4, "radius": 0.01}, False),
        ({"twist_ratio": -0.1, "radius": 0.01}, False),
        ({"twist_ratio": 0.5}, False),
        ({"radius": 99.0}, True),
        ({"radius": 101.0}, False),
        ({"radius": -1.0}, False),
        ({"rest_turn": [0.0, 0.0, 3.14]}, True),
        ({"rest_turn": [[0.0, 0.0, 0.0], [0.0, 3.0, 1.0]]}, False),
        ({"rest_turn": [1.0, 2.0]}, False),
        ({"base_tilt": [1.0, 2.0, 3.0]}, True),
        ({"base_tilt": [1.0]}, False),
        ({"base_tilt": [np.nan, 0.0]}, False),
        ({"rest_turn": []}, False),
    ],
)
def test_spaces_that_can_and_cannot_be(values, good):
    if good:
        space = Space(**values)
        assert space == Space(**values)
        assert space.turns == (3 if values.get("twist_ratio") else 2)
        assert space.rest_of(4).shape == (4, 3)
        return
    with pytest.raises(InputError, match="space"):
        Space(**values)


def test_what_is_a_space():
    assert space_of(None) is space_of(False) is None
    assert space_of(True) == space_of({}) == Space()
    assert space_of({"radius": 0.01}) == Space(radius=0.01) != Space()
    assert space_of({"radius": 0.01}) != 3
    for wrong, said in (({"size": 1}, "no parameter 'size'"), (3, "must be a Space")):
        with pytest.raises(InputError, match=said):
            space_of(wrong)
    assert not rows_of("base_tilt", [1, 2], (2,)).flags.writeable
    deep = PLAIN.with_(space=Space(), gravity=[0.0, 0.0, -9.81])
    assert deep.size == 4
    for change, said in (
        ({"rest_angle": [0.0, 0.1]}, "has no rest_angle: set rest_turn of its space"),
        ({"base_angle": 0.1}, "base_angle: set base_tilt of its space"),
        ({"mass_at": "tip"}, "mass_at: leave it out"),
        ({"gravity": [0.0, -9.81]}, "must be 3 numbers"),
        ({"space": Space(rest_turn=np.zeros((3, 3)))}, "one row or 2, got 3"),
    ):
        with pytest.raises(InputError, match=said):
            deep.with_(**change)
    deep.with_(space=Space(rest_turn=np.zeros((2, 3))))
    with pytest.raises(InputError, match="cross_gain, which needs a model in space"):
        PLAIN.with_(chambers=(Chamber([1e-6], cross_gain=[0.0, 1.0]),))
