"""The right reader is found, by ending and content; xarray opens the same files."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest
import xarray as xr

from pliant.errors import InputError
from pliant.recording import read, readers, write
from pliant.recording.backend import RecordingBackend
from pliant.recording.registry import BUILT_IN, ENDINGS
from pliant.testbed.bundle import FOLDER

ROOT = Path(__file__).parents[2]
SOURCE = ROOT / "src" / "pliant"


def test_xarray_opens_recordings(recording, tmp_path):
    path = write(recording, tmp_path / "a.csv")
    ds = xr.open_dataset(path, engine=RecordingBackend)
    xr.testing.assert_equal(ds.load(), recording)
    assert "pressure" not in xr.open_dataset(path, engine=RecordingBackend, drop_variables="pressure")


def test_every_built_in_reader_loads():
    assert {name: reader.name for name, reader in readers().items() if name in BUILT_IN} == {
        name: name for name in BUILT_IN
    }


NEW_READER = """
import numpy as np

from pliant.errors import InputError
from pliant.recording.registry import ENDINGS, Reader
from pliant.recording.schema import make_recording


def read_plumb(path, mapping=None):
    rows = path.read_text().split("\\n")[1:]
    if not rows:
        raise InputError(f"{path.name} is no log of a plumb line")
    return make_recording(np.arange(len(rows)), np.array([[float(x) for x in row.split()] for row in rows])[:, None])


def recognises(head):
    return head.startswith(b"plumb")
"""


def test_the_recipe_for_a_reader_is_all_that_one_needs(recording, tmp_path):
    """The lines of CONTRIBUTING, followed in a copy of the package: the new format is read, and so are the others."""
    recipe = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8").partition("**... a reader.**")[2]
    line, ending = (part.replace("NAME", "plumb").replace(".ending", ".plumb")
                    for part in re.findall(r'`("NAME": .*?|READER = .*?)`', recipe.partition("**...")[0]))  # fmt: skip
    package = tmp_path / "copy" / "pliant"
    (package / "recording").mkdir(parents=True)
    for file in (*SOURCE.iterdir(), *(SOURCE / "recording").iterdir()):
        if file.name not in ("recording", "registry.py", "__pycache__"):
            (package / file.relative_to(SOURCE)).symlink_to(file)
    registry = (SOURCE / "recording" / "registry.py").read_text(encoding="utf-8")
    registry = registry.replace("BUILT_IN = {", f"BUILT_IN = {{\n    {line}", 1)
    (package / "recording" / "registry.py").write_text(registry)
    (package / "recording" / "plumb.py").write_text(f"{NEW_READER}\n\n{ending}\n")
    (tmp_path / "a.plumb").write_text("plumb line\n0 0 1\n0 1 0")
    write(recording, tmp_path / "a.csv")
    code = ("import sys; sys.path.insert(0, sys.argv[1])\nfrom pliant.recording import read, readers\n"
            "new, old = read(sys.argv[2]), read(sys.argv[3])\n"
            "print(new.attrs['source_format'], new.sizes['time'], old.attrs['source_format'], list(readers())[0])")
    done = subprocess.run([sys.executable, "-c", code, package.parent, tmp_path / "a.plumb", tmp_path / "a.csv"],
                          capture_output=True, text=True, check=False)  # fmt: skip
    assert done.stdout.split() == ["plumb", "2", "csv", "plumb"], done.stderr


def test_endings_and_names_stand_in_one_list():
    assert {name: reader.suffixes for name, reader in readers().items() if name in BUILT_IN} == ENDINGS


def test_a_reader_of_another_ending_is_not_loaded():
    code = (
        "import sys; from pliant.recording import read\n"
        f"print(read({str(FOLDER / 'pulse_119.nc')!r}).sizes['station'])\n"
        "print([m for m in ('camera', 'c3d', 'tables') if f'pliant.recording.{m}' in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split("\n")[:2] == ["296", "[]"]


def test_files_that_are_absent_or_unknown_are_named(tmp_path):
    with pytest.raises(InputError, match="absent"):
        read(tmp_path / "a.csv")
    with pytest.raises(InputError, match="a folder"):
        read(tmp_path)
    (tmp_path / "a.xyz").write_text("1 2 3")
    with pytest.raises(InputError, match="no known format"):
        read(tmp_path / "a.xyz")
    with pytest.raises(InputError, match=r"use one of .*netcdf"):
        read(tmp_path / "a.xyz", format="word")
    (tmp_path / "b.csv").write_bytes(b"")
    with pytest.raises(InputError, match="empty"):
        read(tmp_path / "b.csv")


@pytest.mark.parametrize("ending", [".nc", ".c3d", ".npz", ".mat", ".tsv", ".csv", ".txt", ".h5"])
@pytest.mark.parametrize("content", [b"\x00" * 3000, b"\xff\xfe\x00a" * 900, b"no numbers here\n", b"1"])
def test_any_bytes_under_any_ending_end_in_one_sentence(tmp_path, ending, content):
    (tmp_path / f"a{ending}").write_bytes(content)
    with pytest.raises(InputError) as caught:
        read(tmp_path / f"a{ending}")
    assert "\n" not in str(caught.value)
