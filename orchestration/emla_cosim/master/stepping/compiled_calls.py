"""Calls of slaves through the FMI, for compiled code; each answers a failure and the slave's status."""

from ..algorithms.extrapolation import Mode
from ..instances.call_codes import CALLS
from .by_address import copy_state, derive, do_step, doubles, exchange, input_at, part, positions
from .record_layout import Failure

_HOLD, _MIDDLE, _LINE = int(Mode.HOLD), int(Mode.MIDDLE), int(Mode.LINE)
_NONE, _SET_REAL, _SET_DERIVATIVES = int(Failure.NONE), int(Failure.SET_REAL), int(Failure.SET_DERIVATIVES)
_DO_STEP, _GET_REAL = int(Failure.DO_STEP), int(Failure.GET_REAL)
_GET_STATE, _SET_STATE = int(Failure.GET_STATE), int(Failure.SET_STATE)
_SETTING, _DERIVING, _STEPPING, _GETTING, _SAVING, _RESTORING = (
    CALLS.index(call)
    for call in (
        "setReal",
        "setRealInputDerivatives",
        "doStep",
        "getReal",
        "getFMUstate",
        "setFMUstate",
    )
)
_OK, _WARNING = 0, 1


@part
def _is_bad(status):
    """Whether a status is worse than a warning, or none of the standard's."""
    return status > _WARNING or status < _OK


@part
def prediction(source, time):
    """Slope and value at `time` of what drives an input; see `Exchange.predict`."""
    signal, newest = doubles(source.signal)[0], doubles(source.at)[0]
    span = newest - doubles(source.before)[0]
    slope = 0.0
    if source.moves and span > 0.0:
        slope = (signal - doubles(source.previous)[0]) / span
    return signal + (time - newest) * slope


@part
def _compute_inputs(slave, time, length):
    """See `Exchange.pass_inputs`."""
    inputs, derivatives = doubles(slave.inputs), doubles(slave.derivatives)
    middle = 0.5 * length if slave.mode == _MIDDLE else 0.0
    for j in range(slave.input_count):
        source = input_at(slave.sources, j)
        signal = doubles(source.signal)[0]
        if slave.mode == _HOLD:
            inputs[j] = source.factor * signal + source.offset
            continue
        newest = doubles(source.at)[0]
        earlier, then = doubles(source.previous)[0], doubles(source.before)[0]
        if slave.rare:
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
def set_inputs(slave, present, time, length):
    """Give a slave its inputs for the step from `time` of this length."""
    references, count = slave.input_references, slave.input_count
    if count == 0:
        return _NONE, _OK
    _compute_inputs(slave, time, length)
    present.code = slave.code + _SETTING
    status = exchange(slave.set_real, (slave.component, references, count, slave.inputs))
    if _is_bad(status):
        return _SET_REAL, status
    if slave.mode == _LINE:
        orders, values = slave.derivative_orders, slave.derivatives
        present.code = slave.code + _DERIVING
        status = derive(
            slave.set_real_input_derivatives, (slave.component, references, count, orders, values)
        )
        if _is_bad(status):
            return _SET_DERIVATIVES, status
    return _NONE, _OK


@part
def step(slave, present, time, length):
    """Let a slave do its step."""
    present.code, present.time = slave.code + _STEPPING, time
    status = do_step(slave.do_step, (slave.component, time, length, slave.no_way_back))
    return _DO_STEP if _is_bad(status) else _NONE, status


@part
def shift(slave, time):
    """The present outputs become the previous ones; new ones of `time` will follow. See `Exchange.shift`."""
    outputs, previous = doubles(slave.outputs), doubles(slave.previous)
    for s in range(slave.output_count):
        previous[s] = outputs[s]
    at = doubles(slave.at)
    doubles(slave.before)[0] = at[0]
    at[0] = time


@part
def keep_history(slave):
    """Keep what the next shift forgets."""
    undo, previous = doubles(slave.undo), doubles(slave.previous)
    for s in range(slave.output_count):
        undo[s] = previous[s]
    undo[slave.output_count] = doubles(slave.before)[0]


@part
def shift_back(slave):
    """Undo a shift, and whatever happened to the outputs after it."""
    outputs, undo, previous = doubles(slave.outputs), doubles(slave.undo), doubles(slave.previous)
    for s in range(slave.output_count):
        outputs[s] = previous[s]
        previous[s] = undo[s]
    before = doubles(slave.before)
    doubles(slave.at)[0] = before[0]
    before[0] = undo[slave.output_count]


@part
def get_outputs(slave, present):
    """Read the outputs."""
    count = slave.output_count
    if count == 0:
        return _NONE, _OK
    present.code = slave.code + _GETTING
    status = exchange(slave.get_real, (slave.component, slave.output_references, count, slave.outputs))
    return _GET_REAL if _is_bad(status) else _NONE, status


@part
def save(slave, present):
    """Let a slave copy its state."""
    present.code = slave.code + _SAVING
    status = copy_state(slave.get_state, (slave.component, slave.state))
    return _GET_STATE if _is_bad(status) else _NONE, status


@part
def restore(slave, present):
    """Bring a slave back to the state that it copied."""
    present.code = slave.code + _RESTORING
    status = copy_state(slave.set_state, (slave.component, positions(slave.state)[0]))
    return _SET_STATE if _is_bad(status) else _NONE, status
