"""Warnings on a built-in system before its run: on its actuators, and on overrides."""

from collections.abc import Iterator, Sequence

from ...base.errors import CommandError
from ...run.options import Options
from ...system.model import System
from ..controllers import choose_controller
from .actuator import Actuator
from .model_parameters import describe_stale_parameters
from .travel import describe_heavy_load, describe_impossible

_BY_RULE = ("compensated", "robust", "rule")
"""Sets of gains that scale with the sample rate; all others were tuned or printed for one joint."""


def remarks(system: System, options: Options) -> Sequence[str]:
    """Return warnings without full stops.

    Raises:
        CommandError: An actuator cannot do what its joint requires.
    """
    own = {joint: one for joint, one in options.actuator.items() if isinstance(one, Actuator)}
    problems = [p for joint, one in own.items() for p in describe_impossible(joint, one, system, options)]
    if problems:
        raise CommandError("\n  ".join(f"{p}." for p in problems), problems=problems)
    found = [f"{joint}: {said}" for joint, one in own.items() for said in one.remarks]
    for joint, one in own.items():
        found += describe_heavy_load(joint, one, system, options)
    return [*found, *_gains(own, options), *describe_stale_parameters(system, options)]


def _gains(own: dict[str, Actuator], options: Options) -> Iterator[str]:
    """Yield a warning if the gains were made for another actuator."""
    if not own:
        return
    found = choose_controller(options.controller, options.gains)
    name = found.gain_set
    if found.gains.has_controller_gains and name not in _BY_RULE:
        yield (
            f"the gains '{name}' were made for the joint's own actuator; only a_max is adapted. Gains that "
            "adapt to any actuator: rsba's compensated and robust, and foc's rule"
        )
