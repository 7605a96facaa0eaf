"""The printed summary of a model."""

from __future__ import annotations

import numpy as np

from pliant.display import Card, body_svg
from pliant.equations.spring_terms import SPRING_TERMS, in_words
from pliant.model.extension import Extension
from pliant.model.parameters import ModelParameters

BENT = (0.1, 0.2)  # rad, of each joint: bent shapes in the drawing
HEAD = ("link", "length mm", "mass g", "stiffness N m/rad", "damping N m s/rad", "rest angle deg")


Array = np.ndarray
SAME = 0.1  # relative tolerance between the part before the first joint and the last link of a mid-segment chain
PLACEMENT = {"base": "each joint at the base of its segment", "midsegment": "each joint in the middle of its segment"}


def joint_placement(model: ModelParameters) -> str:
    """Return "midsegment" if the model's joints are in the middle of its segments, or "base" if at the base of each.

    `chain_model` describes the two placements.
    """
    stub, last = model.base_length, float(model.link_length[-1])
    halves = model.n == 1 or float(model.link_length[0]) > (1.0 + SAME) * last
    return "midsegment" if halves and stub > 0 and abs(stub - last) < SAME * last else "base"


def segments(model: ModelParameters) -> Array:
    """Return, for each of n joints, the length (n,) [m] of the part of the actuator whose bending the joint represents.

    For joints at the base of segments it is the link behind the joint, else half of the links on both sides.
    """
    if joint_placement(model) == "base":
        return np.array(model.link_length)
    joints = model.base_length + np.concatenate([[0.0], np.cumsum(model.link_length)[:-1]])
    borders = np.concatenate([[0.0], 0.5 * (joints[1:] + joints[:-1]), [model.length]])
    return np.diff(borders)


def bending_stiffness(model: ModelParameters) -> Array:
    """Return the bending stiffness EI (n,) [N m^2] of the actuator at each of n joints: joint stiffness times segment
    length.

    EI depends on the assumed `joint_placement`: with few links, fits of the same motion give springs that differ by
    tens of per cent between the two placements. The difference vanishes as the number of links grows.
    """
    return np.asarray(model.stiffness * segments(model))


def model_card(model: ModelParameters) -> Card:
    """Return the summary of a model as a printable card: links, actuation, valve, hysteresis and gravity."""
    table = np.column_stack([
        1e3 * model.link_length, 1e3 * model.link_mass, model.stiffness, model.damping, np.degrees(model.rest_angle)
    ])
    rows = [[str(i + 1), *(f"{v:.4g}" for v in row)] for i, row in enumerate(table)]
    if model.n > 1 and np.allclose(table, table[0], rtol=1e-12, atol=0):
        rows = [[f"1 to {model.n}", *rows[0][1:]]]
    title = f"Model {model.name!r}: {model.n} link(s), {1e3 * model.length:.4g} mm, {1e3 * model.mass:.4g} g"
    poses = [("faint", chain(model, angle)) for angle in BENT] + [("modelled", chain(model, 0.0))]
    return Card(title, sentences(model), HEAD, rows, body_svg(poses, f"{title}, at rest and bent"))


def chain(model: ModelParameters, turn: float) -> np.ndarray:
    """Return the positions (n + 1, 2) [m] of the base and the link tips with every joint turned by `turn` [rad] from
    its rest angle.
    """
    angle = np.cumsum(model.rest_angle + turn)
    steps = model.link_length[:, None] * np.stack([-np.sin(angle), np.cos(angle)], axis=1)
    return np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])


def curve(segment: Extension) -> str:
    """Return text for a model's summary that says by how much an axial spring softens or stiffens; '' for a linear
    spring.
    """
    if not segment.curved:
        return ""
    sizes = ", ".join(f"{term.letter} = {getattr(segment, name) or 0.0:.3g}" for name, term in SPRING_TERMS.items())
    bound = f", slope by s at most {100 * segment.stiffening_bound:.3g} %" if segment.stiffening_bound else ""
    bending = ", and so does the bending stiffness" if segment.stiffens_bending else ""
    return f", softens or stiffens with the strain ({sizes}{bound}){bending}"


def sentences(model: ModelParameters) -> list[str]:
    """Return the sentences of a model's summary: chambers, stiffness, hysteresis, masses, gravity
    and observed points.
    """
    said = [line for c in model.chambers for line in c.sentences(alone=len(model.chambers) == 1)]
    section = " to ".join(dict.fromkeys(f"{f(bending_stiffness(model)):.3g}" for f in (np.min, np.max)))
    said.append(f"bending stiffness EI = K l: {section} N m^2, {PLACEMENT[joint_placement(model)]}")
    if used := [k for k, name in enumerate(SPRING_TERMS, 1) if getattr(model, name).any()]:
        sizes = (
            f"{term.letter} in {term.unit}: {', '.join(f'{c:.3g}' for c in np.unique(getattr(model, name)))}"
            for name, term in list(SPRING_TERMS.items())[: used[-1]]
        )
        springs = f"springs {in_words(used[-1])}, {'; '.join(sizes)}"
        if model.stiffening_bound.any():
            most = ", ".join(f"{100 * f:.3g} %" for f in np.unique(model.stiffening_bound))
            springs += f"; s changes the slope by at most {most} of K"
        said.insert(1, springs)
    for e, length in zip(model.extensions, model.segment_length, strict=True):
        damper = f", {e.damping:.4g} N s" if e.damping else ""
        said.append(f"segment {e.name!r} of {1e3 * length:.4g} mm lengthens: EA {e.stiffness:.4g} N{damper}{curve(e)}")
    if model.memory.labels:
        said.append(f"hysteresis: {', '.join(model.memory.labels)}")
    if model.memory.has_axial:
        said.append(f"hysteresis of the segments: {', '.join(model.memory.axial.labels)}")
    if model.tip_mass:
        said.append(f"tip mass: {1e3 * model.tip_mass:.4g} g")
    if model.tip_inertia:
        said.append(f"moment of inertia of the tip mass: {model.tip_inertia:.4g} kg m^2")
    if model.mass_at == "tip":
        said.append("mass of a link at its tip")
    gravity = ", ".join(f"{g:.4g}" for g in model.gravity)
    said.append(f"gravity: ({gravity}) m/s^2" if model.gravity.any() else "no gravity")
    if model.stations:
        said.append(f"observed: {', '.join(s.name for s in model.stations)}")
    return said
