"""How lengths of actuators determine the pose: by slides, triangles, or Newton's method."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any

from .assembly import assemble
from .description import Machine, MachineError
from .exact import ONE, ZERO, plain
from .linear import Factors
from .mechanism import Bar, Mechanism
from .pose import Angle, Pose, direction
from .rows import Row, coordinate_of, row_direction, row_ends, row_slopes
from .structure import Step, StructureError, order_steps
from .triangles import close_bar

ITERATIONS = 3
"""Default number of Newton's iterations on symbols, from a guess that is close."""

_MANY, _PARTS = 30, 16
"""Most iterations for floats, and parts of the way from the assembly pose to another one."""

_TURNS = 72
"""Angles for which a message has the distance of two ends."""

_NEAR, _SINGULAR = 1e-12, 1e-9
"""Residual in m of a pose that is found, and least slope of lengths that is not singular."""


@dataclass(frozen=True)
class Closure:
    """The equations of a mechanism in the order in which they determine the coordinates.

    Attributes:
        rows: All equations.
        steps: Groups of them, each with the coordinates that it determines.
        sides: 1 or -1 by coordinate: on which side of the fixed pin a triangle has its moving pin, or to
            which side a bar pushes a slide. Coordinates that are not here are found by Newton's method.
        lengths: Lengths by bar in the assembly pose at the strokes of the start, m.
        assembly: Coordinates of this pose.
    """

    rows: tuple[Row, ...]
    steps: tuple[Step, ...]
    sides: Mapping[int, int]
    lengths: Mapping[str, float]
    assembly: tuple[float, ...]

    @property
    def iterated(self) -> list[int]:
        """The coordinates that Newton's method finds."""
        return sorted(u for step in self.steps for u in step.unknowns if u not in self.sides)


def find_closure(machine: Machine) -> Closure:
    """Return how lengths determine the pose of a machine, near its assembly pose.

    Raises:
        MachineError: They do not determine it, or links and loops do not close in the assembly pose.
    """
    return _find_closure(_Key(repr(machine), machine))


@dataclass(frozen=True)
class _Key:
    """A machine by its text; the mappings of a machine have no hash."""

    text: str
    machine: Machine = field(compare=False)


@lru_cache(maxsize=32)
def _find_closure(key: _Key) -> Closure:
    """Return the closure, which takes a while: readers and both blocks of a machine need it."""
    machine = key.machine
    mechanism = assemble(machine)
    rows = [Row(bar=i) for i in range(len(mechanism.bars))]
    rows += [Row(loop=i, component=k) for i in range(len(mechanism.loops)) for k in range(machine.dimensions)]
    unknowns = set(range(mechanism.coordinates)) - set(mechanism.passive)
    try:
        steps = order_steps([_dependence(mechanism, row) & unknowns for row in rows], unknowns)
    except StructureError as error:
        raise MachineError(_explain(mechanism, rows, error)) from None
    guess = _given_assembly(machine, mechanism)
    pose = Pose(mechanism).with_numbers(dict(enumerate(guess)))
    lengths = {
        bar.name: float(plain(direction(pose, bar).length if bar.is_actuator else _link_length(pose, bar)))
        for bar in mechanism.bars
    }
    found = Closure(tuple(rows), tuple(steps), {}, lengths, guess)
    found = replace(found, assembly=_iterate_numbers(mechanism, found, lengths, guess))
    starts = {
        bar.name: float(plain(bar.length)) + start
        for bar in mechanism.actuators
        if (start := machine.actuators[bar.name].start) is not None
    }
    if starts:
        lengths = {**lengths, **starts}
        found = replace(found, lengths=lengths, assembly=tuple(reach_pose(mechanism, found, lengths)))
    assembly = found.assembly
    pose = Pose(mechanism).with_numbers(dict(enumerate(assembly)))
    sides = dict[int, int]()
    for step in steps:
        if (side := _side(pose, rows, step)) is not None:
            sides[step.unknowns[0]] = side
        else:
            _refuse_singular(pose, rows, step, lengths)
    return replace(found, sides=sides)


def start_strokes(machine: Machine) -> list[float]:
    """Return the strokes at the start of a run in m; those of the assembly pose where none are given.

    Raises:
        MachineError: As `find_closure`.
    """
    lengths, bars = find_closure(machine).lengths, assemble(machine).actuators
    starts = (machine.actuators[bar.name].start for bar in bars)
    return [
        lengths[bar.name] - float(plain(bar.length)) if start is None else start
        for bar, start in zip(bars, starts, strict=True)
    ]


def solve_pose(
    mechanism: Mechanism,
    closure: Closure,
    lengths: Mapping[str, Any],
    passive: Mapping[int, Any] | None = None,
    guess: Mapping[int, Any] | None = None,
    iterations: int = ITERATIONS,
) -> Pose:
    """Return the pose for lengths of all bars, on floats or symbols.

    Args:
        mechanism: The mechanism.
        closure: How to find the pose.
        lengths: Lengths in m by bar.
        passive: Passive coordinates in m or rad by number; those of the assembly pose by default.
        guess: Where Newton's method begins, by coordinate; the assembly pose by default.
        iterations: The number of its iterations. On floats, `reach_pose` does as many as are needed.
    """
    passive = passive or {i: closure.assembly[i] for i in mechanism.passive}
    guess = guess or dict(enumerate(closure.assembly))
    pose = Pose(mechanism).with_numbers(dict(passive))
    for step in closure.steps:
        rows = [closure.rows[e] for e in step.equations]
        seen = _seen_from_carrier(pose, rows, step.unknowns)
        if step.unknowns[0] in closure.sides:
            coordinate, bar = step.unknowns[0], mechanism.bars[rows[0].bar]
            close_bar(seen, bar, coordinate, closure.sides[coordinate], lengths[bar.name])
            pose.values[coordinate] = seen.values[coordinate]
            pose.levers.update(seen.levers)
            continue
        x = [guess[i] for i in step.unknowns]
        for _ in range(iterations):
            before = x
            x, _ = _improve(seen, rows, step.unknowns, x, lengths)
            changes = (b - a for a, b in zip(before, x, strict=True))
            pose.changes.update(zip(step.unknowns, changes, strict=True))
        pose.numbers.update(zip(step.unknowns, x, strict=True))
        pose.values.update({i: pose.value(i, x_i) for i, x_i in zip(step.unknowns, x, strict=True)})
    return pose


def _seen_from_carrier(pose: Pose, rows: Sequence[Row], unknowns: Sequence[int]) -> Pose:
    """Return the pose for equations whose ends a body carries that later steps move: it is at 0 then."""
    mechanism = pose.mechanism
    later = dict[int, Any]()
    for end in (end for row in rows for end in row_ends(mechanism, row)):
        for frame in (mechanism.frames[i] for i in mechanism.ancestors(end.frame)):
            if frame.coordinate is not None and frame.coordinate not in (*pose.values, *unknowns):
                later[frame.coordinate] = ZERO if frame.slides else Angle(ONE, ZERO)
    return Pose(mechanism, {**pose.values, **later}) if later else pose


def closure_errors(pose: Pose, closure: Closure, lengths: Mapping[str, Any]) -> list[Any]:
    """Return how far a pose is from its lengths in m, by equation that Newton's method solves."""
    errors = list[Any]()
    for step in closure.steps:
        if step.unknowns[0] in closure.sides:
            continue
        for row in (closure.rows[e] for e in step.equations):
            distance, _ = row_direction(pose, row)
            length = lengths[pose.mechanism.bars[row.bar].name] if row.bar >= 0 else 0.0
            errors.append(plain(distance - length))
    return errors


def reach_pose(mechanism: Mechanism, closure: Closure, lengths: Mapping[str, float]) -> list[float]:
    """Return the coordinates for lengths, found from the assembly pose in small parts, on floats.

    Raises:
        MachineError: There is no such pose, or a singular one is on the way.
    """
    x, last = list(closure.assembly), closure.lengths
    for part in range(1, _PARTS + 1):
        share = part / _PARTS
        there = {name: last[name] + share * (lengths[name] - last[name]) for name in last}
        x = list(_iterate_numbers(mechanism, closure, there, x, lengths))
    return x


def _improve(
    pose: Pose, rows: Sequence[Row], unknowns: Sequence[int], x: Sequence[Any], lengths: Mapping[str, Any]
) -> tuple[list[Any], list[Any]]:
    """Return the coordinates after an iteration of Newton's method, and the residuals before it."""
    trial = pose.with_numbers(dict(zip(unknowns, x, strict=True)))
    residuals, slopes = list[Any](), list[list[Any]]()
    for row in rows:
        distance, u = row_direction(trial, row)
        wanted = lengths[pose.mechanism.bars[row.bar].name] if row.bar >= 0 else 0.0
        residuals.append(plain(distance - wanted))
        found = row_slopes(trial, row, u)
        slopes.append([plain(found.get(i, 0.0)) for i in unknowns])
    change = Factors(slopes).solve(residuals)
    return [a - b for a, b in zip(x, change, strict=True)], residuals


def _iterate_numbers(
    mechanism: Mechanism,
    closure: Closure,
    lengths: Mapping[str, float],
    guess: Sequence[float],
    target: Mapping[str, float] | None = None,
) -> tuple[float, ...]:
    """Return the coordinates for lengths near a guess; raise MachineError if there are none.

    Messages have the lengths of `target`, if these are a step towards them.
    """
    target = target or lengths
    x = dict(enumerate(guess))
    # also coordinates of later steps: a slide's length is computed in world axes, whatever turns the slide
    pose = Pose(mechanism).with_numbers(x)
    for step in closure.steps:
        rows = [closure.rows[e] for e in step.equations]
        names = _names(mechanism, step.unknowns)
        values = [x[i] for i in step.unknowns]
        for _ in range(_MANY):
            try:
                values, residuals = _improve(pose, rows, step.unknowns, values, lengths)
            except (ZeroDivisionError, OverflowError):
                raise _singular(names, _lengths(pose, rows, target)) from None
            if max(map(abs, residuals)) <= _NEAR:
                break
        else:
            raise MachineError(
                f"the mechanism cannot close, or is singular: no pose of {names} has "
                f"{_lengths(pose, rows, target)}{_range(pose, rows, step.unknowns)}"
            )
        x.update(zip(step.unknowns, values, strict=True))
        pose = pose.with_numbers({i: x[i] for i in step.unknowns})
    return tuple(x[i] for i in range(len(x)))


def _lengths(pose: Pose, rows: Sequence[Row], lengths: Mapping[str, float]) -> str:
    """Return the lengths in equations for a message."""
    bars = [pose.mechanism.bars[row.bar].name for row in rows if row.bar >= 0]
    loops = {list(pose.mechanism.machine.loops)[row.loop]: None for row in rows if row.bar < 0}
    texts = [*(f"'{bar}' {lengths[bar]:.6g} m long" for bar in bars), *(f"'{loop}' closed" for loop in loops)]
    return ", ".join(texts)


def _range(pose: Pose, rows: Sequence[Row], unknowns: Sequence[int]) -> str:
    """Return for a message how far the ends of the bar of a triangle can be apart; empty for others."""
    (unknown, *others), row = unknowns, rows[0]
    mechanism = pose.mechanism
    if others or row.bar < 0 or mechanism.frames[mechanism.frame_of(unknown)].slides:
        return ""
    turns = (2.0 * math.pi * i / _TURNS for i in range(_TURNS))
    distances = [float(plain(row_direction(pose.with_numbers({unknown: turn}), row)[0])) for turn in turns]
    return f"; its ends can be {min(distances):.4g} to {max(distances):.4g} m apart"


def _side(pose: Pose, rows: Sequence[Row], step: Step) -> int | None:
    """Return the side of an explicit step in a pose of floats; None for Newton's method."""
    (unknown, *others), row = step.unknowns, rows[step.equations[0]]
    if others or row.bar < 0:
        return None
    mechanism, bar = pose.mechanism, pose.mechanism.bars[row.bar]
    frame = mechanism.frame_of(unknown)
    if frame not in (bar.start.frame, bar.end.frame):
        return None
    found, u = row_direction(pose, row)
    slope = plain(row_slopes(pose, row, u)[unknown])
    if abs(slope) < _SINGULAR * max(1.0, abs(plain(found))):
        raise MachineError(
            f"the bar '{bar.name}' cannot move '{mechanism.frames[frame].name}': it is singular"
        )
    return 1 if slope > 0.0 else -1


def _refuse_singular(pose: Pose, all_rows: Sequence[Row], step: Step, lengths: Mapping[str, float]) -> None:
    """Raise MachineError if Newton's method cannot leave a pose of floats, although lengths close there."""
    rows = [all_rows[e] for e in step.equations]
    directions = [(row, row_direction(pose, row)[1]) for row in rows]
    slopes = [row_slopes(pose, row, u) for row, u in directions]
    table = [[float(plain(found.get(i, 0.0))) for i in step.unknowns] for found in slopes]
    error = _singular(_names(pose.mechanism, step.unknowns), _lengths(pose, rows, lengths))
    try:
        sizes = [abs(x) for x in Factors(table).diagonal()]
    except ZeroDivisionError:
        raise error from None
    if min(sizes) < _SINGULAR * max(1.0, *sizes):
        raise error


def _singular(names: str, lengths: str) -> MachineError:
    return MachineError(f"the pose is singular: {names} cannot be found from {lengths}")


def _dependence(mechanism: Mechanism, row: Row) -> set[int]:
    if row.bar >= 0 and (slide := mechanism.bars[row.bar].slide) is not None:
        return {coordinate_of(mechanism, slide)}
    start, end = row_ends(mechanism, row)
    frames = (mechanism.frames[f] for path in mechanism.paths(start.frame, end.frame) for f in path)
    return {frame.coordinate for frame in frames if frame.coordinate is not None}


def _link_length(pose: Pose, bar: Bar) -> Any:
    return direction(pose, bar).length if bar.length is None else bar.length


def _given_assembly(machine: Machine, mechanism: Mechanism) -> tuple[float, ...]:
    """Return the coordinates of the assembly pose as the description has them; 0 without."""
    found = list[float]()
    for name, body in machine.bodies.items():
        count, given = len(machine.coordinates(name)), body.joint.assembly
        if given and len(given) != count:
            raise MachineError(f"the assembly pose of '{name}' has {len(given)} numbers; it needs {count}")
        found += [float(x) for x in given] or [0.0] * count
    return tuple(found)


def _names(mechanism: Mechanism, coordinates: Sequence[int]) -> str:
    return ", ".join(f"'{mechanism.frames[mechanism.frame_of(i)].name}'" for i in coordinates)


def _explain(mechanism: Mechanism, rows: Sequence[Row], error: StructureError) -> str:
    """Return a message on coordinates that are not determined, or equations that are too many."""
    bars, loops = mechanism.bars, list(mechanism.machine.loops)
    extra = [
        f"'{bars[rows[e].bar].name}'" if rows[e].bar >= 0 else f"'{loops[rows[e].loop]}'"
        for e in error.equations
    ]
    extra = list(dict.fromkeys(extra))  # a loop has several equations
    if extra and not error.unknowns:
        return f"the machine has more actuators, links and loops than joints; remove {', '.join(extra)}"
    free = _names(mechanism, error.unknowns)
    hint = f"; {', '.join(extra)} cannot move them" if extra else ""
    return (
        f"nothing determines the joint of {free}{hint}; add an actuator or a link, or write passive = true "
        "if it swings freely"
    )
