"""Contradictions in the data of a problem, found before it is solved."""

import math
from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from .problem import MotionProblem
from .reaching import Reach, nearest_position
from .surroundings import base_approach, ground_approach

_MOMENTS = {"q_S": 0.0, "q_E": 1.0}
"""When ends are, as fractions of the duration."""

_ROUNDING = 1e-9
"""Distance in m that counts as rounding."""


def find_contradictions(problem: MotionProblem) -> list[str]:
    """Return a message for each contradiction found in the data."""
    empty = list(_check_empty_bounds(problem))
    accelerations = [] if empty else list(_check_accelerations(problem))
    checks = (
        _check_ends(problem),
        _check_duration(problem),
        accelerations,
        _check_forces(problem),
        _check_clearances(problem),
    )
    aims = list(_check_order(problem)) or list(_check_reach(problem))
    return [*empty, *(message for messages in checks for message in messages), *aims]


def _check_order(problem: MotionProblem) -> Iterator[str]:
    for i, (a, b) in enumerate(pairwise(problem.moments)):
        if a >= b:
            yield f"via[{i + 2}].at = {b:g} is not after via[{i + 1}].at = {a:g}"


def _check_reach(problem: MotionProblem) -> Iterator[str]:
    """Yield messages for positions that no posture reaches above the ground."""
    for (name, moment, position), guess in zip(problem.aims, problem.postures, strict=False):
        target, above = f"{name} = {_format_position(position)} m", position[-1] - problem.ground_height
        if problem.ground_clearance is not None and above < problem.ground_clearance:
            side = "above" if above >= 0.0 else "below"
            yield f"{target} is {abs(above):.3g} m {side} {_describe_ground(problem)}"
            continue
        for obstacle in problem.obstacles:
            point = np.array([position])
            if (distance_of_obstacle := float(obstacle.distances(point, point)[0][0])) < obstacle.clearance:
                yield (
                    f"{target} is {distance_of_obstacle:.3g} m from {obstacle.label}; its clearance = "
                    f"{obstacle.clearance:g} m is required"
                )
        if guess is None:
            nearest = nearest_position(Reach(problem.machine, problem.payload_until(moment)), position)
            distance = math.dist(nearest, position)
            if distance <= 1e-6:
                yield (
                    f"{target} is in the tip's reach only with a point of the machine too near to the ground"
                )
                continue
            yield (
                f"{target} is out of the tip's reach by {distance:.3g} m; the nearest position in reach is "
                f"{_format_position(nearest, 4)} m"
            )


def _format_position(position: tuple[float, ...], digits: int = 6) -> str:
    return ",".join(f"{x:.{digits}g}" for x in position)


def _describe_ground(problem: MotionProblem) -> str:
    return (
        f"the ground, which is at {problem.axes[-1]} = {problem.ground_height:.4g} m; "
        f"ground_clearance = {problem.ground_clearance:g} m is required"
    )


def _list_fixed_ends(problem: MotionProblem) -> list[str]:
    """Names of the ends whose strokes are fixed."""
    return ["q_S"] if problem.tip_E is not None else ["q_S", "q_E"]


def _check_empty_bounds(problem: MotionProblem) -> Iterator[str]:
    for x in "vfaj":
        lows, highs = getattr(problem, f"{x}_LB"), getattr(problem, f"{x}_UB")
        if lows is None or highs is None:
            continue
        for i, (low, high) in enumerate(zip(lows, highs, strict=True), 1):
            if low > high:
                yield f"{x}_LB[{i}] = {low:g} is above {x}_UB[{i}] = {high:g}"


def _check_ends(problem: MotionProblem) -> Iterator[str]:
    """Yield messages for end points that are beyond the bounds of the motion between them."""
    for name, unit in (*((name, "m") for name in _list_fixed_ends(problem)), ("v_S", "m/s"), ("v_E", "m/s")):
        limits_of = problem.machine if name.startswith("q") else problem
        lows, highs = (getattr(limits_of, f"{name[0]}_{end}") for end in ("LB", "UB"))
        for i, (x, low, high) in enumerate(zip(getattr(problem, name), lows, highs, strict=True)):
            if not low <= x <= high:
                yield (
                    f"{name}[{i + 1}] = {x:g} {unit} of the {problem.names[i]} is beyond its own bounds, "
                    f"{low:g} to {high:g} {unit}{_format_ratio(x, low, high)}"
                )


def _check_duration(problem: MotionProblem) -> Iterator[str]:
    if problem.tip_E is not None:
        return  # its strokes are not known yet
    for i, joint in enumerate(problem.names):
        stroke = problem.q_E[i] - problem.q_S[i]
        speed = problem.v_UB[i] if stroke > 0.0 else problem.v_LB[i]
        shortest = math.inf if stroke and stroke * speed <= 0.0 else stroke / speed if stroke else 0.0
        if shortest > problem.t_M:
            yield (
                f"the {joint}'s {abs(stroke):g} m take {shortest:.3g} s at its bound of {abs(speed):g} m/s, "
                f"more than t_M = {problem.t_M:g} s"
            )


def _check_accelerations(problem: MotionProblem) -> Iterator[str]:
    """Yield messages for ends that the bounds of the accelerations do not join within t_M.

    The farthest motion in t_M has its highest acceleration first, and then its lowest, and the nearest
    one the reverse.
    """
    if problem.a_LB is None or problem.a_UB is None:
        return
    t_M = problem.t_M
    for i, joint in enumerate(problem.names):
        low, high, gain = problem.a_LB[i], problem.a_UB[i], problem.v_E[i] - problem.v_S[i]
        bounds = f"a_LB[{i + 1}] = {low:g} and a_UB[{i + 1}] = {high:g} m/s2"
        if not low * t_M <= gain <= high * t_M:
            yield (
                f"the {joint}'s change from v_S[{i + 1}] = {problem.v_S[i]:g} to v_E[{i + 1}] = "
                f"{problem.v_E[i]:g} m/s is not possible in t_M = {t_M:g} s with {bounds}"
            )
            continue
        ends = [
            problem.v_S[i] * t_M + _compute_distance(a, b, gain, t_M) for a, b in ((low, high), (high, low))
        ]
        stroke = problem.q_E[i] - problem.q_S[i]
        if problem.tip_E is None and not ends[0] - _ROUNDING <= stroke <= ends[1] + _ROUNDING:
            yield (
                f"the {joint}'s way of {stroke:.4g} m is not possible in t_M = {t_M:g} s with {bounds}: "
                f"they allow {ends[0]:.4g} to {ends[1]:.4g} m"
            )


def _check_forces(problem: MotionProblem) -> Iterator[str]:
    """Yield messages for postures that do not close, or that the forces cannot hold at rest."""
    for name in _list_fixed_ends(problem):
        q = np.array([getattr(problem, name)])
        if not problem.within_strokes(q[0]):
            continue  # reported before
        payload, rest = problem.payload_until(_MOMENTS[name]), np.zeros_like(q)
        forces = problem.machine.forces(q, rest, rest, payload)[0].tolist()
        if not np.isfinite(forces).all():
            yield f"the machine cannot close at the strokes of {name}"
            continue
        for i, force in enumerate(forces):
            if not problem.f_LB[i] <= force <= problem.f_UB[i]:
                bounds = f"{problem.f_LB[i] / 1e3:g} to {problem.f_UB[i] / 1e3:g} kN"
                yield (
                    f"holding {name} takes {force / 1e3:.4g} kN of the {problem.names[i]}, beyond its "
                    f"bounds, {bounds}"
                )


def _check_clearances(problem: MotionProblem) -> Iterator[str]:
    """Yield messages for postures at the start or end that are too close to ground, base or obstacles."""
    machine, time = problem.machine, np.zeros(1)
    for name in _list_fixed_ends(problem):
        q = np.array([getattr(problem, name)])
        points = machine.points(q, payload=problem.payload_until(_MOMENTS[name]))
        if not problem.within_strokes(q[0]) or not all(np.isfinite(x).all() for x in points.values()):
            continue
        if problem.ground_clearance is not None:
            ground = ground_approach(machine, problem.ground_height, time, points)
            if ground.distance < problem.ground_clearance:
                side = "above" if ground.distance >= 0.0 else "below"
                height = f"{abs(ground.distance):.3g} m {side}"
                yield f"{name} puts {ground.part} {height} {_describe_ground(problem)}"
        if problem.body_clearance is not None:
            base = base_approach(machine, time, points)
            if base is not None and base.distance < problem.body_clearance:
                yield (
                    f"{name} puts {base.part} {base.distance:.3g} m from the base or an actuator on it; "
                    f"body_clearance = {problem.body_clearance:g} m is required"
                )
        for obstacle in problem.obstacles:
            approach = obstacle.approach(machine, time, points)
            if approach.distance < obstacle.clearance:
                yield (
                    f"{name} puts {approach.part} {approach.distance:.3g} m from {obstacle.label}; "
                    f"its clearance = {obstacle.clearance:g} m is required"
                )


def _compute_distance(first: float, last: float, gain: float, duration: float) -> float:
    """Return the way in m from rest with two accelerations in turn, which change the speed by gain."""
    first_duration = (gain - last * duration) / (first - last) if first != last else duration
    last_duration = duration - first_duration
    return (
        0.5 * first * first_duration**2
        + first * first_duration * last_duration
        + 0.5 * last * last_duration**2
    )


def _format_ratio(x: float, low: float, high: float) -> str:
    bound = high if x > high else low
    return f": {x / bound:.2g} times as much" if bound * x > 0.0 else ""
