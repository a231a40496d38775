"""FMI calls in compiled code. Each returns a `Failure` and the FMI status."""

from ...fmu.fmi_3_calls import StepEnd, judge_step
from ..algorithms.extrapolation import Mode
from ..instances.call_codes import CALLS
from .by_address import (
    copy_state,
    derive,
    do_step,
    do_step_3,
    doubles,
    exchange,
    exchange_3,
    flags,
    input_at,
    integers,
    part,
    positions,
)
from .record_layout import Failure

_HOLD, _MIDDLE, _LINE = int(Mode.HOLD), int(Mode.MIDDLE), int(Mode.LINE)
_NONE, _SET_REAL, _SET_DERIVATIVES = int(Failure.NONE), int(Failure.SET_REAL), int(Failure.SET_DERIVATIVES)
_DO_STEP, _GET_REAL = int(Failure.DO_STEP), int(Failure.GET_REAL)
_GET_STATE, _SET_STATE = int(Failure.GET_STATE), int(Failure.SET_STATE)
_OBSERVE = int(Failure.OBSERVE)
_DERIVING, _STEPPING = (CALLS.index(call) for call in ("setRealInputDerivatives", "doStep"))
_OK, _WARNING = 0, 1
_TIME = StepEnd.TIME

_judge_step = part(judge_step)


@part
def is_bad(status):
    """Whether a status is worse than a warning, or not in the standard."""
    return status > _WARNING or status < _OK


@part
def prediction(source, time):
    """Return the signal that drives an input, extrapolated to `time`; see `Exchange.predict`."""
    signal, newest = doubles(source.signal)[0], doubles(source.at)[0]
    span = newest - doubles(source.before)[0]
    slope = 0.0
    if source.moves and span > 0.0:
        slope = (signal - doubles(source.previous)[0]) / span
    return signal + (time - newest) * slope


@part
def _compute_inputs(instance, time, length):
    """See `Exchange.pass_inputs`."""
    inputs, derivatives = doubles(instance.inputs), doubles(instance.derivatives)
    middle = 0.5 * length if instance.mode == _MIDDLE else 0.0
    for j in range(instance.input_count):
        source = input_at(instance.sources, j)
        signal = doubles(source.signal)[0]
        if instance.mode == _HOLD:
            inputs[j] = source.factor * signal + source.offset
            continue
        newest = doubles(source.at)[0]
        earlier, then = doubles(source.previous)[0], doubles(source.before)[0]
        if instance.rare:
            taken, taken_at = doubles(source.taken), doubles(source.taken_at)
            if taken_at[0] < then:
                earlier, then = taken[0], taken_at[0]
            taken[0], taken_at[0] = signal, newest
        span = newest - then
        slope = 0.0
        if source.moves and span > 0.0:
            slope = (signal - earlier) / span
        inputs[j] = source.factor * (signal + (time - newest + middle) * slope) + source.offset
        derivatives[j] = source.factor * slope


@part
def set_inputs(instance, present, time, length):
    """Set the inputs of an instance for the step from `time` of this length."""
    references, count = instance.input_references, instance.input_count
    if count == 0:
        return _NONE, _OK
    _compute_inputs(instance, time, length)
    present.code = instance.code_set
    if instance.is_version_3:
        own = references, instance.input_reference_count, instance.inputs, count
        status = exchange_3(instance.set_real, (instance.component, *own))
    else:
        status = exchange(instance.set_real, (instance.component, references, count, instance.inputs))
    if is_bad(status):
        return _SET_REAL, status
    if instance.mode == _LINE:
        orders, values = instance.derivative_orders, instance.derivatives
        present.code = instance.code + _DERIVING
        status = derive(
            instance.set_real_input_derivatives, (instance.component, references, count, orders, values)
        )
        if is_bad(status):
            return _SET_DERIVATIVES, status
    return _NONE, _OK


@part
def whole_step(function, component, time, length, no_way_back, end):
    """Do a step of FMI 3.0; see `StepEnd.call`."""
    said = flags(end)
    integers(end)[0] = 0
    arguments = time, length, no_way_back, end, end + 1, end + 2, end + _TIME
    status = do_step_3(function, (component, *arguments))
    return _judge_step(status, said[0] != 0, said[1] != 0, said[2] != 0)


@part
def step(instance, present, time, length):
    """Do the step of an instance."""
    present.code, present.time = instance.code + _STEPPING, time
    if instance.is_version_3:
        status = whole_step(
            instance.do_step, instance.component, time, length, instance.no_way_back, instance.step_end
        )
    else:
        status = do_step(instance.do_step, (instance.component, time, length, instance.no_way_back))
    return _DO_STEP if is_bad(status) else _NONE, status


@part
def shift(instance, time):
    """Move the present outputs to the history, before those of `time`; see `Exchange.shift`."""
    outputs, previous = doubles(instance.outputs), doubles(instance.previous)
    for s in range(instance.output_count):
        previous[s] = outputs[s]
    at = doubles(instance.at)
    doubles(instance.before)[0] = at[0]
    at[0] = time


@part
def keep_history(instance):
    """Save the part of the history that the next `shift` overwrites."""
    undo, previous = doubles(instance.undo), doubles(instance.previous)
    for s in range(instance.output_count):
        undo[s] = previous[s]
    undo[instance.output_count] = doubles(instance.before)[0]


@part
def shift_back(instance):
    """Undo a `shift`, and restore the outputs from before it."""
    outputs, undo, previous = doubles(instance.outputs), doubles(instance.undo), doubles(instance.previous)
    for s in range(instance.output_count):
        outputs[s] = previous[s]
        previous[s] = undo[s]
    before = doubles(instance.before)
    doubles(instance.at)[0] = before[0]
    before[0] = undo[instance.output_count]


@part
def get_outputs(instance, present):
    """Read the outputs of an instance."""
    count = instance.output_count
    if count == 0:
        return _NONE, _OK
    present.code = instance.code_get
    references = instance.output_references
    if instance.is_version_3:
        own = references, instance.output_reference_count, instance.outputs, count
        status = exchange_3(instance.get_real, (instance.component, *own))
    else:
        status = exchange(instance.get_real, (instance.component, references, count, instance.outputs))
    return _GET_REAL if is_bad(status) else _NONE, status


@part
def get_observed(observed, present):
    """Read observed variables of one type of an instance."""
    count, targets = observed.count, positions(observed.targets)
    present.code = observed.code
    status = exchange(observed.get, (observed.component, observed.references, count, observed.values))
    if is_bad(status):
        return _OBSERVE, status
    if observed.real:
        numbers = doubles(observed.values)
        for v in range(count):
            doubles(targets[v])[0] = numbers[v]
    else:
        whole = integers(observed.values)
        for v in range(count):
            value = whole[v]
            if observed.boolean and value != 0:
                value = 1
            doubles(targets[v])[0] = float(value)
    return _NONE, _OK


@part
def save(instance, present):
    """Save the state of an instance."""
    present.code = instance.code_save
    status = copy_state(instance.get_state, (instance.component, instance.state))
    return _GET_STATE if is_bad(status) else _NONE, status


@part
def restore(instance, present):
    """Restore the saved state of an instance."""
    present.code = instance.code_restore
    status = copy_state(instance.set_state, (instance.component, positions(instance.state)[0]))
    return _SET_STATE if is_bad(status) else _NONE, status
