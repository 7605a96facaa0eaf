"""A number that was measured says where it comes from: in its section stands what gives it.

That is a cell that runs when the site is built, a command, a test, a place in the paper, or a link to a section that
has one of these. Numbers that nobody measured (definitions, settings, defaults, what the paper prints) are told apart
by hand, in `CHOSEN`.
"""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
UNIT = r"(?:%|mm\b|[mµun]?s\b|k?Hz\b|degrees\b|mrad\b|px\b|k?B\b|MiB\b|GiB\b|times\b|points\b)"
NUMBER = re.compile(rf"\d ?{UNIT}")
CELL = re.compile(r"\|\s*[-−+±]?\d[\d., ]*\d(?: to [-−+\d.]+)?\s*(?=\|)")  # of a table: a number alone
FENCE = re.compile(r"^```([^\n]*)\n(.*?)^```", re.MULTILINE | re.DOTALL)
SCRIPT = re.compile(r"\bpython ((?:benchmarks|examples)/\S+?\.py)|\bpliant run (examples/\S+?\.toml)|(tests/\S+?\.py)")
GIVES = r"(?:`|^)(?:pliant (?:run|demo|bench|order)|make (?:demo|bench))\b"
COMMAND = re.compile(f"{GIVES}|{SCRIPT.pattern}", re.MULTILINE)
PAPER = re.compile(r"\[D\d+\]\(deviations\.md|\bSec(?:\.|tion) [IV]+|\bEqs?\. \(\d|^Printed\b", re.MULTILINE)
LINK = re.compile(r"\]\(([\w./]*)#([\w-]+)\)")

CHOSEN = {  # page -> section -> why its numbers need no source
    "another_day.md": {
        "another-day-another-arm": "defaults", "what-is-fitted": "widths of priors, which are set",
        "another-robot-of-the-kind": "a default", "what-comes-out": "a limit, which is set",
        "whether-the-body-changed": "thresholds, which are set",
    },
    "metrics.md": {"metrics": "definitions"},
    "real_time.md": {"what-vents-and-when": "settings"},
    "scaling_out.md": {"a-sweep": "defaults, an example", "a-cluster": "an example of a setting"},
    "studies.md": {
        "alignment": "a bound that is set",
    },
    "time_step.md": {"time-step-and-accuracy": "a bound that is set", "where-a-time-step-is-fixed": "defaults"},
    "your_own_camera.md": {"filming": "1.5 m/s times 1 ms"},
}


def slug(title):
    return re.sub(r"\s", "-", re.sub(r"[^\w\s-]", "", title.lower()))


@cache
def sections(page):
    """Text of every section by the slug of its heading; code of fences is marked, their text kept as it is."""
    text = re.sub(r"\A---\n.*?^---\n", "", page.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
    found, fences = {}, FENCE.findall(text)
    marked = FENCE.sub("\n@@\n", text)
    parts = re.split(r"^#+ (.*)$", marked, flags=re.MULTILINE)
    for title, body in zip(["", *parts[1::2]], parts[::2], strict=True):
        found[slug(title)] = (body, [fences.pop(0) for _ in range(body.count("@@"))])
    return found


def measured(body):
    """Blocks of a section that hold a number with a unit, or a table of numbers."""
    for block in re.split(r"\n\s*\n", body):
        words = re.sub(r"`[^`]*`|\$[^$]*\$|\]\([^)]*\)", "", block)
        if NUMBER.search(words) or CELL.search(words):
            yield " ".join(block.split())


def sourced(page, name, *, follow=True):
    """Whether a section says where its numbers come from."""
    body, fences = sections(page)[name]
    if any(kind.startswith("{code-cell}") or COMMAND.search(code) for kind, code in fences):
        return True
    if COMMAND.search(body) or PAPER.search(body):
        return True
    linked = ((page.parent / file if file else page, anchor) for file, anchor in LINK.findall(body))
    return follow and any(a in sections(p) and sourced(p, a, follow=False) for p, a in linked)


def found(page):
    return {name: blocks for name, (body, _) in sections(page).items() if (blocks := list(measured(body)))}


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.name)
def test_measured_numbers_name_what_gives_them(page):
    chosen = CHOSEN.get(page.name, {})
    bare = [f"{name}: {block[:90]}" for name, blocks in found(page).items() for block in blocks
            if name not in chosen and not sourced(page, name)]
    assert not bare, f"{page.name} does not say where these come from:\n" + "\n".join(bare)
    idle = [name for name in chosen if name not in found(page) or sourced(page, name)]
    assert not idle, f"{page.name} needs no exception for {', '.join(idle)}"


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.name)
def test_what_is_named_exists(page):
    for files in SCRIPT.findall(page.read_text(encoding="utf-8")):
        file = "".join(files)
        assert (ROOT / file).is_file(), f"{page.name} names {file}, which is absent"


@pytest.mark.parametrize(("more", "told"), [
    ("", False), ("`pliant run examples/a.toml` says so.", True), ("```\npliant order fit\n```", True),
    ("The study says so.", False), ("`tests/a.py` holds it.", True), ("See [below](#b).", False),
])  # fmt: skip
@pytest.mark.parametrize("number", ["It errs by 2.5 % of travel.", "| a | b |\n|---|---|\n| error, mm | 2.5 |"])
def test_a_number_without_its_source_is_found(tmp_path, number, more, told):
    page = tmp_path / "page.md"
    page.write_text(f"# A page\n\n{number}\n\n{more}\n\n## B\n\nNothing.\n", encoding="utf-8")
    assert list(found(page)) == ["a-page"]
    assert sourced(page, "a-page") == told
