"""Models whose texts try to become code, and what of a C file is neither comment nor string."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Iterator
from typing import Any, get_type_hints

from pliant.errors import InputError
from pliant.model import Chamber, Extension, Memory, Model, Station, Valve

MARK = "zqx"
HOSTILE = (
    f"a */ int {MARK}(void) {{ return 7; }} /*", f'a"; int {MARK} = 7; "', f"a\nint {MARK} = 7;\n",
    f"a */\r#error {MARK}\r", f"??/\n*??/\n/ int {MARK};", f"a *\\\n/ int {MARK};", f"{MARK} \\", f"// {MARK} ??/",
    f"@STATE@ @P@ @COMMENT@ {MARK}", f"{MARK}'><b id='x'/><!-- -- --->", f"]]>&lt;&{MARK};%{MARK};",
    f"%s%n {MARK} %%", f"$\\{MARK}$", f"\0\x1b[2J{MARK}", f"{MARK}\u202e\u2028\ud800\ufffe", f"é {MARK} 名",
    f"{MARK}--", "", f"{MARK}[1,2].x", f"der({MARK})", f"9 {MARK}", f"q_1\t{MARK}", f"{MARK}" * 2000,
    f"__import__('os').system('{MARK}')", f"{{{{ {MARK} }}}}", f"../../{MARK}",
)


def plain_model(*, lengthens: bool = False) -> Model:
    """A model with a text in every field that takes one."""
    valve = Valve(rise_time=0.02, fall_time=0.02)
    chambers = (
        Chamber([6e-7, 1e-13], joint_gain=[1.0, 0.0], valve=valve if lengthens else Valve(), name="near"),
        Chamber([-5e-7], joint_gain=[0.0, 1.0], valve=valve, name="far"),
    )
    return Model(
        link_length=[0.05, 0.04], link_mass=0.01, stiffness=1.0, damping=5e-3, chambers=chambers,
        memory=Memory((0.1,), (0.5,)), name="arm", source={"stiffness": "a test"},
        stations=[("middle", 0, 0.03), ("tip", 1, 0.04), ("base", -1, 0.0)],
        extensions=(Extension(300.0, 1.0, name="whole"),) if lengthens else (),
    )


def texts(value: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Paths to every text in nested dataclasses, named tuples, tuples and dictionaries, keys included."""
    if isinstance(value, str):
        yield path
    elif dataclasses.is_dataclass(value):
        for field in dataclasses.fields(value):
            yield from texts(getattr(value, field.name), (*path, field.name))
    elif hasattr(value, "_fields"):
        for field in value._fields:
            yield from texts(getattr(value, field), (*path, field))
    elif isinstance(value, tuple):
        for k, part in enumerate(value):
            yield from texts(part, (*path, k))
    elif isinstance(value, dict):
        for key, part in value.items():
            yield (*path, ("key", key))
            yield from texts(part, (*path, key))


def changed(value: Any, path: tuple[Any, ...], text: str) -> Any:
    """A copy of a value with another text at a path; InputError where the model refuses it."""
    if not path:
        return text
    first, rest = path[0], path[1:]
    if isinstance(first, tuple):
        return {text if key == first[1] else key: part for key, part in value.items()}
    if isinstance(value, dict):
        return value | {first: changed(value[first], rest, text)}
    if isinstance(value, tuple) and not hasattr(value, "_fields"):
        return tuple(changed(part, rest, text) if k == first else part for k, part in enumerate(value))
    part = changed(getattr(value, first), rest, text)
    if isinstance(value, Model):
        return value.with_(**{first: part})
    return value._replace(**{first: part}) if hasattr(value, "_fields") else dataclasses.replace(value, **{first: part})


def accepted(model: Model, path: tuple[Any, ...]) -> bool:
    """Whether a text of the model may be any text: not one of a few words."""
    try:
        changed(model, path, "anything else")
    except InputError:
        return False
    return True


def hostile_everywhere(model: Model, *given: str) -> Model:
    """The model with hostile texts, one after the other, in every place that takes one; a number makes them differ."""
    for k, path in enumerate([p for p in texts(model) if accepted(model, p)][::-1]):  # a key last: it moves its text
        model = changed(model, path, f"{given[k % len(given)]}{k or ''}")
    return model


def text_fields() -> set[tuple[str, str]]:
    """Every field of the model's parts whose annotation can hold a text: (class, field)."""
    parts = (Model, Chamber, Valve, Memory, Extension, Station)
    return {
        (part.__name__, name) for part in parts for name, hint in get_type_hints(part).items()
        if re.search(r"\bstr\b", str(hint)) and name in fields_of(part)
    }


def fields_of(part: type) -> tuple[str, ...]:
    """Names of the fields of a dataclass or a named tuple."""
    return part._fields if hasattr(part, "_fields") else tuple(f.name for f in dataclasses.fields(part))


def code_of(text: str) -> str:
    """What of a C text is neither comment nor string nor character, by the phases of translation of C99 5.1.1.2."""
    for third, plain in zip("=/'()!<>-", "#\\^[]|{}~", strict=True):
        text = text.replace(f"??{third}", plain)
    text = re.sub(r"\\[ \t]*\r?\n", "", text)  # gcc takes blanks before the end of the line too
    token = re.compile(r"/\*.*?\*/|//[^\n]*|\"(?:\\.|[^\"\\\n])*\"|'(?:\\.|[^'\\\n])*'", re.DOTALL)
    code = token.sub(lambda match: " " if match[0][0] == "/" else match[0][0] * 2, text)
    assert "/*" not in code, "a comment without an end"
    return "\n".join(line for line in (" ".join(line.split()) for line in code.splitlines()) if line)
