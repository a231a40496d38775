"""The tables of the stepper as C: constants, and records that each instance connects to its memory."""

import ctypes
from bisect import bisect_right
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fmublock.compiling import c_number

from ..master.instances.measured_calls import split_code
from ..stepper.layout import (
    CALL,
    CLOCK_SET,
    CLOCKED_CALL,
    COMBINATION,
    GROUP,
    INPUT,
    INSTANCE,
    OPERATION,
    SIGNAL,
    TERM,
    TIMED_CLOCK,
    TRIGGERED_CLOCK,
    Events,
    Stepper,
)

_TYPES: Mapping[Any, str] = {
    **{np.dtype(name): f"{name}_t" for name in ("int8", "uint8", "int16", "uint16", "int32", "uint32")},
    np.dtype("int64"): "int64_t",
    np.dtype("uint64"): "uint64_t",
    np.dtype("float64"): "double",
    np.dtype("float32"): "float",
    np.dtype("bool"): "unsigned char",
    INPUT: "Input",
    SIGNAL: "Signal",
    OPERATION: "Operation",
    COMBINATION: "Combination",
    TERM: "Term",
    CLOCK_SET: "ClockSet",
    TIMED_CLOCK: "TimedClock",
    TRIGGERED_CLOCK: "TriggeredClock",
}
"""Types of constants in C."""

_POOLS: Mapping[Any, tuple[str, str]] = {
    INSTANCE: ("instances", "FmuInstance"),
    GROUP: ("groups", "Group"),
    CALL: ("calls", "Call"),
    CLOCKED_CALL: ("clocked_calls", "ClockedCall"),
}
"""Arrays of an instance for records with addresses, and their type in C."""

_SCRATCH_FIELDS = {
    *("guess", "sizes", "direction", "earlier", "basis", "residuals", "answers", "kept"),
    *("values", "input_values", "derivatives", "observed", "marks", "active"),
}
"""Fields that point to memory whose content steps do not need later."""

_ADDRESSES = {
    *(name for t in (CALL, INSTANCE, GROUP) for name in t.names or () if t[name] == np.intp),
    *(name for t in (Stepper, Events) for name, kind, *_ in t._fields_ if kind is ctypes.c_void_p),
} - {"code"}
"""Fields that are addresses of memory, besides those of functions and components."""

_CODES = {
    "do_step": "code_step",
    "set_derivatives": "code_derivatives",
    "get_state": "code_save",
    "set_state": "code_restore",
    "get_status": "code_status",
}
"""Fields with functions of an instance, and those with their codes."""

_WORD = 8
"""Bytes of the numbers of which all memory consists."""


@dataclass
class _Region:
    """Memory of a table, and its expression in C.

    Attributes:
        address: where it begins.
        values: the array; None for a record of ctypes, or a function.
        name: the expression in C of its first element; empty until it is known.
        position: position in its pool in C.
    """

    address: int
    size: int
    values: NDArray[Any] | None
    name: str = ""
    position: int = 0


class Image:
    """The tables of a stepper as C.

    All memory is known by its address. What steps change and keep is `saved`, other memory is `room`. Each
    instance fills in the records with addresses; all other tables are constants.

    Functions and instances are known by the codes of their calls, not by their addresses: linkers may give
    several functions one address, and tools may number their instances.

    Args:
        arrays: All arrays to which the tables point.
        functions: Array in C with the functions of each instance, and the beginning of their names.
    """

    def __init__(self, arrays: Iterable[NDArray[Any]], functions: Sequence[tuple[str, str]]) -> None:
        self._functions = functions
        self.constants, self._wires, self._starts = list[str](), list[str](), list[str]()
        self.saved = self.room = 0
        """Sizes of the two memories, in doubles."""
        self.pools = {name: 0 for name, _ in _POOLS.values()}
        self._regions = dict[int, _Region]()
        self._addresses = list[int]()
        self._tables = 0
        for values in arrays:
            self._add_array(values)

    def _add_array(self, values: NDArray[Any]) -> _Region:
        """Return the memory of an array, which is that of the whole array if this is a part of one."""
        # parts of an array point into its memory
        owner = values.base if isinstance(values.base, np.ndarray) else values
        return self._add(_Region(owner.ctypes.data, owner.nbytes, owner))

    def _add(self, region: _Region) -> _Region:
        """Add memory, and return what is known at its address: the larger of the two."""
        existing = self._regions.get(region.address)
        if existing is None or existing.size < region.size:  # an empty region may have the address of another
            self._regions[region.address] = region
            self._addresses = []
        return self._regions[region.address]

    def name(self, address: int, expression: str) -> None:
        """Give a record its expression in C."""
        self._regions.pop(address, None)
        self._add(_Region(address, 0, None, expression))

    def save(self, values: NDArray[Any], first: NDArray[Any] | None = None) -> int:
        """Keep memory that steps change, with these first values; return its position in `saved`."""
        region = self._add_array(values)
        if region.name:
            return region.position
        region.name, region.position = "memory.saved", self.saved
        self.saved += -(-values.nbytes // _WORD)
        if first is not None and first.any():
            name = self._add_constant(first)
            self._starts.append(f"memcpy(&saved[{region.position}], {name}, sizeof {name});")
        return region.position

    def find_position(self, address: int) -> int:
        """Return the position of memory in its pool, such as `calls`."""
        region, offset = self._find(address)
        assert region.values is not None
        self._enter_pool(region)
        return region.position + offset // region.values.itemsize

    def find_position_in_saved(self, address: int) -> int:
        """Return the position of a number in `saved`."""
        region, offset = self._find(address)
        return region.position + offset // _WORD

    def wire(self, target: str, record: Any, kind: str) -> None:
        """Let each instance fill in a record of ctypes, such as `m->stepper`."""
        values = {name: getattr(record, name) for name, *_ in record._fields_}
        self._wires.append(f"{target} = {self._format_record(values, kind)};")

    def add(self, line: str) -> None:
        """Let each instance do something else."""
        self._wires.append(line)

    def point(self, target: str, address: int) -> None:
        """Let each instance fill in an address."""
        self._wires.append(f"{target} = {self._format_address('values', address)};")

    def text(self) -> str:
        """Return the function that fills in the tables of an instance, and the one for its first memory."""
        lines = ["/* Fill in the tables of an instance, which has its own memory. */"]
        lines += ["static void wire(Instance *m) {", *(f"    {line}" for line in self._wires), "}", ""]
        lines += ["/* Set arrays, which FMI sets as a whole, to their start values. */"]
        lines += ["static void begin_arrays(double *saved) {", "    (void)saved;"]
        return "\n".join([*lines, *(f"    {line}" for line in self._starts), "}", ""])

    def _find(self, address: int) -> tuple[_Region, int]:
        """Return the region to which an address belongs, and the distance from its start in bytes."""
        self._addresses = self._addresses or sorted(self._regions)
        index = bisect_right(self._addresses, address) - 1
        region = self._regions[self._addresses[max(index, 0)]]
        offset = address - region.address
        assert 0 <= offset <= region.size, "a table of the stepper points to unknown memory"
        return region, offset

    def _format_address(self, field: str, address: int) -> str:
        """Return an address in C."""
        if address == 0:
            return "NULL"
        region, offset = self._find(address)
        if region.values is None:
            return region.name
        if region.name == "memory.saved" or region.name == "room" or field in _SCRATCH_FIELDS:
            if not region.name:
                region.name, region.position = "room", self.room
                self.room += -(-region.size // _WORD)
            return f"AT({region.name}, {region.position + offset // _WORD})"
        if region.values.dtype in _POOLS:
            self._enter_pool(region)
            return f"&m->{region.name}[{region.position + offset // region.values.itemsize}]"
        if not region.name:
            region.name = self._add_constant(region.values)
        return region.name if offset == 0 else f"{region.name} + {offset // region.values.itemsize}"

    def _enter_pool(self, region: _Region) -> None:
        """Let each instance fill in the records of an array."""
        if region.name or region.values is None:
            return
        name, kind = _POOLS[region.values.dtype]
        region.name, region.position = name, self.pools[name]
        self.pools[name] += len(region.values)
        for position, record in enumerate(region.values, region.position):
            self._wires.append(f"m->{name}[{position}] = {self._format_record(_make_dict(record), kind)};")

    def _format_record(self, values: Mapping[str, Any], kind: str) -> str:
        """Return a record in C."""
        return f"({kind}){{{', '.join(self._format_cell(name, values, kind) for name in values)}}}"

    def _format_cell(self, name: str, values: Mapping[str, Any], kind: str) -> str:
        """Return a member of a record in C."""
        value = values[name]
        if name.startswith("code"):  # of the present call, which has no reader here
            return "{0}" if isinstance(value, ctypes.Array) else "0"
        if name == "component":
            # the address of the component in this process means nothing in another one
            code = values["codes"][0] if kind == "Events" else values["code"]
            return f"m->parts[{split_code(int(code))[0]}]" if value else "NULL"
        if name == "function":
            return self._format_function(values["code"]) if value else "NULL"
        if name == "functions":
            return f"{{{', '.join(map(self._format_function, values['codes']))}}}"
        if name in _CODES:
            return self._format_function(values["code"] + values[_CODES[name]]) if value else "NULL"
        if isinstance(value, ctypes.Array):
            return f"{{{', '.join(map(_format_number, value))}}}"
        if isinstance(value, np.void):
            members = _make_dict(value)
            return self._format_record(members, "Call" if "function" in members else "ClockSet")
        if name in _ADDRESSES:
            is_room = name == "references" and kind == "Events"  # elsewhere, they are constants
            return self._format_address("values" if is_room else name, int(value or 0))
        return _format_number(value)

    def _format_function(self, code: int) -> str:
        """Return the function of a call in C."""
        instance, call = split_code(int(code))
        if not call:  # between components, not to one
            return "(Function)step_texts"
        table, prefix = self._functions[instance]
        return f"{table}[{prefix}_{call[0].upper()}{call[1:]}]"

    def _add_constant(self, values: NDArray[Any]) -> str:
        """Add a constant array, and return its name."""
        name = f"table_{self._tables}"
        self._tables += 1
        self.constants += format_table(_TYPES[values.dtype], name, map(_format_row, values.reshape(-1)))
        return name


def _make_dict(record: Any) -> dict[str, Any]:
    return {name: record[name] for name in record.dtype.names}


def _format_row(value: Any) -> str:
    if isinstance(value, np.void):
        return f"{{{', '.join(map(_format_number, _make_dict(value).values()))}}}"
    return _format_number(value)


def _format_number(value: Any) -> str:
    if isinstance(value, float | np.floating):
        return c_number(float(value))
    return str(int(value))


def format_table(kind: str, name: str, rows: Iterable[str]) -> list[str]:
    """Return a constant array, with one empty element if it has none: C has no empty arrays."""
    listed = list(rows)
    return [f"static const {kind} {name}[] = {{", *(f"    {row}," for row in listed or ["0"]), "};", ""]
