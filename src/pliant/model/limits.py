"""Largest numbers of links, terms and observed points of a model."""

MOST_LINKS = 128  # beyond, compiling and stepping take minutes, and a chain is not a reduced model
MOST_TERMS = 16  # of the torque law, and branches of each kind of hysteresis
MOST_STATIONS = 4096
