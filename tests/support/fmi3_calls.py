"""Random calls of the FMI 3.0 functions of a library, with arrays of exactly the announced sizes.

Arguments: the library, the instantiation token, the number of value references, the seed, the calls, whether
the FMU has a clock (0 or 1), whose value reference follows the others, and the value references of the
variables to read within steps.
"""

import ctypes
import random
import sys
from ctypes import byref, c_bool, c_double, c_int, c_int8, c_int32, c_int64, c_size_t, c_uint32, c_void_p
from typing import Any

UPDATE = ctypes.CFUNCTYPE(
    None, c_void_p, c_double, *4 * (c_bool,), ctypes.POINTER(c_bool), ctypes.POINTER(c_double)
)
LOGGER = ctypes.CFUNCTYPE(None, c_void_p, c_int, ctypes.c_char_p, ctypes.c_char_p)
NUMBERS = (0.0, 1.0, -1.0, 0.1, 1e-3, 2.0, 1e308, float("inf"), float("nan"))
TYPES = {"Float64": c_double, "Int32": c_int32, "Int64": c_int64, "Boolean": c_bool, "Int8": c_int8}
STEP = c_double(0.01)


def references(rng: random.Random, n: int) -> tuple[Any, c_size_t]:
    count = rng.randrange(4)
    return (c_uint32 * count)(*(rng.randrange(n + 2) for _ in range(count))), c_size_t(count)


def numbers(rng: random.Random, kind: Any = c_double) -> tuple[Any, c_size_t]:
    count = rng.randrange(7)
    is_float = kind is c_double
    values = (rng.choice(NUMBERS) if is_float else rng.randrange(-1, 9) for _ in range(count))
    return (kind * count)(*values), c_size_t(count)


def main(path: str, token: str, variables: int, seed: int, calls: int, has_clock: int, *needed: int) -> None:
    rng, library = random.Random(seed), ctypes.CDLL(path)
    logger = LOGGER(lambda environment, status, category, message: None)
    counts: dict[str, list[int]] = {}

    def call(name: str, *arguments: Any, counted_as: str = "") -> int:
        status = int(getattr(library, f"fmi3{name}")(*arguments))
        counts.setdefault(counted_as or name, [0] * 5)[status] += 1
        return status

    def update(environment: Any, time: float, *pointers: Any) -> None:
        """Read and set random values within a step, and end it now and then."""
        refs, values = references(rng, variables), numbers(rng)
        for name in ("GetFloat64", "SetFloat64"):
            call(name, instances[0], *refs, *values, counted_as=f"{name}WithinStep")
        pointers[-2][0], pointers[-1][0] = rng.random() < 0.3, rng.choice((time, *NUMBERS))

    callback = UPDATE(update)
    required = (c_uint32 * len(needed))(*needed)
    of_co_simulation = (c_bool(bool(has_clock)), c_bool(True), required, c_size_t(len(needed)))
    instances, states = [], [c_void_p(), c_void_p()]
    for kind in ("CoSimulation", "CoSimulation" if has_clock else "ModelExchange"):
        create = getattr(library, f"fmi3Instantiate{kind}")
        create.restype = c_void_p
        extra, last = (of_co_simulation, (callback,)) if kind == "CoSimulation" else ((), ())
        instance = create(
            b"x", token.encode(), b"/", c_bool(False), c_bool(True), *extra, None, logger, *last
        )
        instances.append(c_void_p(instance))
    flags, time, size = [c_bool() for _ in range(5)], c_double(), c_size_t()
    clock, ticks, about = 0.0, (c_uint32 * 1)(variables), c_uint32()
    of_clock = (
        ("GetClock", (ticks, c_size_t(1), (c_bool * 1)())),
        ("SetClock", (ticks, c_size_t(1), (c_bool * 1)(True))),
        ("GetIntervalDecimal", (ticks, c_size_t(1), (c_double * 1)(), (c_int * 1)())),
        ("GetShiftDecimal", (ticks, c_size_t(1), (c_double * 1)())),
        ("EnterStepMode", ()),
    )
    for _ in range(calls):
        i = rng.randrange(2)
        c, state = instances[i], states[i]
        kind = rng.choice(list(TYPES))
        refs, values, floats = references(rng, variables), numbers(rng, TYPES[kind]), numbers(rng)
        derivative = (*refs, *references(rng, variables), *floats, *numbers(rng))
        data = (ctypes.c_uint8 * rng.choice((0, 8, size.value)))()
        start = c_double(rng.choice((clock, 0.0, 5.0)))
        orders = (c_int32 * len(refs[0]))(*(rng.randrange(3) for _ in refs[0]))
        about.value = rng.randrange(variables + 2)
        initialization = (c_bool(False), c_double(0), c_double(0), c_bool(False), c_double(0))
        name, arguments = rng.choice(
            (
                (f"Get{kind}", (*refs, *values)),
                (f"Set{kind}", (*refs, *values)),
                ("GetFloat64", (*refs, *floats)),
                ("GetDirectionalDerivative", derivative),
                ("GetAdjointDerivative", derivative),
                ("GetOutputDerivatives", (*refs, orders, *floats)),
                ("GetNumberOfVariableDependencies", (about, byref(size))),
                ("EnterInitializationMode", initialization),
                ("ExitInitializationMode", ()),
                ("DoStep", (start, STEP, c_bool(False), *map(byref, flags[:3]), byref(time))),
                ("DoStep", (start, STEP, c_bool(False), None, None, None, None)),
                ("Reset" if rng.random() < 0.05 else "EnterEventMode", ()),
                ("Terminate" if rng.random() < 0.05 else "EnterContinuousTimeMode", ()),
                ("UpdateDiscreteStates", (*map(byref, flags), byref(time))),
                ("SetContinuousStates", floats),
                ("GetContinuousStates", floats),
                ("GetContinuousStateDerivatives", floats),
                ("GetFMUState", (byref(state),)),
                ("SetFMUState", (state,)),
                ("FreeFMUState" if rng.random() < 0.2 else "GetFMUState", (byref(state),)),
                ("SerializedFMUStateSize", (state, byref(size))),
                ("SerializeFMUState", (state, data, c_size_t(len(data)))),
                ("DeserializeFMUState", (data, c_size_t(len(data)), byref(state))),
                ("GetClock", (*refs, (c_bool * len(refs[0]))())),
                *(of_clock if has_clock else ()),
            )
        )
        status = call(name, c, *arguments)
        if name == "DoStep" and status == 0:
            clock = time.value
        if name == "GetNumberOfVariableDependencies" and status == 0:
            arrays = [(t * size.value)() for t in (c_size_t, c_uint32, c_size_t, c_int)]
            call("GetVariableDependencies", c, about, *arrays, size)
    for c, state in zip(instances, states, strict=True):
        call("FreeFMUState", c, byref(state))
        library.fmi3FreeInstance(c)
    for name, of_status in sorted(counts.items()):
        print(name, *of_status)


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], *map(int, sys.argv[3:]))
