"""Random calls of the functions of a system as one FMU, with arrays of exactly the announced sizes.

Arguments: version of FMI, library, GUID or token, location of the resources, letters of the variables' types
(R, I, E, B, S, those of TYPES_3, and ? for others), seed, number of calls. Prints how often each function
returned each status.
"""

import ctypes
import random
import sys
from collections.abc import Callable
from ctypes import byref, c_bool, c_char_p, c_double, c_int, c_int32, c_int64, c_size_t, c_uint32, c_void_p
from typing import Any

NUMBERS = (0.0, 1.0, -1.0, 0.1, 1e-3, 2.0, 1e308, -1e308, float("inf"), float("nan"))
STEP = 1e-4
LOGGER_2 = ctypes.CFUNCTYPE(None, c_void_p, c_char_p, c_int, c_char_p, c_char_p)
LOGGER_3 = ctypes.CFUNCTYPE(None, c_void_p, c_int, c_char_p, c_char_p)
TYPES_2 = {"Real": ("R", c_double), "Integer": ("I", c_int), "Boolean": ("B", c_int)}
TYPES_3 = {
    "Float64": ("R", c_double),
    "Int32": ("I", c_int32),
    "Int64": ("E", c_int64),
    "Boolean": ("B", c_bool),
    "Float32": ("r", ctypes.c_float),
    "Int8": ("b", ctypes.c_int8),
    "UInt8": ("c", ctypes.c_uint8),
    "UInt16": ("t", ctypes.c_uint16),
    "UInt64": ("U", ctypes.c_uint64),
}
OTHERS_3 = ("EnterEventMode", "EnterStepMode", "EnterConfigurationMode", "EnterContinuousTimeMode")


class Callbacks(ctypes.Structure):
    """fmi2CallbackFunctions."""

    _fields_ = (
        ("logger", LOGGER_2),
        ("allocateMemory", c_void_p),
        ("freeMemory", c_void_p),
        ("stepFinished", c_void_p),
        ("componentEnvironment", c_void_p),
    )


class Caller:
    """An instance, and what its calls need."""

    def __init__(self, version: int, path: str, token: str, location: str, letters: str) -> None:
        self.version, self.letters = version, letters
        self.types: dict[str, tuple[str, Any]] = TYPES_2 if version == 2 else TYPES_3
        self.library = ctypes.CDLL(path)
        self.texts = list[str]()
        make = self.library[f"fmi{version}Instantiate{'' if version == 2 else 'CoSimulation'}"]
        make.restype = c_void_p
        if version == 2:
            self.logger: Any = LOGGER_2(lambda *message: self.texts.append(message[4].decode()))
            self.callbacks = Callbacks(self.logger, None, None, None, None)
            arguments = (1, token.encode(), location.encode(), byref(self.callbacks), 0, 1)
            self.instance = c_void_p(make(b"x", *arguments))
        else:
            self.logger = LOGGER_3(lambda *message: self.texts.append(message[3].decode()))
            flags = (c_bool(False), c_bool(True), c_bool(False), c_bool(False))
            rest = (None, c_size_t(0), None, self.logger, None)
            self.instance = c_void_p(make(b"x", token.encode(), location.encode(), *flags, *rest))
        assert self.instance.value, self.texts
        self.state, self.time, self.size = c_void_p(), 0.0, c_size_t()
        self.bytes = b""

    def call(self, name: str, *arguments: Any) -> int:
        return int(self.library[f"fmi{self.version}{name}"](self.instance, *arguments))

    def free(self) -> None:
        self.call(f"FreeFMU{'state' if self.version == 2 else 'State'}", byref(self.state))
        self.library[f"fmi{self.version}FreeInstance"](self.instance)


def vector(kind: Any, values: list[Any]) -> Any:
    return (kind * len(values))(*values)


def references(rng: random.Random, caller: Caller, letter: str) -> list[int]:
    """Mostly those of one type."""
    candidates = [i for i, x in enumerate(caller.letters) if x == letter] or [0]
    return [
        rng.choice(candidates) if rng.random() < 0.97 else rng.randrange(len(caller.letters) + 2)
        for _ in range(rng.randrange(4))
    ]


def exchange(rng: random.Random, caller: Caller) -> tuple[str, int]:
    """Get values, and set them again or others."""
    kind = rng.choice(list(caller.types))
    letter, ctype = caller.types[kind]
    indices = references(rng, caller, letter)
    n = c_size_t(len(indices))
    length = len(indices) if rng.random() < 0.95 or caller.version == 2 else rng.randrange(5)
    values = vector(ctype, [0] * length)
    rest = (c_size_t(length),) if caller.version == 3 else ()
    status = caller.call(f"Get{kind}", vector(c_uint32, indices), n, values, *rest)
    if rng.random() < 0.5:
        return f"Get{kind}", status
    for i in range(length):
        if rng.random() < 0.02:
            values[i] = rng.choice(NUMBERS) if ctype is c_double else rng.randrange(-(2**31), 2**31)
    array = None if rng.random() < 0.02 else values
    return f"Set{kind}", caller.call(f"Set{kind}", vector(c_uint32, indices), n, array, *rest)


def texts(rng: random.Random, caller: Caller) -> tuple[str, int]:
    indices = references(rng, caller, "S")
    values = vector(c_char_p, [rng.choice((b"a", b"", None)) for _ in indices])
    rest = (c_size_t(len(indices)),) if caller.version == 3 else ()
    name = rng.choice(("GetString", "SetString"))
    return name, caller.call(name, vector(c_uint32, indices), c_size_t(len(indices)), values, *rest)


def step(rng: random.Random, caller: Caller) -> tuple[str, int]:
    start = caller.time if rng.random() < 0.9 else rng.choice((0.0, 5.0, -1.0, *NUMBERS))
    length = STEP * rng.choice((1, 1, 1, 2, 10)) if rng.random() < 0.95 else rng.choice((STEP / 3, *NUMBERS))
    if caller.version == 2:
        status = caller.call("DoStep", c_double(start), c_double(length), rng.randrange(2))
        reached, ended = c_double(), c_int()
        caller.call("GetRealStatus", 2, byref(reached))
        caller.call("GetBooleanStatus", 3, byref(ended))
    else:
        flags, reached = [c_bool() for _ in range(3)], c_double()
        pointers: list[Any] = [*map(byref, flags), byref(reached)]
        if rng.random() < 0.05:
            pointers[rng.randrange(4)] = None
        status = caller.call("DoStep", c_double(start), c_double(length), c_bool(False), *pointers)
    if status == 0:
        caller.time = reached.value
    return "DoStep", status


def state(rng: random.Random, caller: Caller, foreign: bytes) -> tuple[str, int]:
    old = caller.version == 2
    end = "state" if old else "State"
    match rng.randrange(6):
        case 0 | 1:
            name, pointer = f"GetFMU{end}", None if rng.random() < 0.05 else byref(caller.state)
            return name, caller.call(name, pointer)
        case 2:
            name = f"SetFMU{end}"
            status = caller.call(name, caller.state)
            reached = c_double()
            if old and caller.call("GetRealStatus", 2, byref(reached)) == 0:
                caller.time = reached.value
            return name, status
        case 3:
            name = f"FreeFMU{end}" if rng.random() < 0.2 else f"SerializedFMU{end}Size"
            if name.startswith("Free"):
                return name, caller.call(name, byref(caller.state))
            return name, caller.call(name, caller.state, byref(caller.size))
        case 4:
            name = f"SerializeFMU{end}"
            length = caller.size.value if rng.random() < 0.9 else rng.randrange(100)
            data = (ctypes.c_uint8 * length)()
            status = caller.call(name, caller.state, data, c_size_t(length))
            caller.bytes = bytes(data) if status == 0 else caller.bytes
            return name, status
        case _:
            name = f"De{'Serialize' if old else 'serialize'}FMU{end}"
            content = bytearray(rng.choice((caller.bytes, caller.bytes, foreign, b"")))
            if content and rng.random() < 0.5:
                content[rng.randrange(len(content))] ^= 1 << rng.randrange(8)
            if rng.random() < 0.1:
                content = content[: rng.randrange(len(content) + 1)]
            data = vector(ctypes.c_uint8, list(content))
            return name, caller.call(name, data, c_size_t(len(content)), byref(caller.state))


def move_on(rng: random.Random, caller: Caller) -> tuple[str, int]:
    start = c_double(0.0 if rng.random() < 0.9 else rng.choice(NUMBERS))
    if caller.version == 2 and rng.random() < 0.3:
        tolerance = c_double(rng.choice(NUMBERS))
        stop = (rng.randrange(2), c_double(rng.choice((1.0, *NUMBERS))))
        return "SetupExperiment", caller.call("SetupExperiment", rng.randrange(2), tolerance, start, *stop)
    if rng.random() < 0.5:
        extra = (c_bool(False), c_double(0), start, c_bool(False), c_double(0)) if caller.version == 3 else ()
        status = caller.call("EnterInitializationMode", *extra)
        caller.time = 0.0 if status == 0 else caller.time
        return "EnterInitializationMode", status
    return "ExitInitializationMode", caller.call("ExitInitializationMode")


def end(rng: random.Random, caller: Caller) -> tuple[str, int]:
    name = rng.choice(("Terminate", "Reset", "Reset"))
    return name, caller.call(name)


def other(rng: random.Random, caller: Caller) -> tuple[str, int]:
    if rng.random() < 0.3:
        categories = (b"logAll", b"logStatusError", b"what", None)
        names = vector(c_char_p, [rng.choice(categories) for _ in range(2)])
        on = 1 if rng.random() < 0.7 else 0
        return "SetDebugLogging", caller.call("SetDebugLogging", on, c_size_t(rng.randrange(3)), names)
    indices = references(rng, caller, "R")
    refs, n = vector(c_uint32, indices), c_size_t(len(indices))
    numbers, orders = vector(c_double, [0.0] * len(indices)), vector(c_int, [1] * len(indices))
    if caller.version == 2:
        values = {"GetStatus": c_int(), "GetIntegerStatus": c_int(), "GetStringStatus": c_char_p()}
        name = rng.choice(("CancelStep", *values, "SetRealInputDerivatives", "GetRealOutputDerivatives"))
        if name in values:
            return name, caller.call(name, rng.randrange(5), byref(values[name]))
        return name, caller.call(name, *(() if name == "CancelStep" else (refs, n, orders, numbers)))
    name = rng.choice((*OTHERS_3, "GetClock", "GetOutputDerivatives", "GetAdjointDerivative"))
    arguments: tuple[Any, ...] = ()
    if name == "GetClock":
        arguments = (refs, n, vector(c_bool, [False] * len(indices)))
    elif name == "GetOutputDerivatives":
        arguments = (refs, n, orders, numbers, n)
    elif name == "GetAdjointDerivative":
        arguments = (refs, n, refs, n, numbers, n, numbers, n)
    return name, caller.call(name, *arguments)


def main(version: int, path: str, token: str, location: str, letters: str, seed: int, calls: int) -> None:
    rng = random.Random(seed)
    callers = [Caller(version, path, token, location, letters) for _ in range(2)]
    ways: list[tuple[Callable[[random.Random, Caller], tuple[str, int]], int]] = [
        (exchange, 40),
        (texts, 3),
        (step, 25),
        (lambda r, c: state(r, c, rng.randbytes(200)), 15),
        (move_on, 12),
        (end, 2),
        (other, 3),
    ]
    counts: dict[str, list[int]] = {}
    for k in range(calls):
        caller = rng.choice(callers)
        way = rng.choices([w for w, _ in ways], [n for _, n in ways])[0]
        name, status = way(rng, caller)
        counts.setdefault(name, [0] * 5)[status] += 1
        caller.texts.clear()
        if k % 1000 == 999:  # a new instance, while the other one continues
            i = callers.index(caller)
            caller.free()
            callers[i] = Caller(version, path, token, location, letters)
    for caller in callers:
        caller.free()
    for name, numbers in sorted(counts.items()):
        print(name, *numbers)


if __name__ == "__main__":
    version, library, token, location, letters, seed, calls = sys.argv[1:]
    main(int(version), library, token, location, letters, int(seed), int(calls))
