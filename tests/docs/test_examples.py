"""Examples in the docstrings of public names give what they show."""

from __future__ import annotations

import doctest

import pytest
from test_public_page import DOCUMENTED

SHOWN = [name for name, thing in DOCUMENTED.items() if ">>> " in (thing.__doc__ or "")]


def test_most_public_names_have_an_example():
    assert len(SHOWN) >= 24


@pytest.mark.parametrize("name", SHOWN)
def test_the_example_of_a_public_name(name):
    text = DOCUMENTED[name].__doc__
    example = doctest.DocTestParser().get_doctest(text, {}, name, None, 0)
    printed: list[str] = []
    doctest.DocTestRunner(verbose=False).run(example, out=printed.append)
    assert not printed, "".join(printed)
