"""URDF: links, joints, inertia and dampers, for RViz and for tools that know no springs."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np

from pliant.errors import InputError
from pliant.exporters.features import ALL
from pliant.exporters.mjcf import TINY, link_inertia, number
from pliant.exporters.names import with_identifiers
from pliant.exporters.provenance import Provenance
from pliant.exporters.registry import Exporter
from pliant.files import write_text
from pliant.model import Model, Station
from pliant.text import identifiers

LOST = "URDF has no springs and no pressure: it carries links, joints, inertia and dampers, and its chain hangs loose"
WORLD = "URDF has no gravity: the world that loads it has"
BY_NATURE = dict.fromkeys(ALL - {"points", "lengthening", "gravity"}, LOST) | {"gravity": WORLD}
TURN = 3.0  # rad, limit of a joint: RViz draws its sliders by it


def urdf(model: Model, provenance: Provenance, *, prefix: str = "", radius: float = 0.0) -> str:
    """The XML of a body; joint angles are zero in the rest shape."""
    size = radius or 0.08 * model.length
    model = with_identifiers(model)
    root = ET.Element("robot", name=f"{prefix}{model.name}")
    root.append(ET.Comment(" " + "\n  ".join(provenance.lines("xml_comment")) + " "))
    shape(ET.SubElement(root, "link", name=f"{prefix}base"), model.base_length, size, model.base_angle)
    for i in range(model.n):
        link = ET.SubElement(root, "link", name=f"{prefix}link_{i + 1}")
        mass, centre, inertia = link_inertia(model, i)
        across = number(max(min(0.5 * mass * size**2, 2.0 * inertia), TINY))
        own = ET.SubElement(link, "inertial")
        ET.SubElement(own, "origin", xyz=number(0.0, centre, 0.0))
        ET.SubElement(own, "mass", value=number(mass))
        ET.SubElement(
            own, "inertia", ixx=number(inertia), iyy=across, izz=number(inertia), ixy="0", ixz="0", iyz="0"
        )
        shape(link, float(model.link_length[i]), size, 0.0)
        hinge(root, model, i, prefix)
    links = ["base", *(f"link_{i + 1}" for i in range(model.n))]
    wanted = [f"{p.name}_point" if p.name in links else p.name for p in model.points]
    for p, name in zip(model.points, identifiers(wanted, links), strict=True):
        observed(root, model, p, prefix, name)
    ET.indent(root)
    return ET.tostring(root, encoding="unicode", xml_declaration=False) + "\n"


def hinge(root: ET.Element, model: Model, i: int, prefix: str) -> None:
    """The joint before link `i`."""
    turn = model.rest_angle[i] + (model.base_angle if i == 0 else 0.0)
    place = [*model.first_joint, 0.0] if i == 0 else [0.0, model.link_length[i - 1], 0.0]
    joint = ET.SubElement(root, "joint", name=f"{prefix}q_{i + 1}", type="revolute")
    ET.SubElement(joint, "origin", xyz=number(*place), rpy=number(0.0, 0.0, turn))
    ET.SubElement(joint, "parent", link=f"{prefix}link_{i}" if i else f"{prefix}base")
    ET.SubElement(joint, "child", link=f"{prefix}link_{i + 1}")
    ET.SubElement(joint, "axis", xyz=number(0.0, 0.0, 1.0))
    ET.SubElement(joint, "dynamics", damping=number(model.damping[i]), friction="0")
    ET.SubElement(joint, "limit", lower=number(-TURN), upper=number(TURN), effort="0", velocity="1000")


def shape(link: ET.Element, length: float, size: float, turn: float) -> None:
    """A cylinder along a link, to see and to touch."""
    if not length > 0:
        return
    middle = 0.5 * length * np.array([-np.sin(turn), np.cos(turn), 0.0])
    for what in ("visual", "collision"):
        part = ET.SubElement(link, what)
        ET.SubElement(part, "origin", xyz=number(*middle), rpy=number(-0.5 * np.pi, 0.0, turn))
        geometry = ET.SubElement(part, "geometry")
        ET.SubElement(geometry, "cylinder", length=number(length), radius=number(min(size, 0.9 * length)))


def observed(root: ET.Element, model: Model, point: Station, prefix: str, name: str) -> None:
    """An observed point as a link of its own without mass, fixed to its carrier."""
    place = np.array([-point.across, point.along, 0.0])
    turn = 0.0
    if point.link < 0:  # the base's own frame does not turn with its tangent
        turn = model.base_angle
        c, s = np.cos(turn), np.sin(turn)
        place = np.array([c * place[0] - s * place[1], s * place[0] + c * place[1], 0.0])
    ET.SubElement(root, "link", name=f"{prefix}{name}")
    joint = ET.SubElement(root, "joint", name=f"{prefix}{name}_fixed", type="fixed")
    ET.SubElement(joint, "origin", xyz=number(*place), rpy=number(0.0, 0.0, turn))
    ET.SubElement(joint, "parent", link=f"{prefix}link_{point.link + 1}" if point.link >= 0 else f"{prefix}base")
    ET.SubElement(joint, "child", link=f"{prefix}{name}")


def write(model: Model, provenance: Provenance, path: Path, options: Mapping[str, Any]) -> tuple[Path, ...]:
    """Write the URDF."""
    if options["radius"] < 0:
        raise InputError(f"urdf radius must not be negative, m, got {options['radius']}")
    return (write_text(path, urdf(model, provenance, **options)),)


EXPORTER = Exporter(
    "urdf", "URDF: geometry and inertia, no springs and no drive", (".urdf", ".xml"), frozenset({"points"}), write,
    {"prefix": "", "radius": 0.0}, BY_NATURE, moves=False,
)
