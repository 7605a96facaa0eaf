"""The meaning of each number of `pliant bench`, by its name."""

from __future__ import annotations

MEANING = {
    "step_ns": "one implicit step of five links in a whole motion, energies included",
    "rhs_ns": "the accelerations once", "rhs_jacobian_ns": "the accelerations and their exact Jacobian",
    "c_step_ns": "a step by hand in plain C, compiled on this machine, without energies", "c_rhs_ns": "the same",
    "c_rhs_jacobian_ns": "the same", "step_over_c": "times as long as plain C takes", "rhs_over_c": "the same",
    "rhs_jacobian_over_c": "the same",
    "help_s": "pliant --help in a fresh process", "first_simulation_s": "import and one simulation in a fresh process",
    "first_simulation_cold_s": "the same with nothing compiled before",
}
