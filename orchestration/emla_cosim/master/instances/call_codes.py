"""Number the calls of instances, so that `crash_page` can record the present one."""

from ...base.crash_page import Activity
from ...fmu.fmi_3_calls import NUMBER_TYPES

CALLS = (
    "",
    *("setReal", "setRealInputDerivatives", "doStep", "getReal"),
    "loading its library",
    *("instantiate", "setupExperiment", "enterInitializationMode", "exitInitializationMode"),
    *("setInteger", "setBoolean", "setString", "getInteger", "getBoolean"),
    *("getBooleanStatus", "getRealStatus", "getFMUstate", "setFMUstate", "freeFMUstate"),
    *("serializedFMUstateSize", "serializeFMUstate", "deSerializeFMUstate"),
    *("reset", "terminate", "freeInstance", "getDirectionalDerivative", "getString"),
    *("enterEventMode", "newDiscreteStates", "enterContinuousTimeMode", "completedIntegratorStep"),
    *("setTime", "setContinuousStates", "getContinuousStates", "getDerivatives"),
    *("getEventIndicators", "getNominalsOfContinuousStates"),
    # FMI 3.0: the functions that it adds, and those with another name or another case than in FMI 2.0
    *(f"{access}{kind}" for kind in NUMBER_TYPES for access in ("get", "set")),
    *("instantiateCoSimulation", "getFMUState", "setFMUState", "freeFMUState"),
    *("serializedFMUStateSize", "serializeFMUState", "deserializeFMUState"),
    *("enterStepMode", "updateDiscreteStates", "setClock", "getClock"),
    *("instantiateModelExchange", "getContinuousStateDerivatives"),
    *("getNumberOfContinuousStates", "getNumberOfEventIndicators"),
    *("getIntervalDecimal", "getShiftDecimal", "getBinary", "setBinary"),
    *("enterConfigurationMode", "exitConfigurationMode"),
    *("setting inputs", "getting outputs"),
)
"""Calls of an instance; the first entry means no call."""

_NUMBERS = {name: number for number, name in enumerate(CALLS)}


def code_of(instance: int, call: str) -> int:
    """Return the code of a call of the instance with this number; `call` is an entry of `CALLS`."""
    return instance * len(CALLS) + _NUMBERS[call]


def split_code(code: int) -> tuple[int, str]:
    """Return the number of the instance and the call of a code."""
    instance, call = divmod(code, len(CALLS))
    return instance, CALLS[call]


def decode_call(present: Activity) -> tuple[int | None, str]:
    """Return the number of the instance that is called (None without a call), and the call in words."""
    instance, call = split_code(present.code)
    if not call:
        return None, "no FMI call"
    return instance, f"{call} at t = {present.time:.9g} s" if call == "doStep" else call
