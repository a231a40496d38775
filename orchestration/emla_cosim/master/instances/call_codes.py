"""Calls of slaves by number, as `black_box` has them."""

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
"""What a slave may be busy with; the first is nothing."""

_NUMBERS = {name: number for number, name in enumerate(CALLS)}


def code_of(slave: int, call: str) -> int:
    """The code of a call of the slave with this number."""
    return slave * len(CALLS) + _NUMBERS[call]


def decode_call(present: Activity) -> tuple[int | None, str]:
    """The number of the slave that is called, if one is, and the call in words."""
    slave, call = divmod(present.code, len(CALLS))
    if not call:
        return None, "no call of the FMI"
    at = f" at t = {present.time:.9g} s" if CALLS[call] == "doStep" else ""
    return slave, f"{CALLS[call]}{at}"
