"""Start values that models follow from those that the options set."""

from collections.abc import Callable, Mapping

from ..system.model import System, Value
from .options import Options

FOLLOWERS: list[Callable[[System, Options], Mapping[str, Value]]] = []
"""What computes further start values that follow from those that options set, by full name; registered."""


def following_values(system: System, options: Options) -> dict[str, Value]:
    """Return what models assume of the values that the options set, by full name.

    Nothing follows without the option `follow_models`. `system` is as it was before the options.
    """
    if not options.follow_models:
        return {}
    return {name: value for follow in FOLLOWERS for name, value in follow(system, options).items()}
