"""What a first command compiles: every kernel is paid for once on each machine, so the list is short and known."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections import Counter

import pytest

from pliant.actuators import chen2018
from pliant.model import save_model
from pliant.testbed.bundle import FOLDER

SIMULATE = {"march_loops.march_plane": 1, "step": 1, "add_step_work": 1}  # the loop, and two texts as machine code


def compiled_by(folder, *command):
    """Kernels that a command compiles into an empty cache, by name, with the number of their signatures."""
    cache = folder / "kernels"
    done = subprocess.run(
        [sys.executable, "-m", "pliant", *command], env={**os.environ, "NUMBA_CACHE_DIR": str(cache)},
        capture_output=True, text=True, check=False,
    )
    assert done.returncode == 0, done.stderr
    files = [*cache.rglob("*.nbc"), *cache.rglob("*.code")]
    return Counter(re.sub(r"_[0-9a-f]{12}[-_].*", "", file.name) for file in files)


@pytest.mark.slow
def test_a_first_simulation_compiles_the_march_and_what_it_calls(tmp_path):
    save_model(chen2018.model(), tmp_path / "model.json")
    assert compiled_by(tmp_path, "simulate", str(tmp_path / "model.json")) == SIMULATE


def test_commands_that_march_nothing_compile_nothing(tmp_path):
    for command in (["--help"], ["inspect", str(FOLDER / "pulse_119.nc")]):
        assert not compiled_by(tmp_path, *command), command
