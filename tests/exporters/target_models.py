"""Models that every target is tried on."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from pliant.actuators import chen2018
from pliant.model import Chamber, Memory, Model, Valve, load_model

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
