"""Export of a model as MJCF for MuJoCo: the chain as hinges, creep and slip as hidden hinges, inputs as actuators.

In MJCF a joint's stiffness "K K2 K3" means the torque K q + K2 q^2 + K3 q^3. A fixed tendon whose coefficients are the
joint gains converts one force to the torques of all joints. A branch of creep is a separate hinge, damped by K share
time and tied to the joint by a tendon of stiffness K share. In a slip element dry friction takes the place of the
damper. The frames of the bodies contain the rest shape, so that q = 0 is at rest. A joint in space is two or three
hinges of `rigid_chain`. A tendon of the model is an actuator whose force k (u - length) + T_0 is never negative.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree as ET

import numpy as np

from pliant.errors import InputError, SimulationError
from pliant.exporters.features import ALL, AXIAL, LATER_TERMS, RUBBER
from pliant.exporters.mjcf_step import Hidden, checked_step, linear_chain
from pliant.exporters.names import with_identifiers
from pliant.exporters.provenance import Provenance
from pliant.exporters.registry import Exporter
from pliant.exporters.rigid_chain import (
    RigidChain,
    RigidLink,
    hinge_difference,
    moments,
    point_of,
    rigid_chain,
)
from pliant.files import write_text
from pliant.model import Chamber, Model, Tendon
from pliant.simulation.levels import typical_pressure
from pliant.simulation.state import equilibrium
from pliant.text import identifiers

Array = np.ndarray
CAN = ALL - AXIAL - RUBBER - LATER_TERMS - {
    "lengthening", "space_lengthening", "bounded", "own_law", "lagging_law", "two_lags", "second_order", "rates",
    "opening", "settling", "dead_band", "boucwen", "soft_swing", "space_memory", "tendon_friction", "pair_pretension",
}
ARMATURE = 1e-7  # kg m^2, of a hidden hinge, since MuJoCo needs an inertia
TINY = 1e-12  # kg m^2, of a hidden body
STRONGEST = 1e6  # N, upper limit of a tendon's force
DRY = {"solreffriction": "0.001 1", "solimpfriction": "0.9999 0.9999 0.001 0.5 2"}  # the stiffest friction of MuJoCo
INTEGRATORS = ("implicitfast", "implicit", "Euler", "RK4")
LEVEL = 1e5  # Pa: MuJoCo limits controls to 1e10, so the k-th one is p (p / LEVEL)^(k - 1)


class Branch(NamedTuple):
    """A spring between a joint and a hidden hinge, which a damper or dry friction holds back."""

    name: str
    share: float  # stiffness as a fraction of the joint's K
    time: float  # s, relaxation time of the damper
    angle: float  # rad, angle at which dry friction slips


def number(*values: float) -> str:
    """Return numbers as MJCF text that preserves every bit."""
    return " ".join(f"{float(v):.17g}" for v in values)


def quaternion(turn: Array) -> str:
    """Return a rotation vector (3,) [rad] as an MJCF quaternion: w, x, y, z."""
    from scipy.spatial.transform import Rotation

    return number(*Rotation.from_rotvec(turn).as_quat(scalar_first=True))


def mjcf(
    model: Model, provenance: Provenance, *, prefix: str = "", timestep: float = 0.0, radius: float = 0.0,
    integrator: str = INTEGRATORS[0], highest: float = 0.0,
) -> str:
    """Return the MJCF text of a model that has only features that MJCF can express.

    The time step `timestep` [s] is checked against the stiffest mode; 0 chooses it. Controls reach up to the pressure
    `highest` [Pa]; 0 means twice the typical pressure. With a prefix, for worlds of several bodies, there is no
    keyframe, since a keyframe holds the state of a whole world.
    """
    size = radius or 0.08 * model.length
    model = with_identifiers(model)
    bodies = rigid_chain(model)
    linear = linear_chain(model, [Hidden(b.share, b.time, ARMATURE) for b in branches(model)])
    timestep = checked_step(linear, integrator, timestep)
    root = ET.Element("mujoco", model=f"{prefix}{model.name}")
    ET.SubElement(root, "compiler", angle="radian", autolimits="true")
    ET.SubElement(
        root, "option", timestep=number(timestep), gravity=number(*bodies.gravity), integrator=integrator
    )
    ET.SubElement(ET.SubElement(root, "custom"), "text", name=f"{prefix}pliant", data=provenance.json())
    base = ET.SubElement(
        ET.SubElement(root, "worldbody"), "body", name=f"{prefix}base", quat=quaternion(bodies.base_turn),
    )
    capsule(base, f"{prefix}skin_base", bodies.base_length * bodies.tangent, size)
    sites(base, model, -1, prefix)
    parent = base
    for i in range(model.n):
        parent = link(parent, model, bodies, i, (prefix, size))
    tendons(root, model, prefix)
    contacts(root, model, prefix)
    actuators(root, model, prefix, timestep, highest or 2.0 * typical_pressure(model))
    sensors(root, model, prefix)
    if not prefix:
        keyframe(root, model, provenance)
    ET.indent(root)
    return ET.tostring(root, encoding="unicode") + "\n"


def link(parent: ET.Element, model: Model, bodies: RigidChain, i: int, names: tuple[str, float]) -> ET.Element:
    """Add link `i` to its parent: body in the rest shape, hinges, inertia, geometry and hidden hinges.

    Returns the new body element.
    """
    prefix, size = names
    own = bodies.links[i]
    place = {"pos": number(*own.place), "quat": quaternion(own.turn)}
    hidden_hinges(parent, model, own, place, prefix)
    body = ET.SubElement(parent, "body", attrib={"name": f"{prefix}link_{i + 1}", **place})
    for hinge in own.hinges:
        ET.SubElement(
            body, "joint", name=f"{prefix}{hinge.name}", type="hinge", axis=number(*hinge.axis),
            damping=number(hinge.damping), stiffness=number(*hinge.springs),
        )
    ET.SubElement(
        body, "inertial", pos=number(*(own.centre * bodies.tangent)), mass=number(own.mass),
        diaginertia=number(*moments(bodies, own, size)),
    )
    capsule(body, f"{prefix}skin_{i + 1}", own.length * bodies.tangent, size)
    sites(body, model, i, prefix)
    return body


def hidden_hinges(
    parent: ET.Element, model: Model, own: RigidLink, place: Mapping[str, str], prefix: str
) -> None:
    """Add the hidden hinges of creep and slip for a link."""
    for branch in branches(model):
        for hinge in own.hinges:
            name, K = f"{prefix}{branch.name}_{hinge.link + 1}", hinge.stiffness
            hidden = ET.SubElement(parent, "body", attrib={"name": f"{name}_body", **place})
            ET.SubElement(hidden, "inertial", pos="0 0 0", mass="1e-9", diaginertia=number(TINY, TINY, TINY))
            words = {"damping": number(K * branch.share * branch.time), "armature": number(ARMATURE)}
            if branch.angle:
                words |= {"frictionloss": number(K * branch.share * branch.angle), **DRY}
            ET.SubElement(hidden, "joint", attrib={"name": name, "type": "hinge", "axis": number(*hinge.axis), **words})


def branches(model: Model) -> list[Branch]:
    """Return the creep and slip elements, which are the same at every joint."""
    m = model.memory
    creep = zip(m.creep_share, m.creep_time, strict=True)
    slip = zip(m.slip_share, m.slip_angle, strict=True)
    made = [Branch(f"creep_{j + 1}", share, time, 0.0) for j, (share, time) in enumerate(creep)]
    return made + [Branch(f"slip_{j + 1}", share, 0.0, angle) for j, (share, angle) in enumerate(slip)]


def capsule(body: ET.Element, name: str, reach: Array, size: float) -> None:
    """Add a capsule from the start of a link to its end `reach` (3,) [m], for display and contact, without mass."""
    length = float(np.linalg.norm(reach))
    if length > 0:
        ET.SubElement(
            body, "geom", name=name, type="capsule", fromto=number(0.0, 0.0, 0.0, *reach),
            size=number(min(size, 0.9 * length)), rgba="0.35 0.5 0.65 1",
        )


def sites(body: ET.Element, model: Model, carrier: int, prefix: str) -> None:
    """Add the observed points on link `carrier` as sites."""
    for p in model.points:
        if p.link == carrier:
            ET.SubElement(
                body, "site", name=f"{prefix}{p.name}", pos=number(*point_of(model, p)), size="0.002",
            )


def chamber_names(model: Model, prefix: str) -> list[tuple[Chamber, str, str]]:
    """Return each chamber with the names of its tendon and of its first control."""
    actuation = model.actuation
    names = ([prefix + label for label in actuation.labels(what)] for what in ("bend", "pressure"))
    return list(zip(actuation.inputs, *names, strict=True))


def tendons(root: ET.Element, model: Model, prefix: str) -> None:
    """Add the tendon of each input, and the springs between joints and hidden hinges."""
    group = ET.SubElement(root, "tendon")
    hinges = rigid_chain(model).hinges
    for gain, (_, tendon, _) in zip(model.actuation.gain, chamber_names(model, prefix), strict=True):
        fixed = ET.SubElement(group, "fixed", name=tendon)
        for hinge in hinges:
            ET.SubElement(fixed, "joint", joint=f"{prefix}{hinge.name}", coef=number(gain[hinge.row]))
    for branch in branches(model):
        for hinge in hinges:
            name = f"{prefix}{branch.name}_{hinge.link + 1}"
            spring = ET.SubElement(
                group, "fixed", name=f"{name}_spring", stiffness=number(hinge.stiffness * branch.share),
                springlength="0",
            )
            ET.SubElement(spring, "joint", joint=f"{prefix}{hinge.name}", coef="1")
            ET.SubElement(spring, "joint", joint=name, coef="-1")


def contacts(root: ET.Element, model: Model, prefix: str) -> None:
    """Exclude contacts between the body's own links, which the model does not have either."""
    group = ET.SubElement(root, "contact")
    names = [f"{prefix}base", *(f"{prefix}link_{i + 1}" for i in range(model.n))]
    for a in range(len(names)):
        for b in range(a):
            ET.SubElement(group, "exclude", body1=names[b], body2=names[a])


def control(pressure: float, power: int) -> float:
    """Return the control value of a power of the pressure [Pa]: the pressure times (p / 100 kPa)^(power - 1)."""
    return float(pressure * (pressure / LEVEL) ** (power - 1))


def controls(model: Model, prefix: str = "") -> list[tuple[str, int, int]]:
    """Return the controls of an exported model: name, index of the chamber and power of its pressure, see `control`."""
    powers = [
        (name, c, k + 1) for c, (chamber, _, name) in enumerate(chamber_names(with_identifiers(model), prefix))
        for k, gain in enumerate(chamber.torque) if gain
    ]
    names = identifiers([name + (f"_{power}" if power > 1 else "") for name, _, power in powers])
    return [(name, c, power) for name, (_, c, power) in zip(names, powers, strict=True)]


def actuators(root: ET.Element, model: Model, prefix: str, timestep: float, highest: float) -> None:
    """Add one control for each input and each power of the pressure in its law, up to `highest` [Pa].

    A tendon that is wound in and out takes controls of both signs.
    """
    group = ET.SubElement(root, "actuator")
    several = chamber_names(model, prefix)
    for name, c, power in controls(model, prefix):
        chamber, tendon, _ = several[c]
        valve, gain = chamber.valve, chamber.torque[power - 1] * LEVEL ** (power - 1)
        words = {"gainprm": number(gain), "biastype": "none", "gaintype": "fixed", "dyntype": "none"}
        if isinstance(chamber, Tendon):
            words |= of_tendon(chamber)
        if highest > 0:
            lowest = -highest if "biasprm" in words else 0.0
            words["ctrlrange"] = number(lowest, control(highest, power))
        if valve.rise_time:
            words |= {"dyntype": "filterexact", "dynprm": number(valve.rise_time)}
        if valve.dead_time:
            late = int(np.ceil(valve.dead_time / timestep)) + 1
            words |= {"delay": number(valve.dead_time), "nsample": str(late)}
        ET.SubElement(group, "general", attrib={"name": name, "tendon": tendon, **words})


def of_tendon(tendon: Tendon) -> dict[str, str]:
    """Return the MJCF attributes of an actuator for a tendon, with the force T_0 + k (u - length) or a given tension.

    The force of a single tendon is never negative. A pair without pretension has the force k (u - length), since one of
    the two is taut.
    """
    words = {}
    if tendon.elastic:
        words = {"biastype": "affine", "biasprm": number(tendon.pretension, -tendon.line_stiffness, 0.0)}
    return words if tendon.pair else words | {"forcerange": number(0.0, STRONGEST)}


def sensors(root: ET.Element, model: Model, prefix: str) -> None:
    """Add sensors of the observed points' positions and of the joint angles."""
    group = ET.SubElement(root, "sensor")
    for p in model.points:
        ET.SubElement(group, "framepos", name=f"{prefix}{p.name}_pos", objtype="site", objname=f"{prefix}{p.name}")
    for hinge in rigid_chain(model).hinges:
        ET.SubElement(group, "jointpos", name=f"{prefix}{hinge.name}_pos", joint=f"{prefix}{hinge.name}")


def keyframe(root: ET.Element, model: Model, provenance: Provenance) -> None:
    """Add a keyframe at rest without pressure, under gravity and with relaxed creep."""
    try:
        rest = equilibrium(model, 0.0)
    except SimulationError as error:
        provenance.messages.append(f"no keyframe, since the body has no equilibrium without pressure: {error}")
        return
    order = [hinge.row for hinge in rigid_chain(model).hinges]
    places = [rest[row] for row in order for _ in range(1 + len(branches(model)))]
    ET.SubElement(ET.SubElement(root, "keyframe"), "key", name="rest", qpos=number(*places))


def write(model: Model, provenance: Provenance, path: Path, options: Mapping[str, Any]) -> tuple[Path, ...]:
    """Write the MJCF file."""
    if not min(options["timestep"], options["radius"], options["highest"]) >= 0:
        raise InputError(f"mjcf timestep (s), radius (m) and highest (Pa) must be >= 0, got {dict(options)}")
    if options["integrator"] not in INTEGRATORS:
        raise InputError(f"mjcf integrator must be one of {', '.join(INTEGRATORS)}, got {options['integrator']!r}")
    highest = options["highest"] or 2.0 * typical_pressure(model)
    if not options["highest"] and highest:
        unit = model.actuation.units[0]
        level = f"{1e-3 * highest:.4g} kPa" if unit == "Pa" else f"{highest:.4g} {unit}"
        provenance.messages.append(f"controls range from 0 to {level}: set highest ({unit}) for another range")
    if model.space:
        provenance.messages.append(
            "each joint in space is written as two successive hinges: when the body bends by half a radian halfway "
            f"between their axes, the tip differs by {1e3 * hinge_difference(model):.2g} mm from the model's"
        )
    return (write_text(path, mjcf(model, provenance, **{**options, "highest": highest})),)


EXPORTER = Exporter(
    "mjcf", "MuJoCo model (XML)", (".xml", ".mjcf"), CAN, write,
    {"prefix": "", "timestep": 0.0, "radius": 0.0, "integrator": INTEGRATORS[0], "highest": 0.0},
)
