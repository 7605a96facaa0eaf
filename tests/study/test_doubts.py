"""Wrong inputs of a whole study are named: by `pliant new`, and first of all in the headline of a run."""

from __future__ import annotations

import numpy as np
import pytest
from small_study import AXES, LEVELS_KPA, TORQUE, changed, table, write_recording, write_study

from pliant.errors import InputError
from pliant.study import load_study, run_study
from pliant.study.draft import draft_study
from pliant.study.trial import inspect_trial

HANGS = (9.81 * AXES[:, 1]).tolist()  # along the base tangent


def headline(folder, content, edit=None):
    """Warnings of a run of the small study, its tables changed by `edit`."""
    path = write_study(folder, content)
    for name, level in LEVELS_KPA.items():
        if edit is not None:
            columns = table(level).copy()
            edit(columns)
            write_recording(folder / f"{name}.csv", columns)
    told = []
    outcome = run_study(load_study(path), progress=told.append)
    return outcome, told


def add_atmosphere(columns):
    columns[:, 1] += 101.3


def exchange(columns):
    columns[60:80, 2:5], columns[60:80, 5:8] = columns[60:80, 5:8].copy(), columns[60:80, 2:5].copy()


@pytest.mark.parametrize(("content", "edit", "named"), [
    (None, add_atmosphere, "low: the pressure reads 101.3 kPa"),
    (changed("actuator", mass=50.0), None, "mass = 50 kg"),
    (changed("actuator", gravity=(9.81 * AXES[:, 2]).tolist()), None, "across the plane of bending and are ignored"),
    (None, exchange, "low: stations exchange their labels: base-tip in 20 frames"),
], ids=["absolute", "grams", "gravity", "labels"])  # fmt: skip
def test_a_run_names_what_is_wrong(tmp_path, content, edit, named):
    outcome, told = headline(tmp_path, content, edit)
    assert outcome.headline.state in ("beware", "missed")
    assert any(named in w for w in outcome.headline.warnings[:3])
    assert any(named in line for line in told)


def test_a_body_that_a_vacuum_bends_is_fitted_as_any_other(tmp_path):
    def vent(columns):
        columns[:, 1] *= -1.0

    outcome, _ = headline(tmp_path, None, vent)
    (fit,) = outcome.fits
    assert fit.result.values["torque_1"] == pytest.approx(-TORQUE, rel=0.01)
    metrics = fit.records[-1].metrics
    assert metrics["steady_state_mm"]["measured"] > 10.0
    assert metrics["rmse_percent_of_travel"] < 1.0
    assert outcome.doubts == ()


def test_a_recording_that_is_there_twice_is_named_first(tmp_path):
    def same(columns):
        columns[:] = table(60.0)

    outcome, told = headline(tmp_path, None, same)
    assert any("low and middle hold the same numbers in 160 frames" in w for w in outcome.headline.warnings[:3])
    assert any("middle and high hold the same numbers" in line for line in told)


def test_a_length_in_millimetres_is_named_where_nothing_seems_to_move(tmp_path):
    with pytest.raises(InputError, match=r"hardly move; length = 120 m"):
        run_study(load_study(write_study(tmp_path, changed("actuator", length=120.0))))


def test_a_length_that_no_station_keeps_to_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"cannot be used; length = 0.03 m, .* reaches 0.12 m .* station tip is "
                                         r"120 mm from the base in frame"):  # fmt: skip
        headline(tmp_path, changed("actuator", length=0.03, mass=0.001))


def test_a_right_study_has_no_doubt(tmp_path):
    outcome, _ = headline(tmp_path, changed("actuator", gravity=HANGS, diameter=0.03))
    assert outcome.doubts == ()


def test_exchanged_labels_are_undone_on_request(tmp_path):
    outcome, _ = headline(tmp_path, changed("alignment", swaps="undo"), exchange)
    assert outcome.doubts == ()
    assert outcome.fits[0].records[0].metrics["rmse_mm"] < 0.1
    assert any("exchanged labels are undone, frames: base-tip 20" in line for line in outcome.findings["low"])
    left, _ = headline(tmp_path, changed("alignment", swaps="exclude"), exchange)
    assert left.fits[0].records[0].metrics["points_not_seen"] == 20


@pytest.mark.parametrize(("resting", "line"), [(0.0, "\ncommon_rest = true"), (20.0, "\n# common_rest = true")],
                         ids=["alike", "elsewhere"])  # fmt: skip
def test_a_draft_shifts_motions_that_begin_alike_to_a_common_rest(tmp_path, resting, line):
    files = []
    for k, (name, level) in enumerate(LEVELS_KPA.items()):
        columns = table(level).copy()
        columns[:, 1] += resting * k
        columns[:, 2:] += 0.01 * k  # mounted anew
        files.append(write_recording(tmp_path / f"{name}.csv", columns))
    text = draft_study(files, tmp_path / "s.toml", length=0.12, mass=0.05).text
    assert f"\n[alignment]{line}" in text
    (tmp_path / "s.toml").write_text(text, encoding="utf-8")
    assert load_study(tmp_path / "s.toml").alignment.common_rest == (resting == 0.0)
    assert "common_rest" not in draft_study(files[:1], tmp_path / "one.toml", length=0.12, mass=0.05).text


def test_a_draft_keeps_the_rests_of_loads_and_of_pressures_that_differ_by_less_than_the_atmosphere(tmp_path):
    for kind, zero, names in (("loads", 0.0, ("low_0g", "mid_50g")), ("absolute", 101.3, ("low", "mid"))):
        files = []
        for k, (name, level) in enumerate(zip(names, (30.0, 60.0), strict=True)):
            columns = table(level).copy()
            columns[:, 1] += zero + (4.0 * k if zero else 0.0)
            files.append(write_recording(tmp_path / f"{kind}_{name}.csv", columns))
        text = draft_study(files, tmp_path / f"{kind}.toml", length=0.12, mass=0.05).text
        assert "\n# common_rest = true" in text


def test_a_draft_names_what_is_wrong(tmp_path):
    files = []
    for name, level in LEVELS_KPA.items():
        columns = table(level).copy()
        add_atmosphere(columns)
        files.append(write_recording(tmp_path / f"{name}.csv", columns))
    draft = draft_study(files, tmp_path / "s.toml", length=0.12, mass=50.0, diameter=0.03)
    assert any(line.startswith("offset: the pressure reads 101.3 kPa") for line in draft.questions)
    assert any("kg/m3" in line for line in draft.doubts)
    assert 'linear = { pressure = { offset = "?"' in draft.text
    write_study(tmp_path)
    right = draft_study(files, tmp_path / "s.toml", length=0.12, mass=0.05)
    assert right.doubts == ()


def test_scaffolded_gravity_lies_in_the_plane_of_bending(tmp_path):
    """The small body lies along an oblique axis: nearest is the tracker's +x, not -z, which lies across its plane."""
    write_study(tmp_path)
    text = draft_study([tmp_path / "low.csv"], tmp_path / "s.toml", length=0.12, mass=0.05).text
    nearest = int(np.argmax(np.abs(AXES[:, 1])))
    expected = [0.0, 0.0, 0.0]
    expected[nearest] = float(9.81 * np.sign(AXES[nearest, 1]))
    assert f"gravity = {expected}" in text


def test_fits_with_joints_in_two_places_are_compared(tmp_path):
    """The small body has its joints at the base of two links: that fit finds it again, the other one does not."""
    other = {"title": "Middle", "train": ["low", "high"], "held_out": ["middle"], "starts": 1,
             "joint_placement": "midsegment", "parameters": dict.fromkeys(("stiffness", "damping", "torque_1"), "free")}
    outcome, _ = headline(tmp_path, changed("fits", middle=other))
    base, middle = (f.result.model for f in outcome.fits)
    assert base.base_length == 0
    assert middle.base_length == pytest.approx(0.03)
    assert middle.n == 2
    (said,) = [line for line in outcome.verdict if "assumed positions of the joints" in line]
    assert "linear, each joint at the base of its segment: EI 0.03 N m^2, prediction error 0." in said
    assert "Middle, each joint in the middle of its segment: EI " in said
    errors = [next(r for r in f.records if r.role == "held_out").metrics["rmse_mm"] for f in outcome.fits]
    assert errors[0] < errors[1]


def test_fits_of_several_numbers_of_links_are_compared(tmp_path):
    """The small body has two links: one alone predicts it worse."""
    outcome, _ = headline(tmp_path, changed("fits", one={"like": "linear", "title": "One", "links": 1}))
    assert [f.result.model.n for f in outcome.fits] == [2, 1]
    (said,) = [line for line in outcome.verdict if "assumed positions of the joints and their number" in line]
    assert "linear, 2 links, each joint at the base of its segment: EI 0.03 N m^2, prediction error 0." in said
    assert "One, 1 link, each joint at the base of its segment: EI " in said
    errors = [next(r for r in f.records if r.role == "held_out").metrics["rmse_mm"] for f in outcome.fits]
    assert 2 * errors[0] < errors[1]


@pytest.mark.parametrize(("own", "value"), [("joint_placement", "base"), ("links", 3)])
def test_a_study_that_reduces_places_the_joints_itself(tmp_path, own, value):
    content = changed("reduction", links=2)
    content["fits"]["linear"][own] = value
    with pytest.raises(InputError, match=rf"fit linear states {own}, but \[reduction\]"):
        load_study(write_study(tmp_path, content))


def test_a_fit_has_no_other_number_of_links_where_chambers_stand_on_joints(tmp_path):
    content = changed("actuator", chambers=[{"name": "left", "joints": [1]}, {"name": "right", "joints": [2]}])
    content["fits"]["linear"]["links"] = 3
    with pytest.raises(InputError, match="fit linear states links, but left acts on numbered joints"):
        load_study(write_study(tmp_path, content))


def in_millimetres(columns):
    columns[:, 2:] *= 1e3


def in_milliseconds(columns):
    columns[:, 0] *= 1e3


LATER = changed("recordings", "low", stations=["nobody"])
EARLY = changed("alignment", "options", value={"base": "nobody"})


@pytest.mark.parametrize("content", [EARLY, LATER], ids=["alignment", "experiment"])
@pytest.mark.parametrize(("edit", "unit"), [
    (in_millimetres, (r"recording low: all positions are within 12\d m, implausible for a soft body: state "
                      r"the unit, .*, or correct the positions\. Then: ")),
    (in_milliseconds, r"recording low: the frames are 10 s apart: were times in ms or us .* time_unit .*\. Then: "),
    (None, "(?!.*unit)"),
])
def test_a_wrong_unit_is_named_before_what_may_follow_from_it(tmp_path, content, edit, unit):
    with pytest.raises(InputError, match=f"^{unit}.*nobody"):
        headline(tmp_path, content, edit)


def test_a_draft_names_the_unit_before_the_alignment(tmp_path, monkeypatch):
    def refuse(*_, **__):
        raise InputError("the base moves by 3 m")

    monkeypatch.setattr("pliant.study.trial.align", refuse)
    columns = table(60.0).copy()
    in_millimetres(columns)
    trial = inspect_trial(write_recording(tmp_path / "a.csv", columns))
    assert trial.problem == "the base moves by 3 m"  # millimetres are recognised by their range, and the draft says so
    columns[:, 2:] *= 1e3
    trial = inspect_trial(write_recording(tmp_path / "b.csv", columns))
    assert "in the mapping, or correct the positions. Then: the base moves by 3 m" in trial.problem
