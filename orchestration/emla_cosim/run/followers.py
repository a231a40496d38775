"""Start values that follow from those that the options set."""

from collections.abc import Callable, Mapping

from ..system.model import System, Value
from .options import Options

FOLLOWERS: list[Callable[[System, Options], Mapping[str, Value]]] = []
"""Registered functions that compute such start values, by full name."""


def following_values(system: System, options: Options) -> dict[str, Value]:
    """Return the start values that follow from those in the options, by full name.

    They are empty without the option `follow_models`. `system` is without the changes of the options.
    """
    if not options.follow_models:
        return {}
    return {name: value for follow in FOLLOWERS for name, value in follow(system, options).items()}
