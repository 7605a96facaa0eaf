"""Ranges from which the family of virtual laboratories is drawn, each with its source.

Where no publication gives a range, the entry names its basis: the spread of the named actuators, or commercial
components. Two things are not drawn: gravity, which the scenarios set, and the number of chambers, which is one
(`rod.CHAMBERS` has bodies with two).
"""

from __future__ import annotations

from typing import NamedTuple


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
