"""A chain in space with chambers or tendons, and a value for each kind of parameter that it has beyond the plane."""

from __future__ import annotations

import numpy as np

import pliant
from pliant.model import Chamber, Extension, Space, Station, Tendon
from pliant.simulation import Trace

LINKS, STEP = 3, 4e-3
TIME = np.arange(0.0, 0.6, 0.02)
AZIMUTHS = {"red": 1.5, "green": 3.6, "blue": 5.7}
TRACES = {name: Trace(TIME, 30e3 * (1.0 + np.sin(2 * np.pi * f * TIME + f)))
          for name, f in zip(AZIMUTHS, (0.9, 1.7, 2.3), strict=True)}  # fmt: skip
SOUND = {
    "stiffness": 0.6, "damping": 6e-3, "cubic_stiffening": 0.3, "stiffness_ratio": 1.3, "twist_ratio": 0.8,
    "mass": 0.09, "base_tilt_x": 0.05, "base_tilt_y": -0.08, "base_tilt_z": 0.07, "rest_turn_x_2": 0.06,
    "rest_turn_z_1": -0.1, "tip_mass": 0.004, "tip_inertia": 5e-6,
    "red.gain_x": 1.1, "red.gain_y": -0.2, "green.cross_gain_2": 0.7, "blue.joint_gain_1": -0.4, "red.torque_1": 2.1e-6,
    "green.valve_rise_time": 0.03, "base_z": 1e-3, "base_x": -2e-3, "tip.aside": 3e-3, "mid.across": 1e-3,
    "mid.along": 0.05, "latency": 4e-3, "sensor_lag": 0.02, "start": 2e-3, "gravity_x": 1.5, "gravity_y": -2.0,
    "gravity_z": 8.0,
}  # fmt: skip
OF_MEMORY = {
    "creep_share_1": 0.2, "creep_time_1": 0.15, "slip_share_1": 0.3, "slip_angle_1": 0.02, "boucwen_share": 0.2,
    "boucwen_beta": 20.0, "boucwen_gamma": 9.0, "boucwen_exponent": 1.5,
}  # fmt: skip
OF_AXIAL_MEMORY = {"axial_creep_share_1": 1.3, "axial_creep_time_1": 0.2, "axial_slip_share_1": 0.4,
                   "axial_slip_strain_1": 0.003}  # fmt: skip
CORD = {"driven_by": "displacement", "lever": 8e-3, "line_stiffness": 2e3, "pretension": 0.5, "friction": 0.1,
        "slip_rate": 0.01}  # fmt: skip
WOUND = {"driven_by": "angle", "pulley": 0.01, "lever": 8e-3, "line_stiffness": 2e3, "pair": True}
OF_SEGMENTS = {
    "axial_stiffness": 55.0, "upper.axial_stiffness": 45.0, "lower.axial_damping": 0.3, "axial_gain": 25.0,
    "blue.axial_gain": 40.0, "cord.gain_x": 0.8, "lower.axial_stiffening": 1.5, "lower.axial_cubic_stiffening": 20.0,
}  # fmt: skip
OF_TENDONS = {
    "line_stiffness": 1.8e3, "cord.lever": 7e-3, "cord.taper": 0.02, "cord.pretension": 0.6, "red.pulley": 0.012,
    "red.imbalance": 0.3, "friction": 0.2, "entry_friction": 0.1, "spacing": 0.02,
}  # fmt: skip


def arm(**more):
    chambers = [Chamber(torque=(2e-6,), joint_gain=np.sin(a), cross_gain=-np.cos(a), name=name)
                for name, a in AZIMUTHS.items()]  # fmt: skip
    values = {
        "length": 0.3, "mass": 0.1, "links": LINKS, "joint_placement": "midsegment", "stiffness": 0.5, "damping": 5e-3,
        "chambers": chambers, "gravity": (1.0, 0.5, -9.81),
        "space": Space(stiffness_ratio=1.2, twist_ratio=0.7, radius=0.02),
        "stations": [Station("mid", 1, 0.04, 0.0, 0.01), Station("tip", 2, 0.05)],
    }  # fmt: skip
    return pliant.chain_model(**(values | more))


def rich_arm():
    """The arm with a pair of tendons wound by a motor, two chambers and a tendon, all of which lengthen its halves."""
    motor = Tendon.at_azimuth(AZIMUTHS["red"], np.ones(LINKS), name="red", **WOUND)
    chambers = [Chamber(torque=(2e-6,), joint_gain=np.sin(a), cross_gain=-np.cos(a), axial_gain=30.0, name=name)
                for name, a in AZIMUTHS.items() if name != "red"]  # fmt: skip
    cord = Tendon.at_azimuth(0.4, [1, 1, 0], name="cord", at=[0.05, 0.15, 0.25], **CORD)
    tied = {"stiffening": 0.0, "stiffens_bending": True}
    halves = (Extension(60.0, 0.4, 0.0, 0.15, "lower", **tied), Extension(50.0, 0.5, 0.15, None, "upper"))
    return arm(chambers=[motor, *chambers, cord], extensions=halves)

