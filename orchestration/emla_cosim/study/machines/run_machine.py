"""The machine of a run, with the values that its parameters had."""

import json

from machine_fmu import MachineError, read_definition
from machine_fmu.model import MachineModel
from machine_fmu.naming import name_numbers

from ...run.result import Result
from .schema import load_machine

COMPONENTS = ("machine.manipulator", "machine.plant")
"""Components that may be the machine."""

_DEFAULT_MACHINE = "hdrm"
"""The machine of records that have no definition."""


def find_component(result: Result) -> str | None:
    """Return the component of a run that is its machine; None without."""
    return next((name for name in COMPONENTS if name in result.record["components"]), None)


def find_machine(result: Result) -> MachineModel | None:
    """Return the machine of a run, with the values of its parameters; None if it has none.

    It has none if its component is not one of our blocks, or if its parameters make no machine.
    """
    component = find_component(result)
    if component is None:
        return None
    stored = result.record.get("machine")
    try:
        machine = (
            load_machine(_DEFAULT_MACHINE)
            if stored is None
            else read_definition(json.dumps(stored["definition"]))
        )
        names = name_numbers(machine).parameters
        values = {name: result.parameters[f"{component}.{name}"] for name in names}
        return MachineModel(machine, values)
    # a replaced FMU has other parameters
    except (MachineError, KeyError):
        return None
