"""MuJoCo's MJCF: the chain as hinges, creep and slip as hidden hinges, the drive as actuators on one tendon.

In MuJoCo's words a joint's stiffness "K K2 K3" is K q + K2 q^2 + K3 q^3, a fixed tendon with the joint gains as
coefficients turns one force into the torques of all joints, and a branch of creep is a hinge of its own, damped by
K share time and tied to the joint by a tendon of stiffness K share; of a slip element dry friction holds it instead.
The rest shape is in the frames of the bodies, so that q = 0 is at rest.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree as ET

import numpy as np

from pliant.errors import InputError, SimulationError
from pliant.exporters.features import ALL, LATER_TERMS, RUBBER
from pliant.exporters.mjcf_step import Hidden, checked_step, linear_chain
from pliant.exporters.names import with_identifiers
from pliant.exporters.provenance import Provenance
from pliant.exporters.registry import Exporter
from pliant.files import write_text
from pliant.mechanics.springs import springs_of
from pliant.model import Chamber, Model
from pliant.simulation.levels import typical_pressure
from pliant.simulation.state import equilibrium
from pliant.text import identifiers

CAN = ALL - RUBBER - LATER_TERMS - {
    "lengthening", "bounded", "own_law", "lagging_law", "two_lags", "second_order", "rates", "settling", "dead_band",
    "boucwen",
}
ARMATURE = 1e-7  # kg m^2, of a hidden hinge: MuJoCo moves nothing without inertia
TINY = 1e-12  # kg m^2, of a mass that is a point in pliant
DRY = {"solreffriction": "0.001 1", "solimpfriction": "0.9999 0.9999 0.001 0.5 2"}  # as hard as MuJoCo's friction gets
INTEGRATORS = ("implicitfast", "implicit", "Euler", "RK4")
LEVEL = 1e5  # Pa: MuJoCo takes no control beyond 1e10, so the k-th one takes p (p / LEVEL)^(k - 1)


class Branch(NamedTuple):
    """A spring to a hidden hinge that a damper or dry friction holds back."""

    name: str
    share: float  # stiffness, in parts of the joint's K
    time: float  # s, of a damper
    angle: float  # rad, at which dry friction slips


def number(*values: float) -> str:
    """Numbers as MJCF reads them, to the last bit."""
    return " ".join(f"{float(v):.17g}" for v in values)


def mjcf(
    model: Model, provenance: Provenance, *, prefix: str = "", timestep: float = 0.0, radius: float = 0.0,
    integrator: str = INTEGRATORS[0], highest: float = 0.0,
) -> str:
    """The XML of a model that has only what MJCF can express.

    The time step [s] is checked against the stiffest mode; 0: chosen by it. Controls reach up to the pressure `highest`
    [Pa]; 0: up to twice the typical one. With a prefix, which is for worlds of several bodies, there is no keyframe,
    since one holds the state of a whole world.
    """
    size = radius or 0.08 * model.length
    model = with_identifiers(model)
    chain = linear_chain(model, [Hidden(b.share, b.time, ARMATURE) for b in branches(model)])
    timestep = checked_step(chain, integrator, timestep)
    root = ET.Element("mujoco", model=f"{prefix}{model.name}")
    ET.SubElement(root, "compiler", angle="radian", autolimits="true")
    ET.SubElement(
        root, "option", timestep=number(timestep), gravity=number(*model.gravity, 0.0), integrator=integrator
    )
    ET.SubElement(ET.SubElement(root, "custom"), "text", name=f"{prefix}pliant", data=provenance.json())
    base = ET.SubElement(
        ET.SubElement(root, "worldbody"), "body", name=f"{prefix}base",
        euler=number(0.0, 0.0, model.base_angle),
    )
    capsule(base, f"{prefix}skin_base", model.base_length, size)
    sites(base, model, -1, prefix)
    parent = base
    for i in range(model.n):
        parent = link(parent, model, i, prefix, size)
    tendons(root, model, prefix)
    contacts(root, model, prefix)
    actuators(root, model, prefix, timestep, highest or 2.0 * typical_pressure(model))
    sensors(root, model, prefix)
    if not prefix:
        keyframe(root, model, provenance)
    ET.indent(root)
    return ET.tostring(root, encoding="unicode") + "\n"


def link(parent: ET.Element, model: Model, i: int, prefix: str, size: float) -> ET.Element:
    """Link `i`: its body in the rest shape, hinge, inertia, looks and the hinges of its creep."""
    start = model.base_length if i == 0 else model.link_length[i - 1]
    place = {
        "pos": number(0.0, start, 0.0), "euler": number(0.0, 0.0, model.rest_angle[i]),
    }
    axis = number(0.0, 0.0, 1.0)
    K = model.stiffness[i]
    for branch in branches(model):
        name = f"{prefix}{branch.name}_{i + 1}"
        hidden = ET.SubElement(parent, "body", attrib={"name": f"{name}_body", **place})
        ET.SubElement(hidden, "inertial", pos="0 0 0", mass="1e-9", diaginertia=number(TINY, TINY, TINY))
        hinge = {"damping": number(K * branch.share * branch.time), "armature": number(ARMATURE)}
        if branch.angle:
            hinge |= {"frictionloss": number(K * branch.share * branch.angle), **DRY}
        ET.SubElement(hidden, "joint", attrib={"name": name, "type": "hinge", "axis": axis, **hinge})
    body = ET.SubElement(parent, "body", attrib={"name": f"{prefix}link_{i + 1}", **place})
    ET.SubElement(
        body, "joint", name=f"{prefix}q_{i + 1}", type="hinge", axis=axis, damping=number(model.damping[i]),
        stiffness=number(*np.trim_zeros(springs_of(model).powers[:, i], "b")),
    )
    mass, centre, inertia = link_inertia(model, i)
    across = max(min(0.5 * mass * size**2, 2.0 * inertia), TINY)
    ET.SubElement(
        body, "inertial", pos=number(0.0, centre, 0.0), mass=number(mass), diaginertia=number(inertia, across, inertia)
    )
    capsule(body, f"{prefix}skin_{i + 1}", float(model.link_length[i]), size)
    sites(body, model, i, prefix)
    return body


def branches(model: Model) -> list[Branch]:
    """What remembers: creep and slip elements, the same at every joint."""
    m = model.memory
    creep = zip(m.creep_share, m.creep_time, strict=True)
    slip = zip(m.slip_share, m.slip_angle, strict=True)
    made = [Branch(f"creep_{j + 1}", share, time, 0.0) for j, (share, time) in enumerate(creep)]
    return made + [Branch(f"slip_{j + 1}", share, 0.0, angle) for j, (share, angle) in enumerate(slip)]


def link_inertia(model: Model, i: int) -> tuple[float, float, float]:
    """Mass [kg], distance of its centre from the joint [m] and inertia about it [kg m^2] of a link, cap included."""
    rod = model.mass_at == "rod"
    m, l = float(model.link_mass[i]), float(model.link_length[i])
    cap = model.tip_mass if i == model.n - 1 else 0.0
    own = 0.5 * l if rod else l
    mass = m + cap
    centre = (m * own + cap * l) / mass
    inertia = m * l**2 / 12.0 * rod + m * (own - centre) ** 2 + cap * (l - centre) ** 2
    return mass, centre, max(inertia, TINY)


def capsule(body: ET.Element, name: str, length: float, size: float) -> None:
    """A capsule along a link: looks and contact, no mass."""
    if length > 0:
        r = min(size, 0.9 * length)
        ET.SubElement(
            body, "geom", name=name, type="capsule", fromto=number(0.0, 0.0, 0.0, 0.0, length, 0.0), size=number(r),
            rgba="0.35 0.5 0.65 1",
        )


def sites(body: ET.Element, model: Model, carrier: int, prefix: str) -> None:
    """The observed points on a carrier."""
    for p in model.points:
        if p.link == carrier:
            ET.SubElement(
                body, "site", name=f"{prefix}{p.name}", pos=number(-p.across, p.along, 0.0),
                size="0.002",
            )


def chamber_names(model: Model, prefix: str) -> list[tuple[Chamber, str, str]]:
    """Each chamber with the names of its tendon and its first control."""
    actuation = model.actuation
    names = ([prefix + label for label in actuation.labels(what)] for what in ("bend", "pressure"))
    return list(zip(actuation.inputs, *names, strict=True))


def tendons(root: ET.Element, model: Model, prefix: str) -> None:
    """The tendon of each chamber and the springs between joints and their creep."""
    group = ET.SubElement(root, "tendon")
    for chamber, tendon, _ in chamber_names(model, prefix):
        fixed = ET.SubElement(group, "fixed", name=tendon)
        for i in range(model.n):
            ET.SubElement(fixed, "joint", joint=f"{prefix}q_{i + 1}", coef=number(chamber.joint_gain[i]))
    for branch in branches(model):
        for i in range(model.n):
            name = f"{prefix}{branch.name}_{i + 1}"
            spring = ET.SubElement(
                group, "fixed", name=f"{name}_spring", stiffness=number(model.stiffness[i] * branch.share),
                springlength="0",
            )
            ET.SubElement(spring, "joint", joint=f"{prefix}q_{i + 1}", coef="1")
            ET.SubElement(spring, "joint", joint=name, coef="-1")


def contacts(root: ET.Element, model: Model, prefix: str) -> None:
    """Links do not touch each other: in the plane of the model they never did."""
    group = ET.SubElement(root, "contact")
    names = [f"{prefix}base", *(f"{prefix}link_{i + 1}" for i in range(model.n))]
    for a in range(len(names)):
        for b in range(a):
            ET.SubElement(group, "exclude", body1=names[b], body2=names[a])


def control(pressure: float, power: int) -> float:
    """What the control of a power of the pressure [Pa] takes: the pressure itself times (p / 100 kPa)^(power - 1)."""
    return float(pressure * (pressure / LEVEL) ** (power - 1))


def controls(model: Model, prefix: str = "") -> list[tuple[str, int, int]]:
    """The controls of an exported model: name, number of the chamber, power of its pressure; see `control`."""
    powers = [
        (name, c, k + 1) for c, (chamber, _, name) in enumerate(chamber_names(with_identifiers(model), prefix))
        for k, gain in enumerate(chamber.torque) if gain
    ]
    names = identifiers([name + (f"_{power}" if power > 1 else "") for name, _, power in powers])
    return [(name, c, power) for name, (_, c, power) in zip(names, powers, strict=True)]


def actuators(root: ET.Element, model: Model, prefix: str, timestep: float, highest: float) -> None:
    """One control for each chamber and power of its pressure that the law holds, from none to the `highest` [Pa]."""
    group = ET.SubElement(root, "actuator")
    several = chamber_names(model, prefix)
    for name, c, power in controls(model, prefix):
        chamber, tendon, _ = several[c]
        valve, gain = chamber.valve, chamber.torque[power - 1] * LEVEL ** (power - 1)
        words = {"gainprm": number(gain), "biastype": "none", "gaintype": "fixed", "dyntype": "none"}
        if highest > 0:
            words["ctrlrange"] = number(0.0, control(highest, power))
        if valve.rise_time:
            words |= {"dyntype": "filterexact", "dynprm": number(valve.rise_time)}
        if valve.dead_time:
            late = int(np.ceil(valve.dead_time / timestep)) + 1
            words |= {"delay": number(valve.dead_time), "nsample": str(late)}
        ET.SubElement(group, "general", attrib={"name": name, "tendon": tendon, **words})


def sensors(root: ET.Element, model: Model, prefix: str) -> None:
    """Positions of the observed points and joint angles."""
    group = ET.SubElement(root, "sensor")
    for p in model.points:
        ET.SubElement(group, "framepos", name=f"{prefix}{p.name}_pos", objtype="site", objname=f"{prefix}{p.name}")
    for i in range(model.n):
        ET.SubElement(group, "jointpos", name=f"{prefix}q_{i + 1}_pos", joint=f"{prefix}q_{i + 1}")


def keyframe(root: ET.Element, model: Model, provenance: Provenance) -> None:
    """The rest without pressure, under the model's gravity, its memory relaxed: joints in the order of the tree."""
    try:
        rest = equilibrium(model, 0.0)
    except SimulationError as error:
        provenance.messages.append(f"no keyframe, since the body has no rest without pressure: {error}")
        return
    places = [q for q in rest for _ in range(1 + len(branches(model)))]
    ET.SubElement(ET.SubElement(root, "keyframe"), "key", name="rest", qpos=number(*places))


def write(model: Model, provenance: Provenance, path: Path, options: Mapping[str, Any]) -> tuple[Path, ...]:
    """Write the MJCF."""
    if not min(options["timestep"], options["radius"], options["highest"]) >= 0:
        raise InputError(f"mjcf timestep (s), radius (m) and highest (Pa) must not be negative, got {dict(options)}")
    if options["integrator"] not in INTEGRATORS:
        raise InputError(f"mjcf integrator is one of {', '.join(INTEGRATORS)}, got {options['integrator']!r}")
    highest = options["highest"] or 2.0 * typical_pressure(model)
    if not options["highest"] and highest:
        reach = f"controls reach from 0 to {1e-3 * highest:.4g} kPa: set highest (Pa) for another range"
        provenance.messages.append(reach)
    return (write_text(path, mjcf(model, provenance, **{**options, "highest": highest})),)


EXPORTER = Exporter(
    "mjcf", "MuJoCo model (XML)", (".xml", ".mjcf"), CAN, write,
    {"prefix": "", "timestep": 0.0, "radius": 0.0, "integrator": INTEGRATORS[0], "highest": 0.0},
)
