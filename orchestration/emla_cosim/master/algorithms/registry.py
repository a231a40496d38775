"""Which algorithms there are."""

from .algorithm import Algorithm
from .gauss_seidel import GaussSeidel
from .jacobi import Jacobi
from .strong import Strong

ALGORITHMS: dict[str, type[Algorithm]] = {"jacobi": Jacobi, "gauss-seidel": GaussSeidel, "strong": Strong}
"""Algorithms by name; whoever adds a class here can choose it wherever a name is given."""
