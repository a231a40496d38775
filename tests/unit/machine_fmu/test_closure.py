"""Machines that cannot be: messages say what is wrong."""

from dataclasses import replace
from typing import Any

import pytest

from machine_fmu import (
    Actuator,
    Body,
    Dynamics,
    Joint,
    Link,
    Machine,
    MachineError,
    Point,
    assemble,
    find_closure,
    reach_pose,
)

BOOM = Body(Joint("revolute", assembly=(0.5,)), 100.0, (1.0, 0.0), (30.0,), {"pin": Point((0.6, 0.1))})
LIFT = Actuator(("ground.foot", "boom.pin"), 50.0, L_0=0.5)
CRANE = Machine(2, {"boom": BOOM}, {"foot": Point((0.4, -0.5))}, {"lift": LIFT})


def test_pose_matches_the_lengths() -> None:
    closure = find_closure(CRANE)
    assert closure.sides == {0: 1}
    assert closure.iterated == []
    (angle,) = reach_pose(assemble(CRANE), closure, closure.lengths)
    assert angle == pytest.approx(0.5, abs=1e-14)


ROCKER = Body(Joint("revolute", assembly=(1.5,)), 5.0, points={"end": Point((0.3, 0.0))})
INVALID: list[tuple[dict[str, Any], str]] = [
    (
        {"actuators": {}},
        "nothing determines the joint of 'boom'; add an actuator or a link, or write passive = true if it "
        "swings freely",
    ),
    (
        {"actuators": {"lift": LIFT, "other": LIFT}},
        "the machine has more actuators, links and loops than joints; remove 'other'",
    ),
    ({"ground": {"foot": Point((0.0, 0.0))}}, "singular"),  # the actuator goes through the joint
    (
        {"actuators": {"lift": replace(LIFT, ends=("ground.feet", "boom.pin"))}},
        "the actuator 'lift' is at 'ground.feet', but there is no point 'feet' of 'ground'; existing: foot",
    ),
    ({"bodies": {"boom": replace(BOOM, m="boom.m")}}, "there is no parameter 'boom.m'; existing: none"),
    (
        {
            "bodies": {"boom": BOOM, "rocker": ROCKER},
            "links": {"rod": Link(("boom.pin", "rocker.end"), length=5.0)},
        },
        "no pose of 'rocker' has 'rod' 5 m long; its ends can be 0.3086 to 0.9082 m apart",
    ),
]


@pytest.mark.parametrize(("changes", "message"), INVALID)
def test_invalid_machines_are_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(MachineError) as refused:
        find_closure(replace(CRANE, **changes))
    assert message in str(refused.value)


def test_length_beyond_the_triangle() -> None:
    with pytest.raises(MachineError, match=r"cannot close.* no pose of 'boom' has 'lift'"):
        reach_pose(assemble(CRANE), find_closure(CRANE), {"lift": 3.0})


def test_actuator_between_bodies_that_a_later_one_moves() -> None:
    """A plate is a part of the boom: with or without it, motion and forces are the same."""
    tip, foot, top = Point((2.0, 0.0)), Point((0.5, -0.4)), Point((0.8, 0.4))
    boom = replace(BOOM, points={"tip": tip, "top": top})
    stick = Body(
        Joint("revolute", "boom", "tip", assembly=(-1.0,)),
        40.0,
        (0.5, 0.0),
        (9.0,),
        {"heel": Point((-0.3, 0.1)), "elbow": Point((0.2, 0.3))},
    )
    plate = Body(Joint("fixed", "boom"), points={"top": top})
    lift = replace(LIFT, ends=("ground.foot", "stick.elbow"), c=0.2, J=2.0, rod_share=0.3)

    def forces(bodies: dict[str, Body], pin: str) -> list[float]:
        tilt = Actuator((pin, "stick.heel"), 30.0, 0.1, 1.0, L_0=0.7, rod_share=0.4)
        machine = Machine(2, bodies, {"foot": foot}, {"lift": lift, "tilt": tilt})
        mechanism, closure = assemble(machine), find_closure(machine)
        strokes = [closure.lengths[bar.name] - bar.length + 0.01 for bar in mechanism.actuators]
        return Dynamics(mechanism, closure, strokes).inverse([0.1, -0.2], [1.0, 2.0])

    expected = forces({"boom": boom, "stick": stick}, "boom.top")
    assert forces({"boom": boom, "plate": plate, "stick": stick}, "plate.top") == pytest.approx(expected)


@pytest.mark.parametrize(("bend", "is_singular"), [(0.0, True), (0.3, False)])
def test_links_of_a_singular_pose_are_refused(bend: float, is_singular: bool) -> None:
    """A link in line with a stretched arm holds it, but nothing moves it from there."""
    upper = Body(Joint("revolute", assembly=(0.0,)), 10.0, points={"elbow": Point((1.0, 0.0))})
    points = {"pin": Point((0.5, 0.3)), "hand": Point((1.0, 0.0))}
    fore = Body(Joint("revolute", "upper", "elbow", assembly=(bend,)), 10.0, points=points)
    machine = Machine(
        2,
        {"upper": upper, "fore": fore},
        {"foot": Point((2.0, -1.2)), "wall": Point((3.0, 0.0))},
        {"rod": Actuator(("ground.foot", "fore.pin"), 5.0, L_0=1.0)},
        {"link": Link(("fore.hand", "ground.wall"), 1.0)},
    )
    if is_singular:
        with pytest.raises(MachineError, match="the pose is singular: 'fore', 'upper' cannot be found"):
            find_closure(machine)
    else:
        assert find_closure(machine).iterated == [0, 1]
