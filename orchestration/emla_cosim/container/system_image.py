"""How the stepper steps a system, as C: its tables, those of events, and the calls of initialization mode."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from numpy.typing import NDArray

from ..fmu.elements import BINARY, CLOCK, ElementVariable, is_clocked, is_version_3
from ..master.algorithms.algorithm import Algorithm
from ..master.instances.event_mode_instance import EventModeInstance
from ..master.instances.in_process_instance import InProcessInstance
from ..master.instances.typed_values import allocate_array
from ..master.stepping.stepper_tables import StepperTables, list_entry_points
from .image import Image


@dataclass(frozen=True)
class PartImage:
    """The calls of a component in initialization mode, and its events, by their positions in C.

    Attributes:
        setters: first call that sets inputs, and number of these calls.
        getters: the same for the calls that get signals.
        events: number of its events; -1 without.
        event_state: start of the state of its events in `saved`, its size, and the start of the counts of
            ticks in it.
        clocks: names of its clocks.
        ticks: position in `saved` of each variable that has the value of its last tick, by name.
        pending_inputs: the value that an input gets at its next tick, by name.
    """

    setters: tuple[int, int]
    getters: tuple[int, int]
    events: int = -1
    event_state: tuple[int, int, int] = (0, 0, 0)
    clocks: Sequence[str] = ()
    ticks: Mapping[str, int] = field(default_factory=dict)
    pending_inputs: Mapping[str, NDArray[Any]] = field(default_factory=dict)


@dataclass(frozen=True)
class SystemImage:
    """The stepper of a system as C.

    Attributes:
        image: its tables.
        parts: the calls and events of the components.
        restored: size in doubles of the memory that an initialization clears, at the start of `saved`.
        jacobians: the Jacobians of the loops at the start; they follow in `saved`.
        stores: number of vectors.
        groups: number of groups of strong coupling.
    """

    image: Image
    parts: Sequence[PartImage]
    restored: int
    jacobians: Sequence[float]
    stores: int
    groups: int


def make_system_image(
    algorithm: Algorithm, instances: Sequence[InProcessInstance], libraries: Sequence[int]
) -> SystemImage:
    """Return the tables of the stepper for an algorithm that has initialized its network.

    Args:
        algorithm: The algorithm.
        instances: The instances of the network.
        libraries: The number of the library of each instance.
    """
    with_events = [x for x in instances if isinstance(x, EventModeInstance)]
    pending_inputs = {x.name: x.tables.hold_inputs(_find_open_inputs(x)) for x in with_events}
    points = list_entry_points(algorithm)
    tables = StepperTables(algorithm, points)
    initial = [_list_initial_calls(tables, i, x) for i, x in enumerate(instances)]
    stepper = tables.stepper
    # a host observes nothing in a step, and has no reader of the present call
    stepper.observers = stepper.observed = stepper.activity = None
    functions = [
        (f"m->functions[{library}]", "FMI3" if is_version_3(instance.file.description) else "FMI2")
        for instance, library in zip(instances, libraries, strict=True)
    ]
    image = Image([*tables.arrays, *(a for x in with_events for a in x.tables.arrays)], functions)
    # first: an initialization clears the beginning of `saved`, up to the Jacobians
    for values in (algorithm.block, *(x.tables.memory for x in with_events)):
        image.save(values)
    for instance in instances:
        for reference, values in instance.arrays.items():
            image.save(values, allocate_array(instance.array(reference)))
    for values in (values for inputs in pending_inputs.values() for values in inputs.values()):
        image.save(values, values)
    for number, instance in enumerate(with_events):
        image.name(instance.tables.address, f"&m->events[{number}]")
    _name_records(image, tables, points)
    image.wire("m->stepper", stepper, "Stepper")
    for number, instance in enumerate(with_events):
        image.wire(f"m->events[{number}]", instance.tables.record, "Events")
    if tables.passing is not None:
        image.add(f"m->instances[{len(instances)}].component = m;")
    parts = [
        _make_part_image(image, instance, initial[i], with_events, pending_inputs.get(instance.name, {}))
        for i, instance in enumerate(instances)
    ]
    restored = len(algorithm.restored)
    jacobians = algorithm.block[restored:].tolist()
    return SystemImage(image, parts, restored, jacobians, len(tables.stores), len(algorithm.groups))


def _find_open_inputs(instance: EventModeInstance) -> list[ElementVariable]:
    """Return the clocked inputs that nothing drives: a host sets them, and they change at ticks."""
    driven = {v.name for v in instance.read}
    return [
        v
        for v in instance.file.variables.values()
        if isinstance(v, ElementVariable)
        and v.causality == "input"
        and is_clocked(v)
        and v.name not in driven
        and v.type not in ("String", BINARY, CLOCK)
    ]


def _list_initial_calls(tables: StepperTables, i: int, instance: InProcessInstance) -> list[tuple[int, int]]:
    """Return address and number of the calls of initialization mode that set all inputs, and get all outputs.

    Without events, they are those of steps.
    """
    if not isinstance(instance, EventModeInstance):
        record = tables.instances[i]
        return [(int(record[f"{kind}ters"]), int(record[f"{kind}ter_count"])) for kind in ("set", "get")]
    points = InProcessInstance.entry_points(instance)
    assert points is not None
    calls = [tables.list_calls(i, points, access) for access in ("set", "get")]
    return [(x.ctypes.data, len(x)) for x in calls]


def _name_records(image: Image, tables: StepperTables, points: Sequence[Any]) -> None:
    """Name the records that each instance has once: the end of a step, its saved state, the vectors."""
    states = tables.states.records
    for i, point in enumerate(points):
        if point.step_end is not None:
            image.name(point.step_end.address, f"&m->ends[{i}]")
        image.name(states.ctypes.data + i * states.itemsize, f"&m->states[{i}]")
        if point.events:
            image.point(f"m->states[{i}].events", int(states["events"][i]))
    image.name(int(tables.stepper.stores), "m->stores")
    for number, address in enumerate(tables.stores.tolist()):
        image.point(f"m->stores[{number}]", address)


def _make_part_image(
    image: Image,
    instance: InProcessInstance,
    initial: Sequence[tuple[int, int]],
    with_events: Sequence[InProcessInstance],
    pending_inputs: Mapping[str, NDArray[Any]],
) -> PartImage:
    """Return the calls and events of a component by their positions; `initial` are addresses and counts."""
    setters, getters = ((image.find_position(address) if count else 0, count) for address, count in initial)
    if not isinstance(instance, EventModeInstance):
        return PartImage(setters, getters)
    tables, variables = instance.tables, list(instance.file.variables.values())
    start = image.find_position_in_saved(tables.memory.ctypes.data)
    positions = tables.find_positions(variables)
    return PartImage(
        setters=setters,
        getters=getters,
        events=with_events.index(instance),
        event_state=(start, len(tables.memory), tables.first_count),
        clocks=[tables.name_clock(clock) for clock in range(tables.record.clock_count)],
        ticks={str(v.name): start + int(p) for v, p in zip(variables, positions, strict=True) if p >= 0},
        pending_inputs=pending_inputs,
    )
