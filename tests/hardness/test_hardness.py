"""The fuzzer of hardness.py at a small size: nothing crashes, nothing is silent; and the fuzzer sees it."""

from __future__ import annotations

import time
from collections import Counter

import forked
import hardness
import hostile
import mutations
import numpy as np
import pytest


@pytest.fixture(scope="module")
def tools():
    with forked.forked():
        yield hardness, hostile, mutations


@pytest.fixture(scope="module")
def originals(tools, tmp_path_factory):
    return {o.name: o for o in tools[2].originals(tmp_path_factory.mktemp("originals"))}


FAST = ("csv, own", "csv, wide", "csv, Motive", "tsv, Luna", "txt, mapped", "npz", "csv, DeepLabCut",
        "csv, angles", "csv, curvature", "lvm, LabVIEW")  # fmt: skip
HELPED = ("c3d", "nc, own", "nc, foreign", "mat, plain", "mat, packed", "nc, resealed", "mat, 7.3",
          "h5, SLEAP", "h5, DeepLabCut table", "h5, DeepLabCut fixed")  # fmt: skip


def test_every_format_is_here(originals, tools):
    assert set(originals) == {*FAST, *HELPED}
    assert set(tools[2].HDF5) < set(originals)


@pytest.mark.parametrize(("name", "count"), [
    *((n, 60) for n in FAST), *((n, 15) for n in HELPED),
    *(pytest.param(n, 50, marks=pytest.mark.slow) for n in HELPED),
])
def test_damaged_files_are_right_refused_or_told(tools, originals, tmp_path, name, count):
    mutations, original = tools[2], originals[name]
    whole, counted = mutations.read_whole(original, tmp_path), Counter()
    for number in range(count):
        data, kind, at = mutations.damaged(original, np.random.default_rng([99, number]))
        result, sentence = mutations.outcome(original, data, kind, at, whole, tmp_path)
        counted[result] += 1
        assert result in ("right", "refused", "told", "unseen"), f"seed 99, {number}: {kind} at {at}: {sentence}"
    assert counted["refused"] + counted["told"] > 0


HOSTILE = {"model files": 40, "studies": 150, "packets": 500, "free motions": 8}


@pytest.mark.parametrize(("kind", "count"), HOSTILE.items())
def test_hostile_content_is_right_refused_or_told(tools, tmp_path, kind, count):
    for number in range(count):
        result, sentence = tools[1].ATTEMPTS[kind](np.random.default_rng([99, number]), tmp_path)
        assert result in ("right", "refused", "told"), f"seed 99, {number}: {sentence}"


def test_the_oracle_sees_a_change_that_nobody_told(tools, originals, tmp_path, monkeypatch):
    """A reader that swallows a cut is found silent; one that raises its library's error, a crash."""
    mutations, original = tools[2], originals["csv, Motive"]
    whole = mutations.read_whole(original, tmp_path)
    cut = whole.recording.isel(time=slice(0, -3))
    for answer, expected in ((lambda *_, **__: cut, "silent"), (lambda *_, **__: 1 / 0, "crash")):
        monkeypatch.setattr(mutations, "read", answer)
        assert mutations.outcome(original, original.data[:-100], "cut", 900, whole, tmp_path)[0] == expected


def test_the_watch_counts_what_ends_and_what_hangs(tools, tmp_path, monkeypatch):
    hardness = tools[0]
    helper = tmp_path / "helper.py"
    helper.write_text("""
import json, os, sys, time
for k in range(int(sys.argv[3]), int(sys.argv[4])):
    if k == 2:
        os.abort()
    if k == 4:
        time.sleep(60)
    print(json.dumps([k, "right", ""]), flush=True)
""")
    monkeypatch.setattr(hardness, "__file__", str(helper))
    monkeypatch.setattr(hardness, "START", 2.0)
    counted, bad = hardness.watched("any", 6, 1, 2.0, time.monotonic() + 60)
    assert counted == {"right": 4, "signal": 1, "hang": 1}
    assert [line.split(", ")[2].split(":")[0] for line in bad] == ["2", "4"]


def test_the_files_are_shared_among_the_formats(tools):
    shares = tools[0].shares(10_000)
    assert 9_900 < sum(shares.values()) <= 10_000
    hdf5 = tools[0].shares(0, 6_000)
    assert sum(hdf5.values()) == 6_000
    assert set(hdf5) == set(tools[2].HDF5)


def test_a_pickle_that_is_run_is_seen(tools, originals, tmp_path, monkeypatch):
    mutations, original = tools[2], originals["h5, DeepLabCut table"]
    whole = mutations.read_whole(original, tmp_path)
    monkeypatch.setattr(mutations, "read", lambda *_, **__: mutations.MARKER.touch() or whole.recording)
    assert mutations.outcome(original, original.data, "pickle", 0, whole, tmp_path) == ("crash", "a pickle was run")
    monkeypatch.setattr(mutations, "read", lambda *_, **__: whole.recording)
    assert mutations.outcome(original, original.data, "attack, virtual", 0, whole, tmp_path)[0] == "silent"
