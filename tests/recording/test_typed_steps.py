"""Tables of typed steps: a row holds until the next; tables of ramps and measured logs stay linear."""

from __future__ import annotations

import numpy as np
import pytest

from pliant.errors import InputError
from pliant.preprocessing.cut import cut_time
from pliant.preprocessing.quality import quality
from pliant.recording import make_recording, read
from pliant.recording.inputs import inputs_at
from pliant.study.aligned import with_pressure

STEPS = "Time (s);left (kPa);right (kPa)\n0,0;0;0\n1,0;60;0\n2,5;0;0\n4,0;0;60\n5,5;0;0\n7,0;60;60\n8,5;0;0\n"


def put(tmp_path, text):
    path = tmp_path / "log.csv"
    path.write_text(text)
    return path


def at(recording, *times):
    return (inputs_at(recording, np.array(times)) / 1e3).round(6).tolist()


def table(times, levels):
    return "t,p_kpa\n" + "\n".join(f"{t:.6g},{p:.6g}" for t, p in zip(times, levels, strict=True)) + "\n"


def test_typed_steps_are_held_and_the_history_says_so(tmp_path):
    log = read(put(tmp_path, STEPS))
    assert at(log, 0.5, 0.9999, 1.0, 2.4999, 2.5, 4.2, 7.7, 20) == [
        [0, 0], [0, 0], [60, 0], [60, 0], [0, 0], [0, 60], [60, 60], [0, 0]]  # fmt: skip
    sentence = "each row keeps its value until the next row, 7 rows, since they look like typed steps; set hold = false"
    assert sentence in log.attrs["history"]
    assert quality(log).findings == ()


def test_the_mapping_decides(tmp_path):
    assert at(read(put(tmp_path, STEPS), mapping={"hold": False}), 0.5, 1.75) == [[30, 0], [30, 0]]
    ramp = read(put(tmp_path, table([0, 1, 3, 4], [0, 0, 60, 60])), mapping={"hold": True})
    assert at(ramp, 2.9) == [[0]]
    assert "4 rows (hold = true)" in ramp.attrs["history"]
    with pytest.raises(InputError, match=r"log\.csv: hold must be true or false, got 'yes'"):
        read(put(tmp_path, STEPS), mapping={"hold": "yes"})
    shape = tmp_path / "shape.csv"
    shape.write_text("t,x_0,y_0,z_0\n0,0,0,0\n1,0,0,0\n")
    with pytest.raises(InputError, match="hold = true needs pressure or another input"):
        read(shape, mapping={"hold": True})


@pytest.mark.parametrize("rows", [
    ([0, 1, 3, 4, 6], [0, 0, 60, 60, 0]),  # corners of ramps: some rows repeat the level before them
    (np.arange(0, 60, 1.0), np.arange(0, 60, 1.0)),  # a slow sweep that was logged once a second
    (np.arange(0, 30, 1.0), 30 + 30 * np.sin(np.arange(0, 30, 1.0))),  # measured values are on no coarse scale
    (np.arange(0, 2, 0.05), np.tile([0, 60], 20)),  # a log of 20 Hz
    ([0, 5], [0, 60]),
], ids=["ramps", "sweep", "measured", "fast", "two rows"])
def test_other_tables_stay_as_they_are(tmp_path, rows):
    log = read(put(tmp_path, table(*rows)))
    assert log.sizes["pressure_time"] == len(rows[0])
    assert "keeps its value" not in log.attrs["history"]


def test_a_window_that_begins_between_two_rows_keeps_the_level(tmp_path):
    time = np.arange(0, 9, 0.05)
    shape = make_recording(time, np.zeros((time.size, 1, 3)), station=["tip"])
    joined = with_pressure(shape, read(put(tmp_path, STEPS)), "r", "log.csv")
    assert at(cut_time(joined, 1.5, 2.2), 1.5, 2.2) == [[60, 0], [60, 0]]


def test_tensions_are_held_too(tmp_path):
    path = put(tmp_path, "0,0\n1,2.5\n2,0\n3,5\n")
    mapping = {"time": 0, "inputs": {"columns": [1], "kind": "tension", "unit": "N", "names": ["cable"]}}
    assert inputs_at(read(path, mapping=mapping), np.array([1.9, 2.5, 3.5])).tolist() == [[2.5], [0.0], [5.0]]
