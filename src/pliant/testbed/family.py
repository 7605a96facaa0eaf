"""A family of virtual laboratories: each seed draws an actuator and its instruments from realistic ranges.

`family_ranges.FAMILY` holds every range with its source. Each number has its own random stream, so that a range added
later changes no other number. Draws are repeated until first frequency and working pressure lie in a realistic range.
Actuators "a", "b" and "c" are named members with the standard instruments.

Ranges from which the family of virtual laboratories is drawn, each with its source.

Where no publication gives a range, the entry names its basis: the spread of the named actuators, or commercial
components. Two things are not drawn: gravity, which the scenarios set, and the number of chambers, which is one
(`rod.CHAMBERS` has bodies with two).
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from pliant.errors import InputError
from pliant.testbed.fibre import FibreSensor
from pliant.testbed.rod import ACTUATORS, CHAMBERS, RodParameters, actuator
from pliant.testbed.scenarios import Circle, Scenario, Wall
from pliant.testbed.valve import Iso6358, PressureSensor, SupplyRegulator

NOMINAL = 180e3  # Pa: what the scenarios call 180 kPa is a member's working pressure
USUAL_RATE = 75.0  # Hz, of the scenarios; replaced by a member's own
MODE = 0.5596  # f1 L^2 sqrt(m / EI) of a clamped-free beam with mass m a metre: 1.875^2 / (2 pi)
SPRINGPOT_BRANCHES = 8  # log-spaced relaxation times
SPRINGPOT_TIMES = (1.0e-3, 30.0)  # s
RELAXING = 0.3  # of EI, most that a springpot may relax later than SLOW: silicone creeps by 5 to 15 %, filled ones more
SLOW = 0.1  # s
FREQUENCY = (2.0, 12.0)  # Hz, of the first mode: 5 Hz in Chen et al., 8 Hz of a measured arm of Dragon Skin 10
PRESSURE = (8e3, 250e3)  # Pa, working: bare soft silicone at the low end, fibre-reinforced at the high one


class Draw(NamedTuple):
    """One range: uniform between `low` and `high`, or uniform in the logarithm when `log` is True."""

    low: float
    high: float
    source: str
    log: bool = False


_BUILT = "Polygerinos et al., IEEE T-RO 31 (2015); Chen, Galloway, Godage; Soft Robotics Toolkit"
_SILICONE = "Ecoflex 00-50: 29 kPa, loss 0.1 (Sorotoki's table); Elastosil M4601: 0.3 MPa (Polygerinos et al. 2015)"
_VALVE = "digital proportional regulators of SMC and Festo: 5-20 Hz, 5-20 ms, dead band to 0.5 % of full scale"
_FIBRE = "multicore fibres read by OFDR: 0.1-0.5 1/m white, 1.6-5 mm gauges, 60-250 Hz (Galloway et al. 2019)"
_TESTBED = "the spread of actuators a, b and c, widened"

FAMILY: dict[str, Draw] = {
    "length": Draw(0.08, 0.25, _BUILT + ": 80 to 250 mm, m", log=True),
    "chamber_radius": Draw(0.005, 0.012, _BUILT + ": half-round bladders, m"),
    "wall": Draw(0.002, 0.004, _BUILT + ", m"),
    "shear_modulus": Draw(3e4, 3.5e5, _SILICONE + ", Pa", log=True),
    "layers": Draw(1.0, 4.0, "EI over the silicone's alone: the printed K_b of Chen et al. is four times Elastosil's"),
    "density": Draw(1000.0, 1130.0, "data sheets of Ecoflex, Dragon Skin, Elastosil, kg/m3"),
    "fittings": Draw(1.0, 1.7, "mass over the silicone's alone: thread, fabric, tube; 1.7 for the mass of Chen et al."),
    "cap_share": Draw(0.02, 0.2, "mass of the end cap over the body's: 0.09 in Chen et al., to 0.2 with a fitting"),
    "rest_bend": Draw(-0.2, 0.8, "rad at the tip; actuator a 0.5"),
    "rest_variation": Draw(0.05, 0.3, _TESTBED + ", rad"),
    "stiffness_variation": Draw(0.05, 0.2, _TESTBED + ": hand-cast walls differ by 5 to 20 %"),
    "gain_variation": Draw(0.05, 0.18, _TESTBED),
    "correlation": Draw(0.1, 0.25, _TESTBED + ", of the length"),
    "end_stiffening": Draw(0.0, 0.6, _TESTBED + ": plugs and clamps"),
    "end_length": Draw(0.03, 0.1, _TESTBED + ", of the length"),
    "gain": Draw(1.0, 2.2, "moment over p A d: 1 where the base layer is the flat face, more below it"),
    "swell": Draw(-0.1, 0.6, "slope of the lever over the section's height: 0.3 for a bladder that bulges"),
    "locking": Draw(0.0, 0.6, "Gent's stiffening, 1 / limit of the invariant; 0 softens as neo-Hookean fibres do"),
    "working_bend": Draw(0.5, 1.2, _BUILT + ": 30 to 70 degrees at the working pressure, by linear theory, rad"),
    "loss": Draw(0.06, 0.3, "loss factor at the first mode: twice the damping ratio; Dragon Skin 10 beams 0.10-0.12"),
    "viscous_part": Draw(0.0, 1.0, "of that loss; the rest is a springpot's"),
    "order": Draw(0.08, 0.45, "of the springpot: silicone's loss factor hardly changes over decades (below 0.5)"),
    "creep": Draw(0.0, 0.15, "Prony shares of silicone in sum: 5-15 % over 0.1-100 s"),
    "creep_branches": Draw(1.0, 4.0, "as above; rounded down"),
    "slip": Draw(0.0, 0.2, "rate-independent share of EI: thread on silicone; reported loops of 1-5 % of the range"),
    "slip_angle": Draw(0.3, 1.0, "bend of the body at which half the friction slips, rad"),
    "slip_shape": Draw(1.0, 2.0, "Weibull shape of the thresholds"),
    "tube": Draw(2e6, 1e8, "2 to 4 mm bore, 0.3 to 2 m, Pa s/m3", log=True),
    "spool": Draw(0.0, 1.0, "below 0.25: a proportional spool by ISO 6358 in place of a regulator"),
    "valve_frequency": Draw(5.0, 20.0, _VALVE + ", Hz", log=True),
    "valve_damping": Draw(0.6, 1.0, _VALVE),
    "dead_time": Draw(0.005, 0.02, _VALVE + ", s"),
    "exhaust": Draw(1.0, 2.0, "exhaust 1 to 2 times slower"),
    "dead_band": Draw(0.0005, 0.005, _VALVE),
    "slew": Draw(8.0, 30.0, "full scales a second"),
    "source": Draw(1.5, 4.0, "supply over the highest pressure (spool)"),
    "conductance": Draw(0.5, 2.0, "sonic conductance over 2e-9 m3/(s Pa): 4 to 16 l/min at 1 bar", log=True),
    "gauge_noise": Draw(0.0005, 0.0025, "pressure transducers: 0.05-0.25 % of full scale"),
    "gauge_bias": Draw(0.0002, 0.002, "as above"),
    "gauge_rate": Draw(100.0, 1000.0, "data acquisition of the measured arms, Hz", log=True),
    "fibre_noise": Draw(0.1, 0.5, _FIBRE + ", 1/m"),
    "fibre_bias": Draw(0.02, 0.1, _FIBRE + ", 1/m"),
    "fibre_gain": Draw(0.003, 0.01, _FIBRE),
    "gauge_length": Draw(1.6e-3, 5e-3, _FIBRE + ", m"),
    "frame_rate": Draw(60.0, 250.0, _FIBRE + ", Hz", log=True),
    "latency": Draw(1e-3, 15e-3, "up to one frame and its transfer, s"),
    "jitter": Draw(5e-5, 5e-4, "s"),
    "drop_out": Draw(0.0, 0.01, "share of frames that begin a drop-out"),
    "twist": Draw(0.01, 0.05, "rad"),
    "lumen": Draw(0.5e-3, 3e-3, "fibre above the inextensible layer, m"),
}


@dataclass(frozen=True)
class Member:
    """A virtual laboratory of the family: its actuator and its instruments (SI units).

    Attributes
    ----------
    name : str
    body : RodParameters
    valve, transducer, fibre
        Instruments of the laboratory.
    pressure : float
        Working pressure [Pa], by which a scenario's 180 kPa is replaced.
    rate : float
        Frame rate of the shape sensor, Hz.
    modulus, loss_factor, order, viscous_part : float
        Values from which the body was drawn: shear modulus [Pa], loss factor at the first mode, order of the springpot
        and viscous fraction of the loss. Used in tables only.
    """

    name: str
    body: RodParameters
    valve: SupplyRegulator | Iso6358 | tuple[SupplyRegulator | Iso6358, ...] = field(default_factory=SupplyRegulator)
    transducer: PressureSensor = field(default_factory=PressureSensor)
    fibre: FibreSensor = field(default_factory=FibreSensor)
    pressure: float = NOMINAL
    rate: float = USUAL_RATE
    modulus: float = float("nan")
    loss_factor: float = float("nan")
    order: float = float("nan")
    viscous_part: float = 1.0

    @property
    def frequency(self) -> float:
        """First natural frequency [Hz] of the straight, undamped body with its cap as a point mass at the tip
        (Rayleigh).
        """
        return first_frequency(self.body.bending_stiffness, self.body.mass, self.body.cap_mass, self.body.length)

    def adapted(self, case: Scenario) -> Scenario:
        """Return the scenario scaled to this member: pressures, pushing forces, obstacles and frame rate.

        Obstacles keep their position relative to the body's length. A body that bends differently may miss them.
        """
        if self.name in ACTUATORS or self.name in CHAMBERS:
            return case
        size, share = self.body.length / RodParameters().length, self.pressure / NOMINAL
        force = self.body.bending_stiffness / RodParameters().bending_stiffness / size**2
        levels = case.command
        command = tuple(c.scaled(share) for c in levels) if isinstance(levels, tuple) else levels.scaled(share)
        return replace(
            case, command=command, obstacles=tuple(scaled(o, size) for o in case.obstacles),
            pushes=tuple((t, x * force, y * force) for t, x, y in case.pushes),
            rate=self.rate if case.rate == USUAL_RATE else case.rate,
        )  # fmt: skip

    def known(self) -> dict[str, float]:
        """Return the known data of the specimen as a dict: length, masses, gauge length and working pressure (SI
        units).
        """
        b = self.body
        return {"body_length": b.length, "body_mass": b.mass, "tip_mass": b.cap_mass,
                "gauge_length": self.fibre.gauge, "working_pressure": self.pressure}  # fmt: skip


def scaled(obstacle: Circle | Wall, size: float) -> Circle | Wall:
    """Return the obstacle with its position and radius multiplied by `size`."""
    if isinstance(obstacle, Wall):
        return replace(obstacle, offset=obstacle.offset * size)
    x, y = obstacle.centre
    return replace(obstacle, centre=(x * size, y * size), radius=obstacle.radius * size)


def first_frequency(stiffness: float, mass: float, cap: float, length: float) -> float:
    """Return the first natural frequency [Hz] of a clamped beam with a point mass at its tip, by Rayleigh's quotient.

    `stiffness` is EI [N m^2], `mass` and `cap` are the masses of beam and tip [kg], `length` is in m.
    """
    alone = MODE / length**2 * np.sqrt(stiffness * length / mass)
    return float(alone / np.sqrt(1.0 + 4.0 * cap / mass))


def springpot(order: float, loss: float, omega: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the stiffness fractions (P,) and relaxation times (P,) [s] of P Prony branches that approximate a
    springpot (fractional derivative) of order `order`.

    At `omega` [rad/s] their loss modulus is `loss` times the stiffness, or less. The springpot ``c s^order`` is the sum
    over relaxations ``s / (s + w)`` with density ``c sin(pi order)/pi w^order`` in ln w. Even steps in ln w give the
    branches, which are then scaled to the requested loss. If more than `RELAXING` of the stiffness would relax slowly,
    all fractions are reduced.
    """
    times = np.geomspace(*SPRINGPOT_TIMES, SPRINGPOT_BRANCHES)
    shape = times ** (-order)
    x = omega * times
    share = shape * loss / float(np.sum(shape * x / (1.0 + x**2)))
    return share * min(1.0, RELAXING / max(float(share[times > SLOW].sum()), 1e-12)), times


def drawn(seed: int, attempt: int) -> dict[str, float]:
    """Draw one random number from every range of `FAMILY` and return them by name. Each range has its own random
    stream.
    """
    out = {}
    for name, d in FAMILY.items():
        u = float(np.random.default_rng([seed, attempt, zlib.crc32(name.encode())]).random())
        out[name] = float(d.low * (d.high / d.low) ** u) if d.log else d.low + (d.high - d.low) * u
    return out


def body_of(d: dict[str, float], seed: int) -> RodParameters:
    """Return the parameters of a rod made from the random numbers `d`, still without damping and viscoelastic
    branches.
    """
    r, length = d["chamber_radius"], d["length"]
    height, width = r + d["wall"], 2.0 * (r + d["wall"])
    area = 0.5 * np.pi * height**2 - 0.5 * np.pi * r**2 + d["wall"] * width  # half-round shell on a base
    second = np.pi / 8.0 * (height**4 - r**4) + width * d["wall"] ** 3 / 3.0  # about the inextensible layer, m4
    stiffness = 4.0 * d["shear_modulus"] * second * d["layers"]
    mass = d["density"] * area * length * d["fittings"]
    return RodParameters(
        seed=seed + 10, length=length, mass=mass, bending_stiffness=stiffness, cap_mass=mass * d["cap_share"],
        stiffness_variation=d["stiffness_variation"], rest_curvature=d["rest_bend"] / length,
        rest_variation=d["rest_variation"] / length, correlation_length=d["correlation"] * length,
        end_stiffening=d["end_stiffening"], end_length=d["end_length"] * length, chamber_area=0.5 * np.pi * r**2,
        chamber_height=4.0 * r / (3.0 * np.pi), gain=d["gain"], gain_variation=d["gain_variation"],
        gain_slope=d["swell"] * height, section_height=height, locking=d["locking"], loss_time=0.0, prony_share=(),
        prony_time=(), slip_share=d["slip"], slip_scale=d["slip_angle"] / length, slip_shape=d["slip_shape"],
        half_width=0.5 * height, tube_resistance=d["tube"],
    )  # fmt: skip


def with_memory(body: RodParameters, d: dict[str, float], seed: int, omega: float) -> RodParameters:
    """Return the rod with viscous, springpot and creep losses added, so that its loss factor at `omega` [rad/s] is
    ``d["loss"]``.

    The viscous part supplies the loss that springpot and creep do not cover. It is 0 where they alone exceed the drawn
    loss factor.
    """
    rng = np.random.default_rng([seed, 4711])
    count = int(d["creep_branches"])
    creep = rng.dirichlet(np.ones(count)) * d["creep"]
    slow = np.exp(rng.uniform(np.log(0.1), np.log(30.0), count))
    pot, fast = springpot(d["order"], (1.0 - d["viscous_part"]) * d["loss"], omega)
    share, time = np.append(pot, creep), np.append(fast, slow)
    x = omega * time
    stores, loses = float(np.sum(share * x**2 / (1.0 + x**2))), float(np.sum(share * x / (1.0 + x**2)))
    viscous = max(d["loss"] * (1.0 + stores) - loses, 0.0)
    return replace(body, loss_time=viscous / omega, prony_share=tuple(share.tolist()), prony_time=tuple(time.tolist()))


def family_member(seed: int) -> Member:
    """Return the virtual laboratory of a seed: body, valve and sensors drawn from `FAMILY`.

    Parameters
    ----------
    seed : int
        >= 0; each seed is a different laboratory.

    Returns
    -------
    Member

    Raises
    ------
    InputError
        For a negative seed.
    """
    if seed < 0:
        raise InputError(f"a seed of the family must be >= 0, got {seed}")
    for attempt in range(1000):
        d = drawn(seed, attempt)
        body = body_of(d, seed)
        frequency = first_frequency(body.bending_stiffness, body.mass, body.cap_mass, body.length)
        lever = body.chamber_area * body.chamber_height * body.gain
        pressure = d["working_bend"] * body.bending_stiffness / (body.length * lever)
        if FREQUENCY[0] < frequency < FREQUENCY[1] and PRESSURE[0] < pressure < PRESSURE[1]:
            break
    else:  # pragma: no cover
        raise InputError(
            f"seed {seed} gives no body with a first frequency in {FREQUENCY} Hz and a working pressure in {PRESSURE} "
            "Pa: use another seed"
        )
    highest = 2.0 * d["working_bend"] / body.length + max(body.rest_curvature, 0.0)
    hook = max(50.0, 2.4 * highest)  # the fibre finds the tip where nothing of the body bends as much
    body = replace(with_memory(body, d, seed, 2.0 * np.pi * frequency), cap_curvature=hook,
                   cap_length=min(0.03, 2.0 / hook))  # fmt: skip
    return Member(
        str(seed), body, *instruments(d, pressure, body), pressure=pressure, rate=float(round(d["frame_rate"])),
        modulus=d["shear_modulus"], loss_factor=d["loss"], order=d["order"], viscous_part=d["viscous_part"],
    )  # fmt: skip


def instruments(
    d: dict[str, float], pressure: float, body: RodParameters
) -> tuple[SupplyRegulator | Iso6358, PressureSensor, FibreSensor]:
    """Return a valve, a pressure transducer and a fibre sensor made from the random numbers `d`.

    The full scale of the instruments is 2.5 times the working pressure `pressure` [Pa].
    """
    full = 2.5 * pressure
    valve: SupplyRegulator | Iso6358
    if d["spool"] < 0.25:
        volume = 1.0e-5 + body.chamber_area * body.length  # m3: tube and chamber
        flow = 2.0e-9 * d["conductance"]
        valve = Iso6358(source=d["source"] * full, fill=flow, exhaust=1.25 * flow / d["exhaust"], band=0.08 * full,
                        dead_time=d["dead_time"], volume=volume)  # fmt: skip
    else:
        valve = SupplyRegulator(
            frequency=d["valve_frequency"], damping=d["valve_damping"], dead_time=d["dead_time"],
            exhaust_slowdown=d["exhaust"], slew_up=d["slew"] * full, slew_down=0.75 * d["slew"] * full,
            dead_band=d["dead_band"] * full,
        )
    gauge = PressureSensor(d["gauge_rate"], d["gauge_noise"] * full, d["gauge_bias"] * full, full / 4096)
    fibre = FibreSensor(
        gauge=d["gauge_length"], offset=d["lumen"], noise=d["fibre_noise"], bias=d["fibre_bias"],
        gain_error=d["fibre_gain"], twist=d["twist"], jitter=d["jitter"], drop_out=d["drop_out"], latency=d["latency"],
    )
    return valve, gauge, fibre


def member(name: str | int) -> Member:
    """Return the laboratory of a named actuator, or the member of the family for a seed (7 or "7").

    "a", "b" and "c" have one chamber; "two_segment", "antagonistic" and "lengthening" have two. The second chamber lies
    behind a longer tube, so that its valve is slower.

    Raises
    ------
    InputError
        For a name that is neither an actuator nor an integer.
    """
    if isinstance(name, int) or (name.isdecimal() and name.isascii()):
        return family_member(int(name))
    if name in CHAMBERS:
        return Member(name, actuator(name), (SupplyRegulator(), SupplyRegulator(frequency=6.0, dead_time=0.014)))
    if name not in ACTUATORS:
        known = ", ".join((*ACTUATORS, *CHAMBERS))
        raise InputError(f"unknown actuator {name!r}: use {known}, or an integer such as 7: the seed of a random one")
    return Member(name, actuator(name))
