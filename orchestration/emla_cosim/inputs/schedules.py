"""What knows of schedules that components follow by themselves."""

from collections.abc import Callable, Iterable, Mapping

Schedule = Callable[[Mapping[str, float]], Iterable[float]]
"""From the parameters by full name to times in s at which something in a component begins or ends."""

SCHEDULES: list[Schedule] = []
