"""Faults as components that are inserted into the connections of a system."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

from ..base.errors import CommandError
from ..base.quantities import read_quantity
from ..base.units import IDENTITY
from ..base.wording import find_free_name
from ..fmu.interface import Interface
from .fault import Fault
from .model import Component, Connection, System, Value
from .names import NamedVariable, Names
from .resolution import find_transformation

MODEL = "SignalFault"
"""The model of these components; it has an input u and an output y."""

FaultComponents = Mapping[str, Fault]
"""Faults by component name."""


def add_fault_components(system: System, faults: Sequence[Fault]) -> tuple[System, FaultComponents]:
    """Add a component for each fault, without connections.

    A fault of lift.plant.x_measured is the component lift.plant_x_measured_fault, a second one ends in
    _fault_2.

    Returns:
        The system, and the faults by component.

    Raises:
        CommandError: If a component does not exist.
    """
    used_names, by_name = {c.name for c in system.components}, dict[str, Fault]()
    for fault in faults:
        component, variable = system.split(fault.signal)
        first = f"{component.name}_{variable.replace('.', '_')}_fault"  # not inside of the component
        name = find_free_name(first, used_names)
        used_names.add(name)
        by_name[name] = fault
    components = (Component(name, MODEL, _list_fault_start_values(fault)) for name, fault in by_name.items())
    return replace(system, components=(*system.components, *components)), by_name


def wire_faults(system: System, faults: FaultComponents, interfaces: Mapping[str, Interface]) -> System:
    """Connect the components of `add_fault_components`; several faults of a signal apply in their order.

    Args:
        system: The system with these components.
        faults: The faults by component.
        interfaces: The model descriptions by component.

    Raises:
        CommandError: If a signal does not exist, is not connected, or is not continuous, or if a unit does
            not fit.
    """
    signals = {name: _find_signal(Names(system, interfaces), fault) for name, fault in faults.items()}
    for name, signal in signals.items():
        fault = faults[name]
        if isinstance(fault.value, str):
            unit = signal.unit
            if unit is not None and fault.kind == "offset":
                # 5 degC more are 5 K
                unit = replace(unit, is_difference=True)
            value = read_quantity(fault.value, f"the value of the fault of {signal.full_name}", unit)
            values = _list_fault_start_values(replace(fault, value=value))
            system = system.with_component(replace(system.component(name), parameters=values))
    outputs = [name for name, signal in signals.items() if signal.variable.causality == "output"]
    for name in reversed(outputs):  # each is connected directly to the output
        end = signals[name].end
        if not any(x.ends[0] == end for x in system.connections):
            raise CommandError(f"{'.'.join(end)} is not connected, so a fault of it would have no effect.")
        system = _insert_fault(system, Connection(*end, name, "u"), interfaces, source=name, output="y")
    for name, signal in signals.items():
        if name in outputs:
            continue
        if any(x.ends[1] == signal.end for x in system.connections):
            added = Connection(name, "y", *signal.end)
            system = _insert_fault(system, added, interfaces, target=name, input="u")
        else:
            system = _connect_free_input(system, name, signal)
    return system


def _list_fault_start_values(fault: Fault) -> dict[str, Value]:
    """Return the start values of a fault's component; only its start time while its value is a text."""
    values: dict[str, Value] = {"start": fault.start}
    if isinstance(fault.value, str):
        return values  # `wire_faults` sets them, once the unit of the signal is known
    if fault.duration is not None:
        values["duration"] = fault.duration
    if fault.value is None:
        return values | {"freeze": True}
    effects = {"offset": {"offset": fault.value}, "gain": {"gain": fault.value}}
    return values | effects.get(fault.kind, {"gain": 0.0, "offset": fault.value})


def _find_signal(names: Names, fault: Fault) -> NamedVariable:
    """Return the signal of a fault; CommandError if it is not a continuous Real output or input."""
    signal = names.find(fault.signal)
    variable = signal.variable
    if variable.causality not in ("output", "input"):
        raise CommandError(
            f"{fault.signal} is a {variable.causality}; a fault needs an output or an input.",
            signal=fault.signal,
        )
    variability = variable.variability or ("continuous" if variable.type == "Real" else "discrete")
    if variable.type != "Real" or variability != "continuous":
        raise CommandError(
            f"{fault.signal} is a {variability} {variable.type}; a fault needs a continuous Real.",
            signal=fault.signal,
        )
    return signal


def _insert_fault(
    system: System, added: Connection, interfaces: Mapping[str, Interface], **ends: str
) -> System:
    """Insert a fault into the connections of a signal: `ends` replace theirs, and `added` joins both.

    At an output it is before the conversion of units, at an input behind it.
    """
    # the position in `Connection.ends`
    side = 0 if "source" in ends else 1
    connections = (
        _convert_connection(x, interfaces, **ends) if x.ends[side] == added.ends[side] else x
        for x in system.connections
    )
    return replace(system, connections=(*connections, added))


def _connect_free_input(system: System, name: str, signal: NamedVariable) -> System:
    """Connect a fault to an unconnected input; the input's value becomes the fault's input value."""
    component = system.component(signal.component.name)
    values = dict(component.parameters)
    number = values.pop(signal.name, None)
    to_fmu = component.alias(signal.name).transformation
    start = float(signal.variable.start or 0.0) if number is None else to_fmu(float(number))
    fault = system.component(name)
    system = system.with_component(replace(component, parameters=values))
    system = system.with_component(replace(fault, parameters={"u": start, **fault.parameters}))
    return replace(system, connections=(*system.connections, Connection(name, "y", *signal.end)))


def _convert_connection(
    connection: Connection, interfaces: Mapping[str, Interface], **ends: str
) -> Connection:
    """Return a connection with another end, which has no unit: the unit conversion is made explicit."""
    transformation = connection.transformation
    if transformation is None and (conversion := find_transformation(connection, interfaces)) != IDENTITY:
        transformation = conversion
    return replace(connection, transformation=transformation, **ends)
