from __future__ import annotations

from dataclasses import replace

import pytest

from pliant.view import write_report
from pliant.view.rows import link_rows, order_rows


def test_rows_tell_each_order_and_link(shape):
    rows = order_rows(shape)
    assert [r["n"] for r in rows] == [str(n) for n in shape.order.orders]
    assert [r["n"] for r in rows if r["used"]] == ["3"]
    assert [r["n"] for r in rows if r["chosen"]] == [str(shape.order.chosen)]
    lengths = [float(row[1]) for row in link_rows(shape)]
    assert sum(lengths) == pytest.approx(200, rel=0.02)


def test_report_has_the_shape_with_its_reason(outcome, shape, tmp_path):
    one = replace(outcome.fits[1], records=outcome.fits[1].records[:1])
    page = write_report(replace(outcome, fits=(one,), forecasts=(), shape=shape), tmp_path).read_text(encoding="utf-8")
    assert "is the lowest order within the bound of 1 mm" in page
    assert "The tip was found by its cap." in page
    assert "plot-order" in page
