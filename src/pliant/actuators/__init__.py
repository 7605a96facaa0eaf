"""Constants of published soft actuators with their sources, one module for each actuator."""
