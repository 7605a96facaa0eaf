"""Export of models to other tools: one module for each target, and the function `export`."""

from pliant.exporters.registry import Exported, Exporter, export, exporters

__all__ = ["Exported", "Exporter", "export", "exporters"]
