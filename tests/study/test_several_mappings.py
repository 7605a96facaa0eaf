"""One mapping of a study describes its recordings and their logs, each by the names of its files."""

from __future__ import annotations

import numpy as np
import pytest
from command_line import invoke
from small_study import LEVELS_KPA, STUDY, changed, table, write_study

from pliant.study import load_study
from pliant.study.prepare import load_recording

COUNTS = {"columns": ["adc"], "unit": "kPa", "scale": 0.05, "zero": 512}
FILES = {"track": {"length_unit": "mm", "stations": {"base": {"position": ["bx", "by", "bz"]},
                                                     "tip": {"position": ["tx", "ty", "tz"]}}},
         "log": {"pressure": COUNTS}}  # fmt: skip


@pytest.fixture
def folder(tmp_path):
    """Recordings in mm beside logs in counts, both with a column of time."""
    for name, level in LEVELS_KPA.items():
        data = table(level)
        points = np.column_stack([data[:, 0], 1e3 * data[:, 2:]])
        counts = np.column_stack([data[:, 0], data[:, 1] / 0.05 + 512])
        np.savetxt(tmp_path / f"{name}_track.csv", points, "%.6f", ",", header="t,bx,by,bz,tx,ty,tz", comments="")
        np.savetxt(tmp_path / f"{name}_log.csv", counts, "%.6f", ",", header="t,adc", comments="")
    return tmp_path


def test_a_mapping_of_a_study_describes_logs_too(folder):
    recordings = {name: {"file": f"{name}_track.csv", "pressure_file": f"{name}_log.csv", "clock": "same"}
                  for name in LEVELS_KPA}  # fmt: skip
    content = {**changed("recordings", value=recordings), "mapping": {"time": "t", "files": FILES}}
    study = load_study(write_study(folder, content, recordings=False))
    for name, level in LEVELS_KPA.items():
        recording = load_recording(study, name)
        assert recording["pressure"].values.max() == pytest.approx(1e3 * level, rel=1e-6)
        np.testing.assert_allclose(recording["position"].values[:, 1], table(level)[:, 5:8], atol=1e-8)


@pytest.mark.slow  # estimates the offset of the clocks
def test_a_draft_keeps_the_mapping_of_each_file(folder):
    (folder / "track.toml").write_text(
        'time = "t"\nlength_unit = "mm"\nstations.base = { position = ["bx", "by", "bz"] }\n'
        'stations.tip = { position = ["tx", "ty", "tz"] }\n')  # fmt: skip
    (folder / "log.toml").write_text(
        'time = "t"\npressure = { columns = ["adc"], unit = "kPa", scale = 0.05, zero = 512 }\n')
    mappings = ["--mapping", f"track={folder / 'track.toml'},log={folder / 'log.toml'}"]
    done = invoke("new", folder / "arm.toml", "--from", folder / "low_track.csv", folder / "low_log.csv", *mappings,
                  "--length", "0.12", "--mass", "0.05")  # fmt: skip
    assert done.exit_code == 0, done.output
    study = load_study(folder / "arm.toml")
    (recording,) = study.recordings.values()
    assert recording.pressure_mapping["pressure"] == COUNTS
    assert recording.mapping["length_unit"] == "mm"
    assert STUDY["actuator"]["length"] == study.actuator.length
    done = invoke("new", folder / "other.toml", "--from", folder / "low_track.csv", "--mapping",
                  f"lgo={folder / 'log.toml'}")  # fmt: skip
    assert "the mapping is for files named 'lgo', but no file is: low_track.csv" in str(done.exception)
    assert not (folder / "other.toml").exists()
