"""Step an instance."""

from collections.abc import Callable, Iterable, Iterator

from ..host.hosted_instance import HostedInstance


def walk(
    instance: HostedInstance,
    times: Iterable[float],
    step: float,
    prepare: Callable[[int], object] = lambda _: None,
) -> Iterator[int]:
    """Step an instance from each of these times in s, and yield the number of steps that it has made.

    `prepare` gets the number of a step, from 0, before it. The walk ends early if the FMU asks for it.
    """
    for k, time in enumerate(times):
        prepare(k)
        instance.step(float(time), step)
        if instance.terminated:
            return
        yield k + 1
