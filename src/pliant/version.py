"""The version of pliant, alone in its file so that any room may ask for it."""

__version__ = "0.1.0"
