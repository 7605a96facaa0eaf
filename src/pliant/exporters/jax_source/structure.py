"""Structure of one model: its numbers of links, inputs and hysteresis branches. An export writes its own values."""

from __future__ import annotations

import numpy as np

LINKS = 5  # joints, and links behind them
SEGMENTS = 0  # segments that lengthen
TURNS = 1  # coordinates of a joint: 1 in a plane; in space 2 swings, or 3 with a twist
ROD = True  # mass of a link: along it, or at its end
SPRING_TERMS = ("stiffening", "cubic_stiffening")  # nonlinear terms of a spring, in the order of their powers
SPRING_BOUND = "stiffening_bound"
CURVED = False  # whether a segment has a nonlinear axial spring
TIED = np.zeros((LINKS, 0))  # 1 where the strain of a segment changes the stiffness of a joint
BRANCHES = (0, 0, 0)  # hysteresis of joints: branches of creep, slip and Bouc-Wen
AXIAL_BRANCHES = (0, 0)  # hysteresis of segments: branches of creep and slip
REMEMBERING = 0  # coordinates with hysteresis states
COLUMNS = 0  # of these states
CHAMBERS = (((0,), 0, False, False, False),)  # inputs of one kind: indices, law, swelling, inflation, Gent's wall
LIMITED = np.zeros(1, dtype=bool)  # inputs whose valve has limited rates
RUBS = False  # whether tendons have friction
POINT_LINK = np.zeros(1, dtype=int)  # link of each observed point; -1: the part before the first joint
POINT = np.zeros((1, 3))  # m: along, across and aside of each observed point
START = np.zeros(5)  # coordinates in equilibrium without inputs
parameters = {"stiffness": np.ones(LINKS)}
MEAN = np.zeros(1)  # fitted values, and their bounds
LOWER = np.zeros(1)
UPPER = np.ones(1)
FACTOR = np.eye(1)  # FACTOR FACTOR^T is their covariance
SLOPES = {"stiffness": np.ones((1, LINKS))}  # derivatives of `parameters` by the fitted values
