"""Export of models to other tools: one module for each target, what each can express, and `export`."""

from pliant.exporters.registry import Exported, Exporter, export, exporters

__all__ = ["Exported", "Exporter", "export", "exporters"]
