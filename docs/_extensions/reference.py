"""Parts of the reference that are made from the code: ``<!-- made from the code: NAME -->`` becomes Markdown.

Commands from their help, parameters and metrics from their tables, files from the schemas that check them. The
schemas themselves are written beside the site, for editors and other programs.
"""

from __future__ import annotations

import dataclasses
import importlib
import inspect
import json
import math
import re
import types
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Literal, Union, get_args, get_origin

SHAPED = re.compile(r"\w+\[[~\w.]*(?:ndarray|Array), ' ?([^']*)'\]")  # evaluated, or as it is written
MARK = re.compile(r"<!-- made from the code: ([\w-]+) -->")
PACKAGES = (
    "recording", "reduction", "sensing", "model", "simulation", "linear", "identification", "estimation", "contact",
    "control", "loop", "exporters", "testbed", "study",
)
WORDS = {float: "number", int: "whole number", str: "text", bool: "true or false", types.NoneType: "null"}


def cell(text: Any) -> str:
    """Text in one cell of a table."""
    return " ".join(str(text).split()).replace("|", r"\|")


def table(head: tuple[str, ...], rows: list[tuple[Any, ...]]) -> str:
    """A table in Markdown."""
    lines = [head, ("---",) * len(head), *rows]
    return "\n".join(f"| {' | '.join(cell(c) for c in line)} |" for line in lines)


def commands() -> str:
    """Every command: what it does, its example, its arguments and options."""
    import typer

    from pliant.cli import JOURNEY, app

    group: Any = typer.main.get_command(app)
    made = []
    for panel, names in JOURNEY.items():
        made.append(f"## {panel}")
        for name in names:
            command = group.commands[name]
            context = command.context_class(command)
            made += [f"### `pliant {name}`", plain(command.help), f"```bash\n{command.example}\n```",
                     table(("", "meaning", "default"), [row(context, p) for p in command.get_params(context)[:-1]])]
    return "\n\n".join(made)


def plain(text: str) -> str:
    """Help as Markdown; a star stands for itself."""
    return inspect.cleandoc(text).replace("*", r"\*")


def row(context: Any, p: Any) -> tuple[str, str, str]:
    """An argument or option as the help has it: name, meaning, default."""
    name, text = p.get_help_record(context)
    words, _, ends = text.partition("  [")
    default = ends.removeprefix("default: ").removesuffix("]").strip("()")
    return f"`{name}`", words.replace("*", r"\*").replace("<", r"\<"), default.replace("*", r"\*")


def said(kind: Any) -> str:
    """A type in words."""
    origin, inner = get_origin(kind), get_args(kind)
    if origin is Literal:
        return " or ".join(f"`{json.dumps(v)}`" for v in inner)
    if origin in (Union, types.UnionType):
        return " or ".join(dict.fromkeys(said(k) for k in inner))
    if origin is Annotated:
        return said(inner[0])
    if origin in (list, tuple, dict):
        words = said(inner[-1] if origin is dict else inner[0])
        return f"{'table' if origin is dict else 'list'} of {words}{'s' * words.endswith(('number', 'text'))}"
    if hasattr(kind, "model_fields"):
        return f"[{kind.__name__}](#{kind.__name__.lower()})"
    return WORDS.get(kind, "any")


def classes(top: Any) -> list[Any]:
    """A schema and all that stand in it, in the order in which they are met."""
    found: list[Any] = []

    def enter(kind: Any) -> None:
        if inspect.isclass(kind) and hasattr(kind, "model_fields"):
            if kind not in found:
                found.append(kind)
                for field in kind.model_fields.values():
                    enter(field.annotation)
            return
        for inner in get_args(kind):
            enter(inner)

    enter(top)
    return found


def schema(top: Any, meanings: dict[str, str]) -> str:
    """A file: its entries, and those of the tables in it."""
    made = []
    for kind in classes(top):
        title = [] if kind is top else [f"### {kind.__name__}", first_line(kind)]
        made += [*title, entries(kind, meanings)]
    return "\n\n".join(made)


def entries(kind: Any, meanings: dict[str, str]) -> str:
    """Entries of one table of a file, with their meanings (in sight on a phone), types and defaults."""
    rows = []
    for name, field in kind.model_fields.items():
        shown = field.alias or name
        default = "needed" if field.is_required() else f"`{json.dumps(as_json(field.get_default()))}`"
        meaning = field.description or meanings.get(f"{kind.__name__}.{name}") or meanings.get(name, "")
        rows.append((f"`{shown}`", meaning, said(field.annotation), default if len(default) < 40 else ""))
    return table(("entry", "meaning", "type", "default"), rows)


def as_json(value: Any) -> Any:
    """A default as it stands in a file."""
    return value.model_dump() if hasattr(value, "model_dump") else value


def first_line(thing: Any) -> str:
    """The first sentence of a docstring."""
    return (inspect.getdoc(thing) or "").split("\n\n")[0].split("\n")[0]


def documented(kind: Any) -> dict[str, str]:
    """Meaning of each parameter in a docstring of numpy's style, by name."""
    text = inspect.getdoc(kind) or ""
    block = re.search(r"(?:Parameters|Attributes)\n-+\n(.*?)(?=\n\n\w+\n-+|\Z)", text, re.DOTALL)
    found = {}
    entry = re.compile(r"^(\S[^\n]*) : [^\n]*\n((?:    [^\n]*\n?)*)", re.MULTILINE)
    for names, meaning in entry.findall(block[1] if block else ""):
        words = re.sub(r"\s*# D\d+", "", " ".join(meaning.split())).replace("*", r"\*")
        found |= dict.fromkeys((n.strip() for n in names.split(",")), words)
    return found


def model_meanings() -> dict[str, str]:
    """Meaning of the entries of a model file, from the classes that they become."""
    from pliant.model import Chamber, Extension, Memory, Model, Station, Valve
    from pliant.model.file import UNITS

    made = {"units": "of every number; other units are refused", "name": "of the model",
            "chambers": "in place of the entries of the only chamber, where there are several",
            "checksum": "of all else; a file without one is taken as it is"}
    made = documented(Chamber) | documented(Model) | made
    made |= {f"ChamberEntry.{k}": v for k, v in documented(Chamber).items()}
    made |= {f"ValveEntry.{k}": v for k, v in documented(Valve).items()}
    made |= {f"ExtensionEntry.{k}": v for k, v in documented(Extension).items()}
    made |= {f"MemoryEntry.{k}": v for k, v in documented(Memory).items()}
    made |= {f"StationEntry.{k}": v for k, v in station_meanings(Station).items()}
    for name, unit in UNITS.items():
        if name in made and unit not in made[name] and " " not in name and "," not in unit:
            made[name] += f" ({unit})"
    return made


def station_meanings(kind: Any) -> dict[str, str]:
    """Meaning of a station's entries, from its docstring or the remarks beside its fields."""
    rows = re.findall(r"^    (\w+): [^#\n]*# (.*)$", inspect.getsource(kind), re.MULTILINE)
    return documented(kind) | dict(rows)


def model_file() -> str:
    """Entries of model.json."""
    from pliant.model.file import ModelFile

    return schema(ModelFile, model_meanings())


def metrics_file() -> str:
    """Entries of metrics.json."""
    from pliant.validation.metrics import definitions
    from pliant.validation.metrics_file import MetricsFile

    kinds = {"Record": definitions(turns=False), "AngleRecord": definitions(turns=True)}
    return schema(MetricsFile, {f"{kind}.{k}": v for kind, meanings in kinds.items() for k, v in meanings.items()})


def task_file() -> str:
    """Entries of a task."""
    from pliant.control.task import TaskFile

    return schema(TaskFile, {})


def metrics() -> str:
    """Every metric with its formula."""
    from pliant.validation.metrics import METRICS

    formulas = {name: f"${m.formula}$" if m.formula else "A count." if m.kind == "count" else ""
                for name, m in METRICS.items()}  # fmt: skip
    return "\n\n".join(f"`{name}`\n: {m.meaning}\n\n  {formulas[name]}" for name, m in METRICS.items())


def parameters() -> str:
    """Every parameter that a fit can free."""
    from pliant.identification.names import families

    rows = []
    for name, kind in families().items():
        bounds = " to ".join(f"{b:g}" if math.isfinite(b) else "any" for b in (kind.lower, kind.upper))
        rows.append((f"`{name}`", kind.unit, "" if bounds == "any to any" else bounds, meaning_of(kind)))
    return table(("parameter", "unit", "bounds", "meaning"), rows)


def names() -> str:
    """Public names of every package that are not on the public page: their first sentence."""
    import pliant

    made = []
    for package in PACKAGES:
        module = importlib.import_module(f"pliant.{package}")
        rows = [(f"`{name}`", first_line(getattr(module, name)).replace("*", r"\*"))
                for name in module.__all__ if name not in pliant.__all__ and described(getattr(module, name))]
        if rows:
            made += [f"### `pliant.{package}`", first_line(module), table(("name", "what it is"), rows)]
    return "\n\n".join(made)


def described(thing: Any) -> bool:
    """Whether a name has words of its own: functions and classes."""
    return callable(thing) or dataclasses.is_dataclass(thing)


def meaning_of(quantity: Any) -> str:
    """Meaning of a declared parameter, and the source of its definition in brackets."""
    source = f" ({quantity.source})" if quantity.source else ""
    return f"{quantity.meaning}{source}".replace("*", r"\*")


def number_text(value: Any) -> str:
    """Default value of an entry: a number, or numbers of an array; empty where there is none."""
    if isinstance(value, int | float):
        return f"{value:g}"
    listed = getattr(value, "tolist", lambda: value)()
    return ", ".join(map(number_text, listed)) if isinstance(listed, list | tuple) else ""


def of_record(record: Any, kind: Any) -> str:
    """Entries of a study's table that are parameters of a record of the model."""
    from pliant.model.quantity import quantities
    from pliant.model.tables import defaults_of

    rows = []
    for name, quantity in quantities(record).items():
        if name not in kind.model_fields:
            continue
        default = kind.model_fields[name].default
        if default is None and not kind.model_fields[name].is_required():  # of the record, or the preset
            default = defaults_of(record).get(name)
        rows.append((f"`{name}`", quantity.unit, number_text(default), meaning_of(quantity)))
    return table(("entry", "unit", "default", "meaning"), rows)


def study_body() -> str:
    """Parameters of the table [actuator]: of the body, then of its single chamber."""
    from pliant.model import Chamber, Model
    from pliant.study.body_tables import ActuatorEntry

    return "\n".join((of_record(Model, ActuatorEntry), *of_record(Chamber, ActuatorEntry).splitlines()[2:]))


def study_part(name: str) -> Callable[[], str]:
    """Function that returns the parameters of the study's table of one part of the body, such as "Tendon"."""

    def rows() -> str:
        from pliant import model
        from pliant.study import body_tables

        return of_record(getattr(model, name), getattr(body_tables, f"{name}Table"))

    return rows


def table_of(module: str, name: str) -> Callable[[], str]:
    """Function that returns the entries of a table of a TOML file, such as "Fit"; null stands for no value."""

    def rows() -> str:
        kind = getattr(importlib.import_module(f"pliant.{module}"), name)
        rows = entries(kind, documented(kind)).replace("`null`", "").replace(" or null", "")
        return re.sub(r"\[(\w+)\]\(#\w+\)", "table", rows)

    return rows


def checks() -> str:
    """Every plausibility check: what it examines, and its limits."""
    from pliant.preprocessing.plausibility import CHECKS

    of = {"recording": "each recording", "body": "the stated data of the body", "model": "each fitted model"}
    rows = [(c.name, of[c.subject], c.looks_at, c.threshold) for c in CHECKS]
    return table(("check", "of", "what is examined", "reported when"), rows)


def selection_terms() -> str:
    """Every term of a model selection, and what it adds."""
    from pliant.selection import TERMS

    return table(("term", "adds"), [(f"`{name}`", words) for name, words in TERMS.items()])


def targets() -> str:
    """Every part of a model, and whether an export target expresses it, always omits it with a note, or refuses it."""
    from pliant.exporters.registry import BUILT_IN, exporters
    from pliant.model.features import FEATURES

    built_in = [e for name, e in exporters().items() if name in BUILT_IN]
    rows = [(f.title, *("yes" if key in e.can else "left out" if key in e.by_nature else "no" for e in built_in))
            for key, f in FEATURES.items()]
    return table(("", *(e.name for e in built_in)), rows)


PARTS = {
    "study-body": study_body,
    **{f"study-{name.lower()}": study_part(name)
       for name in ("Valve", "Memory", "Space", "Chamber", "Tendon", "Extension")},
    "camera": table_of("recording.camera", "Camera"), "cores": table_of("sensing.cores", "Cores"),
    "mapping": table_of("recording.column_arrays", "ColumnMapping"),
    "mapping-curvature": table_of("recording.curvature", "CurvatureMapping"),
    "mapping-bag": table_of("recording.bag", "BagMapping"),
    "inclination": table_of("recording.inclination", "InclinationMapping"),
    **{f"study-{part}": table_of("study.schema", name) for part, name in (
        ("fibre", "Fibre"), ("reduction", "Reduction"), ("fit", "Fit"), ("adapt", "AdaptEntry"),
        ("selection", "SelectionEntry"), ("forecast", "ForecastEntry"), ("targets", "Targets"))},
    "commands": commands, "model-file": model_file, "metrics-file": metrics_file, "task-file": task_file,
    "checks": checks, "selection-terms": selection_terms, "targets": targets,
    "metrics": metrics, "parameters": parameters, "names": names,
}


def fill(text: str) -> str:
    """A page with every mark replaced."""
    return MARK.sub(lambda m: PARTS[m[1]](), text)


def schemas() -> dict[str, dict[str, Any]]:
    """JSON schemas by file name."""
    from pliant.model.file import ModelFile
    from pliant.study.schema import Study
    from pliant.validation.metrics_file import MetricsFile

    made = {"study": Study, "model": ModelFile, "metrics": MetricsFile}
    return {f"{name}.schema.json": kind.model_json_schema() for name, kind in made.items()}


def mark_meanings(tree: Any) -> None:
    """Mark tables of entries with their column of meanings, which has a line of its own on a phone."""
    from docutils import nodes

    for group in tree.findall(nodes.tgroup):
        head = [entry.astext() for entry in next(group.findall(nodes.row)).children]
        if "meaning" in head and len(head) in (3, 4):
            group.parent["classes"].append("entries")
            for line in group.findall(nodes.row):
                line.children[head.index("meaning")]["classes"].append("meaning")


def setup(app: Any) -> dict[str, Any]:
    """Fill pages as they are read, always anew, and write the schemas beside the site."""

    def read(_app: Any, _page: str, source: list[str]) -> None:
        source[0] = fill(source[0])

    def outdated(_app: Any, env: Any, _added: Any, _changed: Any, _removed: Any) -> list[str]:
        return [d for d in env.found_docs if MARK.search(Path(env.doc2path(d)).read_text(encoding="utf-8"))]

    def write(app: Any, error: Exception | None) -> None:
        if error is None and app.builder.name == "html":
            for name, content in schemas().items():
                Path(app.outdir, name).write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")

    def shapes(_app: Any, *details: Any) -> tuple[str | None, str | None]:
        """Show types of arrays with their shapes as they are written, without the blank that a single letter needs."""
        given, result = (text and SHAPED.sub(r"Float[Array, '\1']", text) for text in details[-2:])
        return given, result

    app.connect("autodoc-process-signature", shapes)
    app.connect("source-read", read)
    app.connect("doctree-read", lambda _app, tree: mark_meanings(tree))
    app.connect("env-get-outdated", outdated)
    app.connect("build-finished", write)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
