"""Models of the supply between a commanded and the measured pressure: valve, chamber, sensor."""

from pliant.testbed.valve.supply import Iso6358, PressureSensor, SupplyRegulator, read_pressure, supply_pressure

__all__ = ["Iso6358", "PressureSensor", "SupplyRegulator", "read_pressure", "supply_pressure"]
