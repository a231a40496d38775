"""The functions that the library of an FMU must export (FMI 2.0, sections 2.1, 3.2 and 4.2; FMI 3.0, 2.5)."""

import re
from functools import cache
from importlib.resources import files

_COMMON = (
    "GetTypesPlatform",
    "GetVersion",
    "SetDebugLogging",
    "Instantiate",
    "FreeInstance",
    "SetupExperiment",
    "EnterInitializationMode",
    "ExitInitializationMode",
    "Terminate",
    "Reset",
    "GetReal",
    "GetInteger",
    "GetBoolean",
    "GetString",
    "SetReal",
    "SetInteger",
    "SetBoolean",
    "SetString",
    "GetFMUstate",
    "SetFMUstate",
    "FreeFMUstate",
    "SerializedFMUstateSize",
    "SerializeFMUstate",
    "DeSerializeFMUstate",
    "GetDirectionalDerivative",
)
_OF_KIND = {
    "ModelExchange": (
        "EnterEventMode",
        "NewDiscreteStates",
        "EnterContinuousTimeMode",
        "CompletedIntegratorStep",
        "SetTime",
        "SetContinuousStates",
        "GetDerivatives",
        "GetEventIndicators",
        "GetContinuousStates",
        "GetNominalsOfContinuousStates",
    ),
    "CoSimulation": (
        "SetRealInputDerivatives",
        "GetRealOutputDerivatives",
        "DoStep",
        "CancelStep",
        "GetStatus",
        "GetRealStatus",
        "GetIntegerStatus",
        "GetBooleanStatus",
        "GetStringStatus",
    ),
}


def list_required_functions(kind: str) -> tuple[str, ...]:
    """Return the function names for `CoSimulation` or `ModelExchange`, in the order of the standard."""
    return tuple(f"fmi2{name}" for name in (*_COMMON, *_OF_KIND[kind]))


@cache
def list_all_functions_3() -> tuple[str, ...]:
    """Return the names of all functions of FMI 3.0, in the order of its header file."""
    header = (files("fmpy") / "c-code" / "fmi3Functions.h").read_text(encoding="utf-8")
    return tuple(re.findall(r"FMI3_Export\s+fmi3\w+TYPE\s+(fmi3\w+);", header))
