"""Parameters of the virtual actuator, and the named actuators of the test bed."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np

from pliant.errors import InputError

ACTUATORS = {"a": 1, "b": 2, "c": 3}  # name -> seed of everything that differs between specimens


@dataclass(frozen=True)
class ChamberParameters:
    """One pressure chamber: the part of the body from `start` to `stop` (fractions of the length) and its gain there.

    The moment per pressure is `gain` times that of `RodParameters`. With a negative gain the chamber lies on the other
    side of the inextensible layer and bends the body the other way; its lever arm grows as the body bends that way. The
    axial force per pressure is `push` times the chamber's area: with 0 the body carries it, with 1 all of it lengthens
    the body.
    """

    name: str = "chamber"
    start: float = 0.0
    stop: float = 1.0
    gain: float = 1.0
    push: float = 0.0

    def __post_init__(self) -> None:
        """Raise InputError for impossible parameters of a chamber."""
        if not 0.0 <= self.start < self.stop <= 1.0:
            raise InputError(f"chamber {self.name!r} must cover a part of the body, 0 <= start < stop <= 1, "
                             f"got {self.start} to {self.stop}")
        if not np.isfinite(self.gain) or self.gain == 0.0:
            raise InputError(f"the gain of chamber {self.name!r} must be finite and not 0, got {self.gain}")
        if not (np.isfinite(self.push) and self.push >= 0.0):
            raise InputError(f"the push of chamber {self.name!r} must be finite and >= 0, got {self.push}")


PLAIN = (ChamberParameters(),)  # one chamber along the whole body
CHAMBERS = {
    "two_segment": (ChamberParameters("near", 0.0, 0.5), ChamberParameters("far", 0.5, 1.0, gain=0.85)),
    "antagonistic": (ChamberParameters("left"), ChamberParameters("right", gain=-0.85)),
    "lengthening": (ChamberParameters("left", push=1.0), ChamberParameters("right", gain=-0.85, push=1.0)),
}


@dataclass(frozen=True)
class RodParameters:
    """Parameters of a planar soft bending actuator: SI units, gauge pressure, positive bending about +z.

    Values are means along the body; `*_variation` is the standard deviation of a smooth random field relative to
    the mean (absolute, in 1/m, for the rest curvature). `seed` determines all random fields.

    The section is a stack of fibres from the inextensible base (height 0) to `section_height`, of
    ``mu (lam - lam^-3)`` each (``linear=True`` for ``M = EI kappa``); `locking` > 0 makes it stiffen as
    Gent's law does. The pressure's moment is ``p A d G (1 + gain_slope kappa)``, the derivative of a chamber
    volume. Hysteresis comes from Prony branches (fractions `prony_share` of EI, times `prony_time`)
    and from `slip_elements` Maxwell-slip elements at each vertex (in sum the fraction `slip_share` of EI), whose
    thresholds follow a Weibull law. With `two_sided` the fibres lie on both sides of the inextensible layer, from
    `-section_height` on.
    """

    seed: int = 0
    length: float = 0.17  # m
    mass: float = 0.069  # kg, of the bending part
    elements: int = 100
    bending_stiffness: float = 0.0335  # N m2
    stiffness_variation: float = 0.15
    rest_curvature: float = 3.1  # 1/m
    rest_variation: float = 1.6  # 1/m
    correlation_length: float = 0.022  # m
    end_stiffening: float = 0.35  # relative rise of EI and fall of the gain at both ends
    end_length: float = 0.008  # m
    chamber_area: float = 1.5708e-4  # m2, semicircle of radius 10 mm
    chamber_height: float = 4.2441e-3  # m, centroid above the flat face
    gain: float = 1.85  # moment over p A d: the base layer lies below the flat face
    gain_variation: float = 0.13
    gain_slope: float = 0.004  # m, the bladder bulges as it bends
    section_height: float = 0.014  # m
    locking: float = 0.25  # 1 / limit of the invariant
    linear: bool = False
    axial_stiffness: float = 2.0e4  # N, EA; so much of it that the middle layer does not stretch
    loss_time: float = 0.0036  # s, Kelvin-Voigt
    prony_share: tuple[float, ...] = (0.06, 0.05, 0.06)
    prony_time: tuple[float, ...] = (0.05, 0.6, 8.0)  # s
    slip_share: float = 0.10
    slip_elements: int = 15
    slip_scale: float = 4.0  # 1/m
    slip_shape: float = 1.4
    cap_mass: float = 0.006  # kg; 0 leaves the tip free
    cap_length: float = 0.03  # m along its arc
    cap_curvature: float = 50.0  # 1/m, above the body's operating range
    half_width: float = 0.005  # m, from the centreline to the surface that touches
    gravity: tuple[float, float] = (0.0, 0.0)  # m/s2 in the plane of bending
    tube_resistance: float = 2.0e7  # Pa s/m3, between the regulated supply and the chamber
    pushed_node: int = 0  # that the force of a load acts on; 0: the last
    two_sided: bool = False  # a section that is alike on both sides of the inextensible layer
    chambers: tuple[ChamberParameters, ...] = PLAIN

    def __post_init__(self) -> None:
        """Raise InputError for impossible parameters of a rod."""
        positive = ("length", "mass", "bending_stiffness", "axial_stiffness", "correlation_length",
                    "end_length", "slip_scale", "slip_shape", "cap_length")  # fmt: skip
        free = {"gravity", "rest_curvature", "gain_slope", "cap_curvature"}
        for field in fields(self):
            if field.name == "chambers":
                continue
            value = np.asarray(getattr(self, field.name), dtype=float)
            if not np.all(np.isfinite(value)):
                raise InputError(f"rod parameter {field.name} must be finite, got {getattr(self, field.name)}")
            if field.name in positive and value <= 0:
                raise InputError(f"rod parameter {field.name} must be > 0, got {value}")
            if field.name not in free and np.any(value < 0):
                raise InputError(f"rod parameter {field.name} must be >= 0, got {getattr(self, field.name)}")
        if self.pushed_node > self.elements + 1:
            raise InputError(f"pushed_node must be at most {self.elements + 1}, got {self.pushed_node}")
        if self.elements < 4:
            raise InputError(f"a rod needs at least 4 elements, got {self.elements}")
        if len(self.prony_share) != len(self.prony_time) or min(self.prony_time, default=1.0) <= 0:
            raise InputError("every Prony branch needs a fraction in prony_share and a time > 0 in prony_time")
        if not self.chambers or len({c.name for c in self.chambers}) != len(self.chambers):
            raise InputError(f"a rod needs at least one chamber, with different names, got {self.chambers}")

    def uniform(self, **changes: object) -> RodParameters:
        """Return a uniform linear rod without hysteresis, damping and cap, to compare with closed-form solutions."""
        plain = {"stiffness_variation": 0.0, "gain_variation": 0.0, "rest_variation": 0.0, "rest_curvature": 0.0,
                 "end_stiffening": 0.0, "linear": True, "gain_slope": 0.0, "loss_time": 0.0, "prony_share": (),
                 "prony_time": (), "slip_share": 0.0, "slip_elements": 0, "cap_mass": 0.0, "gain": 1.0,
                 "tube_resistance": 0.0}  # fmt: skip
        return replace(self, **(plain | changes))  # type: ignore[arg-type]


def actuator(name: str = "a") -> RodParameters:
    """Return the parameters of a named actuator: "a", "b" or "c" with one chamber, or one with two chambers.

    For one chamber, means and random fields are drawn from the seed that belongs to the name. "two_segment" is actuator
    "a" with a chamber in each half. "antagonistic" is straight at rest, with a chamber along each side of the
    inextensible layer. "lengthening" is the same with a layer that stretches.

    Raises
    ------
    InputError
        For an unknown name.
    """
    if name in CHAMBERS:
        sides = {} if name == "two_segment" else {"two_sided": True, "rest_curvature": 0.0}
        soft = {"axial_stiffness": 200.0} if name == "lengthening" else {}
        return replace(actuator("a"), chambers=CHAMBERS[name], **sides, **soft)  # type: ignore[arg-type]
    if name not in ACTUATORS:
        raise InputError(f"unknown actuator {name!r}: use one of {', '.join((*ACTUATORS, *CHAMBERS))}")
    seed = ACTUATORS[name]
    draw = np.random.default_rng([seed, 2018]).standard_normal(8)
    base = RodParameters()
    return replace(
        base,
        seed=seed,
        mass=base.mass * float(np.exp(0.02 * draw[0])),
        bending_stiffness=base.bending_stiffness * float(np.exp(0.07 * draw[1])),
        rest_curvature=base.rest_curvature * float(np.exp(0.15 * draw[2])),
        gain=base.gain * float(np.exp(0.05 * draw[3])),
        loss_time=base.loss_time * float(np.exp(0.1 * draw[4])),
        slip_share=base.slip_share * float(np.exp(0.2 * draw[5])),
        cap_mass=base.cap_mass * float(np.exp(0.1 * draw[6])),
        locking=base.locking * float(np.exp(0.3 * draw[7])),
    )
