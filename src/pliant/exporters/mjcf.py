"""Export of a model as MJCF for MuJoCo: joints as hinges, creep and slip as additional hidden hinges, inputs as
actuators.

In MJCF a joint's stiffness "K K2 K3" means the torque K q + K2 q^2 + K3 q^3. A fixed tendon whose coefficients are the
joint gains converts one force to the torques of all joints. A branch of creep is a separate hinge, damped by K share
time and tied to the joint by a tendon of stiffness K share. In a slip element dry friction takes the place of the
damper. The frames of the bodies contain the rest shape, so that q = 0 is at rest. A joint in space is two or three
hinges of `rigid_chain`. A tendon of the model is an actuator whose force k (u - length) + T_0 is never negative.

A link that lengthens has slides along itself. A fixed tendon ``strain_NAME`` has the strain of a segment as its length
and the segment's axial spring and damper. Equality constraints couple the slides of a segment.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree as ET

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import qr

from pliant.errors import InputError, SimulationError
from pliant.exporters.difference import default_levels
from pliant.exporters.mjcf_step import Hidden, checked_step, linear_chain
from pliant.exporters.provenance import Provenance
from pliant.exporters.registry import Exporter, range_note, stated_levels, with_identifiers
from pliant.exporters.rigid_chain import (
    RigidChain,
    RigidLink,
    Slide,
    carrier_of,
    hinge_difference,
    moments,
    rigid_chain,
)
from pliant.files import write_text
from pliant.mechanics import mechanics_of
from pliant.model import Chamber, Model
from pliant.model.features import named
from pliant.simulation.state import equilibrium
from pliant.text import identifiers

Array = np.ndarray
CAN = frozenset({
    "springs", "drive", "chambers", "points", "lengthening", "space_lengthening", "gravity", "softening", "law",
    "dead_time", "lag", "creep", "slip", "space", "twist", "tendons",
})
FINER, MOST_KEPT = 100, 100_000  # time steps at which dead times hold, and controls that MuJoCo keeps for them
ARMATURE = 1e-7  # kg m^2, of a hidden hinge, since MuJoCo needs an inertia
TINY = 1e-12  # kg m^2, of a hidden body
STRONGEST = 1e6  # N, upper limit of a tendon's force
EXACT: dict[str, Any] = {"solref": "1e-6 1", "solimp": "0.9999 0.9999 0.001 0.5 2"}  # as stiff as the step allows
DRY = {"solreffriction": "0.001 1", "solimpfriction": "0.9999 0.9999 0.001 0.5 2"}  # the stiffest friction of MuJoCo
INTEGRATORS = ("implicitfast", "implicit", "Euler", "RK4")
LEVEL = 1e5  # Pa: MuJoCo limits controls to 1e10, so the k-th one is p (p / LEVEL)^(k - 1)


class Branch(NamedTuple):
    """A creep or slip element in MJCF: a spring from a joint to an additional, hidden hinge, which has a damper (creep)
    or dry friction (slip).
    """

    name: str
    share: float  # stiffness as a fraction of the joint's K
    time: float  # s, relaxation time of the damper
    angle: float  # rad, angle at which dry friction slips


def number(*values: float) -> str:
    """Return numbers as MJCF text, with enough digits to preserve every bit."""
    return " ".join(f"{float(v) + 0.0:.17g}" for v in values)


def quaternion(turn: Array) -> str:
    """Return a rotation vector (3,) [rad] as the text of an MJCF quaternion (w, x, y, z)."""
    from scipy.spatial.transform import Rotation

    return number(*Rotation.from_rotvec(turn).as_quat(scalar_first=True))


def mjcf(
    model: Model, provenance: Provenance, *, prefix: str = "", time_step: float = 0.0, radius: float = 0.0,
    integrator: str = "", highest: ArrayLike = 0.0,
) -> str:
    """Return the MJCF text of a model.

    The model must have only features that MJCF can express.

    The `integrator` is one of `INTEGRATORS`; "" means implicitfast, and Euler for a body that lengthens.
    The time step `time_step` [s] is checked against the stiffest mode; 0 chooses it. Controls reach up to the level
    `highest` [SI], one number or one for each input; 0 means `default_levels`. With a prefix, for worlds of several
    bodies, there is no keyframe, since a keyframe holds the state of a whole world.
    """
    size = radius or 0.08 * model.length
    model = with_identifiers(model)
    bodies = rigid_chain(model)
    integrator = integrator or INTEGRATORS[2 if bodies.slides else 0]
    if bodies.slides and integrator.startswith("implicit"):
        raise InputError(
            f"mjcf: with integrator={integrator} MuJoCo ignores the dampers of an extensible segment in its constraint "
            "forces, so that the parts of the segment may drift apart: take integrator=Euler or integrator=RK4"
        )
    linear = linear_chain(model, [Hidden(b.share, b.time, ARMATURE) for b in branches(model)])
    time_step = checked_step(linear, integrator, time_step)
    if any(c.valve.dead_time for c in model.chambers):
        provenance.messages.append(
            f"dead times hold at time steps of {finest_step(model, time_step):g} s and longer: export again with "
            "time_step for a shorter one, since MuJoCo would shorten them"
        )
    root = ET.Element("mujoco", model=f"{prefix}{model.name}")
    ET.SubElement(root, "compiler", angle="radian", autolimits="true")
    ET.SubElement(
        root, "option", timestep=number(time_step), gravity=number(*bodies.gravity), integrator=integrator
    )
    ET.SubElement(ET.SubElement(root, "custom"), "text", name=f"{prefix}pliant", data=provenance.json())
    base = ET.SubElement(
        ET.SubElement(root, "worldbody"), "body", name=f"{prefix}base", quat=quaternion(bodies.base_turn),
    )
    parent = along(base, model, bodies, -1, (prefix, size))
    for i in range(model.n):
        parent = link(parent, model, bodies, i, (prefix, size))
    tendons(root, model, prefix)
    contacts(root, prefix)
    actuators(root, model, prefix, time_step, default_levels(model) if not np.any(highest) else highest)
    sensors(root, model, prefix)
    if not prefix:
        keyframe(root, model, provenance)
    ET.indent(root)
    return ET.tostring(root, encoding="unicode") + "\n"


def link(parent: ET.Element, model: Model, bodies: RigidChain, i: int, names: tuple[str, float]) -> ET.Element:
    """Add link `i` to its parent in the MJCF: body, hinges, inertia, geometry, and the hinges that represent the states
    of hysteresis.

    Returns the new body element.
    """
    prefix, size = names
    rigid_link = bodies.links[i]
    pose = {"pos": number(*bodies.start(i)), "quat": quaternion(rigid_link.turn)}
    hidden_hinges(parent, model, rigid_link, pose, prefix)
    body = ET.SubElement(parent, "body", attrib={"name": f"{prefix}link_{i + 1}", **pose})
    for hinge in rigid_link.hinges:
        ET.SubElement(
            body, "joint", name=f"{prefix}{hinge.name}", type="hinge", axis=number(*hinge.axis),
            damping=number(hinge.damping), stiffness=number(*hinge.springs),
        )
    ET.SubElement(
        body, "inertial", pos=number(*(rigid_link.centre * bodies.tangent)), mass=number(rigid_link.mass),
        diaginertia=number(*moments(bodies, rigid_link, size)),
    )
    return along(body, model, bodies, i, names)


def along(body: ET.Element, model: Model, bodies: RigidChain, i: int, names: tuple[str, float]) -> ET.Element:
    """Add slides, capsules and observed points along link `i` (-1: the base) to the MJCF, and return the body that
    carries the next link.

    A capsule reaches from one body along a link to the next; where the link lengthens, half of it and a quarter to
    either side of its middle, so that no gap opens.
    """
    prefix, size = names
    rigid_link = bodies.links[i] if i >= 0 else None
    slides, length = (rigid_link.slides, rigid_link.length) if rigid_link else (bodies.base_slides, bodies.base_length)
    skin, reach = f"{prefix}skin_{i + 1 if rigid_link else 'base'}", length * bodies.tangent
    bodies_along = [body]
    capsule(body, skin, (0.5 if slides else 1.0) * reach, size)
    for slide in slides:
        bodies_along.append(sliding(bodies_along[-1], bodies, slide, prefix))
        middle = slide.place < 0.75 * length
        capsule(bodies_along[-1], f"{skin}_{'middle' if middle else 'end'}", (0.25 if middle else -0.5) * reach, size,
                start=-0.25 * reach if middle else None)  # fmt: skip
    named = {b.attrib["name"]: b for b in bodies_along}
    for point in model.points:
        if point.link == i:
            carrier, position, own_slide = carrier_of(model, bodies, point)
            holder = named[prefix + carrier]
            holder = sliding(holder, bodies, own_slide, prefix) if own_slide else holder
            ET.SubElement(holder, "site", name=f"{prefix}{point.name}", pos=number(*position), size="0.002")
    return bodies_along[-1]


def sliding(parent: ET.Element, bodies: RigidChain, slide: Slide, prefix: str) -> ET.Element:
    """Add a point mass that slides along a link to the MJCF, with a slide joint of the same name,
    and return its body.
    """
    position = number(*(slide.step * bodies.tangent))
    body = ET.SubElement(parent, "body", name=f"{prefix}{slide.name}", pos=position)
    ET.SubElement(body, "joint", name=f"{prefix}{slide.name}", type="slide", axis=number(*bodies.tangent))
    ET.SubElement(body, "inertial", pos="0 0 0", mass=number(slide.mass), diaginertia=number(TINY, TINY, TINY))
    return body


def hidden_hinges(
    parent: ET.Element, model: Model, own: RigidLink, place: Mapping[str, str], prefix: str
) -> None:
    """Add the hidden hinges, which represent creep and slip of the joint before one link, to the MJCF."""
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
    """Return the creep and slip elements of a model, which are the same at every joint."""
    m = model.memory
    creep = zip(m.creep_share, m.creep_time, strict=True)
    slip = zip(m.slip_share, m.slip_angle, strict=True)
    elements = [Branch(f"creep_{j + 1}", share, time, 0.0) for j, (share, time) in enumerate(creep)]
    return elements + [Branch(f"slip_{j + 1}", share, 0.0, angle) for j, (share, angle) in enumerate(slip)]


def capsule(body: ET.Element, name: str, reach: Array, size: float, start: Array | None = None) -> None:
    """Add a massless capsule from `start` (default: the origin) to `reach` (3,) [m] to the MJCF, for display and
    contact.
    """
    start = 0.0 * reach if start is None else start
    length = float(np.linalg.norm(reach - start))
    if length > 0:
        ET.SubElement(
            body, "geom", name=name, type="capsule", fromto=number(*start, *reach),
            size=number(min(size, 0.9 * length)), rgba="0.35 0.5 0.65 1",
        )


def chamber_names(model: Model, prefix: str) -> list[tuple[Chamber, str, str]]:
    """Return (chamber, name of its tendon in the MJCF, name of its first control) for each chamber of a model."""
    actuation = model.actuation
    names = ([prefix + label for label in actuation.labels(what)] for what in ("bend", "{kind}"))
    return list(zip(actuation.inputs, *names, strict=True))


def tendons(root: ET.Element, model: Model, prefix: str) -> None:
    """Add tendons to the MJCF: one for each input, and others that serve as springs of extensible segments and as
    springs between joints and hidden hinges. Constraints that couple the slides of a segment are added too.
    """
    group = ET.SubElement(root, "tendon")
    bodies, joints = rigid_chain(model), mechanics_of(model).joints
    hinges, slides, strains = bodies.hinges, bodies.slides, model.size - len(model.extensions)
    of_slides = bodies.strain_of_slides if slides else np.zeros((0, 0))
    for gain, (_, tendon, _) in zip(model.actuation.gain, chamber_names(model, prefix), strict=True):
        turns = [(prefix + hinge.name, gain[hinge.row]) for hinge in hinges]
        fixed(group, tendon, [*turns, *moved(slides, gain[strains:] @ of_slides, prefix)])
    for s, segment in enumerate(model.extensions):
        K, D = joints.K[strains + s], joints.D[strains + s]
        spring = {"stiffness": number(K), "damping": number(D), "springlength": "0"}
        fixed(group, f"{prefix}strain_{segment.name}", moved(slides, of_slides[s], prefix), **spring)
    for branch in branches(model):
        for hinge in hinges:
            name, K = f"{prefix}{branch.name}_{hinge.link + 1}", number(hinge.stiffness * branch.share)
            fixed(group, f"{name}_spring", [(prefix + hinge.name, 1.0), (name, -1.0)], stiffness=K, springlength="0")
    together(root, group, model, prefix)


def fixed(group: ET.Element, name: str, joints: Iterable[tuple[str, float]], **words: str) -> None:
    """Add a fixed tendon to the MJCF, with the names of its joints and their coefficients, and the attributes
    `words`.
    """
    tendon = ET.SubElement(group, "fixed", attrib={"name": name, **words})
    for joint, coefficient in joints:
        ET.SubElement(tendon, "joint", joint=joint, coef=number(coefficient))


def moved(slides: Sequence[Slide], coefficients: Array, prefix: str) -> list[tuple[str, float]]:
    """Return the names of slides with their coefficients in a fixed tendon. Slides with the coefficient 0 are left
    out.
    """
    return [(prefix + slide.name, c) for slide, c in zip(slides, coefficients, strict=True) if c]


def together(root: ET.Element, group: ET.Element, model: Model, prefix: str) -> None:
    """Add constraints to the MJCF that couple all slides of an extensible segment to one of them, the chief.

    A slide that two segments move is coupled through a fixed tendon in `group`. The tendon's length is the slide's
    displacement minus the displacement that follows from both chiefs.
    """
    bodies = rigid_chain(model)
    if not bodies.slides:
        return
    growth = bodies.growth
    pure = growth * (np.count_nonzero(growth, axis=1) == 1)[:, None]
    chief = np.argmax(pure, axis=0)
    if not pure.any(axis=0).all():
        chief = qr(growth.T, mode="r", pivoting=True)[1][: growth.shape[1]]
    chiefs = [bodies.slides[k] for k in chief]
    points = [carrier_of(model, bodies, p)[2] for p in model.points]
    others = [s for k, s in enumerate(bodies.slides) if k not in chief] + [s for s in points if s]
    equal = ET.SubElement(root, "equality")
    for slide in others:
        factors = np.linalg.solve(growth[chief].T, slide.growth)
        factors[np.abs(factors) < 1e-12 * np.abs(factors).max()] = 0.0
        name = f"{prefix}{slide.name}"
        if np.count_nonzero(factors) == 1:
            k = int(np.flatnonzero(factors)[0])
            ET.SubElement(equal, "joint", name=name, joint1=name, joint2=prefix + chiefs[k].name,
                          polycoef=number(0.0, factors[k], 0.0, 0.0, 0.0), **EXACT)  # fmt: skip
        else:
            fixed(group, f"{name}_apart", moved([slide, *chiefs], np.append(1.0, -factors), prefix))
            ET.SubElement(equal, "tendon", name=name, tendon1=f"{name}_apart", **EXACT)


def contacts(root: ET.Element, prefix: str) -> None:
    """Exclude contacts between the links of the actuator in the MJCF, because the model has none."""
    group = ET.SubElement(root, "contact")
    names = [body.attrib["name"] for body in root.iter("body") if body.find("geom") is not None]
    names = list(dict.fromkeys([f"{prefix}base", *names]))
    for a in range(len(names)):
        for b in range(a):
            ET.SubElement(group, "exclude", body1=names[b], body2=names[a])


def control(pressure: float, power: int) -> float:
    """Return the MuJoCo control value [Pa] that represents the given power of the pressure p [Pa]: p (p / 100
    kPa)^(power - 1).
    """
    return float(pressure * (pressure / LEVEL) ** (power - 1))


def controls(model: Model, prefix: str = "") -> list[tuple[str, int, int]]:
    """Return all controls of the exported model as (name, chamber index, power of the pressure).

    `control` computes the control value.
    """
    powers = [
        (name, c, k + 1) for c, (chamber, _, name) in enumerate(chamber_names(with_identifiers(model), prefix))
        for k, gain in enumerate(chamber.torque) if gain
    ]
    names = identifiers([name + (f"_{power}" if power > 1 else "") for name, _, power in powers])
    return [(name, c, power) for name, (_, c, power) in zip(names, powers, strict=True)]


def actuators(root: ET.Element, model: Model, prefix: str, time_step: float, highest: ArrayLike) -> None:
    """Add one actuator for each input, and for each power of the pressure in its torque law, to the MJCF.

    Controls reach up to the level `highest` [SI], one number or one for each input.

    A tendon that is wound in and out takes controls of both signs.
    """
    group = ET.SubElement(root, "actuator")
    several, levels = chamber_names(model, prefix), np.broadcast_to(highest, model.actuation.count)
    for name, c, power in controls(model, prefix):
        chamber, tendon, _ = several[c]
        valve, gain = chamber.valve, chamber.torque[power - 1] * LEVEL ** (power - 1)
        words = {"gainprm": number(gain), "biastype": "none", "gaintype": "fixed", "dyntype": "none"}
        if chamber.signs:
            words |= of_tendon(chamber)
        if levels[c] > 0:
            lowest = -levels[c] if "biasprm" in words else 0.0
            words["ctrlrange"] = number(lowest, control(levels[c], power))
        if valve.rise_time:
            words |= {"dyntype": "filterexact", "dynprm": number(valve.rise_time)}
        if valve.dead_time:
            late = int(np.ceil(valve.dead_time / finest_step(model, time_step) - 1e-9)) + 1
            words |= {"delay": number(valve.dead_time), "nsample": str(late)}
        ET.SubElement(group, "general", attrib={"name": name, "tendon": tendon, **words})


def finest_step(model: Model, time_step: float) -> float:
    """Return the shortest time step [s] at which the exported dead times hold: MuJoCo delays a control by at most as
    many steps as it keeps values. It is a hundredth of the file's `time_step` [s] or, for long dead times, more.
    """
    longest = max(c.valve.dead_time for c in model.chambers)
    return float(f"{min(max(time_step / FINER, longest / MOST_KEPT), time_step):.3g}")


def of_tendon(tendon: Any) -> dict[str, str]:
    """Return the MJCF attributes of a tendon's actuator. An elastic tendon pulls with the force T_0 + k (u - length),
    with its pretension T_0, its stiffness k and the control u. For any other tendon the control is the tension.

    The force of a single tendon is never negative. A pair without pretension has the force k (u - length) plus half its
    imbalance, since one of the two is taut.
    """
    words = {}
    if tendon.elastic:
        at_rest = tendon.pretension + 0.5 * tendon.imbalance
        words = {"biastype": "affine", "biasprm": number(at_rest, -tendon.line_stiffness, 0.0)}
    return words if tendon.pair else words | {"forcerange": number(0.0, STRONGEST)}


def sensors(root: ET.Element, model: Model, prefix: str) -> None:
    """Add sensors of the observed points' positions, of the joint angles and of the segments' strains to the MJCF."""
    group = ET.SubElement(root, "sensor")
    for p in model.points:
        ET.SubElement(group, "framepos", name=f"{prefix}{p.name}_pos", objtype="site", objname=f"{prefix}{p.name}")
    for hinge in rigid_chain(model).hinges:
        ET.SubElement(group, "jointpos", name=f"{prefix}{hinge.name}_pos", joint=f"{prefix}{hinge.name}")
    for segment in model.extensions:
        name = f"{prefix}strain_{segment.name}"
        ET.SubElement(group, "tendonpos", name=f"{name}_pos", tendon=name)


def keyframe(root: ET.Element, model: Model, provenance: Provenance) -> None:
    """Add a keyframe with the equilibrium without pressure, under gravity and with relaxed creep, to the MJCF."""
    try:
        rest = equilibrium(model, 0.0)
    except SimulationError as error:
        provenance.messages.append(f"no keyframe, since the body has no equilibrium without pressure: {error}")
        return
    bodies, strain = rigid_chain(model), rest[model.size - len(model.extensions) :]
    values = {hinge.name: rest[hinge.row] for hinge in bodies.hinges}
    values |= {f"{b.name}_{h.link + 1}": rest[h.row] for h in bodies.hinges for b in branches(model)}
    slides = [*bodies.slides, *(carrier_of(model, bodies, p)[2] for p in model.points)]
    values |= {slide.name: float(slide.growth @ strain) for slide in slides if slide}
    order = [joint.attrib["name"] for body in root.iter("body") for joint in body.findall("joint")]
    ET.SubElement(ET.SubElement(root, "keyframe"), "key", name="rest", qpos=number(*(values[name] for name in order)))


def write(model: Model, provenance: Provenance, path: Path, options: Mapping[str, Any]) -> tuple[Path, ...]:
    """Write a model as MJCF to `path`, and return the path."""
    highest = stated_levels("mjcf", "highest", options["highest"], model)
    if not min(options["time_step"], options["radius"], *highest) >= 0:
        raise InputError(f"mjcf options time_step (s), radius (m) and highest (SI) must be >= 0, got {dict(options)}")
    if options["integrator"] not in ("", *INTEGRATORS):
        raise InputError(
            f"mjcf option integrator must be one of {', '.join(INTEGRATORS)}, got {options['integrator']!r}"
        )
    if not highest.any() and (highest := default_levels(provenance.model)).any():
        provenance.messages.append(range_note(model, highest))
    if mechanics_of(model).lengthens:
        provenance.messages.append(
            "equality constraints couple the slides of a segment that lengthens: simulate with Euler or RK4, since "
            "MuJoCo's implicit integrators follow them at short steps only"
        )
    if named(model, ("space",)):
        provenance.messages.append(
            "each joint in space is written as two successive hinges: when the body bends by half a radian, evenly or "
            f"by one input, the tip at rest differs by up to {1e3 * hinge_difference(model):.2g} mm from the model's"
        )
    return (write_text(path, mjcf(model, provenance, **{**options, "highest": highest})),)


EXPORTER = Exporter(
    "mjcf", "MuJoCo model (XML)", (".xml", ".mjcf"), CAN, write,
    {"prefix": "", "time_step": 0.0, "radius": 0.0, "integrator": "", "highest": "0"},
)
