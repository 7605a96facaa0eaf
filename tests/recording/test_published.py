"""Public recordings: brought from a mirror, checked, found as data:NAME/FILE; what is absent says how it comes."""

from __future__ import annotations

import tomllib
from hashlib import sha256
from pathlib import Path

import pytest
from typer.testing import CliRunner

from pliant.cli import app
from pliant.errors import InputError
from pliant.recording import published, read
from pliant.recording.published import DataSet, Published, data_sets, fetch, is_published
from pliant.study import load_study
from pliant.study.prepare import load_recording

ROOT = Path(__file__).resolve().parents[2]
CONTENT = b"t,p_kpa\n0,0\n0.1,5\n0.2,6\n"


@pytest.fixture
def mirror(tmp_path, monkeypatch):
    """A data set of one file on a mirror beside the user's folder, with an odd name."""
    there = tmp_path / "a mirror" / "push"
    there.mkdir(parents=True)
    (there / "log 1.csv").write_bytes(CONTENT)
    known = DataSet("push", "a push", "MIT", "nobody, commit 1234567", {
        "log 1.csv": Published(sha256(CONTENT).hexdigest(), "https://localhost:9/raw/log%201.csv")})  # fmt: skip
    monkeypatch.setattr(published, "data_sets", lambda: {"push": known, "hand": DataSet(
        "hand", "made", "MIT", "nobody", {"a.npz": Published("0" * 64, by_hand="made from b.npy")})})  # fmt: skip
    monkeypatch.setenv("PLIANT_DATA", str(tmp_path / "user"))
    monkeypatch.delenv("PLIANT_DATA_MIRROR", raising=False)
    return (tmp_path / "a mirror").as_uri()


def test_a_file_is_brought_once_and_found_by_every_reader(mirror, tmp_path):
    with pytest.raises(InputError, match=r"run `pliant data fetch push`, or download log 1.csv from "
                                         r"https://localhost:9/raw/log%201.csv and put it into .*user/push"):
        read("data:push/log 1.csv")
    (path,) = fetch("push", mirror=mirror)
    assert path.read_bytes() == CONTENT
    (tmp_path / "a mirror" / "push" / "log 1.csv").unlink()
    assert fetch("push", mirror=mirror) == [path]
    assert read("data:push/log 1.csv")["pressure"].values.tolist() == [0.0, 5000.0, 6000.0]


def test_another_file_than_the_published_one_is_not_kept(mirror, tmp_path, monkeypatch):
    (tmp_path / "a mirror" / "push" / "log 1.csv").write_bytes(CONTENT + b"0.3,7\n")
    monkeypatch.setenv("PLIANT_DATA_MIRROR", mirror)
    with pytest.raises(InputError, match=r"cannot download .* from file://"):
        fetch("push")
    assert not list((tmp_path / "user").rglob("*.csv"))
    (tmp_path / "user" / "push").mkdir(parents=True, exist_ok=True)
    (tmp_path / "user" / "push" / "log 1.csv").write_bytes(b"t,p_kpa\n0,1\n")
    with pytest.raises(InputError, match="differs from the published file \\(checksum\\)"):
        read("data:push/log 1.csv")


def test_without_a_network_one_sentence_says_where_to_put_it(mirror, monkeypatch):
    with pytest.raises(InputError, match=r"cannot download .* from https://localhost:9/.*by hand.* put it into"):
        fetch("push")
    for name, told in (("nothing", "there is no public data set 'nothing': use one of push"),
                       ("hand", "download it by hand")):  # fmt: skip
        with pytest.raises(InputError, match=told):
            fetch(name)
    with pytest.raises(InputError, match=r"push has no file 'b\.csv'"):
        read("data:push/b.csv")
    with pytest.raises(InputError, match=r"must begin with https://"):
        fetch("push", mirror="ftp://somewhere")


def test_the_command_lists_and_fetches(mirror):
    runner = CliRunner()
    listed = runner.invoke(app, ["data", "list"])
    assert "absent  log 1.csv" in listed.output
    assert "MIT; nobody, commit 1234567" in listed.output
    assert "by hand: made from b.npy" in listed.output
    done = runner.invoke(app, ["data", "fetch", "push", "--mirror", mirror])
    assert done.exit_code == 0, done.output
    assert "here    log 1.csv" in runner.invoke(app, ["data", "list"]).output


def test_every_example_names_files_that_are_known():
    used = set()
    for path in (ROOT / "examples").glob("*.toml"):
        text = path.read_text(encoding="utf-8")
        if "No licence is stated" in text:  # these recordings may not be passed on: the file says where they are
            continue
        content = tomllib.loads(text)
        files = [r["file"] for r in content.get("recordings", {}).values() if "file" in r]
        assert all(f.startswith("data:") for f in files), path
        used |= {f.removeprefix("data:") for f in files}
    known = {f"{name}/{file}" for name, one in data_sets().items() for file in one.files}
    assert used <= known
    assert len(used) >= 10


def test_the_table_is_that_of_the_recordings(shared_data, monkeypatch):
    for name, one in data_sets().items():
        for file, entry in one.files.items():
            assert is_published(shared_data / name / file, entry), (name, file)
            assert bool(entry.address) != bool(entry.by_hand)
    monkeypatch.setenv("PLIANT_DATA", str(shared_data))
    study = load_study(ROOT / "examples" / "silicone_cantilever.toml")
    assert load_recording(study, "alone").sizes["station"] == 6
