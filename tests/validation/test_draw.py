from __future__ import annotations

from dataclasses import replace

import pytest

from pliant.errors import InputError, PliantError, SimulationError
from pliant.validation.draw import draw_figures, file_name


@pytest.mark.slow
def test_every_figure_of_a_study_is_drawn_once(outcome, shape, tmp_path):
    files = list(draw_figures(replace(outcome, shape=shape), tmp_path, kinds=["svg"], all_fits=True))
    assert len(files) == len(set(files)) == 3 * 5 + 2 + 1 + 2 + 1  # records, compared, torque law, shape, forecast
    assert all(f.is_file() for f in files)


@pytest.mark.parametrize("width", [88.0, 182.0])
def test_the_width_is_that_of_the_column(outcome, tmp_path, width):
    file = next(draw_figures(outcome, tmp_path, kinds=["svg"], width_mm=width, records=["low"]))
    points = float(file.read_text(encoding="utf-8").split('width="')[1].split("pt")[0])
    assert points == pytest.approx(width / 25.4 * 72, abs=0.01)


@pytest.mark.slow
def test_wanted_records_alone(outcome, tmp_path):
    files = list(draw_figures(outcome, tmp_path, kinds=["pdf"], records=["let go/"]))
    assert [f.name for f in files] == [f"linear-let-go--{what}.pdf" for what in ("motion", "residual", "path")]
    assert files[0].read_bytes().startswith(b"%PDF")


@pytest.mark.parametrize(("asked", "sentence"), [
    ({"kinds": ["gif"]}, "must be one of svg, pdf, png, got 'gif'"), ({"records": ["moon"]}, "no record 'moon'"),
    ({"width_mm": 5.0}, "must be 60 to 400 mm, got 5"),
])
def test_what_cannot_be_drawn_is_one_sentence(outcome, tmp_path, asked, sentence):
    with pytest.raises(InputError, match=sentence):
        next(draw_figures(outcome, tmp_path, **asked))


def test_file_names_are_plain_and_differ():
    taken: set[str] = set()
    names = [file_name(n, taken) for n in ("../../etc", "..", "A b", "a-b", "软")]
    assert names == ["etc", "figure", "A-b", "a-b-2", "figure-2"]


def test_a_figure_that_cannot_be_drawn_is_named_and_the_others_are_drawn(outcome, tmp_path, monkeypatch):
    def fail(*_):
        raise SimulationError("no path today")

    monkeypatch.setattr("pliant.validation.figures.path_figure", fail)
    monkeypatch.setattr("pliant.validation.figures.residual_figure", fail)
    warned = []
    drawn = [p.stem for p in draw_figures(
        outcome, tmp_path, kinds=["svg"], records=["low"], all_fits=True, warn=warned.append)]
    assert drawn == ["linear-low-motion", "square-low-motion", "compare-low"]
    assert warned[1] == "warning: The figure linear-low-path could not be computed: no path today."
    assert len(warned) == 4
    for name in ("record_figure", "comparison_figure"):
        monkeypatch.setattr(f"pliant.validation.figures.{name}", fail)
    with pytest.raises(PliantError, match="The figure linear-low-motion could not be computed"):
        list(draw_figures(outcome, tmp_path, kinds=["svg"], records=["low"], all_fits=True))


def test_the_chosen_fit_alone_by_default(outcome, tmp_path):
    files = [f.stem for f in draw_figures(outcome, tmp_path, kinds=["svg"], records=["low"])]
    assert files == ["linear-low-motion", "linear-low-residual", "linear-low-path"]
