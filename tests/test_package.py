"""Wheel and sdist: built, and tried where the source tree is not."""

from __future__ import annotations

import subprocess
import sys
import tarfile
import venv
import zipfile
from pathlib import Path

import numpy as np
import pytest

from pliant.plugins import installed

ROOT = Path(__file__).resolve().parents[1]
TRY = """
import sys
from pathlib import Path
import pliant
from pliant.study import demo_study, load_study
from pliant.testbed import bundled_recording
from pliant.view.report import ASSETS
assert Path(pliant.__file__).is_relative_to(sys.prefix), pliant.__file__
study = load_study(demo_study())
assert bundled_recording("pulse_60").sizes["time"] > 300 and study.fits
assert (ASSETS / "uPlot.LICENSE").is_file() and (Path(pliant.__file__).parent / "py.typed").is_file()
print(pliant.__version__, *map(pliant.__dict__.get, ("__name__",)), len([getattr(pliant, n) for n in pliant.__all__]))
"""


def run(*words, cwd):
    done = subprocess.run([str(w) for w in words], capture_output=True, text=True, cwd=cwd, check=False, timeout=120)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    folder = tmp_path_factory.mktemp("dist")
    run(sys.executable, "-m", "hatchling", "build", "-d", folder, cwd=ROOT)
    return next(folder.glob("*.whl")), next(folder.glob("*.tar.gz"))


@pytest.mark.slow
def test_the_wheel_works_where_the_source_is_not(built, tmp_path):
    """In an environment of its own that has the dependencies, and pliant by this wheel alone."""
    venv.create(tmp_path / "clean")
    site = next((tmp_path / "clean").glob("lib/python*/site-packages"))
    (site / "dependencies.pth").write_text(f"{Path(np.__file__).parents[1]}\n", encoding="utf-8")
    with zipfile.ZipFile(built[0]) as wheel:
        wheel.extractall(site)
        scripts = wheel.read(next(n for n in wheel.namelist() if n.endswith("entry_points.txt"))).decode()
    python = tmp_path / "clean" / "bin" / "python"
    import pliant

    assert run(python, "-W", "error", "-c", TRY, cwd=tmp_path).split() == [
        pliant.__version__, "pliant", str(len(pliant.__all__))]
    assert "inspect" in run(python, "-m", "pliant", "--help", cwd=tmp_path)
    assert "pliant = pliant.__main__:main" in scripts


@pytest.mark.slow
def test_the_sdist_makes_the_same_wheel(built, tmp_path):
    with tarfile.open(built[1]) as sdist:
        sdist.extractall(tmp_path, filter="data")
    (source,) = tmp_path.iterdir()
    run(sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", tmp_path / "again", cwd=source)
    with zipfile.ZipFile(built[0]) as one, zipfile.ZipFile(next((tmp_path / "again").glob("*.whl"))) as two:
        assert {i.filename: i.CRC for i in one.infolist()} == {i.filename: i.CRC for i in two.infolist()}
    for name in ("README.md", "LICENSE", "CITATION.cff", "constraints.txt", "docs/index.md", "tests/test_package.py"):
        assert (source / name).is_file(), name


def test_entry_points_are_those_of_what_is_installed(tmp_path, monkeypatch):
    about = tmp_path / "theirs-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: theirs\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text("[pliant.nothing_yet]\nbench = their_package:Plant\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    installed.cache_clear()
    try:
        assert installed("pliant.nothing_yet") == {"bench": "their_package:Plant"}
    finally:
        installed.cache_clear()
