"""Tendons, walls, segments and files of a model: what each number does, at its edge and by default."""

from __future__ import annotations

import json
from dataclasses import asdict, fields, is_dataclass

import numpy as np
import pytest
from scipy.optimize import brentq

from pliant.errors import InputError
from pliant.model import Chamber, Extension, Memory, Model, Station, Tendon, Valve, chain_model, summary
from pliant.model import file as model_file
from pliant.model.actuation import LEAST, Actuation
from pliant.model.actuation_input import rest_of_gent
from pliant.model.extension import shares
from pliant.model.memory import payne
from pliant.model.space import Space

SIZES = {"link_length": [0.1, 0.2], "link_mass": [0.02, 0.03], "stiffness": [1.5, 2.0], "damping": 0.01}
PLAIN = Model(**SIZES, torque=[1e-6])
LINE = {"joint_gain": [1.0, 0.0, 0.0], "lever": 0.01}


# files


@pytest.mark.parametrize(
    ("entry", "kind", "needed"),
    [
        (model_file.StationEntry, Station, {"name": "tip", "link": 0, "along": 0.1}),
        (model_file.SpaceEntry, Space, {}),
        (model_file.ValveEntry, Valve, {}),
        (model_file.ChamberEntry, Chamber, {"name": "c", "torque": [1e-6], "joint_gain": [1.0]}),
        (model_file.TendonEntry, Tendon,
         {"driven_by": "tension", "name": "t", "joint_gain": [1.0], "cross_gain": [0.0], "lever": 0.01}),
        (model_file.ExtensionEntry, Extension, {"name": "e", "stiffness": 40.0}),
        (model_file.MemoryEntry, Memory, {}),
    ],
)  # fmt: skip
def test_what_a_file_leaves_out_is_what_the_model_takes_by_default(entry, kind, needed):
    made = kind(**needed)
    for name, value in entry(**needed).model_dump().items():
        own = getattr(made, name)
        np.testing.assert_equal(value, asdict(own) if is_dataclass(own) else np.array(own).tolist(), err_msg=name)


def test_a_file_of_the_needed_entries_alone_is_a_model_of_them():
    needed = {**{k: np.broadcast_to(v, 2).tolist() for k, v in SIZES.items()}, "rest_angle": [0.0, 0.0]}
    made = model_file.read_model(json.dumps({**needed, "torque": [1e-6]}), "here")
    assert made == PLAIN
    with pytest.raises(InputError, match=r"^here: .*tip_mass"):
        model_file.read_model(json.dumps({**needed, "torque": [1e-6], "tip_mass": -1.0}), "here")


def test_a_file_has_an_entry_a_line(tmp_path):
    text = model_file.save_model(PLAIN, tmp_path / "m.json").read_text()
    assert '\n "name": "model",\n' in text
    assert text.endswith("}\n")


def test_a_checksum_is_that_of_the_entries_in_any_order(tmp_path):
    path = model_file.save_model(PLAIN, tmp_path / "m.json")
    content = json.loads(path.read_text())
    path.write_text(json.dumps(dict(reversed(content.items()))))
    assert model_file.load_model(path) == PLAIN
    path.write_text(json.dumps({**content, "tip_mass": 0.001}))
    with pytest.raises(InputError, match="its checksum differs"):
        model_file.load_model(path)


# tendons


def test_a_pair_of_tendons_turns_joints_to_opposite_sides_and_shortens_both():
    """Its second tendon has the levers of the first with the other sign, but draws in the same segments."""
    pair = Tendon(**LINE, cross_gain=[0.5, 0, 0], driven_by="displacement", line_stiffness=2e3, pretension=3.0,
                  pair=True, friction=0.2, slip_rate=2e-3, name="pair")  # fmt: skip
    lone = Tendon(joint_gain=[0.0, 0.0, 0.0], cross_gain=[0.0, 1.0, 1.0], lever=0.02, name="lone", pretension=9.0)
    both = Actuation((pair, Chamber([1e-6], name="c"), lone), 3, (0.1, 0.2), ((0, 1), (2,)), 2)
    first = [0.01, 0.005, 0, 0, 0, 0]
    np.testing.assert_allclose(
        both.levers, [[*first, -0.05, 0], [*(-v for v in first), -0.05, 0], [0, 0, 0, 0.02, 0, 0.02, -0.1, -0.2]]
    )
    k, T0, mu, rate, _ = both.tendon_constants
    assert k.tolist() == [2e3, 2e3, 0.0]
    assert T0.tolist() == [3.0, 3.0, 0.0]
    assert mu.tolist() == [0.2, 0.2, 0.0]
    assert rate.tolist() == [2e-3, 2e-3, 1e-3]
    assert both.tendons == (0, 2)
    assert both.columns[0].tolist() == [0.0] * 8 + [1.0, -1.0, 0.0]
    assert both.columns[2].tolist() == [0.0] * 8 + [0.0, 0.0, 1.0]
    assert both.columns[1, 8:].tolist() == [0.0] * 3


def test_an_imbalance_is_half_more_for_the_first_tendon_of_a_pair_and_half_less_for_the_second():
    uneven = Tendon(**LINE, driven_by="displacement", line_stiffness=2e3, pretension=3.0, pair=True, imbalance=-1.0)
    assert Actuation((uneven,), 3, turns=2).tendon_constants[1].tolist() == [2.5, 3.5]


def test_of_a_pair_without_pretension_one_tendon_is_taut():
    slack = Tendon(**LINE, driven_by="displacement", line_stiffness=2e3, pair=True)
    assert Actuation((slack,), 3, turns=2).tendon_constants[1].tolist() == [0.0, -LEAST]


@pytest.mark.parametrize(
    ("turned", "inside", "part"),
    [
        ([1, 0, 0], ((0, 1), (2,)), [0.5, 0.0]),
        ([0, 1, 0], ((0, 1), (2,)), [1.0, 0.0]),
        ([1, 1, 1], ((0, 1), (2,)), [1.0, 1.0]),
        ([0, 0, 1], ((), (0, 1, 2)), [1.0, 1.0]),
        ([1, 0, 0], ((), (0, 1, 2)), [1.0, 1 / 3]),
        ([1, 1, 0], ((0, 1), ()), [1.0, 0.0]),
        ([1, 1, 1], ((0, 1), (), (2,)), [1.0, 1.0, 1.0]),
        ([0, 0, 0], ((), (0, 1, 2)), [0.0, 0.0]),
    ],
)
def test_a_tendon_shortens_segments_up_to_the_last_joint_that_it_turns(turned, inside, part):
    """Along a segment for the part of its joints up to there; along one without joints if any lies beyond."""
    nothing = np.zeros(3)
    for gains in ({"joint_gain": turned, "cross_gain": nothing}, {"joint_gain": nothing, "cross_gain": turned}):
        tendon = Tendon(lever=0.01, **gains)
        actuation = Actuation((tendon,), 3, (0.1,) * len(inside), inside, 2)
        np.testing.assert_allclose(tendon.axial_gains(3, inside), -np.array(part))
        np.testing.assert_allclose(actuation.gain[0, 6:], -0.1 * np.array(part))


def test_a_tendon_at_an_azimuth_turns_joints_about_the_axis_across_it():
    """Pulled at alpha from x towards y, a link bends that way: the axis of its turn is (-sin, cos) of alpha."""
    for alpha in (0.0, 0.4, 2.5):
        made = Tendon.at_azimuth(alpha, [1.0, 0.5, 0.0], lever=0.02)
        x, y, z = np.cross([0, 0, 1.0], [np.cos(alpha), np.sin(alpha), 0.0])
        np.testing.assert_allclose(made.joint_gain, x * np.array([1, 0.5, 0]), atol=1e-15)
        np.testing.assert_allclose(made.cross_gain, y * np.array([1, 0.5, 0]), atol=1e-15)
        assert (z, made.lever) == (0.0, 0.02)


def test_the_command_of_a_tendon_is_a_force_for_each_unit_of_its_input():
    stiff = {**LINE, "line_stiffness": 2e3, "pretension": 3.0}
    kinds = {"tension": ("N", 1.0), "displacement": ("m", 2e3), "angle": ("rad", 2e3 * 0.015)}
    for kind, (unit, force) in kinds.items():
        made = Tendon(**stiff, driven_by=kind, pulley=0.015 if kind == "angle" else 0.0)
        assert (made.kind, made.unit, made.torque.tolist()) == (kind, unit, [pytest.approx(force)])
        assert made.elastic is (kind != "tension")
        assert made.constants() == ((2e3, 3.0, 0.0, 1e-3, 0.0) if made.elastic else (0.0, 0.0, 0.0, 1e-3, 0.0))
    assert Tendon(**LINE).constants() == (0.0, 0.0, 0.0, 1e-3, 0.0)


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"lever": 0.0}, "^tendon 'tendon': lever must be positive"),
        ({"driven_by": "hand"}, "must be tension, displacement, angle, got 'hand'"),
        ({"driven_by": "displacement"}, "driven_by = 'displacement' needs a line_stiffness"),
        ({"driven_by": "angle", "line_stiffness": 1e3}, "'angle' needs the radius of the pulley .* set pulley"),
        ({"pulley": 0.01}, "driven_by = 'tension' has no pulley: leave pulley out"),
        (
            {"driven_by": "displacement", "line_stiffness": 1e3, "pulley": 0.01},
            "driven_by = 'displacement' has no pulley: leave pulley out",
        ),
        ({"joint_gain": [0.0, 2e6]}, "^tendon 'tendon': joint_gain must have a size"),
        ({"joint_gain": [0.0, -2e6]}, "joint_gain must have a size"),
        ({"friction": -0.1}, "friction must not be negative"),
        ({"slip_rate": 0.0}, "slip_rate must be positive"),
        ({"pretension": np.inf}, "pretension must be finite"),
        ({"taper": np.nan}, "taper must be finite"),
        ({"at": [0.1, 0.2]}, "at must be positions .* one for each joint"),
        ({"at": [0.1, 0.2, -0.1]}, "at must be positions"),
        ({"imbalance": np.nan, "pair": True}, "imbalance must be finite"),
        ({"imbalance": 1.0, "driven_by": "displacement", "line_stiffness": 1e3}, "set pair = true"),
        ({"imbalance": 1.0, "pair": True}, "that a displacement or an angle drives"),
    ],
)
def test_tendons_that_cannot_be(values, said):
    with pytest.raises(InputError, match=said):
        Tendon(**{**LINE, **values})


@pytest.mark.parametrize("field", ["torque", "swell_share", "inflation_limit", "axial_gain", "law"])
def test_a_tendon_has_no_field_of_a_chamber(field):
    with pytest.raises(TypeError, match=f"unexpected keyword argument '{field}'"):
        Tendon(**LINE, **{field: 0.1})
    assert field not in {f.name for f in fields(Tendon)}
    assert not isinstance(Tendon(**LINE), Chamber)


def test_a_tendon_says_where_it_runs_and_what_drives_it():
    full = Tendon.at_azimuth(np.radians(30.0), [1.0, 1.0, 0.0], lever=0.012, driven_by="angle", line_stiffness=2e3,
                             pretension=3.0, pulley=0.015, pair=True, imbalance=0.5, friction=0.25, entry_friction=0.2,
                             valve=Valve(rise_time=0.02), name="left")  # fmt: skip
    path, lag = full.sentences(alone=False)
    assert path == (
        "left: tendon at 12 mm, azimuth 30 deg, driven by its angle, 2 N/mm, pretension 3 N, pulley 15 mm, pair, "
        "imbalance 0.5 N, friction 0.25, friction 0.2 N at its entry"
    )
    assert lag == "left: lag rise_time 0.02"
    assert Tendon(joint_gain=[-1.0, 0.0], cross_gain=[0.0, 1.0], lever=0.01).sentences(alone=True) == [
        "tendon: tendon at 10 mm, azimuth 90, 0 deg, driven by its tension"
    ]
    assert "azimuth - deg" in Tendon(joint_gain=[0.0], lever=0.01).sentences(alone=True)[0]


# chambers


@pytest.mark.parametrize("jm", [0.1, 3.0, 30.0, 1e6])
@pytest.mark.parametrize("push", [-3.0, -0.3, 0.0, 0.2, 0.49, 0.5, 0.9, 1.0, 1.5])
def test_a_gent_wall_rests_where_pressure_and_rubber_are_equal(push, jm):
    """push y = (y - 1) / (1 - J / jm), J = stretch^2 + stretch^-2 - 2, y the fourth power of the stretch."""

    def excess(s):
        y = s**2
        return push * y * (jm - s - 1 / s + 2) - (y - 1) * jm

    most = (2 + jm + np.sqrt(jm**2 + 4 * jm)) / 2  # s where J = jm
    expected = 1.0 if push == 0 else brentq(excess, *((1 / most, 1) if push < 0 else (1, most)), xtol=1e-14) ** 2
    if most**0.5 > 0 and (np.sqrt(expected) + 1 / np.sqrt(expected) - 2) < 0.9 * jm:
        assert rest_of_gent(push, jm) == pytest.approx(expected, rel=1e-9)
    else:  # beyond 0.9 of its bound the rubber goes on along a tangent
        assert abs(np.log(rest_of_gent(push, jm) / expected)) < 0.5


def test_a_chamber_keeps_its_numbers_to_itself():
    made = Chamber([1e-6], swell_share=[0.25], inflation_limit=1.0)
    assert not any(a.flags.writeable for a in (made.torque, made.joint_gain, made.cross_gain, made.axial_gain))
    assert type(made.swell_share) is float
    assert made.grows
    assert made.remembers
    near = Chamber([1e-6], joint_gain=[1.0, 0.5], name="near")
    assert PLAIN.with_(chambers=(near,)).chambers[0] is near
    with pytest.raises(InputError, match=r"one chamber, but 'model' has 2: near, far"):
        _ = PLAIN.with_(chambers=(near, Chamber([1e-6], name="far"))).chamber


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"swell_share": 1.01}, "^model swell_share"),
        ({"swell_share": 1.01, "name": "near"}, "^chamber 'near': swell_share"),
        ({"law": "saturating"}, r"^model torque of the law 'saturating' must hold the numbers lever, level, got 1"),
        ({"law": "saturating", "torque": [1e-6, 999.0]}, r"level of .* must lie within 1000 \.\.\. 1e\+08 Pa, got 999"),
        ({"law": "saturating", "torque": [1e-6, 1.01e8]}, "level of the law 'saturating' must lie within"),
        ({"law": "saturating", "torque": [-1e-9, 1e5]}, "lever of the law"),
        ({"law": "saturating", "torque": [np.inf, 1e5]}, "lever of the law"),
        ({"law": "saturating", "torque": [np.nan, 1e5]}, "lever of the law"),
    ],
)
def test_laws_that_cannot_be(values, said):
    with pytest.raises(InputError, match=said):
        Chamber(**{"torque": [1e-6], **values})
    for level in (1e3, 1e8):
        assert Chamber([0.0, level], law="saturating").law == "saturating"


# segments, links, memories


def test_what_misses_the_edge_of_a_link_by_rounding_ends_there():
    links = np.array([0.1])

    def part(**where):
        return shares(links, 0.0, (Extension(1.0, **where),))[:, 0].tolist()

    assert part(stop=0.1 - 8e-11) == [0.0, 1.0]
    assert part(start=0.1 - 8e-11, stop=0.3) == [0.0, 0.0]
    assert part(stop=0.1 - 1.3e-10)[1] == pytest.approx(1 - 1.3e-9, abs=1e-12) != 1.0
    assert part(start=0.1 - 1.3e-10, stop=0.3)[1] == pytest.approx(1.3e-9, rel=1e-3)


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"stiffness": 1e-10}, "stiffness must have a size"),
        ({"stiffness": 2e12}, "stiffness must have a size"),
        ({"stiffness": 1.0, "damping": 2e12}, "damping must have a size"),
        ({"stiffness": 0.0}, "stiffness must be finite and positive, got 0"),
        ({"stiffness": 1.0, "damping": -1.0}, "damping must be finite and not negative, got -1"),
        ({"stiffness": 1.0, "start": 0.2, "stop": 0.2}, "must stop after its start at 0.2 m, got 0.2"),
    ],
)
def test_segments_that_cannot_be(values, said):
    with pytest.raises(InputError, match=f"^extension 'body':? .*{said}|^extension 'body' {said}"):
        Extension(**values)


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"link_mass": [1e-13, 0.1, 0.1]}, "link_mass must have a size"),
        ({"link_mass": [0.1, 0.0, 0.1]}, "positive for every link"),
        ({"link_mass": [0.1, 0.1, 0.0]}, "positive for every link"),
        ({"link_mass": [0.1, 0.1, 0.0], "tip_mass": 9e-13}, "positive for every link"),
        ({"stiffening": 1.2e6}, "stiffening must have a size of 0 to 1e"),
        ({"cubic_stiffening": -1.2e9}, "cubic_stiffening must have a size of 0 to 1e"),
        ({"space": Space(), "gravity": [0.0, 1.0]}, r"must be 3 numbers \(x, y, z in the base frame\), got 2"),
        ({"gravity": [0.0, 1.0, 0.0]}, r"must be 2 numbers \(x, y in the base frame\), got 3"),
        ({"gravity": [9.81]}, "must be 2 numbers"),
    ],
)
def test_bodies_of_three_links_that_cannot_be(values, said):
    with pytest.raises(InputError, match=said):
        Model(**{"link_length": 0.1, "link_mass": [0.1] * 3, "stiffness": 1.0, "damping": 0.0, "torque": [1e-6],
                 **values})  # fmt: skip


@pytest.mark.parametrize("name", ["stiffness_ratio", "twist_ratio"])
def test_a_ratio_stays_below_its_bound(name):
    with pytest.raises(InputError, match=f"{name}.* must .* to 10000, got 10000"):
        Space(**{name: 1e4, "radius": 0.01})
    with pytest.raises(InputError, match=r"radius.* must be 0 to 100 m, got 100"):
        Space(radius=1e2)


@pytest.mark.parametrize("changed", [{"angle": 2e3}, {"low": 1e-10}, {"high": 2e3}])
def test_angles_of_paynes_curve_are_those_of_slip_elements(changed):
    values = {"share": 0.5, "angle": 0.02, "exponent": 0.3, "low": 1e-3, "high": 1e-1} | changed
    with pytest.raises(InputError, match="Payne's curve slip_angle must have a size"):
        payne(**values)


def test_a_body_without_mass_is_refused_before_it_is_cut():
    for length, mass in ((0.1, 0.0), (0.0, 0.1), (-0.1, -0.1)):
        with pytest.raises(InputError, match=r"^length \[m\] and mass \[kg\] must be positive"):
            chain_model(length=length, mass=mass, stiffness=1.0, damping=0.0, torque=[1e-6])


# cards


def test_a_card_names_terms_segments_and_gains_that_are_used(monkeypatch):
    poses = []
    monkeypatch.setattr(summary, "body_svg", lambda lines, title: poses.extend(lines) or title)
    near = Chamber([1e-6], axial_gain=[0.0, 20.0], inflation_limit=3e5, inflation_jm=25.0, name="near")
    ends = (Extension(50.0, 0.25, 0.0, 0.1, "a"), Extension(60.0, 0.0, 0.1, None, "b"))
    body = PLAIN.with_(stiffening=[0.5, 0.0], stiffening_bound=[0.3, 0.0], chambers=(near,), extensions=ends)
    card = body.card()
    assert card.lines[1] == (
        "springs K q (1 + s q), s in 1/rad: 0, 0.5; s changes the slope by at most 0 %, 30 % of K"
    )
    assert "segment 'a' of 100 mm lengthens: EA 50 N, 0.25 N s" in card.lines
    assert "segment 'b' of 200 mm lengthens: EA 60 N" in card.lines
    assert "inflation: limit 3e+05 Pa, 0.1 s, J_m 25" in card.lines
    assert "axial force: 0, 20 1/m of the torque" in card.lines
    assert card.drawing == "Model 'model': 2 link(s), 300 mm, 50 g, at rest and bent"
    styles, shapes = zip(*poses, strict=True)
    assert styles == ("faint", "faint", "modelled")
    np.testing.assert_allclose(shapes[2], [[0, 0], [0, 0.1], [0, 0.3]])
    assert (np.diff([shape[-1, 0] for shape in shapes[:2]]) < 0).all()  # bent further to -x
    level = Chamber([1e-6, 2e5], law="saturating")
    assert PLAIN.with_(chambers=(level,)).card().lines[0].startswith(
        "torque at each joint: saturating (1e-06, 2e+05) N m"
    )
