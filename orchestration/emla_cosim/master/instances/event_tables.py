"""Tables of an instance with event mode, clocks or early returns for the stepper in C; see `layout`."""

import ctypes
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from fmpy.model_description import ModelVariable
from numpy.typing import NDArray

from ...base.arrays import Vector
from ...fmu.elements import (
    BINARY,
    CLOCK,
    COUNTDOWN,
    PERIODIC,
    ElementVariable,
    InputClock,
    clocks_of,
    is_clocked,
    is_triggered_input,
)
from ...stepper.layout import (
    CALL,
    CLOCK_SET,
    CLOCKED_CALL,
    FIRST_PASSED,
    FUNCTIONS,
    NEXT_EVENT,
    TICKS_SIZE,
    TIMED_CLOCK,
    TRIGGERED_CLOCK,
    ClockKind,
    Events,
)
from .typed_values import TypedValues, TypeGroup, allocate_array, fill_typed_call

_FMI_FUNCTION = ctypes.CFUNCTYPE(
    ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_size_t, ctypes.c_void_p, ctypes.c_size_t
)
"""An FMI 3.0 function that sets or gets values."""


class FmiAccess(NamedTuple):
    """How the functions of an FMU are called.

    Attributes:
        functions: The functions by their short names, for calls from Python.
        addresses: Their addresses.
        codes: The codes of calls in the record of the present call.
        arrays: The memory of arrays that are set; see `TypedValues`.
    """

    functions: Mapping[str, Callable[..., int]]
    addresses: Mapping[str, int]
    codes: Mapping[str, int]
    arrays: dict[int, NDArray[Any]]


class EventTables:
    """The tables of an instance, and the memory of all that its steps change.

    Args:
        variables: All variables of the FMU.
        inputs: Variables of the input vector, with the triggered clocks that are connected.
        clocks: The input clocks that tick at times.
        has_event_mode: Whether the FMU uses event mode. Then its discrete inputs change there.
        access: How its functions are called.

    Attributes:
        record: What the functions in C get.
        memory: The next time event, the request to end, the present time, the discrete inputs that the FMU
            has, the schedule of the clocks, the values of clocked variables, and the ticks of each clock.
        passed: The part with the discrete inputs.
        discrete: The positions of discrete inputs in the input vector.
        continuous: Sets the inputs that change in step mode.
        first_count: Where the numbers of ticks begin in the memory.
    """

    def __init__(
        self,
        variables: Mapping[str, ModelVariable],
        inputs: Sequence[ModelVariable],
        clocks: Sequence[InputClock],
        has_event_mode: bool,
        access: FmiAccess,
    ) -> None:
        self.record, self._access = Events(), access
        self._owners, self._records = list[Any](), list[Any]()
        self._ticking = [v for v in variables.values() if v.type == CLOCK]
        self._clocked = [v for v in variables.values() if _has_value_between_ticks(v)]
        # output clocks come first: after an update, C asks each of them whether it ticks
        outputs = [int(v.valueReference) for v in self._ticking if v.causality != "input"]
        self._references = list(dict.fromkeys([*outputs, *(int(v.valueReference) for v in self._ticking)]))
        self._positions = {reference: i for i, reference in enumerate(self._references)}
        self._clock_list = list[int]()
        is_waiting = np.array([is_clocked(v) or v.type == CLOCK for v in inputs], dtype=bool)
        is_smooth = np.array([v.variability == "continuous" for v in inputs], dtype=bool)
        is_discrete = ~is_smooth & has_event_mode & ~is_waiting
        self.discrete = np.flatnonzero(is_discrete)
        self.continuous = self._make_setters(inputs, np.flatnonzero(~is_discrete & ~is_waiting))
        self._discrete_setters = self._make_setters(inputs, self.discrete)
        self._fill_memory(len(clocks))
        self._fill_clocks(inputs, clocks, len(set(outputs)))
        self._fill_calls(inputs, [i for i, v in enumerate(inputs) if is_clocked(v) and v.type != CLOCK])
        self._list_size = len(self._clock_list)
        self.record.has_event_mode, self.record.first_return = has_event_mode, math.nan
        self.set_by_hand([])
        self.restart(math.nan)

    @property
    def arrays(self) -> list[NDArray[Any]]:
        """Return all memory to which the record points."""
        arrays = [x for x in self._owners if isinstance(x, np.ndarray)]
        return [*arrays, self.memory, *self._by_hand[:2]]

    @property
    def address(self) -> int:
        """Return the address of the record."""
        return ctypes.addressof(self.record)

    def restart(self, time: float) -> None:
        """Forget all events; the next initialization begins at a time in s."""
        self.memory[:] = math.nan
        self.memory[NEXT_EVENT], self._counts[:] = math.inf, 0.0
        self.record.time = time

    def bind(self, component: int, inputs: Vector) -> None:
        """Use this instance of the FMU, by address, and this memory of its inputs."""
        self.record.component, self.record.inputs = component, inputs.ctypes.data
        for records in self._records:
            calls = records["call"] if records.dtype == CLOCKED_CALL else records
            calls["component"] = component

    def find_positions(self, variables: Sequence[ModelVariable]) -> NDArray[np.intp]:
        """Return the positions of clocked variables and clocks in the memory; -1 for others."""
        return np.array([self._state_positions.get(v.name, -1) for v in variables], dtype=np.intp)

    def make_copy_group(self, slots: NDArray[np.intp], targets: NDArray[np.intp]) -> TypeGroup:
        """Return a group that copies numbers from these positions of the memory to targets in a vector."""
        return TypeGroup(
            call="",
            elements=targets,
            references=np.empty(0, dtype=np.uint32),
            values=self.memory,
            slots=slots,
            boolean=False,
            function=lambda *_: 0,
            arguments=(),
        )

    def set_by_hand(self, setters: Sequence[tuple[ModelVariable, Callable[[], int]]]) -> None:
        """Let these functions set their variables whenever a clock of theirs ticks; they return a status.

        They replace those of earlier calls, also of `hold_inputs`.
        """
        del self._clock_list[self._list_size :]
        calls = np.zeros(len(setters), CLOCKED_CALL)
        functions = [_FMI_FUNCTION(lambda *_, do=do: do()) for _, do in setters]
        for record, (variable, _), function in zip(calls, setters, functions, strict=True):
            record["call"]["function"] = ctypes.cast(function, ctypes.c_void_p).value
            record["call"]["is_version_3"] = True
            record["clocks"] = self._add_clocks(clocks_of(variable))
        self._use_by_hand(calls, functions)

    def _use_by_hand(self, calls: NDArray[Any], owners: Sequence[Any]) -> None:
        """Let the stepper do these calls at ticks instead of earlier ones; `owners` must not be freed."""
        clock_list = np.array(self._clock_list, dtype=np.int32)
        self._by_hand = calls, clock_list, owners  # which C knows by address only
        self.record.hand_setters, self.record.hand_setter_count = calls.ctypes.data, len(calls)
        self.record.listed = clock_list.ctypes.data

    def hold_inputs(self, variables: Sequence[ElementVariable]) -> dict[str, NDArray[Any]]:
        """Return memory by name; these variables are set to its values whenever a clock of theirs ticks."""
        del self._clock_list[self._list_size :]
        arrays = {int(v.valueReference): v for v in variables}  # arrays are set as a whole
        calls, values_by_reference = np.zeros(len(arrays), CLOCKED_CALL), dict[int, NDArray[Any]]()
        for record, (reference, variable) in zip(calls, arrays.items(), strict=True):
            (group,) = TypedValues("set", [variable], self._access.functions, self._access.arrays).groups
            group.values[:] = allocate_array(variable)
            values_by_reference[reference] = group.values
            self._fill_call(record["call"], group)
            record["call"]["item_count"] = 0  # its memory has the values already
            record["call"]["component"] = self.record.component
            record["clocks"] = self._add_clocks(clocks_of(variable))
        self._use_by_hand(calls, [])
        return {str(v.name): values_by_reference[int(v.valueReference)] for v in variables}

    @property
    def setters(self) -> tuple[TypedValues, ...]:
        """Return what sets inputs in step mode, in event mode and at ticks."""
        return self.continuous, self._discrete_setters, self._clocked_setters

    def name_clock(self, clock: int) -> str:
        """Return the name of a clock by its position."""
        return self._get_name(self._references[clock])

    def describe_needed(self, clock: int) -> str:
        """Return the names of the clocks of which one must tick whenever this clock ticks."""
        return " or ".join(self._get_name(c) for c in sorted(self._needed[self._references[clock]]))

    def _get_name(self, reference: int) -> str:
        names = {int(v.valueReference): str(v.name) for v in self._ticking}
        return names.get(reference, f"clock {reference}")

    def _find_position(self, clock: ModelVariable) -> int:
        return self._positions[int(clock.valueReference)]

    def _keep(self, values: NDArray[Any]) -> int:
        """Keep an array, and return its address."""
        self._owners.append(values)
        return int(values.ctypes.data)

    def _make_setters(self, inputs: Sequence[ModelVariable], elements: NDArray[np.intp]) -> TypedValues:
        """Return what sets the inputs at these positions."""
        variables = [inputs[i] for i in elements]
        return TypedValues("set", variables, self._access.functions, self._access.arrays, elements)

    def _add_clocks(self, references: Sequence[int]) -> tuple[int, int]:
        """Add clocks to the list, and return where they begin there and how many they are."""
        first = len(self._clock_list)
        self._clock_list += [self._positions.get(reference, -1) for reference in references]
        return first, len(references)

    def _fill_memory(self, clocks: int) -> None:
        """Make the memory, for this number of clocks that tick at times, and fill in its addresses."""
        record, sizes = self.record, (len(self.discrete), TICKS_SIZE * clocks, len(self._clocked))
        first, self._first_value, self.first_count = (int(n) for n in FIRST_PASSED + np.cumsum(sizes))
        self._state_positions = {v.name: i for i, v in enumerate(self._clocked, self._first_value)}
        self._state_positions |= {v.name: self.first_count + self._find_position(v) for v in self._ticking}
        self.memory = np.empty(self.first_count + len(self._references))
        self.passed, self._counts = self.memory[FIRST_PASSED:first], self.memory[self.first_count :]
        record.memory, record.memory_size = self._keep(self.memory), len(self.memory)
        record.passed, record.schedule = self.passed.ctypes.data, self.memory[first:].ctypes.data
        record.values, record.counts = self.memory[self._first_value :].ctypes.data, self._counts.ctypes.data
        for name, kind in (("marks", np.uint8), ("active", np.bool_), ("references", np.uint32)):
            setattr(record, name, self._keep(np.zeros(len(self._references), dtype=kind)))

    def _fill_clocks(
        self, inputs: Sequence[ModelVariable], clocks: Sequence[InputClock], outputs: int
    ) -> None:
        """Fill in the functions, the clocks, and on which others they depend."""
        record, addresses = self.record, [self._access.addresses[name] for name in FUNCTIONS]
        record.functions[:], record.codes[:] = addresses, [self._access.codes[name] for name in FUNCTIONS]
        record.clocks = self._keep(np.array(self._references, dtype=np.uint32))
        record.clock_count, record.output_clock_count = len(self._references), outputs
        depending = [v for v in self._ticking if v.causality == "input" and v.clocks]
        self._needed = {int(v.valueReference): set(clocks_of(v)) for v in depending}
        needed = [self._add_clocks(sorted(self._needed.get(r, ()))) for r in self._references]
        record.needed = self._keep(np.array(needed, dtype=CLOCK_SET))
        timed = [
            (
                math.nan if c.interval is None else c.interval,
                c.shift,
                self._positions[c.reference],
                _find_kind(c),
            )
            for c in clocks
        ]
        record.timed, record.timed_count = self._keep(np.array(timed, dtype=TIMED_CLOCK)), len(timed)
        triggered = [(self._find_position(v), i) for i, v in enumerate(inputs) if is_triggered_input(v)]
        record.triggered = self._keep(np.array(triggered, dtype=TRIGGERED_CLOCK))
        record.triggered_count = len(triggered)

    def _fill_calls(self, inputs: Sequence[ModelVariable], waiting: list[int]) -> None:
        """Fill in the calls that set and get values; `waiting` are the positions of clocked inputs."""
        record = self.record
        record.discrete = self._keep(self.discrete.astype(np.int32))
        record.discrete_count = len(self.discrete)
        calls = np.zeros(len(self._discrete_setters.groups), CALL)
        for call, group in zip(calls, self._discrete_setters.groups, strict=True):
            self._fill_call(call, group)
        record.discrete_setters, record.discrete_setter_count = self._keep(calls), len(calls)
        self._records.append(calls)
        waiting_elements = np.array(waiting, dtype=np.intp)
        self._clocked_setters = self._make_setters(inputs, waiting_elements)
        clocked_elements = np.arange(len(self._clocked))
        for access, variables, elements in (
            ("set", [inputs[i] for i in waiting], waiting_elements),
            ("get", self._clocked, clocked_elements),
        ):
            calls = self._make_clocked_calls(access, variables, elements)
            setattr(record, f"{access}ters", self._keep(calls))
            setattr(record, f"{access}ter_count", len(calls))
            self._records.append(calls)

    def _make_clocked_calls(
        self, access: str, variables: Sequence[ModelVariable], elements: NDArray[np.intp]
    ) -> NDArray[Any]:
        """Return a call for each type of the variables that belong to the same clocks."""
        sets = [tuple(dict.fromkeys(clocks_of(v))) for v in variables]
        groups = list[tuple[TypeGroup, tuple[int, int]]]()
        for clocks in dict.fromkeys(sets):
            members = [i for i, clock_set in enumerate(sets) if clock_set == clocks]
            functions, arrays = self._access.functions, self._access.arrays
            member_variables = [variables[i] for i in members]
            typed = TypedValues(access, member_variables, functions, arrays, elements[members])
            clock_range = self._add_clocks(clocks)
            groups += [(group, clock_range) for group in typed.groups]
        calls = np.zeros(len(groups), CLOCKED_CALL)
        for call, (group, clock_range) in zip(calls, groups, strict=True):
            self._fill_call(call["call"], group)
            call["clocks"] = clock_range
        return calls

    def _fill_call(self, call: Any, group: TypeGroup) -> None:
        self._owners.append(group)
        fill_typed_call(call, group, self._access.addresses[group.call], self._keep)
        call["is_version_3"], call["code"] = True, self._access.codes[group.call]


def _has_value_between_ticks(variable: ModelVariable) -> bool:
    """Return whether a variable is a number that has the value of its last tick between ticks."""
    if not is_clocked(variable) or variable.causality not in ("output", "local"):
        return False
    return variable.type not in ("String", BINARY, CLOCK)


def _find_kind(clock: InputClock) -> ClockKind:
    if clock.kind in PERIODIC:
        return ClockKind.REPORTED if clock.interval is None else ClockKind.DECLARED
    return ClockKind.COUNTDOWN if clock.kind == COUNTDOWN else ClockKind.CHANGING
