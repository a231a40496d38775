"""FMUs count steps of one length, so that it does not matter how a tool rounds its times."""

import math
from collections.abc import Sequence
from itertools import accumulate, repeat

import pytest

from fmublock.instance import Instance
from tests.support.sessions import Session
from tests.support.toy import Toy

STEP = 1e-4
COUNT = 3000
NAMES = ("x", "v[1]", "v[2]", "random", "power")
Steps = Sequence[tuple[float, float]]

TOOLS: dict[str, Steps] = {
    "products": [(k * STEP, STEP) for k in range(COUNT)],
    "sums": [(t, STEP) for t in accumulate(repeat(STEP, COUNT - 1), initial=0.0)],
    "nanoseconds": [(k * 1e5 / 1e9, (k + 1) * 1e5 / 1e9 - k * 1e5 / 1e9) for k in range(COUNT)],
    "differences": [(k * STEP, (k + 1) * STEP - k * STEP) for k in range(COUNT)],
}


def run(steps: Steps) -> Instance:
    instance = Instance(Toy())
    instance.setup_experiment()
    instance.enter_initialization()
    instance.exit_initialization()
    for time, step in steps:
        instance.do_step(time, step)
    return instance


def values(instance: Instance) -> list[float]:
    return instance.get([instance.layout.reference(name) for name in NAMES])


def test_tools_pass_different_times() -> None:
    assert len({tuple(steps) for steps in TOOLS.values()}) == len(TOOLS)


@pytest.mark.parametrize("tool", TOOLS)
def test_all_tools_get_the_same_bits(sessions: dict[str, Session], tool: str) -> None:
    slave = sessions["Toy"].instance(tool)
    for time, step in TOOLS[tool]:
        slave.doStep(time, step)
    found, expected = run(TOOLS[tool]), run(TOOLS["products"])
    assert found.time == expected.time == COUNT * STEP
    assert values(found) == values(expected)
    assert sessions["Toy"].get(slave, *NAMES) == values(expected)


def test_a_first_step_that_is_rounded_up_is_not_divided_once_more(sessions: dict[str, Session]) -> None:
    """As of a tool that begins at 2e-4 s with (3 - 2) 1e-4 s: here so long that results tell."""
    up = math.nextafter(0.2, 1.0)
    assert math.ceil(up / 0.1) == 3

    def native(step: float, internal: float) -> list[float]:
        slave = sessions["Toy"].instance("up", **{"solver.internal_step": internal})
        slave.doStep(0.0, step)
        return sessions["Toy"].get(slave, "x", "v[1]", "v[2]")

    def in_process(step: float, internal: float) -> list[float]:
        instance = Instance(Toy())
        instance["solver.internal_step"] = internal
        instance.enter_initialization()
        instance.exit_initialization()
        instance.do_step(0.0, step)
        return values(instance)[:3]

    for flavour in (native, in_process):
        halves, thirds = flavour(0.2, 0.1), flavour(0.2, 0.2 / 3.0)
        assert flavour(up, 0.1) == pytest.approx(halves, rel=1e-14)
        assert halves != pytest.approx(thirds, rel=1e-10)


def test_another_step_begins_where_the_tool_says() -> None:
    instance = run([(0.0, 0.1), (0.1, 0.1), (0.2, 0.05)])
    assert instance.time == 0.2 + 0.05
    instance.do_step(0.25, 0.05)
    assert instance.time == 0.2 + 2 * 0.05


def test_a_tool_that_drifts_is_followed() -> None:
    """A part in a million of a step is no rounding any more."""
    instance = run([(0.0, 0.1), (0.1, 0.1)])
    instance.do_step(0.2 + 5e-7, 0.1)
    assert instance.time == (0.2 + 5e-7) + 0.1


def test_a_step_that_is_done_again_gives_the_same_bits() -> None:
    instance = run(TOOLS["sums"][:100])
    state = instance.get_state()
    (time, step), again = TOOLS["sums"][100], 2
    results = []
    for _ in range(again):
        instance.set_state(state)
        instance.do_step(time, 0.5 * step)  # as error control does
        instance.set_state(state)
        instance.do_step(time, step)
        results.append((instance.time, values(instance)))
    assert results[0] == results[1]
    assert results[0][1] == values(run(TOOLS["sums"][:101]))
