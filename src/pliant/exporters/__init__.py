"""Export of models to other tools (MuJoCo, C, FMU, state space, URDF): one module for each target, and the function
`export`.
"""

from pliant.exporters.registry import Exported, Exporter, export, exporters

__all__ = ["Exported", "Exporter", "export", "exporters"]
