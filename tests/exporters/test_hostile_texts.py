"""No text of a model becomes code, markup or a name that another tool would not take, in any export."""

from __future__ import annotations

import ast
import re
import shutil
import subprocess
import zipfile
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from hostile_models import (
    HOSTILE,
    MARK,
    accepted,
    changed,
    code_of,
    fields_of,
    hostile_everywhere,
    plain_model,
    text_fields,
    texts,
)

import pliant
from pliant.exporters.fmu import compiled
from pliant.exporters.registry import BUILT_IN, exporters, with_identifiers
from pliant.model import Model

ENDS = {name: e.suffixes[0] for name, e in exporters().items()} | {"state-space": ".npz"}
NAME = re.compile(r"[A-Za-z_]\w*(\[\d+(,\d+)*\])?(\.[A-Za-z_]\w*)*", re.ASCII)
WORDS = {("Model", "mass_at")}  # one of a few words, checked by the model


@pytest.fixture(scope="module", autouse=True)
def no_compiler():
    """FMUs without binaries: the C is compiled once, below."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("pliant.exporters.fmu.compiled", lambda *_: (None, "not compiled"))
        yield


def exported(model: Model, target: str, folder: Path) -> dict[str, bytes]:
    """The files of an export, those within an archive by their names."""
    done = pliant.export(
        model, target, folder / f"arm{ENDS[target]}", approximate=target == "urdf",
        standard_errors={f"{model.name}.x": 1.0} if model.name else None,
    )
    files = {}
    for path in done.files:
        if path.suffix in (".fmu", ".npz"):
            with zipfile.ZipFile(path) as archive:
                files |= {name: archive.read(name) for name in archive.namelist()}
        else:
            files[path.name] = path.read_bytes()
    return files


def skeleton(data: bytes) -> list[tuple[str, tuple[str, ...]]]:
    """Tags and names of attributes of an XML file, in order."""
    return [(e.tag, tuple(e.keys())) for e in ET.fromstring(data).iter()]


def without_texts(data: bytes) -> str:
    """The syntax of a Python file with every text emptied."""
    tree = ast.parse(data)
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            node.value = ""
    return ast.dump(tree)


def check(model: Model, target: str, folder: Path, calm: dict[str, bytes]) -> None:
    """The export of a hostile model differs from a calm one's in comments, descriptions and identifiers alone."""
    files = exported(model, target, folder)
    assert set(files) == set(calm)
    for name, data in files.items():
        if name.endswith((".c", ".h")):
            assert code_of(data.decode("ascii")) == code_of(calm[name].decode("ascii"))
        elif name.endswith(".py"):
            assert without_texts(data) == without_texts(calm[name])
        elif name.endswith((".xml", ".urdf")):
            assert skeleton(data) == skeleton(calm[name])
            for element in ET.fromstring(data).iter():
                for attribute, value in element.items():
                    if attribute in ("name", "joint", "link", "tendon", "objname") and element.tag != "Unit":
                        assert NAME.fullmatch(value), value
        elif name.endswith(".npy") and not name.startswith("pliant"):
            folder.joinpath("a.npy").write_bytes(data)
            array = np.load(folder / "a.npy", allow_pickle=False)
            assert array.dtype.kind == "f" or all(re.fullmatch(r"[\w/1]*|Pa/s|rad/s", str(v)) for v in array.ravel())


def test_every_field_that_holds_a_text_is_tried():
    models = [plain_model(), plain_model(lengthens=True)]
    tried = set()
    for model in models:
        for path in texts(model):
            owner = model
            for step in path[:-1]:
                if isinstance(step, tuple) or isinstance(owner, dict):
                    break
                owner = owner[step] if isinstance(step, int) else getattr(owner, step)
            words = [s for s in path if isinstance(s, str) and s in fields_of(type(owner))] if not isinstance(
                owner, dict) else ["source"]  # fmt: skip
            name = "Model" if isinstance(owner, dict) else type(owner).__name__
            tried |= {(name, word) for word in words}
    assert text_fields() <= tried
    refused = {(type(m).__name__, p[0]) for m in models for p in texts(m) if len(p) == 1 and not accepted(m, p)}
    assert refused == WORDS


@pytest.mark.parametrize("target", list(BUILT_IN))
def test_hostile_texts_everywhere(target, tmp_path):
    model = plain_model(lengthens=target == "state-space")
    calm = exported(model, target, tmp_path)
    for turn in (0, 9, 18):  # every place takes three of them, and all are in one place or another
        check(hostile_everywhere(model, *HOSTILE[turn:], *HOSTILE[:turn]), target, tmp_path, calm)


@pytest.mark.slow
@pytest.mark.parametrize("target", list(BUILT_IN))
def test_one_hostile_text_everywhere(target, tmp_path):
    model = plain_model(lengthens=target == "state-space")
    calm = exported(model, target, tmp_path)
    for text in HOSTILE:
        check(hostile_everywhere(model, text), target, tmp_path, calm)


@pytest.mark.slow
@pytest.mark.parametrize("target", list(BUILT_IN))
def test_each_hostile_text_in_each_field(target, tmp_path):
    model = plain_model(lengthens=target == "state-space")
    calm = exported(model, target, tmp_path)
    for place, path in enumerate(texts(model)):  # a quarter of them alone in each place, all of them above
        for text in HOSTILE[place % 4 :: 4] if accepted(model, path) else ():
            check(changed(model, path, text), target, tmp_path, calm)


def test_every_target_is_tried():
    assert set(ENDS) == set(BUILT_IN)
    assert all(ENDS[name] in exporters()[name].suffixes for name in ENDS)


def test_the_tokenizer_finds_code_in_an_old_header():
    """What an export wrote before names were escaped: the comment ends within a station's name."""
    header = f"/* The observed points a */ int {MARK}(void) {{ return 7; }} /*, tip: x, y. */\nint f(void);\n"
    assert MARK in code_of(header)
    assert MARK not in code_of(f'/* {MARK} */ char *s = "{MARK} /* \\" "; // {MARK} ??/\n {MARK}\nint f(void);')
    assert "int f" in code_of("/* *??/\n/ int f(void);")


def test_it_compiles_without_a_warning_and_its_binary_holds_no_byte_of_them(tmp_path):
    if shutil.which("cc") is None:
        pytest.skip("no C compiler (cc) is on the path")
    flags = ["-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Wcomment", "-Wtrigraphs", "-Werror", "-shared", "-fPIC"]
    pliant.export(hostile_everywhere(plain_model(), *HOSTILE), "c99", tmp_path / "arm.c")
    subprocess.run(["cc", *flags, "arm.c", "-o", "arm.so", "-lm"], cwd=tmp_path, check=True)
    assert MARK.encode() not in (tmp_path / "arm.so").read_bytes()


def strings(data: bytes) -> set[bytes]:
    """Runs of ten printable bytes and more, without the token that tells one FMU from another."""
    plain = re.sub(rb"\{[0-9a-f]{32}\}", b"", data)
    return set(re.findall(rb"[ -~]{10,}", plain))


@pytest.mark.parametrize("version", ["2.0", pytest.param("3.0", marks=pytest.mark.slow)])
def test_the_binary_of_an_fmu_holds_no_byte_of_them(tmp_path, monkeypatch, version):
    """Every text field of the model is hostile; the library differs from a calm model's in its token alone."""
    if shutil.which("cc") is None:
        pytest.skip("no C compiler (cc) is on the path")
    monkeypatch.setattr("pliant.exporters.fmu.compiled", compiled)
    libraries, others = [], []
    for model in (plain_model(), hostile_everywhere(plain_model(), *HOSTILE)):
        pliant.export(model, "fmu", tmp_path / "arm.fmu", fmi=version)
        with zipfile.ZipFile(tmp_path / "arm.fmu") as archive:
            held = {name: archive.read(name) for name in archive.namelist()}
        libraries.append(next(held.pop(name) for name in list(held) if name.startswith("binaries/")))
        others.append(b"".join(held.values()))
    assert MARK.encode() in others[1], "the texts are in the archive, as comments and descriptions"
    assert MARK.encode() not in libraries[1]
    assert strings(libraries[1]) == strings(libraries[0])


@pytest.mark.filterwarnings("ignore:Glyph:UserWarning")  # a font without a letter draws a box
def test_a_heading_of_a_figure_is_xml(tmp_path):
    """SVG takes no control characters; markup in a name stays text."""
    from pliant.plotting import new_figure
    from pliant.validation.figures import drawing
    from pliant.validation.wording import clip

    for number, text in enumerate(HOSTILE):
        with drawing():
            figure, ax = new_figure(1, 1)
            ax.set_title(clip(text))
            figure.savefig(tmp_path / f"{number}.svg")
        tags = [e.tag for e in ET.fromstring((tmp_path / f"{number}.svg").read_bytes()).iter()]
        assert not any(tag.endswith("}b") for tag in tags)


def test_names_that_were_changed_are_listed(tmp_path):
    done = pliant.export(changed(plain_model(), ("stations", 1, "name"), "left tip"), "mjcf", tmp_path / "a.xml",
                         approximate=True)  # fmt: skip
    assert "station 'left tip' is named left_tip" in done.notes
    assert "station 'left tip' is named left_tip" in (tmp_path / "a.xml").read_text()
    calm = plain_model()
    assert with_identifiers(calm) is calm
