"""Quantities of the command line: a number in the option's unit, or a number with a unit of the same kind."""

from __future__ import annotations

import json
from inspect import signature
from typing import get_args

import numpy as np
import pytest
import xarray as xr
from command_line import invoke
from small_study import table, write_recording

from pliant.cli import COMMANDS
from pliant.errors import InputError
from pliant.model import chain_model, save_model
from pliant.units import number_in


@pytest.mark.parametrize(("text", "unit", "value"), [
    ("25", "kPa", 25.0), ("25kPa", "kPa", 25.0), (" 0.25 bar ", "kPa", 25.0), ("-.5e1psi", "kPa", -34.473786465841805),
    ("50g", "kg", 0.05), ("170 mm", "m", 0.17), ("0.12s", "ms", 120.0), ("90deg", "rad", np.pi / 2),
    ("2N m", "mN m", 2e3),
    ("1/m", "1/m", None), ("50 1/m", "1/m", 50.0), ("3mm", "g", None), ("inf", "s", np.inf),
    ("", "m", None), ("five", "m", None), ("1,5", "m", None),
])
def test_numbers_with_units(text, unit, value):
    if value is None:
        with pytest.raises(InputError, match=r"is not (a number )?in"):
            number_in(text, unit)
    else:
        assert number_in(text, unit) == pytest.approx(value, rel=1e-12)


@pytest.fixture
def model(tmp_path):
    return save_model(chain_model(length=0.1, mass=0.05, links=2, stiffness=1.0, damping=0.02, torque=[1e-6]),
                      tmp_path / "model.json")


def test_with_units_and_without_is_the_same(model, tmp_path):
    plain = ("--level", "25", "--start", "0.05", "--width", "0.1", "--duration", "0.2", "--time-step-ms", "2",
             "--load-g", "5", "--force", "0.1,0")  # fmt: skip
    worded = ("--level", "0.25bar", "--start", "50ms", "--width", "0.1 s", "--duration", "200ms", "--time-step-ms",
              "0.002s", "--load-g", "0.005kg", "--force", "100mN,0N")  # fmt: skip
    paths = []
    for name, options in (("a", plain), ("b", worded)):
        paths.append(tmp_path / f"{name}.nc")
        done = invoke("simulate", model, *options, "-o", paths[-1])
        assert done.exit_code == 0, done.exception or done.output
    one, other = (xr.load_dataset(path, engine="h5netcdf") for path in paths)
    np.testing.assert_allclose(one["tip_position"], other["tip_position"], rtol=1e-12)


@pytest.mark.parametrize(("option", "text", "sentence"), [
    ("--load-g", "3mm", "'3mm' is not in g: use one of kg, g, mg, or a number alone"),
    ("--start", "soon", "'soon' is not a number in s: write it as 25 or 25s"),
    ("--level", "25V", "use one of pa, kpa, mpa, bar, mbar, psi, "),
])
def test_a_wrong_unit_is_named(model, option, text, sentence):
    done = invoke("simulate", model, option, text)
    assert done.exit_code in (1, 2)
    assert sentence in " ".join((done.output + str(done.exception)).split())


@pytest.mark.usefixtures("untried")
def test_a_draft_takes_units(tmp_path):
    recording = write_recording(tmp_path / "a.csv", table(60.0))
    body = ["--length", "120mm", "--mass", "50g"]
    done = invoke("new", tmp_path / "s.toml", "--from", recording, *body, "--json")
    assert done.exit_code == 0, done.exception or done.output
    assert json.loads(done.stdout)["open"] == []
    assert "length = 0.12  # m, as you stated\nmass = 0.05  # kg, as you stated" in (tmp_path / "s.toml").read_text()


def test_every_number_is_read_by_the_same_parser():
    """So that a new option takes units too."""
    bare = [
        f"{name} {option.name}" for name, command in COMMANDS.items()
        for option in signature(command, eval_str=True).parameters.values()
        if "float" in str(get_args(option.annotation)[:1]) and get_args(option.annotation)[1].parser is None
    ]
    assert bare == []
