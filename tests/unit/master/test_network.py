"""Orders of stepping, groups and cuts of any network, against plain definitions of them."""

from collections.abc import Sequence

import hypothesis.strategies as st
from hypothesis import given

from emla_cosim.master.network import Link, Network, find_stepping_order
from tests.support.slaves import FakeSlave


def plain_stepping_order(count: int, links: Sequence[Link]) -> list[int]:
    """Again and again the slave that waits for the fewest of those that are left."""
    waiting = set(range(count))
    order: list[int] = []
    while waiting:
        open_links = {
            (x.source, x.target, x.direct) for x in links if x.source in waiting and x.source != x.target
        }

        def cost(i: int, open_links: set[tuple[int, int, bool]] = open_links) -> tuple[int, int, int]:
            direct = sum(1 for _, target, is_direct in open_links if target == i and is_direct)
            source_count = len({source for source, target, _ in open_links if target == i})
            return direct, source_count, i

        next_instance = min(waiting, key=cost)
        waiting.remove(next_instance)
        order.append(next_instance)
    return order


@st.composite
def links_of(draw: st.DrawFn, most: int = 9) -> tuple[int, list[Link]]:
    """How many slaves, and links between any of them, also several between two and to itself."""
    count = draw(st.integers(1, most))
    slave, flag = st.integers(0, count - 1), st.booleans()
    ends = draw(st.lists(st.tuples(slave, slave, flag, flag), max_size=3 * count))
    links, inputs = [], [0] * count
    for source, target, direct, initial in ends:
        links.append(Link(source, 0, target, inputs[target], direct, initial))
        inputs[target] += 1
    return count, links


def network(count: int, links: Sequence[Link]) -> Network:
    inputs = [sum(x.target == i for x in links) for i in range(count)]
    slaves = [FakeSlave(f"s{i}", n, [0.0], lambda u, x, t, h: x) for i, n in enumerate(inputs)]
    return Network(slaves, links)


def is_initial(link: Link) -> bool:
    return link.initial


@given(links_of(most=12))
def test_the_stepping_order_is_the_plain_one(drawn: tuple[int, list[Link]]) -> None:
    count, links = drawn
    assert find_stepping_order(count, links) == plain_stepping_order(count, links)


def test_a_large_network_is_ordered_at_once() -> None:
    """A chain declared against its direction, where every step of the order changes what follows."""
    count = 20_000
    links = [Link(i + 1, 0, i, 0, True) for i in range(count - 1)]
    assert find_stepping_order(count, links) == list(reversed(range(count)))


def plain_groups(order: Sequence[int], links: Sequence[Link]) -> list[list[int]]:
    """Who reaches each other is a group; the first of those that wait for no other group is next."""
    reached = {i: {i} for i in order}
    for _ in order:
        for x in links:
            reached[x.target] |= reached[x.source]
    groups: list[list[int]] = []
    waiting = list(order)
    while waiting:
        group = next(
            loop
            for i in waiting
            if (loop := [j for j in waiting if j in reached[i] and i in reached[j]])
            and not (reached[i] & set(waiting)) - set(loop)
        )
        groups.append(group)
        waiting = [i for i in waiting if i not in group]
    return groups


@given(links_of(), st.data())
def test_groups_and_coupled_signals_in_any_order(drawn: tuple[int, list[Link]], data: st.DataObject) -> None:
    count, links = drawn
    system = network(count, links)
    if data.draw(st.booleans(), label="reordered"):
        system.reorder(data.draw(st.permutations([s.name for s in system.instances]), label="order"))
    rank = system.order.index
    assert system.find_feedback_links() == [x for x in links if rank(x.source) >= rank(x.target)]
    assert system.groups() == plain_groups(system.order, links)
    initial = [x for x in links if x.initial]
    groups = system.groups(is_initial)
    assert groups == plain_groups(system.order, initial)
    for group in groups:
        inside = [x for x in initial if {x.source, x.target} <= set(group)]
        against = {system.signal(x) for x in inside if rank(x.source) >= rank(x.target)}
        assert system.find_coupling_variables(group, is_initial).tolist() == sorted(against)
