from __future__ import annotations

import json
import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest

from pliant.errors import InputError
from pliant.identification import Parameter
from pliant.validation.metrics import METRICS
from pliant.validation.wording import metric_label
from pliant.view import write_report
from pliant.view.report import report_page
from pliant.view.rows import bounds, interval, model_facts, not_shown

VOID = {"meta", "img", "br", "link", "hr", "input"}


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
        if not {"style", "script"} & set(self.open):
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
    assert len(source) < 1_500_000
    assert [a["lang"] for a in page.all("html")] == ["en"]
    ids = [a["id"] for _, a in page.tags if "id" in a]
    assert len(ids) == len(set(ids))


def test_the_tables_of_records_have_a_row_for_each_record_of_each_fit(source, outcome):
    rows = sum(len(fit.records) for fit in outcome.fits)
    section = source[source.index('<section id="records">') :]
    tables = section[: section.index("</section>")].split("<table")[1:]
    assert [table.count('<th scope="row">') for table in tables] == [rows] * 3
    assert all(table.count("_polynomial law") == len(outcome.fits[1].records) for table in tables)


def test_nothing_comes_from_elsewhere(source, page):
    for tag, attrs in page.tags:
        assert not {"src", "srcset", "action", "data", "poster"} & set(attrs), tag
        assert (attrs.get("href") or "#").startswith("#")
    assert not page.all("link")
    style = "".join(re.findall(r"<style>(.*?)</style>", source, re.DOTALL))
    assert "url(" not in style
    assert "@import" not in style
    own = "".join(re.findall(r'<script>"use strict";(.*?)</script>', source, re.DOTALL))
    assert not re.search(r"fetch\(|XMLHttpRequest|WebSocket|import\(|https?:", own)


def test_every_picture_has_words(page):
    pictures = [attrs for _, attrs in page.tags if attrs.get("role") == "img"]
    assert len(pictures) == 1 + 5 + 1 + 2 + 1  # body, traces, torque law, forecast, clocks
    assert all(len(attrs["aria-label"]) > 30 for attrs in pictures)


def test_inner_links_lead_somewhere(page):
    ids = {a["id"] for _, a in page.tags if "id" in a}
    assert {a["href"][1:] for a in page.all("a") if a["href"].startswith("#")} <= ids


def test_verdict_comes_before_any_table_and_roles_are_words(page):
    text = page.text
    words = ("Caution.", "Held out, in one sentence.", "the largest error is 22 mm.", "Fits and records", "not used by")
    assert [text.index(w) for w in words] == sorted(text.index(w) for w in words)
    assert "Held out: 0.3 mm, 4 % of travel." in text
    assert text.index("not used by the fit") < text.index("Training: used by the fit")


def test_every_metric_that_is_shown_is_defined(page):
    shown = {a["href"][5:]: a["title"] for a in page.all("a") if a["href"].startswith("#def-")}
    assert len(shown) >= 10
    for key, title in shown.items():
        assert title == METRICS[key].meaning
    for metric in METRICS.values():
        assert metric.meaning in page.text


def test_gravity_shows_no_remains_of_rounding(outcome):
    body = replace(outcome.model, gravity=np.array([-2e-16, 9.81]))
    assert dict(model_facts(replace(outcome, model=body)))["gravity in the base frame"] == "(0, 9.81) m/s²"


def test_parameters_show_value_and_error_first(source):
    heads = re.search(r'aria-label="Parameters of.*?<thead>(.*?)</thead>', source, re.DOTALL)[1]
    names = [re.sub(r"<.*?>", "", h).strip() for h in re.findall(r"<th.*?>(.*?)</th>", heads)]
    assert names[:4] == ["Parameter", "value", "standard error", "unit"]


def test_inputs_are_called_by_their_names(outcome):
    high = outcome.fits[0].records[1]
    high = replace(high, inputs={"left": "Pa", "right": "Pa"}, pressure=np.repeat(high.pressure, 2, axis=1))
    one = replace(outcome, fits=(replace(outcome.fits[0], records=(high,)),))
    packed = json.loads(re.search(r'id="data">(.*?)</script>', report_page(one), re.DOTALL)[1])
    (record,) = packed["fits"][0]["records"].values()
    assert record["driven"] == ["left", "right"]


def test_user_text_is_escaped(source, page):
    assert "<script>alert" not in source
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
    assert write_report(outcome, tmp_path).read_bytes() == written.read_bytes()
    assert [p.name for p in tmp_path.iterdir()] == ["report.html"]


@pytest.fixture
def bare(outcome):
    one = replace(outcome.fits[1], records=outcome.fits[1].records[:1])
    plain = replace(outcome, verdict=(), headline=None, clocks={}, forecasts=())
    return replace(plain, fits=(one,), findings={}, timing={}, provenance={})


def test_without_verdict_and_forecast_the_page_stands(bare, tmp_path):
    page = Page(write_report(bare, tmp_path).read_text(encoding="utf-8"))
    assert "There is no verdict" in page.text
    assert "Forecasts" not in page.text


def test_a_folder_that_cannot_be_is_one_sentence(outcome, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot write into the output folder"):
        write_report(outcome, tmp_path / "file" / "out")


def test_what_the_data_do_not_show_is_told(page):
    for words in ("torque_2: the data do not determine it.", "damping and stiffness compensate each other",
                  "correlated by 0.98", "stiffness 1.480 to 1.520"):
        assert words.replace("stiffness 1.480", "1.480") in page.text


def test_small_texts():
    assert metric_label("frequency_hz") == ("frequency", "Hz")
    assert metric_label("static_drop_mm") == ("static drop", "mm")
    assert metric_label("damping_ratio") == ("damping ratio", "")
    assert bounds(Parameter("base_x")) == "none"
    assert bounds(Parameter("base_x", upper=1.0)) == "≤ 1"
    assert bounds(Parameter("base_angle")) == "−1 to 1"
    assert interval(Parameter("stiffness", 2.0, std=0.1)) == "1.804 to 2.196"
    assert interval(Parameter("stiffness", 2.0, lower=1.9, std=0.1)) == "1.900 to 2.196"
    assert interval(Parameter("stiffness", 2.0)) == "–"


def test_doubt_that_reaches_zero_or_a_bound_is_told(outcome):
    result = outcome.fits[0].result
    vague = (Parameter("stiffening", 0.3, std=0.3), Parameter("creep_time_1", 0.6, std=0.49))
    lines = not_shown(replace(result, parameters=vague, covariance=None))
    assert [line.split(":")[0] for line in lines] == ["stiffening", "creep_time_1"]
    assert "contains zero" in lines[0]
    assert "0.001000 to 1.560, is cut off" in lines[1]
    assert not_shown(replace(result, parameters=(Parameter("stiffening", -0.6, std=0.1),), covariance=None)) == []


def test_every_held_out_prediction_has_its_row(source, outcome):
    held = sum(r.role == "held_out" for f in outcome.fits for r in f.records)
    bodies = re.findall(r'<tbody class="held_out">.*?</tbody>', source, flags=re.DOTALL)
    assert [body.count('scope="row"') for body in bodies] == [held, held]
