"""Descriptions of the numbers that `pliant bench` prints, by name."""

from __future__ import annotations

MEANING = {
    "step_ns": "one implicit step of five links in a simulation, with energies",
    "rhs_ns": "one evaluation of the accelerations",
    "rhs_jacobian_ns": "one evaluation of the accelerations and their exact Jacobian",
    "c_step_ns": "one step in plain C, compiled on this machine, without energies",
    "c_rhs_ns": "one evaluation of the accelerations in plain C",
    "c_rhs_jacobian_ns": "one evaluation of the accelerations and their Jacobian in plain C",
    "step_over_c": "step_ns divided by the time of plain C", "rhs_over_c": "rhs_ns divided by the time of plain C",
    "rhs_jacobian_over_c": "rhs_jacobian_ns divided by the time of plain C",
    "help_s": "pliant --help in a fresh process", "first_simulation_s": "import and one simulation in a fresh process",
    "first_simulation_cold_s": "import and one simulation in a fresh process, with an empty cache of compiled code",
}
