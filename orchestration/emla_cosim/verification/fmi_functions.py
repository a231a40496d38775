"""The functions that the library of an FMU must export (FMI 2.0, sections 2.1, 3.2 and 4.2)."""

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
