"""Functions that make names and other user text safe for generated code, markup and terminals.

The names of a model, its stations, chambers and sources come from files that anybody may have written. Every exporter,
figure, page, message and command passes such text through `escaped` before it is written.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Literal
from unicodedata import category, combining, normalize

Form = Literal["line", "c_comment", "xml_comment", "identifier"]
SHOWN = 80  # characters of a name in a list
LONGEST = 63  # characters of an identifier that every C99 compiler tells apart


def escaped(text: object, form: Form) -> str:
    r"""Return `text` as one line that is safe inside a comment, an XML element or an identifier of a generated file.

    Parameters
    ----------
    text : object
        Any object; its `str` is used.
    form : {"line", "c_comment", "xml_comment", "identifier"}
        ``line``: control characters, line ends and characters that change the direction of text become ``\uXXXX``,
        and other blanks become a space. The result is allowed in XML once its writer has escaped ``<``, ``&`` and
        quotes.
        ``c_comment``: as ``line``, in ASCII, without ``/*``, ``*/`` and ``??`` (trigraphs), and no ``\`` at its end.
        ``xml_comment``: as ``line``, without ``--`` and without ``-`` at its end.
        ``identifier``: at most 63 ASCII letters, digits and ``_``, no digit first: a valid name in C, FMI, MuJoCo and
        ROS.

    Examples
    --------
    >>> escaped("tip */ int x;", "c_comment")
    'tip * / int x;'
    >>> escaped("2nd ring", "identifier")
    '_2nd_ring'
    """
    if form == "identifier":
        if is_identifier(str(text)):
            return str(text)
        letters = "".join(c for c in normalize("NFKD", str(text)) if not combining(c))  # without their accents
        name = re.sub(r"[^A-Za-z0-9]+", "_", letters).strip("_")[:LONGEST]
        return f"_{name}" if not name or name[0].isdigit() else name
    line = str(text)
    if not line.isprintable():
        line = "".join(c if c.isprintable() else " " if category(c) == "Zs" else f"\\u{ord(c):04x}" for c in line)
    if form == "xml_comment":
        line = re.sub("-(?=-|$)", "- ", line)
    if form == "c_comment":
        line = line.encode("ascii", "backslashreplace").decode()
        line = re.sub(r"\*(?=/)|/(?=\*)|\?(?=\?)", r"\g<0> ", line)
        line = f"{line}." if line.rstrip().endswith("\\") else line
    return line


def listed(names: Iterable[object], most: int = 8) -> str:
    """Return names as one text, separated by commas: at most `most` of them, each cut to 80 characters, and how many
    more there are.

    Examples
    --------
    >>> listed(["a", "b", "c"], most=2)
    'a, b and 1 more'
    """
    every = [str(name) for name in names]
    more = f" and {len(every) - most} more" if len(every) > most else ""
    return ", ".join(name if len(name) <= SHOWN else f"{name[: SHOWN - 3]}..." for name in every[:most]) + more


def is_line(text: str) -> bool:
    """Return whether `text` is one line of printable characters."""
    return text.isprintable() or all(c.isprintable() or category(c) == "Zs" for c in text)


def is_identifier(name: str) -> bool:
    """Return whether `name` is at most 63 ASCII letters, digits and _, with no digit first."""
    return len(name) <= LONGEST and re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]*", name) is not None


def identifiers(names: Iterable[object], taken: Iterable[str] = ()) -> tuple[str, ...]:
    """Return a valid identifier for each of `names`, all different from each other and from those in `taken`.

    A name that is a valid identifier and not taken is kept. Any other name is converted, and gets a number at its end
    if the converted name is in use.

    Examples
    --------
    >>> identifiers(["left tip", "left_tip", "left/tip"])
    ('left_tip_2', 'left_tip', 'left_tip_3')
    """
    texts = [str(name) for name in names]
    used = set(taken)
    valid = {name for name in texts if is_identifier(name) and name not in used}
    used |= valid
    result: list[str] = []
    for name in texts:
        if name in valid:
            valid.remove(name)
            result.append(name)
            continue
        candidate = stem = escaped(name, "identifier")
        number = 1
        while candidate in used:
            number += 1
            candidate = f"{stem[: LONGEST - len(str(number)) - 1]}_{number}"
        used.add(candidate)
        result.append(candidate)
    return tuple(result)
