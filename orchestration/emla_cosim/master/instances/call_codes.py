"""Calls of instances by number, as `black_box` has them."""

from ...sandbox.black_box import Activity

CALLS = (
    "",
    "setReal",
    "setRealInputDerivatives",
    "doStep",
    "getReal",
    "loading its library",
    "instantiate",
    "setupExperiment",
    "enterInitializationMode",
    "exitInitializationMode",
    "setInteger",
    "setBoolean",
    "setString",
    "getInteger",
    "getBoolean",
    "getBooleanStatus",
    "getFMUstate",
    "setFMUstate",
    "freeFMUstate",
    "serializedFMUstateSize",
    "serializeFMUstate",
    "deSerializeFMUstate",
    "reset",
    "terminate",
    "freeInstance",
    "getDirectionalDerivative",
)
"""What an instance may be busy with; the first is nothing."""

_NUMBERS = {name: number for number, name in enumerate(CALLS)}


def code_of(instance: int, call: str) -> int:
    """The code of a call of the instance with this number."""
    return instance * len(CALLS) + _NUMBERS[call]


def decode_call(present: Activity) -> tuple[int | None, str]:
    """The number of the instance that is called, if one is, and the call in words."""
    instance, call = divmod(present.code, len(CALLS))
    if not call:
        return None, "no call of the FMI"
    at = f" at t = {present.time:.9g} s" if CALLS[call] == "doStep" else ""
    return instance, f"{CALLS[call]}{at}"
