"""The version number of pliant.

It is alone in this module so that any subpackage can import it.
"""

__version__ = "0.1.0"
