"""Scheduled changes of the loads and the supply of joints."""

import re
from collections.abc import Iterator, Mapping

_LEVEL = re.compile(r"(?P<component>.+)\.load\.start\[\d+\]")
_SAG = re.compile(r"(?P<component>.+)\.supply\.start")


def scheduled_times(parameters: Mapping[str, float]) -> Iterator[float]:
    """Yield the times in s at which a load level begins or is reached, and the supply sags or recovers.

    Args:
        parameters: All parameters by full name.
    """
    for name, start in parameters.items():
        if match := _LEVEL.fullmatch(name):
            yield start
            yield start + parameters.get(f"{match['component']}.load.ramp", 0.0)
        elif match := _SAG.fullmatch(name):
            yield start
            yield start + parameters.get(f"{match['component']}.supply.duration", 0.0)
