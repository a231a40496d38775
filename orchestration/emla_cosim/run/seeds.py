"""Registered seeds of random sequences, whose components draw numbers in each step."""

from collections.abc import Callable, Collection, Mapping

SEEDS: list[Callable[[Mapping[str, float]], Collection[str]]] = []
"""Functions that return the full names of the seeds of random sequences in effect, from all parameters."""
