"""The registry of co-simulation algorithms."""

from .algorithm import Algorithm
from .explicit import GaussSeidel, Jacobi
from .strong import Strong

ALGORITHMS: dict[str, type[Algorithm]] = {"jacobi": Jacobi, "gauss-seidel": GaussSeidel, "strong": Strong}
"""Algorithms by name. Add a class to select it by its name in Python, in files and on the command line."""
