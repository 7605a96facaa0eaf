"""Export of a model as C99 code: one .c and one .h file without dependencies, memory allocation or global variables.

`compiler.c` runs the kernels of `pliant.Stepper` on symbolic names and records their operations as C code. A struct of
parameters holds the numbers that a controller may change (stiffness, damping, masses, lengths, torque law, valve).
Features that the model lacks (hysteresis, viscoelastic lag, limits of a valve) are omitted from the code.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from importlib.resources import files
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from pliant.compiler.c import cosine_and_sine
from pliant.errors import InputError, shown
from pliant.exporters.c_functions import DERIVED, UNIT, Text, parameters
from pliant.exporters.c_space import text_of
from pliant.exporters.provenance import Provenance
from pliant.exporters.registry import Exporter, stated_levels, with_identifiers
from pliant.files import write_text
from pliant.mechanics import mechanics_of
from pliant.model import Model
from pliant.model.features import LATER_TERMS
from pliant.simulation import state
from pliant.simulation.solve import check_step
from pliant.simulation.time_step import shared_step, warn_too_coarse
from pliant.text import escaped

Array = np.ndarray
CAN = LATER_TERMS | {
    "springs", "drive", "chambers", "points", "lengthening", "space_lengthening", "curved_segments", "axial_memory",
    "tied_segments", "gravity", "softening", "bounded", "law", "own_law", "lagging_law", "dead_time", "two_lags", "lag",
    "rates", "swelling", "inflation", "creep", "slip", "space", "twist", "soft_swing", "space_memory", "tendons",
    "tendon_friction", "tendon_chords", "pair_pretension", "boucwen",
}
AXES = {2: "x and y", 3: "x, y and z"}  # by the dimension of space
MOST_LINKS = 24  # the code of a step grows with the cube of the number of links


LINEARISE = """
/* d(angle, rate)/dt = A d(angle, rate) + B d(pressure) about the present state, with hysteresis before slip,
 * and with creep and viscoelastic lag held constant. */
void @P@_linearise(const @P@_state *s, const @P@_parameters *p, @KIND@ A[@TWICE@][@TWICE@],
                        @KIND@ B[@TWICE@][@C@]);
"""


class Code(NamedTuple):
    """Exported C header and C source of a model as text, the prefix of the names in them, and the length of the queue
    that delays commands by the dead time.
    """

    header: str
    source: str
    prefix: str
    delay: int  # length of the queue of delayed commands


def defaults(text: Text) -> str:
    """Return the source of the C function that sets all parameters to the model's values."""
    w = text.writer()
    for field, value in parameters(text.model).items():
        if field not in (*DERIVED, "dead_time"):
            for index in np.ndindex(*value.shape):
                w.say(f"p->{field}{''.join(f'[{i}]' for i in index)} = {w.number(float(value[index]))};")
    w.say(f"{text.prefix}_update(p);")
    return text.function("void", "defaults", f"{text.prefix}_parameters *p", w)


def start(text: Text, pressure: ArrayLike, queue: int) -> str:
    """Return the source of the C function that sets the state to the equilibrium at `pressure` [SI], one number or one
    for each input.
    """
    model, w = text.model, text.writer()
    levels = np.broadcast_to(pressure, model.actuation.count).astype(float)
    q = state.equilibrium(model, levels)
    values: dict[str, Array] = {
        "angle": mechanics_of(model).coordinates(q), "rate": np.zeros(model.size), "pressure": levels,
        "chamber": model.actuation.rest_state(levels), "memory": state.relaxed_as_stored(model, q),
        "queue": np.tile(levels, (queue, 1)),
    }
    for field, value in values.items():
        for index in np.ndindex(*value.shape):
            w.say(f"s->{field}{''.join(f'[{i}]' for i in index)} = {w.number(float(value[index]))};")
    if queue:
        w.say("s->next = 0;")
    return text.function("void", "init", f"{text.prefix}_state *s", w)


def delays(model: Model, h: float) -> tuple[list[int], list[float]]:
    """Return each chamber's dead time as a number of whole steps of `h` [s] and a remainder [s], as two lists."""
    whole, rest = [], []
    for chamber in model.chambers:
        k, part = divmod(chamber.valve.dead_time, h)
        if part < 1e-9 * h:
            part = 0.0
        elif h - part < 1e-9 * h:
            k, part = k + 1, 0.0
        whole.append(int(k))
        rest.append(float(part))
    return whole, rest


def public_step(text: Text, h: float) -> tuple[str, int]:
    """Return the source of the C function for one time step of `h` [s], and the number of time steps that its queue of
    delayed commands holds (0 without dead time).

    A step is split at the times at which delayed commands arrive.
    """
    prefix, C, kind = text.prefix, text.model.actuation.count, text.kind
    whole, rest = delays(text.model, h)
    head = (
        f"int {prefix}_step({prefix}_state *s, const {prefix}_parameters *p, const {kind} command[{C}])\n{{\n"
    )
    head += "".join(f"    if (!isfinite(command[{c}])) return -2;\n" for c in range(C))
    w = text.writer()
    if not any(whole) and not any(rest):
        return f"{head}    return {prefix}_move(s, p, {w.number(h)}, command);\n}}\n", 0
    Q = max(k + (r > 0) for k, r in zip(whole, rest, strict=True)) + 1
    head = head.replace("{\n", f"{{\n    {kind} late[{C}];\n")
    lines = [f"    s->queue[s->next][{c}] = command[{c}];" for c in range(C)]
    cuts = [*sorted({0.0, *rest}), h]
    for begin, end in pairwise(cuts):
        for c in range(C):
            age = whole[c] + (1 if begin < rest[c] else 0)
            lines.append(f"    late[{c}] = s->queue[(s->next + {Q - age}) % {Q}][{c}];")
        lines.append(f"    if ({prefix}_move(s, p, {w.number(end - begin)}, late) < 0) return -1;")
    lines += [f"    s->next = (s->next + 1) % {Q};", "    return 0;"]
    return head + "\n".join(lines) + "\n}\n", Q


def fields(text: Text, queue: int) -> tuple[str, str]:
    """Return two texts: the members of the C struct that holds the state, and those of the C struct that holds the
    parameters.
    """
    N, C, kind = text.model.size, text.model.actuation.count, text.kind
    chain = mechanics_of(text.model)
    strains = ", strains 1" if chain.lengthens else ""
    inputs = ", ".join(dict.fromkeys(text.model.actuation.units)).replace("Pa", "Pa gauge")
    rows = [
        f"{kind} angle[{N}]; /* rad{strains}, {chain.coordinate_words} */",
        f"{kind} rate[{N}]; /* rad/s{strains and ', strains 1/s'} */",
        f"{kind} pressure[{C}]; /* {inputs}, behind the valve */",
        f"{kind} chamber[{C}][2]; /* Pa, slow pressure; 1, fourth power of the hoop stretch */",
    ]
    labels = ", ".join(text.model.memory.labels)
    m, branches = text.remembered
    axial = ", ".join(text.model.memory.axial.labels)
    more = f"; 1, {axial} of each segment" if axial else ""
    members_by_size = (
        (m * branches, f"{kind} memory[{m}][{branches}]; /* rad, {labels} of each {chain.turning_part}{more} */"),
        (queue, f"{kind} queue[{queue}][{C}]; /* {inputs}, delayed commands */"),
        (queue, "int next; /* index of the next command */"),
    )
    rows += [member for size, member in members_by_size if size]
    notes = dict.fromkeys(DERIVED, "derived") | units_of_inputs(text.model) | {
        "tendon_stiffness": "N/m, also in `torque`",
        "share": "fraction of each link, the base part first, in each segment",
        "tied": "1 where the strain of a segment changes the stiffness of a joint",
    }
    members = [
        f"{kind} {f}{''.join(f'[{size}]' for size in v.shape)}; /* {notes.get(f) or UNIT.get(f, '')} */"
        for f, v in parameters(text.model).items() if f != "dead_time"
    ]
    return tuple("\n".join(f"    {row}" for row in part) for part in (rows, members))  # type: ignore[return-value]


def at_start(model: Model, pressure: ArrayLike) -> str:
    """Return the inputs at which a model starts as text, such as "0 Pa" or "0.002 m, 0 rad"."""
    levels, units = np.unique(pressure), list(dict.fromkeys(model.actuation.units))
    if levels.size == 1 and (len(units) == 1 or not levels[0]):
        return f"{levels[0]:g} {units[0]}" if len(units) == 1 else "zero inputs"
    each = zip(np.broadcast_to(pressure, model.actuation.count), model.actuation.units, strict=True)
    return ", ".join(f"{level:g} {unit}" for level, unit in each)


def units_of_inputs(model: Model) -> dict[str, str]:
    """Return comments with the units of the parameters that depend on the kind of an input, if one is a tendon."""
    if set(model.actuation.kinds) == {"pressure"}:
        return {}
    units, law = list(dict.fromkeys(model.actuation.units)), {"Pa": "N m/Pa^k", "N": "1", "m": "N/m", "rad": "N/rad"}
    rates = " or ".join(f"{unit}/s" for unit in units)
    gains = "m of tendons" + (", 1 of chambers" if "Pa" in units else "")
    return {
        "torque": ", ".join(f"{law[unit]} (input in {unit})" for unit in units), "joint_gain": gains,
        "valve": f"s, s, {rates}, {rates}",
    }


def code(
    model: Model, provenance: Provenance, *, time_step: float, precision: str, pressure: ArrayLike, prefix: str,
) -> Code:
    """Return the C header and C source of an exported model as text."""
    if precision not in ("double", "single"):
        raise InputError(f"c99 option precision must be double or single, got {precision!r}")
    if model.n > MOST_LINKS:
        raise InputError(f"c99 supports at most {MOST_LINKS} links, got {model.n}: reduce the model's number of links")
    time_step = time_step or shared_step([model])
    check_step(model, time_step, "midpoint")
    warn_too_coarse(model, time_step)
    model = with_identifiers(model)
    prefix = escaped(prefix or model.name, "identifier").lower()
    single = precision == "single"
    text = text_of(model, prefix, single=single)
    public, queue = public_step(text, time_step)
    comment = "/*\n" + "\n".join(f" * {line}" for line in provenance.lines("c_comment")) + "\n */\n"
    rows, members = fields(text, queue)
    words = {
        "COMMENT": comment, "UP": prefix.upper(), "P": prefix, "N": model.n, "KIND": text.kind,
        "SIZE": model.size, "TWICE": 2 * model.n,
        "POSE": text.pose, "AXES": AXES[mechanics_of(model).dimension], "PLACES": len(model.gravity),
        "COMMANDS": "inputs" if model.actuation.units != ("Pa",) * model.actuation.count else "pressures [Pa gauge]",
        "C": model.actuation.count, "STATIONS": len(model.points), "STEP": repr(float(time_step)),
        "REAL": "float" if single else "double", "STATE": rows, "PARAMETERS": members,
        "PRESSURE": at_start(model, pressure), "POINTS": ", ".join(p.name for p in model.points),
    }
    linearise = text.linearise()
    words["LINEARISE"] = filled(LINEARISE, words) if linearise else ""
    header = filled((files("pliant.exporters") / "templates" / "c99.h").read_text(encoding="utf-8"), words)
    parts = [
        text.update(), defaults(text),
        start(text, pressure, queue), text.step(), public, text.tips(), text.joint_angles(), text.stations(),
        text.energy(), linearise,
    ]
    if any(f"{prefix}_cos_sin(" in part for part in parts):
        parts.insert(0, cosine_and_sine(text.kind, f"{prefix}_", single=single))
    source = f'{comment}#include <math.h>\n\n#include "{prefix}.h"\n\n' + "\n".join(filter(None, parts))
    return Code(header, source, prefix, queue)


def filled(template: str, words: Mapping[str, object]) -> str:
    """Return a text template with each ``@WORD@`` replaced by its value in `words`.

    Values that contain such a word are not replaced again.
    """
    return re.sub("@([A-Z0-9]+)@", lambda match: str(words[match[1]]), template)


def write(model: Model, provenance: Provenance, path: Path, options: Mapping[str, Any]) -> tuple[Path, ...]:
    """Write a model's C source to `path` and its C header next to it, and return both paths."""
    if not re.fullmatch(r"[\w .+-]+", path.name, re.ASCII):
        raise InputError(
            f"the file name {shown(path.name)} holds a character that cannot stand in an #include line of C: use only "
            "letters, digits, spaces, ., -, + and _"
        )
    level = stated_levels("c99", "pressure", options["pressure"], model)
    written = code(model, provenance, **{**options, "pressure": level, "prefix": options["prefix"] or path.stem})
    header = path.with_suffix(".h")
    source = written.source.replace(f'#include "{written.prefix}.h"', f'#include "{header.name}"')
    return write_text(path, source), write_text(header, written.header)


EXPORTER = Exporter(
    "c99", "C99: one .c and one .h, no dependencies, allocation or globals", (".c",), CAN, write,
    {"time_step": 0.0, "precision": "double", "pressure": "0", "prefix": ""},
)
