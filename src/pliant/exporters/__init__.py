"""The model leaves the house: one target one file, what each can express, and one door."""

from pliant.exporters.registry import Exported, Exporter, export, exporters

__all__ = ["Exported", "Exporter", "export", "exporters"]
