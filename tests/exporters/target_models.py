"""Models that every target is tried on."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from pliant.actuators import chen2018
from pliant.model import Chamber, Extension, Memory, Model, Space, Tendon, Valve, chain_model, load_model

KINDS = Path(__file__).parents[2] / "examples" / "state"


def paper() -> Model:
    """The paper's five links."""
    return chen2018.model()


def demo() -> Model:
    """As the demo's: springs that soften and stiffen again, a quadratic law, a curved rest shape, a cap."""
    return load_model(KINDS / "model_a.json").with_(memory=Memory(), cubic_stiffening=0.3, name="demo")


def creeping() -> Model:
    """Creep, valve, dead time, gravity, observed away from the axis."""
    model = load_model(KINDS / "model_b.json")
    memory = replace(model.memory, slip_share=(), slip_angle=())
    return model.with_(
        memory=memory, valve=Valve(rise_time=0.03, fall_time=0.03, dead_time=0.0123), gravity=[-0.4, -9.7],
        torque=[1.1e-6], base_length=0.02, base_angle=0.2, name="creeping",
        stations=[("middle", 2, 0.01, 0.004), ("base", -1, 0.01, 0.0), ("tip", 4, 0.017, 0.0)],
    )


def two_chambers() -> Model:
    """As `creeping`, each half turned by a chamber of its own."""
    model = creeping()
    near = Chamber([1.1e-6], joint_gain=[1.0, 1.0, 0.5, 0.0, 0.0], valve=model.valve, name="near")
    quick = Valve(rise_time=0.02, fall_time=0.02)
    far = Chamber([-9e-7], joint_gain=[0.0, 0.0, 0.5, 1.0, 1.0], valve=quick, name="far")
    return model.with_(chambers=(near, far), name="two chambers")


MODELS = {"paper": paper, "demo": demo, "creeping": creeping}
AZIMUTHS = np.radians([90.0, 210.0, 330.0])


def in_space(links: int = 4) -> Model:
    """Three chambers, a tilted base, a rest shape that bends and twists, two bending stiffnesses, a cap, gravity."""
    chambers = tuple(
        Chamber([2e-6], joint_gain=np.sin(a), cross_gain=-np.cos(a), name=name,
                valve=Valve(rise_time=0.02, fall_time=0.02))
        for a, name in zip(AZIMUTHS, ("red", "green", "blue"), strict=True)
    )  # fmt: skip
    return chain_model(
        length=0.3, mass=0.1, links=links, joint_placement="midsegment", stiffness=0.5, damping=5e-3, chambers=chambers,
        gravity=(0.5, 0.2, -9.8), tip_mass=0.01, tip_inertia=2e-6, name="in_space",
        space=Space(stiffness_ratio=1.3, rest_turn=[0.1, -0.05, 0.2], base_tilt=[0.2, -0.1, 0.3], radius=0.012),
        stations=[
            ("middle", 1, 0.02, 0.003, 0.004), ("base", -1, 0.01, 0.002, 0.001), ("tip", links - 1, 0.15 / links),
        ],
    )


def twisting(links: int = 4) -> Model:
    """As `in_space`, with joints that twist."""
    model = in_space(links)
    return model.with_(space=replace(model.space, twist_ratio=0.7), name="twisting")


def pulled(links: int = 4) -> Model:
    """Converging tendons: one drawn in that can hang slack, a pair on a motor, one under a known tension."""
    path = {"lever": 9e-3, "taper": 7e-3, "at": 0.3 * (np.arange(links) + 0.5) / links}
    passed = {**path, "line_stiffness": 2e3}
    cords = (
        Tendon.at_azimuth(AZIMUTHS[0], np.ones(links), driven_by="displacement", pretension=1.0, name="long", **passed),
        Tendon.at_azimuth(AZIMUTHS[1], np.ones(links), driven_by="angle", pulley=0.01, pair=True, name="pair",
                          valve=Valve(rise_time=0.02, fall_time=0.02), **passed),
        Tendon.at_azimuth(AZIMUTHS[2], [1.0] + [0.0] * (links - 1), name="short", **path),
    )  # fmt: skip
    return in_space(links).with_(chambers=cords, name="pulled")


def longer(links: int = 3) -> Model:
    """Joints that twist and segments that lengthen, of which two chambers push the body too; a tendon that draws it."""
    model = twisting(links)
    near, far, _ = (replace(c, axial_gain=40.0) for c in model.chambers)
    cord = pulled(links).chambers[0]
    segments = Extension(60.0, 0.4, 0.0, 0.16, "near"), Extension(90.0, 0.3, 0.16, None, "far")
    return model.with_(chambers=(near, far, cord), extensions=segments, name="longer")


def tied(links: int = 3) -> Model:
    """As `longer`, and the first segment stiffens with its strain: along the axis and in bending."""
    model = longer(links)
    near, far = model.extensions
    stiffer = replace(near, stiffening=-1.5, cubic_stiffening=40.0, stiffening_bound=0.6, stiffens_bending=True)
    return model.with_(extensions=(stiffer, far), name="tied")


EVERY_BRANCH = Memory(
    (0.1,), (0.5,), (0.1,), (0.02,), boucwen_share=0.1, axial_creep_share=(0.2, 0.1), axial_creep_time=(3.0, 0.1),
    axial_slip_share=(0.1, 0.2), axial_slip_strain=(0.01, 0.03),
)  # of joints and of segments


def flat_longer(links: int = 2) -> Model:
    """In a plane, two segments that lengthen, of which one softens; one with one link. A point beside a link."""
    stop = None if links == 1 else 0.15
    segments = (Extension(60.0, 0.05, 0.0, stop, "lower", -0.3, 0.7, 0.6), Extension(40.0, 0.03, 0.15, None, "upper"))
    chambers = (
        Chamber((1e-6,), axial_gain=30.0, swell_share=0.2, swell_time=0.3, name="a"),
        Chamber((4e-7,), axial_gain=5.0, valve=Valve(rise_time=0.02, fall_time=0.03), name="b"),
    )
    return chain_model(
        length=0.3, mass=0.1, links=links, joint_placement="midsegment", stiffness=0.5, damping=2e-3, tip_mass=0.01,
        gravity=(0.3, -9.81), chambers=chambers, extensions=segments[:links], name="flat_longer",
        stations=[("side", 0, 0.03, 0.002), ("base", -1, 0.01, 0.001), ("tip", links - 1, 0.15 / links)],
    )


SPATIAL = {"in_space": in_space, "twisting": twisting, "pulled": pulled}
