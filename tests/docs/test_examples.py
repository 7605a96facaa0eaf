"""Examples in the docstrings of public names give what they show."""

from __future__ import annotations

import doctest

import pytest

import pliant

SHOWN = [name for name in pliant.__all__ if ">>> " in (getattr(pliant, name).__doc__ or "")]


def test_most_public_names_have_an_example():
    assert len(SHOWN) >= 24


@pytest.mark.parametrize("name", SHOWN)
def test_the_example_of_a_public_name(name):
    text = getattr(pliant, name).__doc__
    example = doctest.DocTestParser().get_doctest(text, {}, name, None, 0)
    printed: list[str] = []
    doctest.DocTestRunner(verbose=False).run(example, out=printed.append)
    assert not printed, "".join(printed)
