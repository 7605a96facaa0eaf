"""Models of the pneumatic supply from commanded to measured pressure: valve, chamber and sensor."""

from pliant.testbed.valve.supply import Iso6358, PressureSensor, SupplyRegulator, read_pressure, supply_pressure

__all__ = ["Iso6358", "PressureSensor", "SupplyRegulator", "read_pressure", "supply_pressure"]
