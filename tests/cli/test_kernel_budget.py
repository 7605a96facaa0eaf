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

SIMULATE = {
    "march_loops.march_5": 1, "llvm.step_5_part": 1, "elastic.follows_n_part": 1, "elastic.tangent_n_part": 1,
    "elastic.spring_slope_n_part": 1, "march_loops.keep_row_n_part": 1,
    "llvm.add_step_work_5_part": 1, "contact.add_link_loads_n_part": 1, "chamber.share_out_n_part": 1,
}


def compiled_by(folder, *command):
    """Kernels that a command compiles into an empty cache, by name, with the number of their signatures."""
    cache = folder / "kernels"
    done = subprocess.run(
        [sys.executable, "-m", "pliant", *command], env={**os.environ, "NUMBA_CACHE_DIR": str(cache)},
        capture_output=True, text=True, check=False,
    )
    assert done.returncode == 0, done.stderr
    names = (re.sub(r"_[0-9a-f]{12}-.*", "", file.name) for file in cache.rglob("*.nbc"))
    return Counter(names)


@pytest.mark.slow
def test_a_first_simulation_compiles_the_march_and_what_it_calls(tmp_path):
    save_model(chen2018.model(), tmp_path / "model.json")
    assert compiled_by(tmp_path, "simulate", str(tmp_path / "model.json")) == SIMULATE


def test_commands_that_march_nothing_compile_nothing(tmp_path):
    for command in (["--help"], ["inspect", str(FOLDER / "pulse_119.nc")]):
        assert not compiled_by(tmp_path, *command), command
