"""Tendons as inputs of a chain in space, driven by a force, a displacement or a motor angle."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, Any, get_args

import numpy as np

from pliant.errors import InputError
from pliant.model.actuation_input import ActuationInput, CrossGain, JointGain
from pliant.model.chamber import Chamber
from pliant.model.checks import check_numbers
from pliant.model.quantity import Quantity, declaring, quantities
from pliant.model.valve import Valve, check_valve
from pliant.units import KIND_OF, DrivenBy

Array = np.ndarray
DRIVEN = {kind: unit for unit, kind in KIND_OF.items() if kind in get_args(DrivenBy)}


@declaring
@dataclass(frozen=True, eq=False)
class Tendon(ActuationInput):
    """One tendon along a chain in space, or a pair of opposite tendons on one motor. SI units.

    The tension is T = max(0, k (u - g . x) + T_0). g is the lever arm at each coordinate x, exact where the body bends
    in arcs, u the length drawn in, and k the stiffness of the tendon with its attachments. With driven_by = "tension",
    T is the input. Over a joint that swings by theta, friction multiplies the tension by exp(-mu theta) while the
    tendon is drawn in, and by exp(mu theta) while it is let out. Where the tendon enters the body, its tension falls by
    `entry_friction` while it is drawn in, and rises by it while it is let out, but never by more than the tension.

    Parameters
    ----------
    driven_by : {"tension", "displacement", "angle"}
        Kind of the input: a tension [N], a displacement of its end [m], or the angle of a motor [rad].
    lever : float
        Distance of the path from the axis at the base, m. The lever arm at a joint is the distance there, `lever`
        - `taper` * `at`, times joint_gain about the x axis and times cross_gain about the y axis. At an azimuth alpha
        from x towards y these gains are -sin(alpha) and cos(alpha), and 0 beyond the tendon's end; see `at_azimuth`.
    taper : float
        Decrease of the distance from the axis per length along the body.
    spacing : float
        Distance between the guides of the path, m: between them it runs along chords, which a bend makes shorter than
        the arc through the guides. 0: along the arc.
    at : array (n,)
        Position along the body that counts for the taper at each joint, m from the base: the middle of the part of the
        path that the joint bends. A single number applies to all joints. Without a taper it has no effect.
    line_stiffness : float
        k, N/m; needed unless driven_by is "tension".
    pretension : float
        T_0, N; below 0 the tendon hangs slack by -T_0 / k.
    pulley : float
        Radius of the motor's pulley, m; needed if driven_by is "angle".
    pair : bool
        Whether there are two opposite tendons on one motor: the second is let out as far as the first is drawn in.
    imbalance : float
        Pretension of the first tendon of a pair less that of the second, N: their pretensions are T_0 + imbalance / 2
        and T_0 - imbalance / 2.
    friction : float
        mu, coefficient of friction along the path.
    entry_friction : float
        Friction force where the tendon enters the body, such as that of its pulley or guide, N.
    slip_rate : float
        Rate of slip [m/s] over which friction changes its direction: a tendon held by friction creeps at up to about
        this rate.
    name, valve, joint_gain, cross_gain
        As for a `Chamber`; the valve is the lag of the motor.

    Raises
    ------
    InputError
        When a parameter is missing, not finite or not physical.
    """

    noun = "tendon"
    gain_unit = "m"
    joint_gain: JointGain = field(default_factory=lambda: np.ones(1))
    valve: Valve = field(default_factory=Valve)
    cross_gain: CrossGain = field(default_factory=lambda: np.zeros(1))
    name: str = "tendon"
    driven_by: str = "tension"
    lever: Annotated[float, Quantity(
        "m", "distance of a tendon's path from the axis, at the base", sign="positive", most=1e2,
        lower=1e-6, scale=2e-3)] = 0.0
    line_stiffness: Annotated[float, Quantity(
        "N/m", "stiffness of a tendon with its motor and mounts", sign="not negative", most=1e9, lower=1e-6,
        log_offset=0.0)] = 0.0
    pretension: Annotated[float, Quantity(
        "N", "tension of a tendon at rest; below 0 it hangs slack", most=1e6, scale=1.0)] = 0.0
    pulley: Annotated[float, Quantity(
        "m", "radius of a motor's pulley", sign="not negative", most=1e2, lower=1e-6)] = 0.0
    pair: bool = False
    friction: Annotated[float, Quantity(
        "1", "coefficient of friction along a tendon", sign="not negative", most=1e2,
        lower=0.0, upper=5.0, scale=0.1)] = 0.0
    slip_rate: Annotated[float, Quantity(
        "m/s", "rate of slip over which friction changes its direction", sign="positive", least=1e-9, most=1e3,
        fitted=False)] = 1e-3
    entry_friction: Annotated[float, Quantity(
        "N", "friction of a tendon where it enters the body", sign="not negative", most=1e6,
        lower=0.0, scale=0.1)] = 0.0
    imbalance: Annotated[float, Quantity(
        "N", "pretension of a pair's first tendon less that of its second", most=1e6, scale=1.0)] = 0.0
    taper: Annotated[float, Quantity(
        "1", "decrease of a tendon's distance from the axis per length", most=10.0, scale=5e-3)] = 0.0
    spacing: Annotated[float, Quantity(
        "m", "distance between the guides of a tendon, which runs straight between them", sign="not negative", most=1e2,
        lower=0.0, scale=5e-3)] = 0.0
    at: Annotated[Array, Quantity(
        "m", "position of each joint along the body, for the taper", per="joint", sign="not negative",
        fitted=False)] = field(default_factory=lambda: np.zeros(1))

    def __post_init__(self) -> None:
        who = f"tendon {self.name!r}:"
        if self.driven_by not in DRIVEN:
            raise InputError(f"{who} driven_by must be {', '.join(DRIVEN)}, got {self.driven_by!r:.40}")
        self._check_gains()
        check_numbers(self, who, [name for name in quantities(Tendon) if name != "at"])
        check_valve(self.valve, who)
        arcs = self.at
        if arcs.size not in (1, self.joint_gain.size) or not (np.isfinite(arcs).all() and (arcs >= 0).all()):
            raise InputError(f"{who} at must be positions [m] along the body, one for each joint, got {arcs.tolist()}")
        if self.elastic and not self.line_stiffness:
            raise InputError(f"{who} driven_by = {self.driven_by!r} needs a line_stiffness [N/m]: set it")
        if self.driven_by == "angle" and not self.pulley:
            raise InputError(f"{who} driven_by = 'angle' needs the radius of the pulley [m]: set pulley")
        if self.driven_by != "angle" and self.pulley:
            raise InputError(f"{who} driven_by = {self.driven_by!r} has no pulley: leave pulley out")
        if self.imbalance and not (self.pair and self.elastic):
            raise InputError(
                f"{who} imbalance compares the two tendons of a pair that a displacement or an angle drives: "
                "set pair = true, or give a single tendon its pretension"
            )

    @property
    def kind(self) -> str:  # type: ignore[override]
        """Kind of the input, as recordings name it: "tension", "displacement" or "angle"."""
        return self.driven_by

    @property
    def unit(self) -> str:  # type: ignore[override]
        """SI unit of the input."""
        return DRIVEN[self.driven_by]

    @property
    def torque(self) -> Array:  # type: ignore[override]
        """Force (1,) per unit of the input: 1, N/m or N/rad."""
        law = {"tension": 1.0, "displacement": self.line_stiffness, "angle": self.line_stiffness * self.pulley}
        return np.array([law[self.driven_by]])

    @property
    def signs(self) -> tuple[float, ...]:  # type: ignore[override]
        """Sign of each tendon: -1 for the second of a pair, which is let out."""
        return (1.0, -1.0) if self.pair else (1.0,)

    @classmethod
    def at_azimuth(cls, azimuth: float, joints: Any, **more: Any) -> Tendon:
        """Return a tendon whose path lies at the `azimuth` [rad] on the cross-section, counted from x towards y.

        Parameters
        ----------
        joints : array (n,)
            1 for each joint that it passes, 0 for those beyond its end, and a fraction for a joint that bends its path
            only in part.
        **more
            Other parameters of `Tendon`.
        """
        passed = np.asarray(joints, dtype=float)
        return cls(joint_gain=-np.sin(azimuth) * passed, cross_gain=np.cos(azimuth) * passed, **more)

    @property
    def elastic(self) -> bool:
        """Whether the tendon's tension depends on its length, because its end displacement or motor
        angle is the input.

        In this case `torque` is the force per unit of the input.
        """
        return self.driven_by != "tension"

    def uses(self, field: str) -> bool:
        """Return whether a field of the tendon has an effect, as it is driven: a pulley for instance only by an
        angle.
        """
        if field in quantities(Chamber) or field not in quantities(Tendon):
            return False
        if field in ("line_stiffness", "pretension", "imbalance", "pulley") and not self.elastic:
            return False
        return (field != "pulley" or self.driven_by == "angle") and (field != "imbalance" or self.pair)

    def distance(self) -> Array:
        """Return the distance of the path from the axis [m]: (n,) at each joint, or (1,) if it is the same at all."""
        return self.lever - self.taper * self.at

    def axial_gains(self, joints: int, segment_joints: tuple[tuple[int, ...], ...]) -> Array:
        """Return the axial force of the tendon on each of S extensible segments, divided by its tension: -1 where it
        spans the whole segment.

        A tendon runs from the base to the last joint that it turns. The value of a segment is minus the fraction of its
        joints up to there. For a segment without joints it is -1 if the tendon turns a joint beyond it.
        """
        part, before = np.zeros(len(segment_joints)), -1
        last = int(np.flatnonzero(self.turned(joints)).max(initial=-1))
        for s, inside in enumerate(segment_joints):
            part[s] = np.mean([k <= last for k in inside]) if inside else float(last > before)
            before = max([before, *inside])
        return -part

    def law_unit(self, power: int) -> str:  # noqa: ARG002  of the interface
        return {"N": "1", "m": "N/m", "rad": "N/rad"}[self.unit]

    def constants(self) -> tuple[float, ...]:
        """Return the tendon's stiffness [N/m], pretension [N], friction coefficient, slip rate [m/s] and entry friction
        [N].
        """
        k, T0 = (self.line_stiffness, self.pretension) if self.elastic else (0.0, 0.0)
        return k, T0, self.friction, self.slip_rate, self.entry_friction

    def sentences(self, *, alone: bool) -> list[str]:  # noqa: ARG002  of the interface
        """Return sentences that describe the tendon's path, input, stiffness and lag."""
        azimuth = np.degrees(np.arctan2(-self.joint_gain, self.cross_gain)) % 360.0
        turned = np.flatnonzero(np.hypot(self.joint_gain, self.cross_gain))
        angles = ", ".join(dict.fromkeys(f"{azimuth[i % azimuth.size]:.3g}" for i in turned)) or "-"
        text = f"{self.name}: tendon at {1e3 * self.lever:.3g} mm, azimuth {angles} deg, driven by its {self.driven_by}"
        more = [f"converging by {self.taper:.3g} per length"] if self.taper else []
        more += [f"guides {1e3 * self.spacing:.3g} mm apart"] if self.spacing else []
        more += [f"{1e-3 * self.line_stiffness:.4g} N/mm, pretension {self.pretension:.3g} N"] if self.elastic else []
        more += [f"pulley {1e3 * self.pulley:.3g} mm"] if self.pulley else []
        more += [f"pair, imbalance {self.imbalance:.3g} N" if self.imbalance else "pair"] if self.pair else []
        more += [f"friction {self.friction:.3g}"] if self.friction else []
        more += [f"friction {self.entry_friction:.3g} N at its entry"] if self.entry_friction else []
        lag = self.valve.words()
        return [", ".join([text, *more]), *([f"{self.name}: lag {lag}"] if lag else [])]
