"""Export of a model as URDF: links, joints, inertia and dampers, for RViz and other tools without springs."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any
from warnings import catch_warnings, simplefilter
from xml.etree import ElementTree as ET

import numpy as np
from scipy.spatial.transform import Rotation

from pliant.errors import InputError
from pliant.exporters.features import ALL
from pliant.exporters.mjcf import number
from pliant.exporters.names import with_identifiers
from pliant.exporters.provenance import Provenance
from pliant.exporters.registry import Exporter
from pliant.exporters.rigid_chain import RigidChain, moments, point_of, rigid_chain
from pliant.files import write_text
from pliant.model import Model, Station
from pliant.text import identifiers

LOST = "URDF has no springs and no pressure: it holds links, joints, inertia and dampers, and its joints are loose"
WORLD = "URDF has no gravity: set gravity in the simulator that loads the file"
CAN = frozenset({"points", "space", "twist"})
BY_NATURE = dict.fromkeys(ALL - CAN - {"lengthening", "space_lengthening", "gravity"}, LOST) | {"gravity": WORLD}
Array = np.ndarray
TURN = 3.0  # rad, limit of a joint, which sets the range of RViz's sliders


def urdf(model: Model, provenance: Provenance, *, prefix: str = "", radius: float = 0.0) -> str:
    """Return the URDF text of a model; joint angles are zero in the rest shape."""
    size = radius or 0.08 * model.length
    model = with_identifiers(model)
    bodies = rigid_chain(model)
    root = ET.Element("robot", name=f"{prefix}{model.name}")
    root.append(ET.Comment(" " + "\n  ".join(provenance.lines("xml_comment")) + " "))
    shape(ET.SubElement(root, "link", name=f"{prefix}base"), turned(bodies.base_turn, bodies), bodies.base_length, size)
    for i, own in enumerate(bodies.links):
        joints(root, bodies, i, prefix)
        link = ET.SubElement(root, "link", name=f"{prefix}link_{i + 1}")
        inertial = ET.SubElement(link, "inertial")
        ET.SubElement(inertial, "origin", xyz=number(*(own.centre * bodies.tangent)))
        ET.SubElement(inertial, "mass", value=number(own.mass))
        about = dict(zip(("ixx", "iyy", "izz"), map(number, moments(bodies, own, size)), strict=True))
        ET.SubElement(inertial, "inertia", attrib={**about, "ixy": "0", "ixz": "0", "iyz": "0"})
        shape(link, turned(np.zeros(3), bodies), own.length, size)
    links = ["base", *(f"link_{i + 1}" for i in range(model.n))]
    wanted = [f"{p.name}_point" if p.name in links else p.name for p in model.points]
    for p, name in zip(model.points, identifiers(wanted, links), strict=True):
        observed(root, model, p, prefix, name)
    ET.indent(root)
    return ET.tostring(root, encoding="unicode", xml_declaration=False) + "\n"


def joints(root: ET.Element, bodies: RigidChain, i: int, prefix: str) -> None:
    """Add the hinges before link `i`, with a link without mass or length between two of them."""
    own, parent = bodies.links[i], f"{prefix}link_{i}" if i else f"{prefix}base"
    turn, place = Rotation.from_rotvec(own.turn), own.place
    if i == 0:  # the frame of the base is not rotated by the base angle
        base = Rotation.from_rotvec(bodies.base_turn)
        turn, place = base * turn, base.apply(place)
    for k, hinge in enumerate(own.hinges):
        last = k + 1 == len(own.hinges)
        child = f"{prefix}link_{i + 1}" if last else f"{prefix}{hinge.name}_turned"
        joint = ET.SubElement(root, "joint", name=f"{prefix}{hinge.name}", type="revolute")
        ET.SubElement(joint, "origin", xyz=number(*place), rpy=number(*angles(turn)))
        ET.SubElement(joint, "parent", link=parent)
        ET.SubElement(joint, "child", link=child)
        ET.SubElement(joint, "axis", xyz=number(*hinge.axis))
        ET.SubElement(joint, "dynamics", damping=number(hinge.damping), friction="0")
        ET.SubElement(joint, "limit", lower=number(-TURN), upper=number(TURN), effort="0", velocity="1000")
        if not last:
            ET.SubElement(root, "link", name=child)
        parent, turn, place = child, Rotation.identity(), np.zeros(3)


def angles(turn: Rotation) -> Array:
    """Return a rotation as URDF angles (3,) [rad] about fixed x, then y, then z.

    In gimbal lock, one of the possible solutions is returned.
    """
    with catch_warnings():
        simplefilter("ignore", UserWarning)  # gimbal lock
        return np.asarray(turn.as_euler("xyz"))


def turned(turn: Array, bodies: RigidChain) -> Rotation:
    """Return the rotation from a cylinder's axis z to the axis of a link with the rotation vector `turn` (3,) [rad]."""
    upright = np.zeros(3) if bodies.tangent[2] else np.array([-0.5 * np.pi, 0.0, 0.0])
    return Rotation.from_rotvec(turn) * Rotation.from_rotvec(upright)


def shape(link: ET.Element, along: Rotation, length: float, size: float) -> None:
    """Add a cylinder along a link, for display and contact; `along` rotates z to the link's axis."""
    if not length > 0:
        return
    middle = along.apply([0.0, 0.0, 0.5 * length])
    for what in ("visual", "collision"):
        part = ET.SubElement(link, what)
        ET.SubElement(part, "origin", xyz=number(*middle), rpy=number(*angles(along)))
        geometry = ET.SubElement(part, "geometry")
        ET.SubElement(geometry, "cylinder", length=number(length), radius=number(min(size, 0.9 * length)))


def observed(root: ET.Element, model: Model, point: Station, prefix: str, name: str) -> None:
    """Add an observed point as a massless link, fixed to the link that carries it."""
    turn, place = Rotation.identity(), point_of(model, point)
    if point.link < 0:  # the frame of the base is not rotated by the base angle
        turn = Rotation.from_rotvec(rigid_chain(model).base_turn)
        place = turn.apply(place)
    ET.SubElement(root, "link", name=f"{prefix}{name}")
    joint = ET.SubElement(root, "joint", name=f"{prefix}{name}_fixed", type="fixed")
    ET.SubElement(joint, "origin", xyz=number(*place), rpy=number(*angles(turn)))
    ET.SubElement(joint, "parent", link=f"{prefix}link_{point.link + 1}" if point.link >= 0 else f"{prefix}base")
    ET.SubElement(joint, "child", link=f"{prefix}{name}")


def write(model: Model, provenance: Provenance, path: Path, options: Mapping[str, Any]) -> tuple[Path, ...]:
    """Write the URDF file."""
    if options["radius"] < 0:
        raise InputError(f"urdf radius must be >= 0 m, got {options['radius']}")
    return (write_text(path, urdf(model, provenance, **options)),)


EXPORTER = Exporter(
    "urdf", "URDF: geometry and inertia, no springs and no drive", (".urdf", ".xml"), CAN, write,
    {"prefix": "", "radius": 0.0}, BY_NATURE, moves=False,
)
