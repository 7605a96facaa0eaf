"""Export of a model as URDF: links, joints, inertia and dampers, without springs, for RViz and other tools.

The joint ``strain_NAME`` of a segment that lengthens moves an empty link by one metre for a strain of one; the
prismatic joints along the links of that segment mimic it, each in proportion to its length.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any
from warnings import catch_warnings, simplefilter
from xml.etree import ElementTree as ET

import numpy as np
from scipy.spatial.transform import Rotation

from pliant.errors import InputError
from pliant.exporters.mjcf import number
from pliant.exporters.provenance import Provenance
from pliant.exporters.registry import Exporter, with_identifiers
from pliant.exporters.rigid_chain import (
    TINY,
    RigidChain,
    Slide,
    carrier_of,
    moments,
    rigid_chain,
)
from pliant.files import write_text
from pliant.mechanics import mechanics_of
from pliant.model import Model, Station
from pliant.model.features import RESTING
from pliant.text import identifiers

LOST = "URDF has no springs and no pressure: it holds links, joints, inertia and dampers, and its joints are loose"
WORLD = "URDF has no gravity: set gravity in the simulator that loads the file"
CAN = frozenset({"points", "space", "twist", "lengthening", "space_lengthening"})
BY_NATURE = dict.fromkeys(RESTING - CAN - {"gravity"}, LOST) | {"gravity": WORLD}
Array = np.ndarray
TURN = 3.0  # rad, limit of a joint, which sets the range of RViz's sliders
STRAINS = -0.5, 1.0  # limits of a strain


def urdf(model: Model, provenance: Provenance, *, prefix: str = "", radius: float = 0.0) -> str:
    """Return the URDF text of a model, with joint angles that are zero in the rest shape."""
    size = radius or 0.08 * model.length
    model = with_identifiers(model)
    bodies = rigid_chain(model)
    root = ET.Element("robot", name=f"{prefix}{model.name}")
    root.append(ET.Comment(" " + "\n  ".join(provenance.lines("xml_comment")) + " "))
    base, upright = ET.SubElement(root, "link", name=f"{prefix}base"), turned(bodies.base_turn, bodies)
    shape(base, upright, (0.5 if bodies.base_slides else 1.0) * bodies.base_length, size)
    strains(root, model, prefix)
    along(root, model, bodies, -1, (prefix, size))
    for i, rigid_link in enumerate(bodies.links):
        joints(root, bodies, i, prefix)
        link = ET.SubElement(root, "link", name=f"{prefix}link_{i + 1}")
        about = dict(zip(("ixx", "iyy", "izz"), map(number, moments(bodies, rigid_link, size)), strict=True))
        inertia(link, rigid_link.centre * bodies.tangent, rigid_link.mass, about)
        shape(link, turned(np.zeros(3), bodies), (0.5 if rigid_link.slides else 1.0) * rigid_link.length, size)
        along(root, model, bodies, i, (prefix, size))
    links = [link.attrib["name"].removeprefix(prefix) for link in root.findall("link")]
    links += [slide.name for p in model.points if (slide := carrier_of(model, bodies, p)[2])]
    wanted = [f"{p.name}_point" if p.name in links else p.name for p in model.points]
    for p, name in zip(model.points, identifiers(wanted, links), strict=True):
        observed(root, model, p, prefix, name)
    ET.indent(root)
    return ET.tostring(root, encoding="unicode", xml_declaration=False) + "\n"


def inertia(link: ET.Element, centre: Array, mass: float, about: Mapping[str, str]) -> None:
    """Add mass [kg], centre of mass (3,) [m] and moments of inertia to a link of the URDF."""
    inertial = ET.SubElement(link, "inertial")
    ET.SubElement(inertial, "origin", xyz=number(*centre))
    ET.SubElement(inertial, "mass", value=number(mass))
    ET.SubElement(inertial, "inertia", attrib={**about, "ixy": "0", "ixz": "0", "iyz": "0"})


def strains(root: ET.Element, model: Model, prefix: str) -> None:
    """Add a prismatic joint for each extensible segment to the URDF. The joint's value is the segment's strain; it
    moves only an empty link.
    """
    dampers = mechanics_of(model).joints.D[model.size - len(model.extensions) :]
    for segment, damping in zip(model.extensions, dampers, strict=True):
        name = f"{prefix}strain_{segment.name}"
        ET.SubElement(root, "link", name=f"{name}_shown")
        joint = ET.SubElement(root, "joint", name=name, type="prismatic")
        ET.SubElement(joint, "parent", link=f"{prefix}base")
        ET.SubElement(joint, "child", link=f"{name}_shown")
        ET.SubElement(joint, "axis", xyz="0 0 1")
        ET.SubElement(joint, "dynamics", damping=number(damping), friction="0")
        low, high = STRAINS
        ET.SubElement(joint, "limit", lower=number(low), upper=number(high), effort="0", velocity="1000")


def along(root: ET.Element, model: Model, bodies: RigidChain, i: int, names: tuple[str, float]) -> None:
    """Add the slides of link `i` (-1: the base), which move when the link lengthens, to the URDF."""
    prefix, size = names
    rigid_link = bodies.links[i] if i >= 0 else None
    slides, length = (rigid_link.slides, rigid_link.length) if rigid_link else (bodies.base_slides, bodies.base_length)
    parent = f"link_{i + 1}" if rigid_link else "base"
    for slide in slides:
        link = sliding(root, model, bodies, slide, (prefix, parent))
        inertia(link, np.zeros(3), slide.mass, dict.fromkeys(("ixx", "iyy", "izz"), number(TINY)))
        middle = slide.place < 0.75 * length
        shape(link, turned(np.zeros(3), bodies), 0.5 * length, size, start=(-0.25 if middle else -0.5) * length)
        parent = slide.name


def sliding(root: ET.Element, model: Model, bodies: RigidChain, slide: Slide, names: tuple[str, str]) -> ET.Element:
    """Add the link of a slide to the URDF, with one prismatic joint for each segment that moves it, and return the
    link.
    """
    prefix, parent = names
    turn, position = frame_of(bodies, parent, slide.step * bodies.tangent)
    movers = np.flatnonzero(slide.growth)
    for k, s in enumerate(movers):
        last, segment = k + 1 == len(movers), model.extensions[s].name
        name = slide.name if last else f"{slide.name}_{segment}"
        joint = ET.SubElement(root, "joint", name=f"{prefix}{name}", type="prismatic")
        ET.SubElement(joint, "origin", xyz=number(*position), rpy=number(*angles(turn)))
        ET.SubElement(joint, "parent", link=f"{prefix}{parent}")
        ET.SubElement(joint, "child", link=f"{prefix}{name}")
        ET.SubElement(joint, "axis", xyz=number(*bodies.tangent))
        strain, growth = f"{prefix}strain_{segment}", float(slide.growth[s])
        ET.SubElement(joint, "mimic", joint=strain, multiplier=number(growth), offset="0")
        low, high = (growth * bound for bound in STRAINS)
        ET.SubElement(joint, "limit", lower=number(low), upper=number(high), effort="0", velocity="1000")
        link = ET.SubElement(root, "link", name=f"{prefix}{name}")
        parent, turn, position = name, Rotation.identity(), np.zeros(3)
    return link


def frame_of(bodies: RigidChain, parent: str, place: Array) -> tuple[Rotation, Array]:
    """Return the rotation and the position (3,) [m] of a part in the URDF frame of the body that carries it. On the
    base they include the base's own rotation, since the URDF's base frame is not turned.
    """
    base = Rotation.from_rotvec(bodies.base_turn)
    return (base, np.asarray(base.apply(place))) if parent == "base" else (Rotation.identity(), place)


def joints(root: ET.Element, bodies: RigidChain, i: int, prefix: str) -> None:
    """Add the hinges before link `i` to the URDF, with a massless link between each two of them."""
    rigid_link, slides = bodies.links[i], bodies.links[i - 1].slides if i else bodies.base_slides
    before = slides[-1].name if slides else f"link_{i}" if i else "base"
    turn, position = frame_of(bodies, before, bodies.start(i))
    turn, parent = turn * Rotation.from_rotvec(rigid_link.turn), prefix + before
    for k, hinge in enumerate(rigid_link.hinges):
        last = k + 1 == len(rigid_link.hinges)
        child = f"{prefix}link_{i + 1}" if last else f"{prefix}{hinge.name}_turned"
        joint = ET.SubElement(root, "joint", name=f"{prefix}{hinge.name}", type="revolute")
        ET.SubElement(joint, "origin", xyz=number(*position), rpy=number(*angles(turn)))
        ET.SubElement(joint, "parent", link=parent)
        ET.SubElement(joint, "child", link=child)
        ET.SubElement(joint, "axis", xyz=number(*hinge.axis))
        ET.SubElement(joint, "dynamics", damping=number(hinge.damping), friction="0")
        ET.SubElement(joint, "limit", lower=number(-TURN), upper=number(TURN), effort="0", velocity="1000")
        if not last:
            ET.SubElement(root, "link", name=child)
        parent, turn, position = child, Rotation.identity(), np.zeros(3)


def angles(turn: Rotation) -> Array:
    """Return a rotation as the URDF angles (roll, pitch, yaw) (3,) [rad] about fixed x, y and z.

    In gimbal lock, one of the possible solutions is returned.
    """
    with catch_warnings():
        simplefilter("ignore", UserWarning)  # gimbal lock
        return np.asarray(turn.as_euler("xyz"))


def turned(turn: Array, bodies: RigidChain) -> Rotation:
    """Return the rotation that aligns a cylinder's z axis with the axis of a link. The link is turned by the rotation
    vector `turn` (3,) [rad].
    """
    upright = np.zeros(3) if bodies.tangent[2] else np.array([-0.5 * np.pi, 0.0, 0.0])
    return Rotation.from_rotvec(turn) * Rotation.from_rotvec(upright)


def shape(link: ET.Element, along: Rotation, length: float, size: float, start: float = 0.0) -> None:
    """Add a cylinder along a link to the URDF for display and contact. It begins `start` [m] from the link's origin,
    and `along` rotates its z axis to the link's axis.
    """
    if not length > 0:
        return
    middle = along.apply([0.0, 0.0, start + 0.5 * length])
    for what in ("visual", "collision"):
        part = ET.SubElement(link, what)
        ET.SubElement(part, "origin", xyz=number(*middle), rpy=number(*angles(along)))
        geometry = ET.SubElement(part, "geometry")
        ET.SubElement(geometry, "cylinder", length=number(length), radius=number(min(size, 0.9 * length)))


def observed(root: ET.Element, model: Model, point: Station, prefix: str, name: str) -> None:
    """Add an observed point to the URDF as a massless link, fixed to the link that carries it."""
    bodies = rigid_chain(model)
    carrier, position, slide = carrier_of(model, bodies, point)
    if slide:
        sliding(root, model, bodies, slide, (prefix, carrier))
        carrier = slide.name
    turn, position = frame_of(bodies, carrier, position)
    ET.SubElement(root, "link", name=f"{prefix}{name}")
    joint = ET.SubElement(root, "joint", name=f"{prefix}{name}_fixed", type="fixed")
    ET.SubElement(joint, "origin", xyz=number(*position), rpy=number(*angles(turn)))
    ET.SubElement(joint, "parent", link=f"{prefix}{carrier}")
    ET.SubElement(joint, "child", link=f"{prefix}{name}")


def write(model: Model, provenance: Provenance, path: Path, options: Mapping[str, Any]) -> tuple[Path, ...]:
    """Write a model as URDF to `path`, and return the path."""
    if options["radius"] < 0:
        raise InputError(f"urdf option radius must be >= 0 m, got {options['radius']}")
    return (write_text(path, urdf(model, provenance, **options)),)


EXPORTER = Exporter(
    "urdf", "URDF: geometry and inertia, no springs and no drive", (".urdf", ".xml"), CAN, write,
    {"prefix": "", "radius": 0.0}, BY_NATURE, moves=False,
)
