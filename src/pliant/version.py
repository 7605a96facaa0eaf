"""The version of pliant, alone in its file so that any subpackage can import it."""

__version__ = "0.1.0"
