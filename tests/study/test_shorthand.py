"""What a study file need not say twice comes out as the full study; what cannot be written out is told."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path
from typing import Any

import pytest
from small_study import changed, write_study

from pliant.errors import InputError
from pliant.study import Study, load_study

LONG = """
name = "long"
[actuator]
preset = "chen2018"
[recordings.arm]
file = "arm.csv"
format = "columns"
mapping = { rate_hz = 100.0, pressure = { columns = [1], unit = "psi" } }
[recordings.trial_0]
file = "trials.csv"
format = "columns"
mapping = { rate_hz = 100.0, select = { column = "ID", value = 0 } }
excitation = "release"
[recordings.trial_3]
file = "trials.csv"
format = "columns"
mapping = { rate_hz = 50.0, select = { column = "ID", value = 3 } }
excitation = "release"
held = "measured"
[fits.linear]
title = "Linear"
train = ["trial_0", "trial_3"]
held_out = ["arm"]
starts = 1
[fits.linear.parameters]
stiffness = "free"
torque_1 = "free"
[fits.cubic]
train = ["trial_0"]
held_out = ["arm"]
starts = 1
[fits.cubic.parameters]
torque_1 = { value = 1e-6, free = false }
torque_3 = "free"
[model_selection]
train = ["trial_0", "trial_3"]
"""
SHORT = """
name = "long"
[actuator]
preset = "chen2018"
[recordings.defaults]
format = "columns"
mapping = { rate_hz = 100.0 }
[recordings.arm]
file = "arm.csv"
mapping = { pressure = { columns = [1], unit = "psi" } }
[recordings.trial]
file = "trials.csv"
select = { column = "ID", values = [0, 3] }
excitation = "release"
[recordings.trial_3]
mapping = { rate_hz = 50.0 }
held = "measured"
[fits.linear]
title = "Linear"
train = ["trial"]
held_out = ["arm"]
starts = 1
parameters = { stiffness = "free", torque_1 = "free" }
[fits.cubic]
like = "linear"
train = ["trial_0"]
without = ["stiffness"]
parameters = { torque_1 = { value = 1e-6, free = false }, torque_3 = "free" }
[model_selection]
train = ["trial"]
"""


def loaded(folder: Path, text: str) -> Study:
    path = folder / "study.toml"
    path.write_text(text, encoding="utf-8")
    return load_study(path)


def test_short_and_long_say_the_same_in_the_same_order(tmp_path: Path) -> None:
    short, long = (loaded(tmp_path, text).model_dump() for text in (SHORT, LONG))
    assert json.dumps(short) == json.dumps(long)


def test_the_study_that_a_run_leaves_is_the_full_one(tmp_path: Path) -> None:
    study = loaded(tmp_path, SHORT)
    path = tmp_path / "study.json"
    path.write_text(json.dumps(study.model_dump(exclude_none=True)), encoding="utf-8")
    assert load_study(path) == study


def test_a_fit_may_be_like_one_further_down_that_is_like_another(tmp_path: Path) -> None:
    chain = SHORT.replace("[model_selection]", """
[fits.third]
like = "cubic"
held_out = []
[fits.first]
like = "third"
parameters = { damping = "free" }
[model_selection]""").replace("[fits.linear]", """
[fits.zero]
like = "first"
weighting = "metre"
[fits.linear]""", 1)
    fits = loaded(tmp_path, chain).fits
    assert list(fits) == ["zero", "linear", "cubic", "third", "first"]
    assert list(fits["zero"].parameters) == ["torque_1", "torque_3", "damping"]
    assert (fits["zero"].weighting, fits["zero"].held_out, fits["zero"].starts) == ("metre", [], 1)
    assert fits["zero"].title == ""  # a title is a fit's own


def test_what_is_written_out_changes_nothing_that_was_given() -> None:
    from pliant.study.shorthand import expanded

    content = tomllib.loads(SHORT)
    before = json.dumps(content)
    expanded(content)
    assert json.dumps(content) == before


TRIALS: dict[str, Any] = {"file": "a.csv", "select": {"column": "ID", "values": [1, 2]}}


def many(**entries: Any) -> dict[str, Any]:
    """The small study with a recording that stands for trials."""
    return changed("recordings", many={**TRIALS, **entries})


WRONG: dict[str, tuple[dict[str, Any], str]] = {
    "like nothing": (
        changed("fits", other={"like": "lin"}), "of fit other names fit 'lin', which is not one of linear",
    ),
    "like a list": (changed("fits", other={"like": ["linear"]}), "of fit other names fit ['linear']"),
    "like itself": (changed("fits", "linear", like="linear"), "fit linear refers to itself by"),
    "in a circle": (
        changed("fits", a={"like": "b"}, b={"like": "a"}), "fit a refers to itself by `like`, a -> b -> a",
    ),
    "without what is not there": (
        changed("fits", "linear", without=["mass"]), "without = ['mass'], which must be a list of some of its",
    ),
    "without a word": (changed("fits", "linear", without="mass"), "has without = 'mass', which must be a list"),
    "select without values": (many(select={"column": "ID", "value": 3}), "recording many needs select = {"),
    "select no trial": (many(select={"column": "ID", "values": []}), "values of select must be integers"),
    "select by parts": (many(select={"column": "ID", "values": [0.5]}), "values of select must be integers"),
    "select twice": (many(select={"column": "ID", "values": [1, 1]}), "selects a trial twice"),
    "defaults select": (changed("recordings", defaults={"select": TRIALS["select"]}), "[recordings.defaults] has sel"),
    "a typo in the defaults": (changed("recordings", defaults={"fil": "a"}), "'recordings.low.fil' is not a known"),
    "a typo in the trials": (many(hold="measured"), "'recordings.many_1.hold' is not a known entry"),
    "an unknown trial": (
        {**many(), "fits": {"f": {"train": ["many_3"], "parameters": {}}}},
        "uses recording 'many_3', which is not one of low",
    ),
    "trained on and held out": (
        {**many(), "fits": {"f": {"train": ["many"], "held_out": ["many_2"], "parameters": {}}}}, "holds out 'many_2'",
    ),
}


@pytest.mark.parametrize("case", WRONG)
def test_what_cannot_be_written_out_is_told(tmp_path: Path, case: str) -> None:
    content, sentence = WRONG[case]
    path = write_study(tmp_path, content, recordings=False)
    with pytest.raises(InputError) as caught:
        load_study(path)
    assert sentence in str(caught.value)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)
