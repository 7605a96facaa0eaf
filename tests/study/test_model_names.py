"""A study speaks the model's names: its tables take every parameter of a part, and former names are refused."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
from command_line import invoke
from pydantic import ValidationError
from small_study import STUDY

from pliant.model import Chamber, Extension, Memory, Model, Space, Station, Tendon, Valve
from pliant.model.quantity import quantities
from pliant.study.body import study_model
from pliant.study.body_tables import (
    ActuatorEntry,
    ChamberTable,
    ExtensionTable,
    MemoryTable,
    SpaceTable,
    StationTable,
    TendonTable,
    ValveTable,
)

BODY = {"length": 0.12, "mass": 0.05, "links": 2}
COMPUTED = {  # from other entries of the study
    Model: {"link_length", "link_mass"}, Chamber: {"cross_gain"},
    Tendon: {"at", "joint_gain", "cross_gain", "torque", "axial_gain", "swell_share", "swell_time", "inflation_limit",
             "inflation_time", "inflation_jm"},
}  # fmt: skip


@pytest.mark.parametrize(("record", "table"), [
    (Model, ActuatorEntry), (Chamber, ChamberTable), (Tendon, TendonTable), (Valve, ValveTable), (Memory, MemoryTable),
    (Extension, ExtensionTable), (Space, SpaceTable), (Station, StationTable),
])  # fmt: skip
def test_a_table_has_every_parameter_of_its_record(record, table):
    missing = set(quantities(record)) - set(table.model_fields) - COMPUTED.get(record, set())
    assert missing == set()
    for name, quantity in quantities(record).items():
        if name in table.model_fields:
            assert table.model_fields[name].description == quantity.meaning
            assert table.model_json_schema()["properties"][name]["unit"] == quantity.unit


def test_the_entries_of_a_study_reach_its_model():
    entry = ActuatorEntry(
        **BODY, stiffening=-0.2, cubic_stiffening=[0.3, 0.4], stiffening_bound=0.5, base_angle=0.1, tip_mass=0.003,
        torque=[1e-6], swell_share=0.2, swell_time=0.3, joint_gain=[1.0, 0.7],
        valve={"rise_time": 0.02, "dead_time": 3e-3}, memory={"creep_share": [0.2], "creep_time": [1.5]},
        extensions=[{"stiffness": 300.0, "damping": 1.0}],
    )  # fmt: skip
    model = study_model(entry, None)
    np.testing.assert_array_equal(model.stiffening, -0.2)
    np.testing.assert_array_equal(model.cubic_stiffening, [0.3, 0.4])
    assert (model.stiffening_bound[0], model.base_angle, model.tip_mass) == (0.5, 0.1, 0.003)
    assert model.memory == Memory(creep_share=(0.2,), creep_time=(1.5,))
    assert model.valve == Valve(rise_time=0.02, dead_time=3e-3)
    assert (model.chamber.swell_share, model.chamber.swell_time) == (0.2, 0.3)
    np.testing.assert_array_equal(model.joint_gain, [1.0, 0.7])
    assert (model.extensions[0].stiffness, model.extensions[0].damping) == (300.0, 1.0)


def test_the_entries_of_chambers_and_tendons_reach_the_model():
    chamber = {"name": "far", "joints": [2], "joint_gain": -1.0, "torque": [2e-6], "swell_share": 0.1,
               "valve": {"fall_time": 0.04}, "azimuth_deg": 90.0}  # fmt: skip
    tendon = {"name": "cord", "driven_by": "displacement", "lever": 0.01, "azimuth_deg": 0.0, "friction": 0.2,
              "valve": {"rise_time": 0.1}}  # fmt: skip
    entry = ActuatorEntry(**BODY, chambers=[chamber], tendons=[tendon], space={"base_tilt": [0.1, 0.0, 0.0]})
    model = study_model(entry, None)
    far, cord = model.chambers
    np.testing.assert_allclose(far.joint_gain, [0.0, -1.0])
    assert (far.swell_share, far.valve.fall_time) == (0.1, 0.04)
    assert (cord.friction, cord.valve.rise_time, cord.line_stiffness) == (0.2, 0.1, 1000.0)
    assert model.space.base_tilt[0] == 0.1


@pytest.mark.parametrize(("changes", "said"), [
    ({"fits": {"linear": {"parameters": {"valve_rise": "free"}}}}, "use its present name, 'valve_rise_time'"),
    ({"recordings": {"low": {"known": {"valve_fall": 0.1}}}}, "use its present name, 'valve_fall_time'"),
    ({"actuator": {"chambers": [{"name": "left", "gain": -1.0}]}}, "no entry 'gain' any more: write 'joint_gain'"),
    ({"actuator": {"chambers": [{"name": "left", "gein": -1.0}]}}, "gein' is not a known entry"),
    ({"actuator": {"valve": {"rise_tme": 0.1}}}, "use 'rise_time'"),
    ({"actuator": {"swell_share": 0.1, "chambers": [{"name": "left"}]}}, "state either swell_share in"),
])  # fmt: skip
def test_a_former_or_misspelt_name_is_refused_with_the_present_one(tmp_path, changes, said):
    study: dict[str, Any] = json.loads(json.dumps(STUDY))
    for table, entries in changes.items():
        for name, value in entries.items():
            study[table][name] = {**study[table].get(name, {}), **value} if isinstance(value, dict) else value
    path = tmp_path / "study.json"
    path.write_text(json.dumps(study), encoding="utf-8")
    done = invoke("run", path, "--output", tmp_path / "out")
    assert done.exit_code != 0
    assert said in str(done.exception)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(("table", "entries"), [
    (TendonTable, {"name": "a", "driven_by": "tension", "lever": 0.0}), (ExtensionTable, {"damping": -1.0}),
    (ActuatorEntry, {"tip_mass": -1.0}), (ValveTable, {"settle_time": 0.0}),
])  # fmt: skip
def test_a_number_of_the_wrong_sign_is_refused(table, entries):
    with pytest.raises(ValidationError, match="greater than"):
        table(**entries)
