"""Fill the tables of the stepper in C from an algorithm and its network; see `emla_cosim.stepper.layout`."""

import ctypes
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...base import crash_page
from ...fmu.tables import SPANS
from ...stepper.layout import (
    CALL,
    COMBINATION,
    EFFORT,
    FIRST_STORE,
    GROUP,
    INPUT,
    INSTANCE,
    OPERATION,
    PREVIOUS,
    SIGNAL,
    SIGNALS,
    TERM,
    Call,
    Stepper,
)
from ..algorithms import program
from ..algorithms.algorithm import Algorithm
from ..algorithms.extrapolation import Mode
from ..algorithms.group import HALVINGS, SWEEPS, CoupledGroup
from ..algorithms.program import overlap_steps
from ..instances.fmu_instance import EntryPoints, GroupCall
from ..instances.measured_calls import CALLS, code_of
from ..instances.python_calls import PythonCalls
from ..instances.typed_values import fill_typed_call
from .saved_states import SavedStates


def list_entry_points(algorithm: Algorithm) -> list[EntryPoints]:
    """Return the functions that the stepper calls, by instance: those of its FMU, or functions of Python."""
    split = set(algorithm.split_steps)
    return [
        instance.entry_points() or PythonCalls().entry_points(instance, i in split)
        for i, instance in enumerate(algorithm.network.instances)
    ]


class StepperTables:
    """The tables of a stepper, and the arrays that they point to.

    Args:
        algorithm: An algorithm after `setup`.
        points: Addresses of the FMI functions, per instance.

    Attributes:
        stepper: The record that the functions in C get.
        states: The places of the states that groups save.
        residuals: Per group, a buffer for the residuals of all sweeps.
        instances: The records of the instances.
        inputs: The records of all inputs.
        operations: The records of the operations of a step.
        groups: The records of the groups.
        efforts: The records of measured calls, per instance; an instance has none unless it is measured.
        stores: The addresses of the vectors of the program.
        passing: What passes Strings and Binary values on before each step; None without any.
    """

    def __init__(self, algorithm: Algorithm, points: Sequence[EntryPoints]) -> None:
        self._algorithm, self._points = algorithm, points
        self._owners: list[Any] = [points]  # owners of memory whose addresses are in the tables
        self.passing = PythonCalls() if algorithm.network.opaque_links else None
        self.states = SavedStates(points)
        self.efforts = np.zeros(len(points), EFFORT)
        self.residuals = list[NDArray[Any]]()
        self.stepper = Stepper()
        self._fill()

    @property
    def arrays(self) -> list[NDArray[Any]]:
        """Return all arrays to which the tables point."""
        references = [[p.input_references, p.output_references, p.derivative_orders] for p in self._points]
        arrays = [x for x in self._owners if isinstance(x, np.ndarray)]
        return [*arrays, *self.states.event_memory, *(array for group in references for array in group)]

    def _keep(self, values: Any) -> int:
        """Keep an array, and return its address."""
        self._owners.append(values)
        return int(values.ctypes.data)

    def _fill(self) -> None:
        """Make all records, and fill in the stepper."""
        algorithm, network, stepper = self._algorithm, self._algorithm.network, self.stepper
        history, observer = algorithm.exchange.history, network.observer
        vectors = [network.signals, history.previous, *algorithm.stores.values()]
        self._positions = {program.SIGNALS: SIGNALS, program.PREVIOUS: PREVIOUS}
        self._positions |= {name: FIRST_STORE + n for n, name in enumerate(algorithm.stores)}
        self.instances, self.inputs = self._make_instances(), self._make_inputs()
        stepper.instances, stepper.inputs = self._keep(self.instances), self._keep(self.inputs)
        signals = np.zeros(len(network.signals), SIGNAL)
        signals["floor"], signals["instance"] = algorithm.scale.floor, algorithm.exchange.owners
        signals["is_smooth"] = algorithm.exchange.smooth
        stepper.signals = self._keep(signals)
        self.groups = self.list_groups(algorithm.groups)
        stepper.groups, stepper.group_count = self._keep(self.groups), len(algorithm.groups)
        self._fill_program()
        stepper.read, stepper.read_count = self._keep(network.read.astype(np.int32)), len(network.read)
        stepper.follows = self._keep(algorithm.exchange.follows)  # filled in when the run begins
        observers = self._make_observers()
        stepper.observers, stepper.observer_count = self._keep(observers), len(observers)
        stepper.observed, stepper.observed_count = self._keep(observer.values), len(observer.values)
        stepper.coupling_tolerance = algorithm.coupling_tolerance
        stepper.sweep_limit, stepper.halving_limit = SWEEPS, HALVINGS
        stepper.signal_count, stepper.last_point = len(network.signals), math.inf
        self.stores = np.array([v.ctypes.data for v in vectors], dtype=np.intp)
        stepper.stores = self._keep(self.stores)
        stepper.at, stepper.before = history.at.ctypes.data, history.before.ctypes.data
        stepper.taken, stepper.taken_at = history.last_read.ctypes.data, history.last_read_at.ctypes.data
        stepper.input_values = self._keep(network.inputs)
        stepper.derivatives = self._keep(algorithm.exchange.derivatives)
        stepper.first_span = (
            FIRST_STORE + len(algorithm.stores) - (len(SPANS) if algorithm.known_sources else 0)
        )
        stepper.largest = algorithm.scale.largest.ctypes.data
        stepper.activity = ctypes.addressof(crash_page.current_activity())

    def _fill_program(self) -> None:
        """Fill in the operations, and the combinations with their terms."""
        algorithm, groups, rows = self._algorithm, 0, list[tuple[int, ...]]()
        combinations, terms = list[tuple[int, ...]](), list[tuple[float, int, int]]()
        if self.passing is not None:
            rows.append((1, Call.STEP, len(self._points), 0, 0))
        for instruction in (
            algorithm.program[: len(algorithm.groups)] if algorithm.is_plain else algorithm.program
        ):
            if isinstance(instruction, program.Operation):
                rows.append(self._make_row(instruction))
            elif isinstance(instruction, program.Solve):
                rows.append((1, Call.SOLVE, groups, 0, 0))
                groups += 1
            else:
                rows.append((1, Call.COMBINE, len(combinations), 0, 0))
                into, count = self._positions[instruction.into], len(instruction.terms)
                combinations.append((instruction.instance, into, len(terms), count))
                terms += [(factor, self._positions[name], 0) for name, factor in instruction.terms.items()]
        rows += self._make_rows(algorithm.operations) if algorithm.is_plain else []
        stepper, self.operations = self.stepper, np.array(rows, dtype=OPERATION)
        stepper.operations, stepper.operation_count = self._keep(self.operations), len(rows)
        stepper.combinations = self._keep(np.array(combinations, dtype=COMBINATION))
        stepper.terms = self._keep(np.array(terms, dtype=TERM))

    def _make_row(self, operation: program.Operation, is_end: bool = False) -> tuple[int, ...]:
        multiple, store = int(self._algorithm.multiples[operation.instance]), self._positions[operation.store]
        return multiple, Call.END if is_end else int(operation.call), operation.instance, store, 0

    def _make_rows(self, operations: Sequence[program.Operation]) -> list[tuple[int, ...]]:
        """Return the rows of operations, in an order in which steps in other processes overlap."""
        split = {i for i, p in enumerate(self._points) if p.end_step}
        return [
            self._make_row(*entry) for entry in overlap_steps(self._algorithm.exchange, operations, split)
        ]

    def _make_inputs(self) -> Any:
        """Return the INPUT records: what each input reads, and how this is transformed."""
        network, exchange = self._algorithm.network, self._algorithm.exchange
        records = np.zeros(len(network.inputs), INPUT)
        records["signal"] = signals = np.concatenate([np.empty(0, dtype=np.intp), *network.sources])
        records["factor"] = np.concatenate([np.empty(0), *network.factors])
        records["offset"] = np.concatenate([np.empty(0), *network.offsets])
        movable = np.concatenate([np.empty(0, dtype=bool), *(s.continuous_inputs for s in network.instances)])
        records["moves"] = exchange.smooth[signals] & movable
        records["known"] = np.concatenate([np.empty(0, dtype=np.intp), *exchange.readings])
        return records

    def _make_instances(self) -> Any:
        """Return the INSTANCE records, with a last one that passes on texts if there are any."""
        network, exchange, points = self._algorithm.network, self._algorithm.exchange, self._points
        saved = {i for group in self._algorithm.groups if group.is_saved for i in group.members}
        records, indices = np.zeros(len(points), INSTANCE), range(len(points))
        for name in ("component", "do_step", "get_state", "set_state", "get_status", "end_step", "events"):
            records[name] = [getattr(p, name) for p in points]
        records["set_derivatives"] = [p.set_real_input_derivatives for p in points]
        records["references"] = [p.input_references.ctypes.data for p in points]
        records["orders"] = [p.derivative_orders.ctypes.data for p in points]
        records["end"] = [0 if p.step_end is None else p.step_end.address for p in points]
        records["is_version_3"] = [p.step_end is not None for p in points]
        states = self.states.records
        records["state"] = states.ctypes.data + states.itemsize * np.arange(len(points))
        records["code"] = [code_of(i, "") for i in indices]
        numbers = {name: n for n, name in enumerate(CALLS)}
        records["code_derivatives"] = numbers["setRealInputDerivatives"]
        records["code_step"], records["code_status"] = numbers["doStep"], numbers["getBooleanStatus"]
        records["code_save"] = [numbers[p.names.save] for p in points]
        records["code_restore"] = [numbers[p.names.restore] for p in points]
        for kind, parts in (("input", network.input_parts), ("output", network.parts)):
            records[f"first_{kind}"] = [part.start for part in parts]
            records[f"{kind}_count"] = [part.stop - part.start for part in parts]
        records["mode"], records["is_rare"] = exchange.modes, exchange.rare
        records["is_held"] = [
            m == Mode.HOLD and not exchange.reads_known_signal(i) for i, m in enumerate(exchange.modes)
        ]
        records["has_slopes"] = [exchange.has_slopes(i) for i in indices]
        # an FMU may drop what it needs to go back, unless a group restores its state
        records["has_no_way_back"] = [i not in saved for i in indices]
        self._fill_calls(records)
        if self.passing is None:
            return records
        passing = np.zeros(1, INSTANCE)  # one that only steps
        passing["do_step"] = self.passing.make_step(network.pass_opaque_values)
        return np.concatenate([records, passing])

    def _fill_calls(self, records: Any) -> None:
        """Make the calls that set inputs and get outputs: all in one array, as they are read one by one."""
        records_of_calls = list[Any]()
        first = np.zeros((len(records), 2), dtype=np.intp)
        for i, points in enumerate(self._points):
            first[i, 0] = len(records_of_calls)
            records_of_calls.extend(self._make_calls(i, points, "set"))
            first[i, 1] = len(records_of_calls)
            records_of_calls.extend(self._make_calls(i, points, "get"))
        calls = np.array(records_of_calls, dtype=CALL)
        address = self._keep(calls)
        records["setters"], records["getters"] = address + calls.itemsize * first.T
        records["setter_count"] = first[:, 1] - first[:, 0]
        records["getter_count"] = np.append(first[1:, 0], len(calls)) - first[:, 1]

    def list_calls(self, i: int, points: EntryPoints, access: str) -> NDArray[Any]:
        """Return further CALL records that `set` the inputs, or `get` the outputs, of an instance."""
        calls = np.array(self._make_calls(i, points, access), dtype=CALL)
        self._keep(calls)
        return calls

    def _make_calls(self, i: int, points: EntryPoints, access: str) -> Sequence[Any]:
        """Return the CALL records that set the inputs, or get the outputs, of an instance."""
        network, sets = self._algorithm.network, access == "set"
        vector = network.inputs if sets else network.signals
        first = (network.input_parts if sets else network.parts)[i].start
        typed = points.setters if sets else points.getters
        if typed is not None:
            return self._make_typed_calls(i, points, typed, first)
        references = points.input_references if sets else points.output_references
        count = len(network.inputs[network.input_parts[i]] if sets else network.signals[network.parts[i]])
        calls = [self._make_real_call(i, points, access, references, vector[first : first + count])]
        if not sets and i in self._algorithm.known_sources:
            for span, span_references in zip(SPANS, network.instances[i].span_references, strict=False):
                values = self._algorithm.stores[f"{span} of step"][first : first + count]
                self._owners.append(span_references)
                calls.append(self._make_real_call(i, points, access, span_references, values))
        return calls if count else []

    def _make_real_call(
        self, i: int, points: EntryPoints, access: str, references: NDArray[np.uint32], values: NDArray[Any]
    ) -> Any:
        """Return the CALL record for doubles that need no conversion."""
        sets, record = access == "set", np.zeros((), CALL)
        record["function"] = points.set_real if sets else points.get_real
        record["component"], record["instance"] = points.component, i
        record["references"], record["reference_count"] = references.ctypes.data, len(references)
        record["values"], record["value_count"] = values.ctypes.data, len(values)
        record["code"] = code_of(i, getattr(points.names, access))
        record["is_version_3"] = points.step_end is not None
        return record

    def _make_typed_calls(self, i: int, points: EntryPoints, calls: Sequence[GroupCall], first: int) -> Any:
        """Return the CALL records of values whose vector begins at `first` in that of the stepper."""
        records = np.zeros(len(calls), CALL)
        for record, (function, group) in zip(records, calls, strict=True):
            fill_typed_call(record, group, function, self._keep, first)
        records["component"], records["instance"] = points.component, i
        records["is_version_3"] = points.step_end is not None
        records["code"] = [code_of(i, group.call) for _, group in calls]
        return records

    def _make_observers(self) -> Any:
        """Return the CALL records that get the observed variables."""
        network, getters = self._algorithm.network, list[Any]()
        positions = {name: i for i, stepped in enumerate(network.instances) for name in stepped.components}
        for instance, part in network.observer.readers:
            i = positions[instance.name]
            points = self._points[i]
            if points.calls is None:
                getters += list(self._make_typed_calls(i, points, instance.observed_groups(), part.start))
                continue
            record = np.zeros((), CALL)
            record["function"], record["instance"] = points.calls.make_getter(instance.get_observed), i
            getters.append(record)
        return np.array(getters, dtype=CALL)

    def list_groups(self, groups: Sequence[CoupledGroup]) -> NDArray[Any]:
        """Return the GROUP records of groups, and add a buffer for each to `residuals`."""
        parts = self._algorithm.network.parts
        records = np.zeros(len(groups), GROUP)
        for record, group in zip(records, groups, strict=True):
            n = len(group.coupling_variables)
            record["members"] = self._keep(np.array(group.members, dtype=np.int32))
            record["coupling"] = self._keep(group.coupling_variables.astype(np.int32))
            rows = np.array(self._make_rows(group.operations), dtype=OPERATION)
            record["operations"], record["operation_count"] = self._keep(rows), len(rows)
            record["jacobian"] = self._keep(group.jacobian)
            self.residuals.append(np.zeros(SWEEPS * n))
            record["residuals"] = self._keep(self.residuals[-1])
            buffer_sizes = {"guess": n, "sizes": n, "direction": n, "earlier": n * n, "basis": n * n}
            buffer_sizes["answers"] = SWEEPS * n
            buffer_sizes["kept"] = sum(2 * (parts[i].stop - parts[i].start) + 2 for i in group.members)
            for name, size in buffer_sizes.items():
                record[name] = self._keep(np.zeros(size))
            record["member_count"], record["coupling_count"] = len(group.members), n
            record["is_saved"], record["is_halved"] = group.is_saved, group.is_halved
        return records
