"""Fill the tables of the stepper in C from an algorithm and its network; see `emla_cosim.stepper.layout`."""

import ctypes
from collections.abc import Sequence
from typing import Any

import numpy as np

from ...sandbox import black_box
from ...stepper.layout import (
    CALL,
    COMBINATION,
    FIRST_STORE,
    GROUP,
    INPUT,
    INSTANCE,
    OPERATION,
    PREVIOUS,
    SIGNAL,
    SIGNALS,
    TERM,
    TRUTH_OF_FMI_2,
    TYPES,
    Call,
    Stepper,
)
from ..algorithms import program
from ..algorithms.group import HALVINGS, SWEEPS
from ..algorithms.operation_table import OperationTableAlgorithm
from ..instances.call_codes import CALLS, code_of
from ..instances.fmu_instance import EntryPoints, GroupCall, ObservedGroup
from ..instances.typed_values import TypeGroup


class StepperTables:
    """The tables of a stepper, and the arrays that they point to.

    Args:
        algorithm: An algorithm after `setup`.
        points: Addresses of the FMI functions, per instance.

    Attributes:
        stepper: The record that the functions in C get.
        states: Addresses of the saved states, per instance.
        residuals: Per group, room for the residuals of all sweeps.
    """

    def __init__(self, algorithm: OperationTableAlgorithm, points: Sequence[EntryPoints]) -> None:
        self._algorithm, self._points = algorithm, points
        self._held: list[Any] = [points]  # owners of memory whose addresses are in the tables
        self.states = np.zeros(len(points), dtype=np.uintp)
        self.residuals = [np.zeros(SWEEPS * len(g.coupling_variables)) for g in algorithm.groups]
        self.stepper = Stepper()
        self._fill()

    def _keep(self, values: Any) -> int:
        """Keep an array, and return its address."""
        self._held.append(values)
        return int(values.ctypes.data)

    def _fill(self) -> None:
        algorithm, network, stepper = self._algorithm, self._algorithm.network, self.stepper
        history, observer = algorithm.exchange.history, network.observer
        vectors = [network.signals, history.previous, *algorithm.stores.values()]
        self._positions = {program.SIGNALS: SIGNALS, program.PREVIOUS: PREVIOUS}
        self._positions |= {name: FIRST_STORE + n for n, name in enumerate(algorithm.stores)}
        stepper.instances = self._keep(self._instances())
        stepper.inputs, stepper.signals = self._keep(self._inputs()), self._keep(self._signals())
        stepper.groups, stepper.group_count = self._keep(self._groups()), len(algorithm.groups)
        self._fill_program()
        stepper.read, stepper.read_count = self._keep(network.read.astype(np.int32)), len(network.read)
        observers = self._observers()
        stepper.observers, stepper.observer_count = self._keep(observers), len(observers)
        stepper.observed, stepper.observed_count = observer.values.ctypes.data, len(observer.values)
        stepper.coupling_tolerance = algorithm.coupling_tolerance
        stepper.sweep_limit, stepper.halving_limit = SWEEPS, HALVINGS
        stepper.signal_count = len(network.signals)
        stepper.stores = self._keep(np.array([v.ctypes.data for v in vectors], dtype=np.intp))
        stepper.at, stepper.before = history.at.ctypes.data, history.before.ctypes.data
        stepper.taken, stepper.taken_at = history.taken.ctypes.data, history.taken_at.ctypes.data
        stepper.input_values = network.inputs.ctypes.data
        stepper.derivatives = algorithm.exchange.derivatives.ctypes.data
        stepper.largest = algorithm.scale.largest.ctypes.data
        stepper.activity = ctypes.addressof(black_box.current_activity())

    def _fill_program(self) -> None:
        """Fill in the operations, and the combinations with their terms."""
        algorithm, combinations, terms = (
            self._algorithm,
            list[tuple[int, ...]](),
            list[tuple[float, int, int]](),
        )
        rows, groups = list[tuple[int, ...]](), 0
        for each in algorithm.program:
            if isinstance(each, program.Operation):
                every, store = int(algorithm.multiples[each.instance]), self._positions[each.store]
                rows.append((int(each.call), each.instance, every, store))
            elif isinstance(each, program.Solve):
                rows.append((Call.SOLVE, groups, 1, 0))
                groups += 1
            else:
                rows.append((Call.COMBINE, len(combinations), 1, 0))
                into, count = self._positions[each.into], len(each.terms)
                combinations.append((each.instance, into, len(terms), count))
                terms += [(factor, self._positions[name], 0) for name, factor in each.terms.items()]
        stepper = self.stepper
        stepper.operations, stepper.operation_count = self._keep(np.array(rows, dtype=OPERATION)), len(rows)
        stepper.combinations = self._keep(np.array(combinations, dtype=COMBINATION))
        stepper.terms = self._keep(np.array(terms, dtype=TERM))

    def _inputs(self) -> Any:
        network, exchange = self._algorithm.network, self._algorithm.exchange
        records = np.zeros(len(network.inputs), INPUT)
        records["signal"] = signals = np.concatenate([np.empty(0, dtype=np.intp), *network.sources])
        records["factor"] = np.concatenate([np.empty(0), *network.factors])
        records["offset"] = np.concatenate([np.empty(0), *network.offsets])
        movable = np.concatenate([np.empty(0, dtype=bool), *(s.continuous_inputs for s in network.instances)])
        records["moves"] = exchange.smooth[signals] & movable
        return records

    def _signals(self) -> Any:
        exchange, records = self._algorithm.exchange, np.zeros(len(self._algorithm.network.signals), SIGNAL)
        records["floor"], records["instance"] = self._algorithm.scale.floor, exchange.owners
        records["is_smooth"] = exchange.smooth
        return records

    def _instances(self) -> Any:
        network, exchange = self._algorithm.network, self._algorithm.exchange
        saved = {i for group in self._algorithm.groups if group.start is not None for i in group.members}
        records = np.zeros(len(self._points), INSTANCE)
        for i, (record, p) in enumerate(zip(records, self._points, strict=True)):
            inputs, outputs = network.input_parts[i], network.parts[i]
            record["component"], record["do_step"] = p.component, p.do_step
            record["set_derivatives"] = p.set_real_input_derivatives
            record["get_state"], record["set_state"] = p.get_state, p.set_state
            record["get_status"] = p.get_status
            record["references"] = p.input_references.ctypes.data
            record["orders"] = p.derivative_orders.ctypes.data
            record["end"] = 0 if p.step_end is None else p.step_end.address
            record["is_version_3"] = p.step_end is not None
            record["state"] = self.states[i : i + 1].ctypes.data
            for access, vector, part, references, calls in (
                ("set", network.inputs, inputs, p.input_references, p.setters),
                ("get", network.signals, outputs, p.output_references, p.getters),
            ):
                count = part.stop - part.start
                rows = self._calls(i, p, access, vector, part.start, count, references, calls)
                record[f"{access}ters"], record[f"{access}ter_count"] = self._keep(rows), len(rows)
            record["code"] = code_of(i, "")
            record["code_derivatives"] = CALLS.index("setRealInputDerivatives")
            record["code_step"], record["code_status"] = (
                CALLS.index("doStep"),
                CALLS.index("getBooleanStatus"),
            )
            record["code_save"], record["code_restore"] = (
                CALLS.index(p.names.save),
                CALLS.index(p.names.restore),
            )
            record["first_input"], record["input_count"] = inputs.start, inputs.stop - inputs.start
            record["first_output"], record["output_count"] = outputs.start, outputs.stop - outputs.start
            record["mode"], record["is_rare"] = exchange.modes[i], exchange.rare[i]
            record["has_no_way_back"] = i not in saved
        return records

    def _calls(
        self,
        i: int,
        points: EntryPoints,
        access: str,
        vector: Any,
        first: int,
        count: int,
        references: Any,
        calls: Sequence[GroupCall] | None,
    ) -> Any:
        """Return the CALL records that set the inputs, or get the outputs, of an instance."""
        if calls is not None:
            return self._typed_calls(i, points, calls, first)
        records = np.zeros(1 if count else 0, CALL)
        records["function"] = points.set_real if access == "set" else points.get_real
        records["component"], records["instance"] = points.component, i
        records["references"], records["reference_count"] = references.ctypes.data, len(references)
        records["values"], records["value_count"] = vector.ctypes.data + 8 * first, count
        records["code"] = code_of(i, getattr(points.names, access))
        records["is_version_3"] = points.step_end is not None
        return records

    def _typed_calls(self, i: int, points: EntryPoints, calls: Sequence[GroupCall], first: int) -> Any:
        records = np.zeros(len(calls), CALL)
        for record, (function, group) in zip(records, calls, strict=True):
            self._fill_typed(record, group, function, first)
        records["component"], records["instance"] = points.component, i
        records["is_version_3"] = points.step_end is not None
        records["code"] = [code_of(i, group.call) for _, group in calls]
        return records

    def _fill_typed(self, record: Any, group: TypeGroup, function: int, first: int) -> None:
        places = np.arange(len(group.values)) if isinstance(group.places, slice) else group.places
        record["function"] = function
        record["references"], record["reference_count"] = group.references.ctypes.data, len(group.references)
        record["values"], record["value_count"] = self._keep(group.values), len(group.values)
        record["items"] = self._keep((group.elements + first).astype(np.int32))
        record["places"], record["item_count"] = self._keep(places.astype(np.int32)), len(group.elements)
        is_truth = group.boolean and group.values.dtype.name != "bool"
        record["type"] = TRUTH_OF_FMI_2 if is_truth else TYPES.index(group.values.dtype.name)

    def _observers(self) -> Any:
        """Return the CALL records that get the observed variables."""
        network, found = self._algorithm.network, list[Any]()
        for instance, part in network.observer.readers:
            i = network.instances.index(instance)
            for group in instance.observed_groups():
                record = np.zeros((), CALL)
                self._fill_observed(record, group, part.start)
                record["component"], record["instance"] = group.component, i
                record["code"] = code_of(i, group.call)
                found.append(record)
        return np.array(found, dtype=CALL)

    def _fill_observed(self, record: Any, group: ObservedGroup, first: int) -> None:
        self._held.append(group)
        if group.group is not None:
            self._fill_typed(record, group.group.group, group.function, first)
            record["is_version_3"] = True
            return
        count, kind = len(group.targets), group.values.dtype.name
        record["function"] = group.function
        record["references"], record["reference_count"] = group.references.ctypes.data, len(group.references)
        record["values"], record["value_count"] = self._keep(group.values), count
        record["items"] = self._keep((group.targets + first).astype(np.int32))
        record["places"], record["item_count"] = self._keep(np.arange(count, dtype=np.int32)), count
        record["type"] = TRUTH_OF_FMI_2 if group.boolean else TYPES.index(kind)

    def _groups(self) -> Any:
        parts = self._algorithm.network.parts
        records = np.zeros(len(self._algorithm.groups), GROUP)
        for record, group, residuals in zip(records, self._algorithm.groups, self.residuals, strict=True):
            n = len(group.coupling_variables)
            record["members"] = self._keep(np.array(group.members, dtype=np.int32))
            record["coupling"] = self._keep(group.coupling_variables.astype(np.int32))
            record["jacobian"] = self._keep(group.newton.jacobian)
            record["residuals"] = self._keep(residuals)
            room = {"guess": n, "sizes": n, "direction": n, "earlier": n * n, "basis": n * n}
            room["answers"] = SWEEPS * n
            room["kept"] = sum(2 * (parts[i].stop - parts[i].start) + 2 for i in group.members)
            for name, size in room.items():
                record[name] = self._keep(np.zeros(size))
            record["member_count"], record["coupling_count"] = len(group.members), n
            record["is_saved"], record["is_halved"] = group.start is not None, group.halves
        return records
