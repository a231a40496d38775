"""Read parameter sets (SSV) for one FMU."""

from pathlib import Path
from typing import Any

from emla_cosim.base.files import read_file
from emla_cosim.fmu.parameters.parameter_sets import convert_parameter, parse_parameter_set
from emla_cosim.fmu.variables import convert_start_value

from ..subject import Subject
from ..verdict import NotRunError

SSV = "application/x-ssp-parameter-set"
"""MIME type of parameter sets."""


def read_parameter_values(subject: Subject, file: Path) -> tuple[dict[str, Any], list[str]]:
    """Return the values of a parameter set by variable, and the names that the FMU does not have.

    Raises:
        CommandError: The file is invalid, or a variable does not accept its value.
        NotRunError: It sets structural parameters, which are not set here.
    """
    values, unknown, interface = dict[str, Any](), list[str](), subject.interface
    for parameter in parse_parameter_set(read_file(file, "the parameter set"), file.name).parameters:
        variable = interface.variables.get(parameter.name)
        if variable is None:
            unknown.append(parameter.name)
            continue
        if interface.is_structural(parameter.name):
            raise NotRunError(f"It sets the structural parameter {parameter.name}.")
        value = convert_parameter(parameter, interface.unit(parameter.name), file.name)
        values[parameter.name] = convert_start_value(subject.path.stem, interface, variable, value)
    return values, unknown
