"""Registered schedules of components that change their behavior at known times."""

from collections.abc import Callable, Iterable, Mapping

Schedule = Callable[[Mapping[str, float]], Iterable[float]]
"""Returns the times in s at which a component begins or ends something, from the parameters by full name."""


SCHEDULES: list[Schedule] = []
"""The registered schedules."""
