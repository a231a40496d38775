"""The version of this package."""

from importlib.metadata import version

__version__ = version("emla-cosim")
"""Version of the installed package, such as "0.1.0"."""
