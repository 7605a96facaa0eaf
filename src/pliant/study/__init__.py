"""A study: recordings of an actuator, fits of its model and predictions, described in a file and run as a whole."""

from pathlib import Path

from pliant.study.adapted_run import adapt
from pliant.study.run import run_study
from pliant.study.schema import Study, load_study

__all__ = ["Study", "adapt", "angles_study", "camera_study", "demo_study", "load_study", "run_study", "space_study"]


def demo_study() -> Path:
    """Return the path of the bundled study file that uses recordings of a shape-sensing fibre."""
    return Path(__file__).parent / "bundled" / "demo.toml"


def angles_study() -> Path:
    """Return the path of the bundled study file that uses logs of one angle and one pressure."""
    return Path(__file__).parent / "bundled" / "angles.toml"


def space_study() -> Path:
    """Return the path of the bundled study file that uses recordings of a body bending in space."""
    return Path(__file__).parent / "bundled" / "space.toml"


def camera_study() -> Path:
    """Return the path of the bundled study file that uses a video of a bending body."""
    return Path(__file__).parent / "bundled" / "camera.toml"
