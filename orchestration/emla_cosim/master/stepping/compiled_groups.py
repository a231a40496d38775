"""Bring a group of instances to the end of a step in compiled code, as `Strong` does in Python.

A loop repeats its step until it converges. If it does not converge, or an instance discards the step,
the group returns to the begin of the step, and Python does this one step.
"""

import numpy as np

from ..algorithms import quasi_newton
from ..algorithms.group import SWEEPS
from .by_address import doubles, group_at, input_at, instance_at, part, positions, present_at
from .compiled_calls import (
    get_outputs,
    keep_history,
    prediction,
    restore,
    save,
    set_inputs,
    shift,
    shift_back,
    step,
)
from .record_layout import Failure

_NONE, _DO_STEP, _NOT_IN_ONE = int(Failure.NONE), int(Failure.DO_STEP), int(Failure.NOT_IN_ONE)
_DISCARD = 2

_improve = part(quasi_newton.improve)


@part
def _member(loop, group, m):
    return instance_at(loop.instances, positions(group.members)[m])


@part
def _failed(lane, group, m, failure, status):
    """Return whether a call failed, and store its instance and status in the lane."""
    if failure == _NONE:
        return False
    lane.instance, lane.status = positions(group.members)[m], status
    return True


@part
def _begin(loop, lane, group, present, end):
    """Save the states, predict the coupling variables, and shift the outputs. Return the failure."""
    if group.saved:
        for m in range(group.member_count):
            instance = _member(loop, group, m)
            failure, status = save(instance, present)
            if _failed(lane, group, m, failure, status):
                return failure
            keep_history(instance)
    guess = doubles(group.guess)
    for c in range(group.cut_count):
        guess[c] = prediction(input_at(group.cut, c), end)
    for m in range(group.member_count):
        shift(_member(loop, group, m), end)
    return _NONE


@part
def _restore(loop, lane, group, present):
    """Restore the states from the begin of the step. Return the failure."""
    for m in range(group.member_count):
        failure, status = restore(_member(loop, group, m), present)
        if _failed(lane, group, m, failure, status):
            return failure
    return _NONE


@part
def _sweep(loop, lane, group, present, time, length):
    """Do the step of every instance with the newest values. Return the failure."""
    for m in range(group.member_count):
        instance = _member(loop, group, m)
        failure, status = set_inputs(instance, present, time, length)
        if failure == _NONE:
            failure, status = step(instance, present, time, length)
        if failure == _NONE:
            failure, status = get_outputs(instance, present)
        if _failed(lane, group, m, failure, status):
            return failure
    return _NONE


@part
def _compare(loop, group, sweep):
    """Store answer and residual. Return whether the group converged, and whether the residual is finite."""
    n, signals, places = group.cut_count, doubles(loop.signals), positions(group.positions)
    guess, sizes = doubles(group.guess), doubles(group.sizes)
    answers, residuals = doubles(group.answers), doubles(group.residuals)
    agreed, finite = True, True
    for c in range(n):
        answer = signals[places[c]]
        residual = answer - guess[c]
        answers[sweep * n + c], residuals[sweep * n + c] = answer, residual
        agreed = agreed and abs(residual) / sizes[c] <= loop.tolerance
        finite = finite and np.isfinite(residual)
    return agreed, finite


@part
def _agree(loop, lane, group, present, time, length):
    """Iterate as `QuasiNewton.solve` does in Python. Return the failure and the number of sweeps."""
    n, signals, places = group.cut_count, doubles(loop.signals), positions(group.positions)
    guess, sizes, floors = doubles(group.guess), doubles(group.sizes), doubles(group.floors)
    jacobian, earlier, largest = doubles(group.jacobian), doubles(group.earlier), doubles(loop.largest)
    for c in range(n):
        sizes[c] = largest[places[c]] + floors[c]
    for e in range(n * n):
        earlier[e] = jacobian[e]
    for sweep in range(SWEEPS):
        failure = _NONE
        if sweep > 0:
            failure = _restore(loop, lane, group, present)
        if failure == _NONE:
            for c in range(n):
                signals[places[c]] = guess[c]
            failure = _sweep(loop, lane, group, present, time, length)
        if failure != _NONE:
            return failure, sweep
        agreed, finite = _compare(loop, group, sweep)
        if not finite:
            return _NOT_IN_ONE, sweep + 1
        if 0 < sweep <= n or not agreed:
            _improve(
                n,
                sweep + 1,
                doubles(group.residuals),
                doubles(group.answers),
                sizes,
                earlier,
                jacobian,
                doubles(group.basis),
                doubles(group.direction),
                guess,
            )
        if agreed:
            return _NONE, sweep + 1
    return _NOT_IN_ONE, SWEEPS


@part
def _give_up(loop, lane, group, present):
    """Restore states, outputs and Jacobian from the begin of the step. Return the failure."""
    failure = _restore(loop, lane, group, present)
    if failure != _NONE:
        return failure
    for m in range(group.member_count):
        shift_back(_member(loop, group, m))
    jacobian, earlier = doubles(group.jacobian), doubles(group.earlier)
    for e in range(group.cut_count * group.cut_count):
        jacobian[e] = earlier[e]
    return _NOT_IN_ONE


@part
def advance_group(loop, lane, g, time, length):
    """Bring group `g` to the end of the step. Return the failure."""
    group, present = group_at(loop.groups, g), present_at(lane.present, 0)
    failure = _begin(loop, lane, group, present, time + length)
    if failure != _NONE:
        return failure
    sweeps = 0
    if group.cut_count > 0:
        failure, sweeps = _agree(loop, lane, group, present, time, length)
    else:
        failure = _sweep(loop, lane, group, present, time, length)
    discarded = failure == _DO_STEP and lane.status == _DISCARD
    if group.saved and (discarded or failure == _NOT_IN_ONE):
        return _give_up(loop, lane, group, present)
    lane.sweeps += sweeps
    return failure


@part
def see(loop):
    """See `Scale.see`."""
    signals, largest = doubles(loop.signals), doubles(loop.largest)
    for s in range(loop.signal_count):
        size = abs(signals[s])
        if size > largest[s] and np.isfinite(size):
            largest[s] = size
