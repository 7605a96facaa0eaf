"""What a study found, written and read back: nothing that report or figures show may be lost on the way."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from itertools import cycle

import numpy as np
import pytest
import xarray as xr

from pliant.errors import InputError, PliantError
from pliant.exporters.provenance import standard_errors
from pliant.exporters.randomisation import uncertainty_of
from pliant.identification import Experiment
from pliant.simulation import Trace
from pliant.validation import store
from pliant.validation.outcome import RecordOutcome
from pliant.validation.store import load_outcome, recorded, save_results


@pytest.fixture(scope="module")
def kept(outcome, shape, tmp_path_factory):
    """A study, and the folder that it is written into once."""
    whole, folder = replace(outcome, shape=shape), tmp_path_factory.mktemp("kept")
    save_results(whole, folder)
    (folder / "metrics.json").write_text(json.dumps(whole.to_dict()).replace("NaN", "null"), encoding="utf-8")
    return whole, folder


def test_the_report_of_what_was_read_back_is_the_same_page(kept):
    from pliant.view.report import report_page

    whole, folder = kept
    assert report_page(load_outcome(folder)) == report_page(whole)


def test_arrays_come_back_to_the_bit(kept):
    whole, folder = kept
    again = load_outcome(folder)
    for fit, same in zip(whole.fits, again.fits, strict=True):
        assert same.result.model == fit.result.model
        for record, found in zip(fit.records, same.records, strict=True):
            for a, b in ((record.experiment.position, found.experiment.position), (record.modelled, found.modelled),
                         (record.pressure, found.pressure)):
                np.testing.assert_array_equal(a, b)
    np.testing.assert_array_equal(again.shape.links.tips, whole.shape.links.tips)


def test_others_can_read_it_with_names_and_units(kept):
    with xr.open_dataset(kept[1] / "results.nc", group="recording_0", engine="h5netcdf") as ds:
        assert ds["position"].dims == ("time", "station", "axis")
        assert ds["position"].attrs["units"] == "m"
        assert ds["modelled"].sel(fit="linear").dims == ds["position"].dims
        assert ds.attrs["name"] == "low"


@pytest.mark.parametrize(("damage", "sentence"), [
    (lambda f: (f / "metrics.json").unlink(), "interrupted while it replaced its files: run the study again"),
    (lambda f: [p.unlink() for p in f.iterdir()], "name a folder that `pliant run` has written"),
    (lambda f: (f / "metrics.json").write_text((f / "metrics.json").read_text().replace(
        '"run_id": ""', '"run_id": "other"')), "are from different runs"),
    (lambda f: (f / "metrics.json").write_text("{"), "is not valid JSON"),
    (lambda f: (f / "metrics.json").write_text("[]"), "is not a metrics.json of"),
    (lambda f: (f / "results.nc").unlink(), "has no results.nc"),
    (lambda f: (f / "results.nc").write_bytes(b"nonsense"), "cannot be read as netCDF"),
    (lambda f: (f / "metrics.json").write_text(json.dumps({"schema": "pliant-metrics", "fits": {}})), "do not belong"),
])
def test_what_is_no_result_is_one_sentence(kept, tmp_path, damage, sentence):
    damage(shutil.copytree(kept[1], tmp_path, dirs_exist_ok=True))
    with pytest.raises(InputError, match=sentence) as caught:
        load_outcome(tmp_path)
    assert "\n" not in str(caught.value)


def entries(content, path=()):
    """Paths of every entry of nested tables, of the first of each list."""
    pairs = dict(enumerate(content[:1])) if isinstance(content, list) else content
    for key, value in pairs.items() if isinstance(pairs, dict) else ():
        yield (*path, key)
        yield from entries(value, (*path, key))


def test_any_entry_of_the_metrics_may_be_of_another_kind(kept, tmp_path, monkeypatch):
    """Whoever reads metrics.json takes it or refuses it in one sentence, such as `"parameters": null`."""
    whole, folder = kept
    groups = store.groups_of(folder)
    monkeypatch.setattr(store, "groups_of", lambda _: groups)
    content = json.loads((folder / "metrics.json").read_text())
    paths, refused = list(entries(content)), 0
    assert len([p for p in paths if p[-1] == "parameters"]) >= 2
    paths = [p for p in paths if len(p) < 3 or p[-1] in ("parameters", "covariance", "names", "matrix", "std")]
    for path, value in zip(paths, cycle([None, [], {}, "x", -1e400]), strict=False):
        holder = broken = json.loads(json.dumps(content))
        for key in path[:-1]:
            holder = holder[key]
        holder[path[-1]] = value
        (tmp_path / "metrics.json").write_text(json.dumps(broken))
        readers = (lambda: load_outcome(tmp_path), lambda: standard_errors(tmp_path / "metrics.json"),
                   lambda: uncertainty_of(whole.model, tmp_path / "metrics.json"))
        for reads in readers:
            try:
                reads()
            except PliantError as error:
                refused += 1
                assert "\n" not in str(error), path  # noqa: PT017  either way is right
    assert refused > 20


def test_angles_alone_are_kept_with_their_unit_and_reference():
    angle = np.linspace(0.0, 1.0, 24).reshape(12, 2)
    exp = Experiment("a", np.arange(12) * 0.1, np.full((12, 2, 2), np.nan), ("mid", "tip"), "pulse", level=1e4,
                     angle=angle, angle_reference="rest")  # fmt: skip
    kept = recorded(exp)["angle"]
    assert kept.dims == ("time", "station")
    np.testing.assert_array_equal(kept, angle)
    assert (kept.attrs["units"], kept.attrs["reference"]) == ("rad", "rest")


@pytest.mark.parametrize(("inputs", "unit", "called"), [
    ({"a": "Pa", "b": "Pa"}, "Pa", "measured gauge pressure"), ({"a": "N", "b": "N"}, "N", "measured tension"),
    ({"a": "rad", "b": "m"}, "rad, m", "measured input"),
])  # fmt: skip
def test_inputs_are_kept_with_their_units(inputs, unit, called):
    time = np.arange(12) * 0.1
    drives = {name: Trace(time, k + time) for k, name in enumerate(inputs)}
    exp = Experiment("r", time, np.zeros((12, 1, 2)) + time[:, None, None], ("tip",), "trace", drives=drives)
    row = RecordOutcome("r", "train", exp, exp.position, np.zeros((12, 2)), {}, inputs=inputs)
    kept = recorded(exp, row.unit_of)["pressure" if unit == "Pa" else "actuation"]
    assert (kept.attrs["units"], kept.attrs["long_name"]) == (unit, called)
    np.testing.assert_array_equal(kept[:, 1], 1 + time)
