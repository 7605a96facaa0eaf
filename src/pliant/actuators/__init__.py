"""Published actuators with their sources, one file for each actuator."""
