"""Text on its way into code and markup."""

from __future__ import annotations

import re
from xml.etree import ElementTree as ET

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pliant.text import LONGEST, escaped, identifiers, is_identifier

NASTY = st.text(st.sampled_from("*/?\\\n\r\t\0\x1b-<>&\"' ax9é\u202e\u2028\ud800\ufffe%$"), max_size=30)


@pytest.mark.parametrize(("name", "made"), [
    ("Fig. 3: arm", "Fig_3_arm"), ("3 links", "_3_links"), ("Prüfstand", "Prufstand"), ("", "_"), ("π", "_"),
    ("x\n#define y", "x_define_y"), ("tip", "tip"), ("a" * 99, "a" * LONGEST),
])
def test_identifier(name, made):
    assert escaped(name, "identifier") == made
    assert is_identifier(made)


@given(st.one_of(st.text(), NASTY))
def test_a_line_is_printable_and_xml_takes_it(text):
    line = escaped(text, "line")
    assert line.isprintable()
    element = ET.Element("a", b=line)
    assert ET.fromstring(ET.tostring(element)).get("b") == line
    assert is_identifier(escaped(text, "identifier"))


@given(st.one_of(st.text(), NASTY))
def test_a_comment_of_c_goes_on_behind_it(text):
    line = escaped(text, "c_comment")
    assert line.isascii()
    assert not re.search(r"\*/|/\*|\?\?|[\n\r]|\\\s*$", line)


@given(st.one_of(st.text(), NASTY))
def test_a_comment_of_xml_takes_it(text):
    line = escaped(text, "xml_comment")
    assert ET.fromstring(f"<a><!--{line}--></a>").tag == "a"


NEAR = st.sampled_from(["a b", "a_b", "a_b_2", "a/b", "x" * 70])


@given(st.lists(st.one_of(st.text(max_size=5), NEAR), max_size=8))
def test_identifiers_differ_and_good_names_stay(names):
    made = identifiers(names, ["q_1", "a_b"])
    assert len(set(made)) == len(names)
    assert not {"q_1", "a_b"} & set(made)
    assert all(is_identifier(name) for name in made)
    kept = [n for k, n in enumerate(names) if is_identifier(n) and n not in {"q_1", "a_b", *names[:k]}]
    assert set(kept) <= set(made)
