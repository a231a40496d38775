"""Steps of a block in process and as any FMU: rounded times, short steps, the stop time, discarded steps."""

import math
from collections.abc import Callable, Sequence
from itertools import accumulate, pairwise, repeat
from typing import Any

import numpy as np
import pytest

from fmublock import Instance
from tests.support.toy import Toy
from tests.support.units import Make, Unit, Units, start

NAMES = ("x", "v[1]", "v[2]", "power", "random", "step_count")
STEP = 1e-4
COARSE = {"solver.internal_step": 0.01}
Steps = Sequence[tuple[float, float]]


def go_on(unit: Unit, steps: Steps) -> Unit:
    for time, step in steps:
        assert unit.step(time, step), unit.messages
    return unit


def products(count: int) -> Steps:
    """Steps that start at the products of their number and length."""
    return [(k * STEP, STEP) for k in range(count)]


def same(a: Unit, b: Unit) -> None:
    assert a.get(*NAMES) == b.get(*NAMES)


# ---- the same bits everywhere ------------------------------------------------------------------


def test_driven_run_has_the_bits_of_the_block_in_process(make: Make, units: Units) -> None:
    """Steps of uneven length with changing inputs."""
    draw = np.random.default_rng(4)
    values = {"shape": 2, "count": 5, "seed": 99, "x_0": 0.1}
    pair = start(make(), **values), start(units.make(Toy, "block"), **values)
    time = 0.0
    for force, step in zip(draw.normal(size=1000), draw.uniform(1e-5, 4e-4, size=1000), strict=True):
        for unit in pair:
            unit.set(force=float(force))
            assert unit.step(time, float(step))
        time += float(step)
        same(*pair)


TOOLS: dict[str, Steps] = {
    "sums": [(t, STEP) for t in accumulate(repeat(STEP, 599), initial=0.0)],
    "nanoseconds": [(k * 1e5 / 1e9, (k + 1) * 1e5 / 1e9 - k * 1e5 / 1e9) for k in range(600)],
    "differences": [(k * STEP, (k + 1) * STEP - k * STEP) for k in range(600)],
}


def test_tools_that_round_times_in_different_ways_get_the_same_bits(make: Make) -> None:
    """They reach the stop time, although sums pass it by rounding."""
    assert len({tuple(steps) for steps in (products(600), *TOOLS.values())}) == 4
    expected = go_on(start(make()), products(600))
    for steps in TOOLS.values():
        same(go_on(start(make(), stop=600 * STEP), steps), expected)


def test_first_step_that_is_rounded_up_is_not_divided_once_more(make: Make) -> None:
    """As of a tool that starts at 2e-4 s with (3 - 2) 1e-4 s: here so long that the results show it."""
    up = math.nextafter(0.2, 1.0)
    assert math.ceil(up / 0.1) == 3
    rows = [
        go_on(start(make(), **{"solver.internal_step": internal}), [(0.0, step)]).get("x", "v[1]", "v[2]")
        for step, internal in ((up, 0.1), (0.2, 0.1), (0.2, 0.2 / 3.0))
    ]
    assert rows[0] == pytest.approx(rows[1], rel=1e-14)
    assert rows[1] != pytest.approx(rows[2], rel=1e-10)


def test_time_of_an_instance_follows_the_tool() -> None:
    """A step of another length starts where the tool says; a part in a million of a step is not rounding."""

    def run(steps: Steps) -> float:
        instance = Instance(Toy())
        instance.enter_initialization()
        instance.exit_initialization()
        for time, step in steps:
            instance.do_step(time, step)
        return instance.time

    for steps in TOOLS.values():
        assert run(steps) == 600 * STEP
    assert run([(0.0, 0.1), (0.1, 0.1), (0.2, 0.05)]) == 0.2 + 0.05
    assert run([(0.0, 0.1), (0.1, 0.1), (0.2, 0.05), (0.25, 0.05)]) == 0.2 + 2 * 0.05
    assert run([(0.0, 0.1), (0.1, 0.1), (0.2 + 5e-7, 0.1)]) == (0.2 + 5e-7) + 0.1


# ---- slivers: tools add their steps up, so that the last one before the end may be tiny ----------


def textbook(end: float, step: float) -> Steps:
    """The loop of every textbook."""
    time, steps = 0.0, []
    while time < end:
        h = min(step, end - time)
        steps.append((time, h))
        time += h
    return steps


def careless(end: float, step: float) -> Steps:
    """Does not notice that it has arrived, nor that it goes no further."""
    steps = textbook(end, step)
    return [*steps, steps[-1], steps[-1], (end, math.ulp(end)), (end, 1e-300)]


@pytest.mark.parametrize("loop", [textbook, careless])
def test_every_loop_arrives_with_the_same_bits(make: Make, loop: Callable[[float, float], Steps]) -> None:
    """States, noise and the number of steps are those of a run without the sliver."""
    end = 0.2
    count = round(end / STEP)
    last = textbook(end, STEP)[-1][1]
    assert 0.0 < last < 1e-6 * STEP and len(textbook(end, STEP)) == count + 1
    unit = start(make(), stop=end)
    go_on(unit, loop(end, STEP))
    same(unit, go_on(start(make()), products(count)))


def at_rest(make: Make, **values: Any) -> Unit:
    """A unit after 300 steps, at 0.03 s."""
    return go_on(start(make(), **values), products(300))


def test_sliver_step_changes_no_bits(make: Make) -> None:
    """What is set before it acts in the next step; a restored state knows the length of the last step."""
    unit, second = at_rest(make), at_rest(make)
    restored = start(make("restored"))
    restored.restore(unit.save())
    for each in (unit, second, restored):
        each.set(force=3.0)
    before = unit.get(*NAMES)
    for each in (unit, restored):
        assert each.step(0.03 - 2e-15, 1.7e-15)
        assert each.get(*NAMES) == before
    for each in (unit, second, restored):
        assert each.step(0.03, STEP)
    for each in (unit, restored):
        same(each, second)
    assert second.get(*NAMES) != before


def test_repeated_slivers_do_not_move_the_time(make: Make) -> None:
    """The time does not move with them: the instance goes no further than 1e-6 of a step."""
    unit = at_rest(make)
    before, time = unit.get(*NAMES), 0.03
    for _ in range(9):
        assert unit.step(time, 1e-7 * STEP)
        time += 1e-7 * STEP
    assert unit.get(*NAMES) == before
    assert unit.step(time, STEP) and unit.get("step_count") == [301.0]


def test_short_and_first_steps_are_not_slivers(make: Make, units: Units) -> None:
    for part in (1e-5, 1e-3, 0.1):
        unit, second = at_rest(make), at_rest(lambda: units.make(Toy, "block"))
        for each in (unit, second):
            assert each.step(0.03, part * STEP)
        assert unit.get("step_count") == [301.0]
        same(unit, second)
    assert go_on(start(make(), time=1.0), [(1.0, 1e-18)]).get("step_count") == [1.0]
    # at t = 0 a part in a million of the last step, 1 s, is the double 1e-6
    unit = go_on(start(make(), time=-1.0, **COARSE), [(-1.0, 1.0), (0.0, 1e-6)])
    assert unit.get("step_count") == [1.0]
    assert go_on(unit, [(0.0, math.nextafter(1e-6, 1.0))]).get("step_count") == [2.0]


# ---- where a step starts -----------------------------------------------------------------------


def test_step_that_starts_elsewhere_is_refused(make: Make) -> None:
    unit = at_rest(make)
    before = unit.get(*NAMES)
    for time, step in ((0.03 - 1e-9, 1.7e-14), (0.03 + 1e-9, 1.7e-14), (0.03 - 1e-6, STEP), (0.0299, STEP)):
        assert not unit.step(time, step)
        assert "the step starts at" in unit.messages[-1]
        assert unit.get(*NAMES) == before
    assert unit.step(0.03, STEP)


@pytest.mark.parametrize(
    ("time", "digits"), [(0.5, "0.5"), (0.123456789, "0.123456789"), (0.25 + 1e-13, "0.2500000000001")]
)
def test_message_shows_where_two_times_differ(make: Make, time: float, digits: str) -> None:
    """The steps before are so short that these are more than rounding."""
    points = [0.0, 0.25 - 1e-5, 0.25 - 1e-9, 0.25]
    unit = go_on(start(make()), [(a, b - a) for a, b in pairwise(points)])
    assert not unit.step(time, 1e-12)
    assert unit.messages == [f"toy: the step starts at t = {digits} s, but the instance is at t = 0.25 s."]


def test_times_may_be_rounded_to_their_last_place_far_from_zero(make: Make) -> None:
    """At 1e9 s a double resolves 0.12 us, a part in a thousand of this step."""
    unit, time = start(make(), time=1e9), 1e9
    for _ in range(100):
        assert unit.step(time, STEP)
        time = math.nextafter(time + STEP, math.inf)
    assert unit.get("step_count") == [100.0]
    for roundings, is_done in ((-4, True), (4, True), (5, False)):
        unit = start(make(), time=2.0**30)
        assert unit.step(2.0**30 + roundings * math.ulp(2.0**30), STEP) == is_done


@pytest.mark.parametrize(
    ("step", "words"),
    [
        *((step, "not a positive, finite number") for step in (0.0, -0.1, math.nan, math.inf)),
        (1.5, "needs more than 1e+09 internal steps."),  # which would take minutes
    ],
)
def test_impossible_step_sizes_are_refused_at_once(make: Make, step: float, words: str) -> None:
    unit = start(make(), **{"solver.internal_step": 1e-9})
    before = unit.get(*NAMES)
    assert not unit.step(0.0, step)
    assert words in unit.messages[-1]
    assert unit.get(*NAMES) == before
    assert unit.step(0.0, 1e-6)


# ---- start and stop time -----------------------------------------------------------------------


def test_step_past_the_stop_time_is_refused(make: Make) -> None:
    unit, second = start(make(), stop=1.0, **COARSE), start(make("other"))
    second.restore(unit.save())  # which contains the stop time
    for each in (unit, second):
        assert each.step(0.0, 0.75)
        before = each.get(*NAMES)
        assert not each.step(0.75, 0.5)
        assert "the step to t = 1.25 s goes past the stop time 1" in each.messages[-1]
        assert each.get(*NAMES) == before
        assert each.step(0.75, 0.25)
        assert not any(each.step(1.0, step) for step in (1e-9, 1e-3, 1.0))
    far = start(make(), stop=1e9)
    assert not far.step(0.0, 1e9 * (1.0 + 2e-3))
    assert "the step to t = 1.002e+09 s goes past the stop time 1e+09 s." in far.messages[-1]


@pytest.mark.parametrize(("step", "count", "first"), [(0.1, 10, 0.0), (0.01, 100, 5.0), (1 / 3, 3, -1.0)])
def test_steps_that_reach_the_stop_time_but_for_rounding_are_done(
    make: Make, step: float, count: int, first: float
) -> None:
    """Ten times 0.1 added up is not 1."""
    unit = start(make(), time=first, stop=first + count * step, **COARSE)
    times = accumulate(repeat(step, count - 1), initial=first)
    assert go_on(unit, [(t, step) for t in times]).get("step_count") == [count]


@pytest.mark.parametrize(
    ("first", "stop", "words"),
    [
        *((0.0, stop, "is not after the start time") for stop in (-0.5, math.nan, -math.inf)),
        *((x, None, f"the start time {x} is not a finite number of seconds.") for x in (math.nan, math.inf)),
    ],
)
def test_invalid_start_and_stop_times_are_refused(
    make: Make, first: float, stop: float | None, words: str
) -> None:
    unit = make()
    assert not unit.enter(first, stop)
    assert words in unit.messages[0]


def test_run_may_stop_where_it_starts_or_never(make: Make) -> None:
    unit = start(make(), time=1.0, stop=1.0)
    assert unit.get("x") == [0.125]
    assert not unit.step(1.0, 0.1)
    go_on(start(make(), time=1e6, **COARSE), [(1e6, 0.5), (1e6 + 0.5, 0.5)])


# ---- discarded steps, and states ---------------------------------------------------------------

SUMS = [(t, STEP) for t in accumulate(repeat(STEP, 160), initial=0.0)]
AT = 100
NOW = SUMS[AT][0]
TRIES: dict[str, Steps] = {
    "same length, twice": [(NOW, STEP)] * 2,
    "longer, then halves": [(NOW, 3.0 * STEP), (NOW, 0.5 * STEP)],
    "a little later": [(NOW + 5e-5 * STEP, STEP)],
}


@pytest.mark.parametrize("tries", TRIES)
def test_discarded_steps_change_no_bits(make: Make, tries: str) -> None:
    """The own time of an FMU is compared through the saved state, which contains it to the bit."""
    rolled_back, straight = (go_on(start(make()), SUMS[:AT]) for _ in range(2))
    rolled_back.set(force=math.nan)
    for time, step in TRIES[tries]:
        assert not rolled_back.step(time, step)
        assert "discarded: x became" in rolled_back.messages[-1]
    rolled_back.set(force=0.5)
    assert rolled_back.save() == straight.save()
    for steps in (SUMS[AT : AT + 1], SUMS[AT + 1 :]):
        for unit in (rolled_back, straight):
            go_on(unit, steps)
        assert rolled_back.save() == straight.save()
        same(rolled_back, straight)


def test_states_continue_in_other_instances_which_share_nothing(make: Make) -> None:
    """Also back in the first one, as error control repeats a step: a half, and then the whole."""
    unit, second = go_on(start(make("a")), SUMS[:AT]), start(make("b"), x_0=0.9)
    undisturbed = go_on(start(make("c")), SUMS[: AT + 1])
    state = unit.save()
    assert second.step(0.0, STEP) and second.get("x") != unit.get("x")
    for each in (unit, second, unit):
        each.restore(state)
        assert each.step(NOW, 0.5 * STEP)
        each.restore(state)
        assert each.step(*SUMS[AT])
        same(each, undisturbed)
    for each in (undisturbed, unit, second):
        go_on(each, SUMS[AT + 1 :])
        same(each, undisturbed)


def test_outputs_follow_start_values_and_stay_between_steps(make: Make) -> None:
    unit = make()
    assert unit.enter()
    assert unit.set(x_0=0.5)
    assert unit.get("x", "inverse") == [0.5, 2.0]
    assert unit.exit() and unit.step(0.0, 0.1)
    before = unit.get(*NAMES)
    unit.set(force=77.0)
    assert unit.get(*NAMES) == before
    assert unit.step(0.1, 0.1) and unit.get("power") != before[3:4]


@pytest.mark.parametrize(
    ("name", "value"),
    [("body.mass", 0.0), ("body.mass", 11.0), ("body.mass", math.nan), ("body.mass", math.inf), ("shape", 3)],
)
def test_value_out_of_range_is_refused_when_initialization_ends(make: Make, name: str, value: float) -> None:
    unit = make()
    unit.set(**{name: value})
    assert unit.enter() and not unit.exit()
    assert any(f"{name} = {value:g} is outside its range" in line for line in unit.messages)
    assert unit.set(**{name: 2}) and unit.exit()


def test_computed_values_and_parameters_cannot_be_set_after_initialization(make: Make) -> None:
    unit = make()
    assert not unit.set(power=1.0)
    start(unit)
    assert not unit.set(**{"body.mass": 1.0})
    assert unit.step(0.0, 0.1)
