from __future__ import annotations

import re
from dataclasses import replace
from html.parser import HTMLParser

import pytest

from pliant.errors import InputError
from pliant.identification import Parameter
from pliant.validation.metrics import DEFINITIONS
from pliant.validation.report import Gallery, rounded, write_report
from pliant.validation.rows import bounds, metric_label

VOID = {"meta", "img", "br", "link", "hr"}


class Page(HTMLParser):
    """Opens and closes every element, and collects what the tests ask for."""

    def __init__(self, text: str) -> None:
        super().__init__(convert_charrefs=True)
        self.open: list[str] = []
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.words: list[str] = []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open, f"</{tag}> closes nothing"
        assert self.open.pop() == tag

    def handle_data(self, data):
        if "style" not in self.open:
            self.words.append(data)

    def all(self, tag):
        return [attrs for name, attrs in self.tags if name == tag]

    @property
    def text(self):
        return " ".join("".join(self.words).split())


@pytest.fixture(scope="module")
def source(written):
    return written.read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def page(source):
    return Page(source)


def test_page_is_well_formed_small_and_whole(source, page):
    assert page.open == []
    assert len(source) < 3_000_000
    assert [a["lang"] for a in page.all("html")] == ["en"]
    ids = [a["id"] for _, a in page.tags if "id" in a]
    assert len(ids) == len(set(ids))


def test_nothing_comes_from_elsewhere(source, page):
    assert "http" not in re.sub(r"base64,[A-Za-z0-9+/=]+", "", source)
    assert not page.all("script")
    assert not page.all("link")
    for image in page.all("img"):
        assert image["src"].startswith("data:image/")


def test_every_figure_has_words_and_a_file(page, written):
    figures, images = page.all("figure"), page.all("img")
    assert len(figures) == len(images) == 3 * 3 + 1 + 1 + 1
    assert all(len(image["alt"]) > 30 for image in images)
    files = [a["href"] for a in page.all("a") if a["href"].startswith("figures/")]
    assert len(files) == 2 * len(figures) == len(set(files))
    assert all((written.parent / f).is_file() for f in files)


def test_inner_links_lead_somewhere(page):
    ids = {a["id"] for _, a in page.tags if "id" in a}
    assert {a["href"][1:] for a in page.all("a") if a["href"].startswith("#")} <= ids


def test_verdict_comes_before_any_table_and_roles_are_words(page):
    text = page.text
    assert text.index("Held out: 0.3 mm, 4 % of travel.") < text.index("Held out: predicted, never seen by the fit")
    assert text.index("never seen by the fit") < text.index("Training: the fit was made on these")


def test_every_metric_that_is_shown_is_defined(page):
    shown = {a["href"][5:]: a["title"] for a in page.all("a") if a["href"].startswith("#def-")}
    assert len(shown) >= 10
    for key, title in shown.items():
        assert title == DEFINITIONS[key]
    for meaning in DEFINITIONS.values():
        assert meaning in page.text


def test_user_text_is_escaped(source, page):
    assert "<script" not in source
    assert '<script>alert("x")</script> & $x_1' in page.text


def test_absent_numbers_are_dashes(page):
    assert "nan" not in page.text.lower().replace("frequency", "").split()
    assert not re.search(r"\b(None|inf|NaN)\b", page.text)
    assert "–" in page.text


def test_parameters_tell_state_bounds_and_source(page):
    for words in ("free, at a bound", "fixed", "≥ 0", "from the ring-down", "N m/Pa^2", "stiffness of every joint"):
        assert words in page.text


def test_findings_of_records_in_no_fit_are_told(page):
    assert "unused (in no fit)" in page.text


def test_forecast_tells_what_was_stated_and_found(page):
    assert "Stated: tip_mass 0.1 kg, level 10000 Pa. Predicted: frequency 3.200 Hz, static drop 12.00 mm" in page.text


def test_same_outcome_same_bytes(outcome, written, tmp_path):
    again = write_report(outcome, tmp_path)
    assert again.read_bytes() == written.read_bytes()
    figures = sorted(p.name for p in (tmp_path / "figures").iterdir())
    assert figures == sorted(p.name for p in (written.parent / "figures").iterdir())
    for name in figures:
        assert (tmp_path / "figures" / name).read_bytes() == (written.parent / "figures" / name).read_bytes()


@pytest.fixture
def bare(outcome):
    one = replace(outcome.fits[1], records=outcome.fits[1].records[:1])
    return replace(outcome, verdict=(), forecasts=(), fits=(one,), findings={}, timing={}, provenance={})


def test_without_verdict_and_forecast_the_page_stands(bare, tmp_path):
    page = Page(write_report(bare, tmp_path).read_text(encoding="utf-8"))
    assert "No verdict was formed" in page.text
    assert "Forecasts" not in page.text


def test_a_folder_that_cannot_be_is_one_sentence(outcome, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot write into the output folder"):
        write_report(outcome, tmp_path / "file" / "out")


def test_figures_beyond_the_page_are_linked_not_lost(bare, tmp_path, monkeypatch):
    monkeypatch.setattr("pliant.validation.report.BUDGET", 60_000)
    path = write_report(bare, tmp_path)
    page = Page(path.read_text(encoding="utf-8"))
    assert len(page.all("img")) < len(page.all("figure"))
    assert "no room for more figures" in page.text


def test_file_names_are_plain_and_differ(tmp_path):
    gallery = Gallery(tmp_path)
    names = [gallery.file_name(n) for n in ("../../etc", "..", "A b", "a-b", "软")]
    assert names == ["etc", "figure", "A-b", "a-b-2", "figure-2"]


def test_small_texts():
    assert metric_label("frequency_hz") == ("frequency", "Hz")
    assert metric_label("static_drop_mm") == ("static drop", "mm")
    assert metric_label("damping_ratio") == ("damping ratio", "")
    assert bounds(Parameter("base_x")) == "none"
    assert bounds(Parameter("base_x", upper=1.0)) == "≤ 1"
    assert bounds(Parameter("base_angle")) == "−1 to 1"
    assert rounded('<path d="M 1.23456 7"/><text>0.38356</text>') == '<path d="M 1.23 7"/><text>0.38356</text>'


def test_every_held_out_prediction_has_its_row(source, outcome):
    held = sum(r.role == "held_out" for f in outcome.fits for r in f.records)
    bodies = re.findall(r'<tbody class="held_out">.*?</tbody>', source, flags=re.DOTALL)
    assert [body.count('scope="row"') for body in bodies] == [held, held]
