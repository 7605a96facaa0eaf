"""Each mistake that looks right is named, and the same recording without it is not."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pliant.errors import InputError
from pliant.model import Tendon, chain_model
from pliant.model.summary import bending_stiffness, joint_placement
from pliant.preprocessing.align import align
from pliant.preprocessing.labels import exclude_swaps, label_order, undo_swaps
from pliant.preprocessing.plausibility import CHECKS, Case, doubts
from pliant.preprocessing.plausibility.together import beside
from pliant.preprocessing.quality import quality
from pliant.recording import make_recording, read

TIME = np.arange(300) / 100
LENGTH, MASS = 0.12, 0.05
S = np.linspace(0.0, LENGTH, 5)
NAMES = ["base", "p1", "p2", "p3", "tip"]


def places(seed=1):
    """A body of 0.12 m that bends by 1.2 rad and rings, in x-y with its base tangent along +y; noise 0.05 mm."""
    bend = np.where(TIME > 1, 1.2 * (1 - np.exp(-4 * (TIME - 1)) * np.cos(12 * np.pi * (TIME - 1))), 1e-6)
    k = np.maximum(bend, 1e-6)[:, None] / LENGTH
    flat = np.stack([(np.cos(k * S) - 1) / k, np.sin(k * S) / k, 0 * k * S], axis=-1)
    return flat + 5e-5 * np.random.default_rng(seed).standard_normal(flat.shape)


def pressure(seed=2):
    """0 and 40 kPa, with noise of 30 Pa, not in steps."""
    return np.where(TIME > 0.95, 4e4, 0.0) + 30 * np.random.default_rng(seed).standard_normal(TIME.size)


def recording(position=None, p=None):
    return make_recording(TIME, places() if position is None else position, station=NAMES,
                          pressure=pressure() if p is None else p)  # fmt: skip


def body(**changed):
    ds = recording()
    options = {k: changed.pop(k) for k in ("tangent", "plane") if k in changed}
    case = Case(ds, {}, align(ds, **{"tangent": "+y", **options}), LENGTH, MASS, None, (0.0, -9.81, 0.0))
    return doubts(replace(case, **changed), "body")


def fitted(scale=1.0, diameter=None, **changed):
    values = {"length": LENGTH, "mass": MASS, "links": 4, "stiffness": 0.08 * scale, "damping": 1e-3 * scale,
              "torque": [4e-7 * scale]}  # fmt: skip
    return doubts(Case(model=chain_model(**{**values, **changed}), diameter=diameter), "model")


def turning(angle):
    return quality(make_recording(TIME, angle=angle[:, None], station=["tip"], frame="planar")).doubts


def oriented(order):
    """Doubts about the body with the orientations of its stations, whose sensors sit askew, in an order or inverted."""
    bend = np.where(TIME > 1, 1.2 * (1 - np.exp(-4 * (TIME - 1)) * np.cos(12 * np.pi * (TIME - 1))), 0.0)
    askew = Rotation.from_euler("xyz", [0.3, 0.8, -0.5])
    turned = [Rotation.from_rotvec(np.outer(bend * s / LENGTH, [0.0, 0.0, 1.0])) * askew for s in S]
    quaternion = np.stack([(t.inv() if order == "inverse" else t).as_quat() for t in turned], axis=1)
    components = [3, 0, 1, 2] if order == "wxyz" else [0, 1, 2, 3]
    return quality(make_recording(TIME, places(), station=NAMES, quaternion=quaternion[..., components])).doubts


def from_the_tip():
    """Stations listed from the tip on, whose first is taken for the base."""
    ds = recording(places()[:, ::-1])
    case = Case(ds, aligned=align(ds, base="base", tangent="+y"), length=LENGTH)
    return doubts(case, "body")


def swapped(position, a=3, b=4, frames=slice(150, 170)):
    changed = position.copy()
    changed[frames, [a, b]] = position[frames, [b, a]]
    return changed


MISTAKES = {
    "absolute pressure": lambda: quality(recording(p=pressure() + 101_325)).doubts,
    "absolute pressure, in the mountains": lambda: quality(recording(p=pressure() + 82_000)).doubts,
    "raw counts": lambda: quality(recording(p=1e3 * np.rint(204 + 15e-3 * pressure()))).doubts,
    "raw counts, of 16 bits as Pa": lambda: quality(recording(p=np.rint(6554 + 0.6 * pressure()))).doubts,
    "offset of pressure": lambda: quality(recording(p=pressure() + 12_000)).doubts,
    "clipped pressure": lambda: quality(recording(p=np.minimum(pressure(), 39_900.0))).doubts,
    "clipped pressure, of a vacuum": lambda: quality(recording(p=-np.minimum(pressure(), 39_900.0))).doubts,
    "unit of pressure": lambda: quality(recording(p=pressure() / 1e3)).doubts,
    "unit of time": lambda: quality(make_recording(1e3 * TIME, places(), station=NAMES)).doubts,
    "unit of time, the other way": lambda: quality(make_recording(1e-3 * TIME, places(), station=NAMES)).doubts,
    "unit of time, of a log": lambda: quality(make_recording(pressure=pressure(), pressure_time=1e3 * TIME)).doubts,
    "unit of length": lambda: quality(recording(1e3 * places())).doubts,
    "unit of angle": lambda: turning(np.degrees(0.6 * (1 - np.cos(TIME)))),
    "unit of angle, the other way": lambda: turning(np.radians(0.6 * (1 - np.cos(TIME)))),
    "order of quaternions": lambda: oriented("wxyz"),
    "order of quaternions, inverted": lambda: oriented("inverse"),
    "exchanged labels": lambda: quality(recording(swapped(places()))).doubts,
    "moving base": from_the_tip,
    "plane": lambda: body(plane=[1.0, 0.0, 0.2]),
    "base tangent": lambda: body(tangent="+x", plane=[0, 0, 1]),
    "length, in mm": lambda: body(length=120.0),
    "length, in inches": lambda: body(length=LENGTH / 0.0254),
    "length, half": lambda: body(length=0.06),
    "mass, in g": lambda: body(mass=54.0),
    "mass, of another body": lambda: body(mass=40.0),
    "mass, of lead": lambda: body(diameter=0.004),
    "gravity, across": lambda: body(gravity=(0.0, 0.0, -9.81)),
    "gravity, in mm/s^2": lambda: body(gravity=(0.0, -9810.0, 0.0)),
    "bending stiffness": lambda: fitted(1e3),
    "bending stiffness, for the diameter": lambda: fitted(diameter=0.0008),
    "torque": lambda: fitted(1e3),
    "torque, for the diameter": lambda: fitted(torque=[4e-6], diameter=0.015),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_is_named(mistake):
    assert mistake.partition(",")[0] in MISTAKES[mistake]()


def test_every_check_has_a_mistake():
    assert {c.name for c in CHECKS} == {m.partition(",")[0] for m in MISTAKES}


def test_right_inputs_are_left_in_peace():
    assert quality(recording()).doubts == {}
    assert body() == {}
    assert body(diameter=0.025) == {}
    assert body(gravity=(0.0, -9.7, 0.9)) == {}
    assert fitted() == {}
    assert fitted(diameter=0.025) == {}
    assert turning(0.6 * (1 - np.cos(TIME))) == {}
    assert oriented("xyzw") == {}


@pytest.mark.parametrize("p", [
    pressure() - 30e3,  # vacuum after a pressure
    -pressure(),  # vacuum alone
    1e3 * np.rint(1e-3 * pressure()),  # a sensor of 1 kPa
    np.where(TIME > 1, 1.2e5, 0.0),  # above the atmosphere, and vented
    np.clip(4e4 * np.sin(2 * TIME), 0.0, 3e4),  # a command, within its limits
], ids=["both", "vacuum", "coarse", "high", "command"])  # fmt: skip
def test_pressures_that_are_right(p):
    assert quality(recording(p=p)).doubts == {}


def trial(level, *, reach=1.0, seed=1):
    """A recording under `level` [Pa] that moves as far as one under 40 kPa times `reach`, with noise of its own."""
    still = places(0)[:5].mean(axis=0)
    noise = 5e-5 * np.random.default_rng(seed).standard_normal((300, 5, 3))
    return recording(still + reach * (places(0) - still) + noise, level / 4e4 * pressure(seed))


def test_two_recordings_that_contradict_each_other_are_named():
    low, high = trial(4e4), trial(6e4, reach=1.3, seed=3)
    assert beside({"low": low, "high": high}) == []
    assert beside({"low": low, "vacuum": trial(-6e4, reach=0.5, seed=3)}) == []
    (said,) = beside({"low": low, "high": high, "again": low.isel(time=slice(100, 300))})
    assert said.startswith("low and again hold the same numbers in 200 frames")
    (said,) = beside({"low": trial(4e4, reach=1.3), "high": trial(6e4, seed=3)})
    assert said.startswith("high moves by ")
    assert "under only 40.1 kPa: are their pressure logs exchanged, or was the body in high loaded or touched?" in said
    short = np.where((TIME > 0.95) & (TIME < 1.05), 9e4, 0.0)  # a blow that the body cannot follow
    assert beside({"low": low, "blow": recording(trial(9e4, reach=0.2, seed=4)["position"].values, short)}) == []


def test_sentences_say_what_to_do():
    assert "offset = -101.3" in quality(recording(p=pressure() + 101_325)).doubts["absolute pressure"]
    assert 'swaps = "undo"' in quality(recording(swapped(places()))).doubts["exchanged labels"]
    assert "x axis" in body(tangent="+x", plane=[0, 0, 1], gravity=(0.0, 0.0, 9.81)).get("gravity", "")


def test_swaps_are_counted_and_undone():
    clean = places()
    ds = recording(swapped(clean))
    assert quality(ds).swapped == {"p3-tip": 20}
    back = undo_swaps(ds)
    np.testing.assert_array_equal(back["position"].values, clean)
    assert "exchanged labels are undone, frames: p3-tip 20" in back.attrs["history"]
    left = exclude_swaps(ds)["position"].values
    assert np.isnan(left[150:170, 3:]).all()
    assert np.isnan(left).any(-1).sum() == 40
    assert quality(back).doubts == {}


@pytest.mark.parametrize("seed", range(6))
def test_any_exchange_of_labels_is_found_wherever_it_is(seed):
    """Two or three labels, any frames, with drop-outs beside them; the majority is right."""
    rng = np.random.default_rng(seed)
    clean = places(seed)
    first = int(rng.integers(5, 200))
    frames = np.arange(first, first + int(rng.integers(3, 90)))
    which = rng.choice(5, size=2 + seed % 2, replace=False)
    order = np.tile(np.arange(5), (300, 1))
    order[np.ix_(frames, which)] = np.roll(which, 1)
    seen = np.take_along_axis(clean, order[..., None], axis=1)
    lost = rng.integers(0, 300, 20)
    seen[lost, rng.integers(0, 5, 20)] = np.nan
    again = np.take_along_axis(seen, label_order(seen, TIME)[..., None], axis=1)
    np.testing.assert_array_equal(np.where(np.isnan(again), clean, again), clean)


def test_a_body_that_whips_keeps_its_labels():
    """Tip steps of up to 75 % of the spacing of the points from frame to frame are no exchange."""
    t = np.arange(400) / 30
    k = 8.0 * np.sin(2 * np.pi * 2.0 * t)[:, None] + 1e-6
    p = np.stack([(np.cos(k * S) - 1) / k, np.sin(k * S) / k], axis=-1)
    p = np.concatenate([p, np.zeros((400, 5, 1))], axis=-1)
    assert np.linalg.norm(np.diff(p[:, -1], axis=0), axis=-1).max() > 0.75 * (S[1] - S[0])
    assert quality(make_recording(t, p, station=NAMES)).swapped == {}


def test_bending_stiffness_counts_the_segment_of_each_joint():
    at_base = chain_model(length=0.2, mass=0.1, links=4, stiffness=0.3, damping=1e-3, torque=[1e-6])
    middle = chain_model(length=0.2, mass=0.1, links=4, stiffness=0.3, damping=1e-3, torque=[1e-6],
                         joint_placement="midsegment")
    for model, placement in ((at_base, "base"), (middle, "midsegment")):
        assert joint_placement(model) == placement
        np.testing.assert_allclose(bending_stiffness(model), 0.3 * 0.05)
    one = chain_model(length=0.2, mass=0.1, links=1, stiffness=0.3, damping=1e-3, torque=[1e-6],
                      joint_placement="midsegment")
    np.testing.assert_allclose(bending_stiffness(one), 0.3 * 0.2)


def wide(path: Path, p: np.ndarray) -> Path:
    rows = [f"{t!r},{q!r}" for t, q in zip(TIME.tolist(), p.tolist(), strict=True)]
    path.write_text("t,p_kpa\n" + "\n".join(rows) + "\n")
    return path


def test_scale_and_offset_of_any_channel(tmp_path):
    file = wide(tmp_path / "log.csv", np.rint(204 + 15e-3 * pressure()))
    line = {"scale": 1 / 15, "offset": -13.6, "unit": "kPa"}
    ds = read(file, mapping={"linear": {"pressure": line}})
    np.testing.assert_allclose(ds["pressure"].values, pressure(), atol=70.0)
    assert quality(ds).doubts == {}
    assert "pressure is 0.0666667 times the stored value, plus -13.6 kPa" in ds.attrs["history"]
    table = tmp_path / "table.txt"
    np.savetxt(table, np.column_stack([TIME, pressure() / 1e3, 2 * pressure() / 1e3, 100 + TIME]), delimiter=",")
    mapping = {"time": 0, "pressure": {"columns": [1, 2], "unit": "kPa", "chamber": ["left", "right"]}}
    both = read(table, mapping={**mapping, "linear": {"right": 0.5}})["pressure"].values
    np.testing.assert_allclose(both[:, 1], both[:, 0], rtol=1e-12)
    angles = {"time": 0, "angles": {"tip": 3}, "angle_unit": "deg"}
    turned = read(table, mapping={**angles, "linear": {"tip": {"scale": 2, "offset": -200, "unit": "deg"}}})
    np.testing.assert_allclose(turned["angle"].values[:, 0], np.radians(2 * TIME), atol=1e-12)


@pytest.mark.parametrize(("lines", "told"), [
    ({"chamber_9": 2.0}, "names 'chamber_9', but the recording has no such channel"),
    ({"pressure": {"offset": 3.0}}, "an offset without a unit"),
    ({"pressure": 0.0}, "has scale = 0"), ({"pressure": {"gain": 2}}, "unknown key 'gain'"), (3, "table by channel"),
])  # fmt: skip
def test_lines_that_do_not_fit(tmp_path, lines, told):
    with pytest.raises(InputError, match=told):
        read(wide(tmp_path / "log.csv", pressure()), mapping={"linear": lines})


def test_degrees_that_a_header_calls_rad_are_not_undone_as_whole_turns(tmp_path):
    file = tmp_path / "flex.csv"
    angle = 40 * (1 - np.cos(1.3 * TIME))
    rows = [f"{t:.3f};{a:.4f}" for t, a in zip(TIME[::10], angle[::10], strict=True)]
    file.write_text("\n".join(["time;angle_rad", *rows]))
    ds = read(file)
    assert "angle_unit" in quality(ds).doubts["unit of angle"]
    np.testing.assert_allclose(np.ptp(ds["angle"].values), np.ptp(angle[::10]), rtol=1e-3)


def test_the_torque_of_a_tendon_is_not_held_against_a_pressure():
    cord = Tendon.at_azimuth(0.0, np.ones(3), driven_by="displacement", lever=8e-3, line_stiffness=1e5)
    body = {"length": 0.2, "mass": 0.1, "links": 3, "stiffness": 0.3, "damping": 1e-3, "space": True}
    assert not doubts(Case(model=chain_model(**body, chambers=[cord])), "model")
    chamber = replace(chain_model(**body, torque=[1.0]).chambers[0], name="air")
    assert "torque" in doubts(Case(model=chain_model(**body, chambers=[cord, chamber])), "model")
