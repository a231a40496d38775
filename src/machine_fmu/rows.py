"""Equations for coordinates: lengths of bars, and distances of the ends of loops."""

from dataclasses import dataclass
from typing import Any

from .exact import MINUS_ONE, ONE, is_zero
from .mechanism import End, Mechanism
from .pose import Pose, direction
from .vectors import AXES, NONE, Vector, add, cross, dot, scale


@dataclass(frozen=True)
class Row:
    """An equation: the length of a bar, or a component of the distance of a loop's ends."""

    bar: int = -1
    loop: int = -1
    component: int = 0


def row_ends(mechanism: Mechanism, row: Row) -> tuple[End, End]:
    """Return the two ends that an equation is about."""
    if row.bar >= 0:
        return mechanism.bars[row.bar].start, mechanism.bars[row.bar].end
    return mechanism.loops[row.loop]


def row_direction(pose: Pose, row: Row, length: Any = None) -> tuple[Any, Vector]:
    """Return the distance of the ends along a direction in m, and the direction."""
    if row.bar >= 0:
        return direction(pose, pose.mechanism.bars[row.bar], length)
    axis = AXES[row.component]
    return dot(axis, pose.apart(*pose.mechanism.loops[row.loop])), axis


def row_levers(pose: Pose, row: Row) -> dict[int, tuple[Vector, Vector]]:
    """Return, for each coordinate of an equation, how its ends move apart per speed of the coordinate.

    The second vector is the arm from the coordinate's frame to the end, with the same sign.
    """
    mechanism = pose.mechanism
    levers, ends = dict[int, tuple[Vector, Vector]](), row_ends(mechanism, row)
    for end, path, sign in zip(
        ends, mechanism.paths(ends[0].frame, ends[1].frame), (MINUS_ONE, ONE), strict=True
    ):
        arm = pose.reach(end)
        for frame in reversed(path):
            of = mechanism.frames[frame]
            if of.coordinate is not None:
                axis = pose.axis(frame)
                speed = axis if of.slides else cross(axis, arm)
                levers[of.coordinate] = scale(sign, speed), NONE if of.slides else scale(sign, arm)
            arm = add(pose.arm(frame), arm)
    return levers


def row_slopes(pose: Pose, row: Row, u: Vector) -> dict[int, Any]:
    """Return the derivatives of an equation with respect to the coordinates that it depends on."""
    if row.bar >= 0 and (slide := pose.mechanism.bars[row.bar].slide) is not None:
        return {coordinate_of(pose.mechanism, slide): ONE}
    slopes = {
        i: dot(u, lever) if arm is NONE else dot(pose.axis(pose.mechanism.frame_of(i)), cross(arm, u))
        for i, (lever, arm) in row_levers(pose, row).items()
    }
    return {i: slope for i, slope in slopes.items() if not is_zero(slope)}


def coordinate_of(mechanism: Mechanism, frame: int) -> int:
    """Return the number of the coordinate of a frame that has one."""
    coordinate = mechanism.frames[frame].coordinate
    assert coordinate is not None
    return coordinate
