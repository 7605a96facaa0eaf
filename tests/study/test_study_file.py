"""A study file is checked whole before any work is done; every mistake is told in one sentence that names it."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from small_study import STUDY, changed, write_study

from pliant.actuators import chen2018
from pliant.errors import InputError
from pliant.model import load_model, save_model
from pliant.recording import read
from pliant.study import Study, load_study
from pliant.study.prepare import without, without_motion
from pliant.units import metre_per

TOML = """
name = "small"
[actuator]
preset = "chen2018"
[recordings.a]
file = "a.csv"
[fits.first]
train = ["a"]
parameters = { stiffness = "free", "tip.along" = 0.01, damping = { value = 1e-3, upper = 1.0 } }
"""


def test_toml_and_json_say_the_same(tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_text(TOML)
    study = load_study(tmp_path / "a.toml")
    assert study.folder == str(tmp_path)
    assert study.fits["first"].starts == 3
    (tmp_path / "a.json").write_text(json.dumps(study.model_dump(exclude_none=True)))
    assert load_study(tmp_path / "a.json") == study


def test_a_relative_folder_is_taken_from_the_study_file(tmp_path: Path) -> None:
    write_study(tmp_path, {**STUDY, "folder": "data"}, recordings=False)
    assert load_study(tmp_path / "study.json").folder == str(tmp_path / "data")


WRONG: dict[str, tuple[dict[str, Any], str]] = {
    "unknown key at the top": (
        changed(colour="red"), "'colour' is not a known entry: remove it, or use one of name, title"
    ),
    "unknown key in a table of the actuator": (
        changed("actuator", space={"colour": 1.0}),
        "'actuator.space.colour' is not a known entry: remove it, or use one of stiffness_ratio, twist_ratio"
    ),
    "unknown key in the actuator": (changed("actuator", lenght=0.1), "'actuator.lenght' is not a known entry"),
    "unknown key in a recording": (changed("recordings", "low", unit="psi"), "'recordings.low.unit' is not a known"),
    "unknown key in a fit": (
        changed("fits", "linear", held="middle"), "'fits.linear.held' is not a known entry: use 'held_out', or remove"
    ),
    "unknown key in a parameter": (
        changed("fits", "linear", "parameters", stiffness={"start": 1.0}), "'start' is not a known entry; use value",
    ),
    "unknown parameter": (changed("fits", "linear", "parameters", stifness="free"),
                          "unknown parameter 'stifness': did you mean 'stiffness'?"),
    "impossible start": (changed("fits", "linear", "parameters", stiffness=-1.0), "not within its bounds"),
    "word for a number": (
        changed("fits", "linear", "parameters", stiffness={"value": "big"}), "value must be a float, got 'big'",
    ),
    "a force at no place": (
        changed("recordings", "low", forces=[{"time_s": [0.0], "force_n": [[1.0, 0.0]]}]),
        "needs either station, or link",
    ),
    "a force at two places": (
        changed("recordings", "low", forces=[
            {"station": "tip", "link": 2, "along": 0.1, "time_s": [0.0], "force_n": [[1.0, 0.0]]}
        ]), "needs either station, or link",
    ),
    "a force of three numbers": (
        changed("recordings", "low", forces=[{"station": "tip", "time_s": [0.0], "force_n": [[1.0, 0.0, 0.0]]}]),
        "recordings.low.forces.0.force_n.0",
    ),
    "unknown known": (
        changed("recordings", "low", known={"tip_mas": 0.1}),
        "recording low: unknown parameter 'tip_mas': did you mean 'tip_mass'",
    ),
    "impossible known": (changed("recordings", "low", known={"tip_mass": -0.1}), "not within its bounds"),
    "unknown known of a forecast": (
        changed("forecasts", heavy={"like": "low", "known": {"load": 0.1}}), "forecast heavy: unknown parameter 'load'",
    ),
    "forecast like nothing": (
        changed("forecasts", heavy={"like": "lo"}), "names recording 'lo', which is not one of low",
    ),
    "forecast of no fit": (
        changed("forecasts", heavy={"like": "low", "fit": "lin"}), "uses fit 'lin', which is not one of ",
    ),
    "train on what is not listed": (
        changed("fits", "linear", train=["lo"]), "fit linear uses recording 'lo', which is not one",
    ),
    "hold out what is not listed": (
        changed("fits", "linear", held_out=["x"]), "fit linear uses recording 'x', which is not one",
    ),
    "trained and held out": (changed("fits", "linear", held_out=["low"]), "trains on and holds out 'low'"),
    "trains on nothing": (changed("fits", "linear", train=[]), "trains on no recording"),
    "no fit": (changed("fits", value={}), "one under [fits]"),
    "dot in a name": (changed("recordings", **{"a.b": {"file": "a.csv"}}), "must not have a dot, got 'a.b'"),
    "dot in a forecast": (changed("forecasts", **{"a.b": {"like": "low"}}), "must not have a dot, got 'a.b'"),
    "too many links": (changed("actuator", links=65), "less than or equal to 64"),
    "part of a name": (changed(step=2e-3), "'step' is not a known entry: use 'time_step', or remove it"),
    "step of zero": (changed(time_step=0.0), "'time_step' should be greater than 0"),
    "no starts": (changed("fits", "linear", starts=0), "greater than or equal to 1"),
    "unknown loss": (changed("fits", "linear", loss="l7"), "'linear', 'soft_l1', 'huber' or 'cauchy'"),
    "a recording without a file": (changed("recordings", "low", value={}), "'recordings.low.file' is missing"),
    "a text for a table": (changed("actuator", value="chen2018"), "'actuator' should be a valid dictionary"),
}


@pytest.mark.parametrize("case", WRONG)
def test_a_mistake_is_told_in_one_sentence(tmp_path: Path, case: str) -> None:
    content, sentence = WRONG[case]
    path = write_study(tmp_path, content, recordings=False)
    with pytest.raises(InputError) as caught:
        load_study(path)
    message = str(caught.value)
    assert sentence in message
    assert str(path) in message
    assert "\n" not in message


@pytest.mark.parametrize(("name", "text", "sentence"), [
    ("a.toml", "name = ", "is not valid TOML"), ("a.json", "{", "is not valid JSON"),
    ("a.toml", "name = 'a'\nname = 'b'", "is not valid TOML"), ("a.json", "[1]", "should be a valid dictionary"),
    ("a.toml", "", "'name' is missing"),
])
def test_a_file_that_is_no_study_is_refused(tmp_path: Path, name: str, text: str, sentence: str) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match=sentence):
        load_study(tmp_path / name)


DEEP = 5000
HOSTILE = {
    "nested deep, TOML": ("a.toml", f"name = 'a'\nmapping.x = {'[' * DEEP}{']' * DEEP}", "levels|not valid TOML"),
    "nested deep, JSON": ("a.json", "[" * 100_000 + "]" * 100_000, "deeper than 32 levels"),
    "nested less deep": ("a.json", '{"name": ' + "[" * 100 + "]" * 100 + "}", "deeper than 32 levels at 'name'"),
    "a tangent beyond numbers": (
        "a.toml", TOML + f"[alignment.options]\ntangent = [1{'0' * 400}, 0, 0]", "NaN or larger"),
    "an integer of 5000 digits": ("a.json", '{"seed": 1' + "0" * 5000 + "}", "not valid JSON|NaN or larger"),
    "a path of 5000 characters": ("a.toml", TOML.replace("a.csv", "a" * 5000), "text of 5000 characters at 'file'"),
    "NUL in a folder": ("a.toml", TOML.replace("name =", 'folder = "a\\u0000b"\nname ='), "control character"),
    "not a number": ("a.toml", TOML.replace("0.01", "nan"), "a number that is NaN"),
    "infinite": ("a.toml", TOML.replace("0.01", "inf"), "NaN or larger"),
    "a key of 40,000 parts": ("a.toml", ".".join(["a"] * 40_000) + " = 1", "key of more than 32 parts: 'a.a.a"),
    "a table of 40,000 parts": ("a.toml", "[" + ".".join(["a"] * 40_000) + "]", "key of more than 32 parts"),
    "a quoted key of 20,000 parts": (
        "a.toml", "x = {" + " . ".join(['"\\""', "'b'"] * 10_000) + " = 1}", "key of more than 32 parts"),
    "a name of a fit without end": ("a.toml", TOML.replace("first", "f" * 5000), "text of 5000 characters"),
}


@pytest.mark.parametrize("case", HOSTILE)
def test_what_no_person_writes_is_one_sentence(tmp_path: Path, case: str) -> None:
    name, text, sentence = HOSTILE[case]
    (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match=sentence) as caught:
        load_study(tmp_path / name)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 600


def test_units_are_not_echoed_whole() -> None:
    with pytest.raises(InputError) as caught:
        metre_per("m" * 100_000)
    assert len(str(caught.value)) < 200


def test_a_file_name_that_no_disk_takes_is_one_sentence() -> None:
    with pytest.raises(InputError, match="cannot read a recording"):
        read("a" * 3000 + ".csv")


def test_a_file_that_cannot_be_read_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="No such file"):
        load_study(tmp_path / "none.toml")
    with pytest.raises(InputError, match="directory"):
        load_study(tmp_path)
    (tmp_path / "a.toml").write_bytes(b"name = '\xff'")
    with pytest.raises(InputError, match="is not valid TOML"):
        load_study(tmp_path / "a.toml")


def test_a_study_made_in_memory_is_the_same_kind_of_thing() -> None:
    assert Study.model_validate(STUDY).fits["linear"].held_out == ["middle"]


def test_a_recording_that_hardly_moves_leaves_its_fits_and_a_fit_of_nothing_else_is_refused(tmp_path: Path) -> None:
    write_study(tmp_path, STUDY, recordings=False)
    study = load_study(tmp_path / "study.json")
    (name, entry), *_ = study.fits.items()
    still = entry.train[0]
    two = study.model_copy(update={"fits": {name: entry.model_copy(update={"train": [still, "other"]})}})
    assert without(two, [still]).fits[name].train == ["other"]
    assert without(two, []) is two
    with pytest.raises(InputError, match=f"fit {name} has no usable training recording"):
        without(two, [still, "other"])
    moves = [SimpleNamespace(travel=t, without_positions=False, shown_in=("mm", 1e3)) for t in (1e-2, 1e-4)]
    said = without_motion(dict(zip(("a", "b"), moves, strict=True)), 0.1)
    assert list(said) == ["b"]
    assert "0.1 mm" in said["b"]


VALUES: tuple[Any, ...] = (None, 1, "x", [], {}, [None], {"a": None}, 1.5)


def places(content: Any, at: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Keys that lead to every entry."""
    for key, value in content.items() if isinstance(content, dict) else enumerate(content):
        yield (*at, key)
        if isinstance(value, (dict, list)):
            yield from places(value, (*at, key))


def refused(path: Path, content: Any, load: Callable[[Path], Any]) -> int:
    """Put a wrong value into every entry; each is read or refused in a sentence. The count of what was refused."""
    sentences = []
    for place in places(content):
        for value in VALUES:
            changed_content = json.loads(json.dumps(content))
            table = changed_content
            for key in place[:-1]:
                table = table[key]
            table[place[-1]] = value
            path.write_text(json.dumps(changed_content))
            try:
                load(path)
            except InputError as error:
                sentences.append(str(error))
    assert not any("\n" in sentence for sentence in sentences)
    return len(sentences)


def test_a_wrong_value_anywhere_in_a_study_is_one_sentence(tmp_path: Path) -> None:
    content = changed("fits", "other", like="linear", without=["damping"], parameters={"stiffness": {"value": 1.0}})
    content["recordings"] |= {"defaults": {"mapping": {"length_unit": "mm"}},
                              "many": {"file": "m.csv", "select": {"column": "ID", "values": [0, 1]}}}
    content["model_selection"] = {"train": ["low"], "common": {"torque_1": "free"}}
    assert refused(tmp_path / "study.json", content, load_study) > 200


def test_a_wrong_value_anywhere_in_a_model_is_one_sentence(tmp_path: Path) -> None:
    save_model(chen2018.model(), tmp_path / "model.json")
    content = json.loads((tmp_path / "model.json").read_text())
    del content["checksum"]
    assert refused(tmp_path / "other.json", content, load_model) > 100
