"""Sourced numbers: one file for each actuator, named after its source."""
