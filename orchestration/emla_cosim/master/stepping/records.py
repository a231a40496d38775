"""Fill the records for compiled code from an algorithm and its network; see `record_layout`."""

import ctypes
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ...base.arrays import Indices
from ...sandbox import crash_page
from ..algorithms.group import SWEEPS, CoupledGroup
from ..algorithms.operation_table import OperationTableAlgorithm
from ..algorithms.scale import Scale
from ..algorithms.tasks import StepTask
from ..instances.call_codes import code_of
from ..instances.fmu_instance import CallNames, EntryPoints
from ..network import Network
from .forwarding import forward_observed
from .record_layout import GROUP, INPUT, INSTANCE, LANE, OBSERVED, OPERATION, TASK

KeptArrays = Callable[[Any], Any]
"""Keeps a reference to an array whose address is in a record, and returns the array."""


def operation_records(algorithm: OperationTableAlgorithm) -> Any:
    """Return the OPERATION records, in order."""
    return np.array([(o.call, o.instance) for o in algorithm.operations], dtype=OPERATION)


def input_records(algorithm: OperationTableAlgorithm) -> Any:
    """Return the INPUT records of all inputs, instance by instance."""
    network, history = algorithm.network, algorithm.exchange.history
    sources = np.concatenate([np.empty(0, dtype=np.intp), *network.sources])
    movable = np.concatenate([np.empty(0, dtype=bool), *(s.continuous_inputs for s in network.instances)])
    records = _source_records(algorithm, sources)
    every = np.arange(len(sources))
    records["taken"], records["taken_at"] = (
        addresses(history.taken, every),
        addresses(history.taken_at, every),
    )
    records["factor"] = np.concatenate([np.empty(0), *network.factors])
    records["offset"] = np.concatenate([np.empty(0), *network.offsets])
    records["moves"] &= movable
    return records


def _source_records(algorithm: OperationTableAlgorithm, signals: Indices) -> Any:
    """Return INPUT records with the history of these signals."""
    exchange, history = algorithm.exchange, algorithm.exchange.history
    owners, records = exchange.owners[signals], np.zeros(len(signals), INPUT)
    records["signal"] = addresses(algorithm.network.signals, signals)
    records["previous"] = addresses(history.previous, signals)
    records["at"], records["before"] = addresses(history.at, owners), addresses(history.before, owners)
    records["moves"] = exchange.smooth[signals]
    return records


def instance_records(
    algorithm: OperationTableAlgorithm,
    points: Sequence[EntryPoints],
    sources: Any,
    states: Any,
    saved: set[int],
) -> Any:
    """Return the INSTANCE records.

    Args:
        algorithm: An algorithm after `initialize`.
        points: Addresses of the FMI functions, per instance.
        sources: INPUT records of all inputs.
        states: Room for the address of a saved state, per instance.
        saved: Positions of the instances that restore a saved state.
    """
    network, exchange, history = algorithm.network, algorithm.exchange, algorithm.exchange.history
    every = np.arange(len(points))
    first_inputs = np.array([part.start for part in network.input_parts], dtype=np.intp)
    first_outputs = np.array([part.start for part in network.parts], dtype=np.intp)
    records = np.zeros(len(points), INSTANCE)
    records["code"] = [code_of(int(i), "") for i in every]
    for call in CallNames._fields:
        records[f"code_{call}"] = [code_of(i, getattr(p.names, call)) for i, p in enumerate(points)]
    names = ("component", "set_real", "set_real_input_derivatives", "do_step", "get_real")
    for name in (*names, "get_state", "set_state"):
        records[name] = [getattr(p, name) for p in points]
    for name in ("input_references", "derivative_orders", "output_references"):
        records[name] = [getattr(p, name).ctypes.data for p in points]
    records["input_reference_count"] = [len(p.input_references) for p in points]
    records["output_reference_count"] = [len(p.output_references) for p in points]
    records["input_count"] = [len(s.inputs) for s in network.instances]
    records["output_count"] = [len(s.outputs) for s in network.instances]
    records["sources"] = addresses(sources, first_inputs)
    records["inputs"] = addresses(network.inputs, first_inputs)
    records["derivatives"] = addresses(exchange.derivatives, first_inputs)
    records["outputs"] = addresses(network.signals, first_outputs)
    records["previous"] = addresses(history.previous, first_outputs)
    records["at"], records["before"] = addresses(history.at, every), addresses(history.before, every)
    records["multiple"], records["mode"] = algorithm.multiples, exchange.modes
    records["rare"], records["state"] = exchange.rare, addresses(states, every)
    records["no_way_back"] = [i not in saved for i in every]
    for record, p in zip(records, points, strict=True):
        if p.step_end is not None:  # a step has no time for memory elsewhere
            record["is_version_3"] = True
            record["step_end"] = p.step_end.use(record["step_end_memory"])
    return records


def observed_records(network: Network, kept: KeptArrays) -> Any:
    """Return the OBSERVED records of all instances."""
    observer, records = network.observer, []
    for instance, part in observer.readers:
        i = network.instances.index(instance)
        for group in map(forward_observed, instance.observed_groups()):
            kept(group)
            record = np.zeros((), OBSERVED)
            record["code"], record["instance"] = code_of(i, group.call), i
            record["get"], record["component"] = group.function, group.component
            record["references"], record["count"] = _address(group.references), len(group.references)
            record["values"], record["boolean"] = _address(group.values), group.boolean
            record["real"] = group.values.dtype == np.float64
            targets = addresses(observer.values, part.start + group.targets)
            record["targets"] = _address(kept(targets.astype(np.intp)))
            records.append(record)
    return np.array(records, dtype=OBSERVED)


def add_undo(records: Any, kept: KeptArrays) -> None:
    """Add room to INSTANCE records for the outputs and time before the previous ones."""
    places = np.cumsum([0, *(records["output_count"] + 1)])
    records["undo"] = addresses(kept(np.zeros(places[-1])), places[:-1])


def group_records(
    algorithm: OperationTableAlgorithm, groups: Sequence[CoupledGroup], scale: Scale | None, kept: KeptArrays
) -> Any:
    """Return the GROUP records, in order."""
    records = np.zeros(len(groups), GROUP)
    for record, group in zip(records, groups, strict=True):
        n = len(group.coupling_variables)
        record["members"] = _address(kept(np.array(group.members, dtype=np.intp)))
        record["member_count"], record["cut_count"] = len(group.members), n
        record["saved"] = group.start is not None
        if scale is None or not n:
            continue
        record["cut"] = _address(kept(_source_records(algorithm, group.coupling_variables)))
        record["positions"] = _address(kept(group.coupling_variables.copy()))
        record["floors"] = _address(kept(scale.floor[group.coupling_variables]))
        record["jacobian"] = _address(group.newton.jacobian)
        rooms = {"earlier": n * n, "basis": n * n, "residuals": SWEEPS * n, "answers": SWEEPS * n}
        for name, size in (rooms | dict.fromkeys(("sizes", "direction", "guess"), n)).items():
            record[name] = _address(kept(np.zeros(size)))
    return records


def lane_records(lanes: Sequence[Sequence[int]], kept: KeptArrays) -> Any:
    """Return the LANE records of threads that do the tasks at these places, each in this order."""
    records = np.zeros(len(lanes), LANE)
    for thread, (record, places) in enumerate(zip(records, lanes, strict=True)):
        record["tasks"] = _address(kept(np.array(places, dtype=np.intp)))
        record["task_count"] = len(places)
        record["present"] = ctypes.addressof(kept(crash_page.current_activity(thread)))
    return records


def task_records(tasks: Sequence[StepTask], lanes: Sequence[Sequence[int]], kept: KeptArrays) -> Any:
    """Return the TASK records by place. Earlier tasks of the same lane are left out of `waits`."""
    records, lane_of = np.zeros(len(tasks), TASK), np.zeros(len(tasks), dtype=np.intp)
    for lane, places in enumerate(lanes):
        lane_of[places] = lane
    for place, (record, task) in enumerate(zip(records, tasks, strict=True)):
        elsewhere = [before for before in task.after if lane_of[before] != lane_of[place]]
        record["waits"] = _address(kept(np.array(elsewhere, dtype=np.intp)))
        record["wait_count"] = len(elsewhere)
    return records


def addresses(values: Any, positions: Any) -> Any:
    """Return the memory addresses of the elements at these positions."""
    return values.ctypes.data + values.itemsize * positions


def _address(values: Any) -> int:
    return values.ctypes.data
