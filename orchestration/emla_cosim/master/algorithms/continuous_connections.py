"""Find the continuous connections of a network, and what their consumers read during a step."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...base.arrays import Vector
from ..network import Link, Network
from .algorithm import Algorithm
from .newton import RELAXATION


@dataclass(frozen=True)
class ContinuousConnection:
    """A continuous connection between two components that compute in continuous time.

    Args:
        name: Names of output and input.
        signal: Position of the output among all signals.
        source: Name of the component with the output.
        target: Name of the component with the input.
        is_late: Whether the consumer reads the value from the start of a step instead of its end.
        mode: How the input changes during the step; see `Mode`.
        is_in_loop: Whether the source depends on the target, so that an error is fed back.
        group: Number of the loop that iterates on the signal; -1 without one.
        position: Position of the signal among the coupling variables of that loop; -1 without one.
    """

    name: str
    signal: int
    source: str
    target: str
    is_late: bool
    mode: int
    is_in_loop: bool = False
    group: int = -1
    position: int = -1


def list_continuous_connections(
    algorithm: Algorithm, samplers: Collection[str] = ()
) -> list[ContinuousConnection]:
    """Return the connections at which the exchange can cost accuracy, in the order of the network.

    Leaves out discrete variables and components that sample: they read values at points in time on purpose.

    Args:
        algorithm: An algorithm after `setup`.
        samplers: Names of components that sample. Components with a step multiple are added.
    """
    network, exchange = algorithm.network, algorithm.exchange
    sampling = {*samplers, *algorithm.step_multiples}
    sampling |= {x.name for x, is_rare in zip(network.instances, exchange.rare, strict=True) if is_rare}
    late = {id(link) for link in algorithm.late_links()}
    paths = [
        (first, last, is_late)
        for first in network.links
        if first.source not in network.followers | algorithm.known_sources
        and exchange.smooth[network.signal(first)]
        for last, is_late in _list_readers(network, first, late)
        if _is_continuous(network, first, last, sampling)
    ]
    loops = _number_loops([(first.source, last.target) for first, last, _ in paths])
    coupling_positions = {
        int(signal): (number, position)
        for number, group in enumerate(algorithm.groups)
        for position, signal in enumerate(group.coupling_variables)
    }
    connections = []
    for first, last, is_late in paths:
        signal, is_in_loop = network.signal(first), loops.get(first.source, -1) == loops.get(last.target, -2)
        group, position = coupling_positions.get(signal, (-1, -1)) if is_in_loop else (-1, -1)
        source, target = network.instances[first.source].name, network.instances[last.target].name
        name = f"{network.names[signal]} -> {last.name.partition(' -> ')[2] or f'{target}[{last.input}]'}"
        mode = exchange.modes[last.target]
        connections.append(
            ContinuousConnection(name, signal, source, target, is_late, mode, is_in_loop, group, position)
        )
    return connections


def loop_responses(algorithm: Algorithm) -> Mapping[int, Vector]:
    """Return the matrix F' - 1 of each loop, by its number: by how much wrong guesses miss the answers.

    F' are the derivatives of the answers with respect to the guesses, as the algorithm learned them. Loops
    of which it learned nothing are left out.
    """
    responses = {}
    for number, group in enumerate(algorithm.groups):
        count = len(group.coupling_variables)
        missing = group.jacobian - np.eye(count)  # J = F' (F' - 1)^-1, so this is (F' - 1)^-1
        if not count or np.array_equal(missing, -RELAXATION * np.eye(count)):
            continue
        try:
            response = np.linalg.inv(missing)
        except np.linalg.LinAlgError:
            continue
        if np.isfinite(response).all():
            responses[number] = response
    return responses


def _list_readers(network: Network, link: Link, late_ids: Collection[int]) -> Iterator[tuple[Link, bool]]:
    """Yield the last link to each consumer of a signal, through followers, and whether its value is late."""
    if link.target not in network.followers:
        yield link, id(link) in late_ids
        return
    for onward in network.links:
        if onward.source == link.target:
            yield from (
                (last, is_late or id(link) in late_ids)
                for last, is_late in _list_readers(network, onward, late_ids)
            )


def _is_continuous(network: Network, first: Link, last: Link, sampling: Collection[str]) -> bool:
    """Return whether a path of links passes a continuous signal between components that do not sample."""
    source, target = network.instances[first.source], network.instances[last.target]
    has_continuous_ends = bool(
        source.continuous_outputs[first.output] and target.continuous_inputs[last.input]
    )
    return has_continuous_ends and source.name not in sampling and target.name not in sampling


def _number_loops(paths: Collection[tuple[int, int]]) -> dict[int, int]:
    """Return the number of the loop by instance, without instances outside of loops (Kosaraju)."""
    # by hand, because networkx takes long to import, and every run with a loop needs this
    readers: dict[int, list[int]] = {}
    sources: dict[int, list[int]] = {}
    for source, target in paths:
        readers.setdefault(source, []).append(target)
        sources.setdefault(target, []).append(source)
    visited: set[int] = set()
    order = [instance for start in readers for instance in _list_in_post_order(start, readers, visited)]
    loops, visited = {}, set()
    for number, start in enumerate(reversed(order)):
        members = _list_in_post_order(start, sources, visited)
        if len(members) > 1 or start in readers.get(start, ()):
            loops |= dict.fromkeys(members, number)
    return loops


def _list_in_post_order(start: int, neighbours: Mapping[int, Sequence[int]], visited: set[int]) -> list[int]:
    """Return the instances that are reachable outside of `visited`, in post-order; add them to `visited`."""
    if start in visited:
        return []
    visited.add(start)
    # with a path of its own: recursion ends at about a thousand instances in a row
    finished, path = [], [(start, iter(neighbours.get(start, ())))]
    while path:
        instance, rest = path[-1]
        following = next((i for i in rest if i not in visited), None)
        if following is None:
            finished.append(instance)
            path.pop()
        else:
            visited.add(following)
            path.append((following, iter(neighbours.get(following, ()))))
    return finished
