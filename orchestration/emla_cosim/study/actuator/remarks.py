"""What is worth saying of a built-in system before it is run: of its actuators, and of values set in it."""

from collections.abc import Iterator, Sequence

from ...base.errors import CommandError
from ...run.options import Options
from ...system.model import System
from ..controllers import choose_controller
from .actuator import Actuator
from .model_parameters import describe_stale_parameters
from .travel import describe_heavy_load, describe_impossible

_BY_RULE = ("compensated", "robust", "rule")
"""Sets of gains that are parts of the sample rate; all others were found, or printed, for a certain joint."""


def remarks(system: System, options: Options) -> Sequence[str]:
    """Sentences without their stops; CommandError where an actuator cannot do what its joint is to do."""
    own = {joint: one for joint, one in options.actuator.items() if isinstance(one, Actuator)}
    problems = [p for joint, one in own.items() for p in describe_impossible(joint, one, system, options)]
    if problems:
        raise CommandError("\n  ".join(f"{p}." for p in problems), problems=problems)
    found = [f"{joint}: {said}" for joint, one in own.items() for said in one.remarks]
    for joint, one in own.items():
        found += describe_heavy_load(joint, one, system, options)
    return [*found, *_gains(own, options), *describe_stale_parameters(system, options)]


def _gains(own: dict[str, Actuator], options: Options) -> Iterator[str]:
    """That gains do not belong to the actuators that they are used with."""
    if not own:
        return
    found = choose_controller(options.controller, options.gains)
    name = found.gain_set
    if found.gains.has_controller_gains and name not in _BY_RULE:
        yield (
            f"the gains '{name}' belong to the joint's usual actuator, and of them only a_max follows from "
            "another one; by rule are rsba's compensated and robust, and foc's rule"
        )
