"""What the documents show works: links lead somewhere, examples run, options exist, TOML is what pliant takes."""

from __future__ import annotations

import ast
import importlib.util
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
import typer

from pliant.cli import app
from pliant.cli.new import new
from pliant.recording.arrays import ArrayMapping
from pliant.recording.bag import BagMapping
from pliant.recording.column_arrays import ColumnMapping
from pliant.recording.curvature import CurvatureMapping
from pliant.recording.mapping import options_of
from pliant.sensing.cores import Cores
from pliant.study import load_study
from pliant.study.schema import Recording, Study

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))]
LINK = re.compile(r"!?\[[^\]]*\]\(([^)\s]+)\)")
BLOCK = re.compile(r"^```(\S*)[^\n]*\n(.*?)^```", re.MULTILINE | re.DOTALL)
SCRIPTS = sorted((ROOT / "examples" / "gallery").glob("*.py"))


def name_of(path):
    return path.relative_to(ROOT).as_posix()


def blocks(path, language):
    return [text for kind, text in BLOCK.findall(path.read_text(encoding="utf-8")) if kind == language]


def anchors(path):
    """Names that a link into a page may end in: slugs of its headings, and explicit labels."""
    text = BLOCK.sub("", path.read_text(encoding="utf-8"))
    titles = re.findall(r"^#+ (.+)$", text, re.MULTILINE)
    slugs = {re.sub(r"\s", "-", re.sub(r"[^\w\s-]", "", title.lower())) for title in titles}
    return slugs | set(re.findall(r"^\(([\w-]+)\)=$", text, re.MULTILINE))


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_relative_links_lead_somewhere(page):
    for link in LINK.findall(BLOCK.sub("", page.read_text(encoding="utf-8"))):
        if re.match(r"[a-z]+:", link):
            continue
        file, _, anchor = link.partition("#")
        target = (page.parent / file).resolve() if file else page
        assert target.exists(), f"{name_of(page)} links to {link}, which is absent"
        if anchor:
            assert anchor in anchors(target), f"{name_of(page)} links to {link}, whose page has no #{anchor}"


def test_every_page_is_in_the_site():
    trees = re.findall(r"```\{toctree\}\n(.*?)```", (ROOT / "docs" / "index.md").read_text(encoding="utf-8"), re.DOTALL)
    listed = {line.strip() for tree in trees for line in tree.splitlines() if re.fullmatch(r"\w+", line.strip())}
    assert listed == {p.stem for p in (ROOT / "docs").glob("*.md")} - {"index"}


@pytest.mark.slow
def test_the_readme_s_python_runs(tmp_path):
    code = "\n".join(blocks(ROOT / "README.md", "python"))
    environment = {**os.environ, "MPLBACKEND": "Agg"}
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", code], cwd=tmp_path, env=environment, capture_output=True, text=True,
        check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-2000:]
    first_peak, difference = (float(line) for line in done.stdout.splitlines())
    assert first_peak == pytest.approx(-42.9e-3, abs=5e-5)  # as the README says
    assert difference == pytest.approx(9e-6, rel=0.1)


def programs():
    """Every command by name."""
    group = typer.main.get_command(app)
    alone = typer.Typer()
    alone.command()(new)
    return {**group.commands, "new": typer.main.get_command(alone)}


def command_lines(page):
    for text in [t for _, t in BLOCK.findall(page.read_text(encoding="utf-8"))]:
        for line in text.splitlines():
            if re.match(r"(\.venv/bin/)?pliant \w", line.strip()):
                yield line.partition("#")[0].split()


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_commands_and_options_exist(page):
    known = programs()
    for words in command_lines(page):
        assert words[1] in known, f"{name_of(page)}: there is no command {words[1]}"
        options = {option for parameter in known[words[1]].params for option in parameter.opts}
        for word in words[2:]:
            if word.startswith("-") and not re.fullmatch(r"-[\d.,]+", word):
                assert word.partition("=")[0] in options, f"{name_of(page)}: pliant {words[1]} has no option {word}"


def test_every_extra_is_listed():
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["optional-dependencies"]
    page = (ROOT / "docs" / "getting_started.md").read_text(encoding="utf-8")
    listed = re.findall(r"^\| `(\w+)` \|", page, re.MULTILINE)
    assert set(listed) == set(extras) - {"dev", "docs", "browser"}


def test_the_citation_names_this_version():
    from pliant.version import __version__

    assert f"\nversion: {__version__}\n" in (ROOT / "CITATION.cff").read_text(encoding="utf-8")


def test_the_short_study_is_whole():
    Study.model_validate(tomllib.loads(blocks(ROOT / "docs" / "studies.md", "toml")[0]))


def test_toml_of_the_data_page_is_what_pliant_takes():
    parts = [tomllib.loads(text) for text in blocks(ROOT / "docs" / "your_own_data.md", "toml")]
    assert len(parts) >= 8
    for part in parts:
        for entry in part.get("recordings", {}).values():
            Recording.model_validate(entry)
        if "recordings" not in part:
            cores = part.pop("cores", None)
            kinds = {"curvature": CurvatureMapping, "transforms": BagMapping, "stations": ColumnMapping}
            kinds |= {"inputs": ColumnMapping, "inclination": ColumnMapping}
            for name in part.get("files", {"a": 0}):
                options = options_of(Path(name), part) or {}
                if not {"time", "rate_hz"} & set(options) and {"inputs", "files"} & set(part):
                    options["rate_hz"] = 1.0  # or the time by the names of the columns
                next((kind for key, kind in kinds.items() if key in options), ArrayMapping).model_validate(options)
            if cores is not None:
                assert Cores.model_validate(cores).layout().radius.size == len(cores["files"])


CELL = re.compile(r"^```\{code-cell\}[^\n]*\n(.*?)^```", re.MULTILINE | re.DOTALL)


def cells(page):
    """Executed cells of a page as Python, without their options and magics."""
    for text in CELL.findall(page.read_text(encoding="utf-8")):
        body = re.sub(r"\A(---\n.*?^---\n|(:.*\n)+)", "", text, flags=re.MULTILINE | re.DOTALL)
        yield "\n".join(line for line in body.splitlines() if not line.startswith("%"))


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_python_uses_what_pliant_has(page):
    """Executed cells, and what a page shows without running it."""
    import pliant

    text = page.read_text(encoding="utf-8")
    assert ("{code-cell}" in text) == text.startswith("---\nfile_format: mystnb\n"), "a page with cells needs its head"
    for code in [*cells(page), *blocks(page, "python")]:
        tree = ast.parse(code)
        for node in ast.walk(tree):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("pliant"):
                exec(ast.unparse(node), {})
            if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "pliant":
                assert hasattr(pliant, node.attr), f"{name_of(page)} uses pliant.{node.attr}"


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_other_fits_of_a_study_leave_out_its_model_selection(page):
    """The first outcome of a study with model selection is the selected model, whatever its fits are."""
    for code in cells(page):
        for changes in re.findall(r"\bstudy\.model_copy\(update=\{([^}]*)\}", code):
            assert '"fits"' not in changes or '"model_selection": None' in changes, f"{name_of(page)}: {changes}"


def test_every_page_shows_what_its_pictures_are():
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        for alt, file in re.findall(r"!\[([^\]]*)\]\(([^)]+)\)", text):
            assert len(alt) > 20, f"{name_of(page)}: {file} needs words for who does not see it"
        for code in CELL.findall(text):
            if re.search(r"plt\.subplots|_figure\(|^figure$", code, re.MULTILINE):
                assert "alt:" in code, f"{name_of(page)}: a drawn figure needs alt"


@pytest.mark.parametrize("study", sorted((ROOT / "examples").glob("*.toml")), ids=name_of)
def test_example_files_are_valid(study):
    if "actuator" in tomllib.loads(study.read_text(encoding="utf-8")):
        assert load_study(study).fits
    else:
        from pliant.recording.columns import ColumnMapping

        ColumnMapping.model_validate(tomllib.loads(study.read_text(encoding="utf-8")))



def test_every_entry_of_a_study_is_explained():
    """At the head of a row of a table, of a section, or of a line of an example or a list."""
    from pliant.study import body_tables, schema
    from pliant.sweep.spec import Range, Sweep

    spec = importlib.util.spec_from_file_location("reference", ROOT / "docs" / "_extensions" / "reference.py")
    reference = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(reference)
    pages = ((ROOT / "docs" / name).read_text(encoding="utf-8") for name in ("studies.md", "scaling_out.md"))
    text = "".join(map(reference.fill, pages))
    models = (schema.Study, body_tables.ActuatorEntry, body_tables.ChamberTable, body_tables.TendonTable,
              body_tables.ExtensionTable, body_tables.SpaceTable, body_tables.ValveTable, body_tables.MemoryTable,
              schema.AlignmentEntry, schema.Fibre, schema.Reduction, schema.KnownForce, schema.Recording, schema.Fit,
              schema.SelectionEntry, schema.AdaptEntry, schema.ForecastEntry, schema.Targets, Sweep, Range)  # fmt: skip
    told = r"^\|[^|]*`{0}`|^#+ .*\[{0}|^(# )?{0} = |^`\[\w+\.{0}\]`"
    missing = [f"{m.__name__}.{n}" for m in models for n in m.model_fields
               if not re.search(told.format(n), text, re.MULTILINE)]
    assert not missing, f"docs/studies.md does not explain {', '.join(missing)}"


@pytest.mark.slow
@pytest.mark.parametrize("script", [s for s in SCRIPTS if s.stem in {"pulse_response", "curvature_fan"}], ids=name_of)
def test_gallery_scripts_run(script, tmp_path):
    picture = tmp_path / "picture.png"
    done = subprocess.run([sys.executable, "-W", "error", script, picture], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    assert picture.stat().st_size > 10_000


def test_a_users_script_takes_every_public_name():
    """`make lint` holds it to mypy --strict."""
    script = Path(__file__).with_name("user_script.py")
    used = set(re.findall(r"pliant\.(\w+)", script.read_text(encoding="utf-8")))
    import pliant

    assert set(pliant.__all__) <= used, f"the script leaves out {sorted(set(pliant.__all__) - used)}"


@pytest.mark.parametrize("path", PAGES, ids=name_of)
def test_no_line_of_a_page_begins_as_a_comment(path):
    """MyST drops lines that begin with a percent sign."""
    lost = [line for line in BLOCK.sub("", path.read_text(encoding="utf-8")).splitlines() if line.startswith("% ")]
    assert not lost
