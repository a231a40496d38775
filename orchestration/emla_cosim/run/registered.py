"""Functions that a study registers: start values that follow from others, and seeds."""

from collections.abc import Callable, Collection, Mapping

from ..recorders.metrics import default_roles
from ..system.model import System, Value
from .options import Options

FOLLOWERS: list[Callable[[System, Options], Mapping[str, Value]]] = []
"""Registered functions that compute such start values, by full name."""

SEEDS: list[Callable[[Mapping[str, float]], Collection[str]]] = []
"""Registered functions that return the full names of the seeds of random sequences, whose components draw
numbers in each step, from all parameters."""


def list_roles(system: System, options: Options) -> dict[str, str]:
    """Return the roles of a system, with those of the options."""
    return default_roles(map(str, system.connections)) | dict(options.roles)


def following_values(system: System, options: Options) -> dict[str, Value]:
    """Return the start values that follow from those in the options, by full name.

    They are empty without the option `follow_models`. `system` is without the changes of the options.
    """
    if not options.follow_models:
        return {}
    return {name: value for follow in FOLLOWERS for name, value in follow(system, options).items()}
