"""Names of variables taken apart, and connections found, against plain definitions of them."""

import hypothesis.strategies as st
from hypothesis import example, given

from emla_cosim.base.errors import CommandError
from emla_cosim.system.model import Component, Connection, System

names = st.text("ab.", max_size=5)


def plain_split(components: list[Component], path: str) -> tuple[Component, str] | None:
    """The component with the longest name that the path begins with, before a dot and something more."""
    inside = [c for c in components if path.startswith(f"{c.name}.") and path != f"{c.name}."]
    if not inside:
        return (components[0], path) if len(components) == 1 and path else None
    component = max(inside, key=lambda c: len(c.name))
    return component, path.removeprefix(f"{component.name}.")


@example(["lift", "lift.plant", "lift.plant.motor"], "lift.plant.motor.R_s")
@example(["lift", "lift.plant", "lift.plan"], "lift.plant.motor.R_s")
@example(["lift.plant", "lift"], "lift.plant.")
@example(["lift", "lift."], "lift..x")
@example(["a", "a"], "a.b")
@given(st.lists(names, max_size=6), names)
def test_path_belongs_to_the_component_with_the_longest_name(component_names: list[str], path: str) -> None:
    components = [Component(name, parameters={"number": i}) for i, name in enumerate(component_names)]
    expected = plain_split(components, path)
    try:
        split = System(tuple(components), ()).split(path)
    except CommandError:
        assert expected is None
    else:
        assert expected is not None
        assert split[0] is expected[0]
        assert split[1] == expected[1]


@given(st.lists(names, max_size=6), names)
def test_first_component_of_a_name_is_returned(component_names: list[str], name: str) -> None:
    components = [Component(n, parameters={"number": i}) for i, n in enumerate(component_names)]
    try:
        component = System(tuple(components), ()).component(name)
    except CommandError:
        assert name not in component_names
    else:
        assert component is components[component_names.index(name)]


@given(st.lists(st.tuples(st.sampled_from("abc"), st.sampled_from("abc")), max_size=8))
def test_connections_are_listed_by_source_and_by_target(ends: list[tuple[str, str]]) -> None:
    connections = [Connection(a, f"y{i}", b, f"u{i}") for i, (a, b) in enumerate(ends)]
    system = System((), tuple(connections))
    for name in "abcd":
        assert list(system.into(name)) == [x for x in connections if x.target == name]
        assert list(system.out_of(name)) == [x for x in connections if x.source == name]


def test_changed_system_returns_its_own_components() -> None:
    before = System((Component("a"), Component("b")), (Connection("a", "y", "b", "u"),))
    assert before.split("a.y")[0] is before.components[0]
    after = before.with_component(Component("a", parameters={"p": 1.0}))
    assert after.component("a").parameters == {"p": 1.0}
    assert not after.without_connections("b.u").into("b")
    assert before.into("b") == list(before.connections)
