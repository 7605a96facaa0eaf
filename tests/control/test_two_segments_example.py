"""The example of two segments does what its page says."""

from __future__ import annotations

import runpy
from pathlib import Path

import pytest

from pliant.loop import read_log

pytestmark = pytest.mark.slow  # kernels of their own are compiled first

SCRIPT = Path(__file__).parents[2] / "examples" / "control" / "two_segments.py"


def test_the_tip_of_another_specimen_keeps_to_its_path(tmp_path):
    example = runpy.run_path(str(SCRIPT))
    done = example["follow"](tmp_path, duration=1.0)
    off = example["off_path"](done)
    assert len(off) == 100
    assert off.max() < 1.5  # mm, of a path of 72 by 20
    assert not done.summary["fault"]
    assert len(read_log(tmp_path / "log.csv")) == 250
