"""Random calls of the FMI 3.0 functions of a library, with arrays of exactly the announced sizes.

Arguments: the library, the instantiation token, the number of value references, the seed, the calls, whether
the FMU has a clock (0 or 1), whose value reference follows the others, and the value references of the
variables to read within steps.
"""

import ctypes
import random
import sys
from ctypes import byref, c_bool, c_double, c_int, c_int32, c_int64, c_size_t, c_uint32, c_void_p
from typing import Any

UPDATE = ctypes.CFUNCTYPE(
    None, c_void_p, c_double, *4 * (c_bool,), ctypes.POINTER(c_bool), ctypes.POINTER(c_double)
)
LOGGER = ctypes.CFUNCTYPE(None, c_void_p, c_int, ctypes.c_char_p, ctypes.c_char_p)
NUMBERS = (0.0, 1.0, -1.0, 0.1, 1e-3, 2.0, 1e308, float("inf"), float("nan"))


def call(library: Any, name: str, *arguments: Any) -> int:
    return int(getattr(library, name)(*arguments))


def references(rng: random.Random, n: int) -> tuple[Any, int]:
    count = rng.randrange(4)
    return (c_uint32 * count)(*(rng.randrange(n + 2) for _ in range(count))), count


def numbers(rng: random.Random, kind: Any) -> tuple[Any, int]:
    count = rng.randrange(7)
    is_float = kind is c_double
    values = (rng.choice(NUMBERS) if is_float else rng.randrange(-1, 9) for _ in range(count))
    return (kind * count)(*values), count


def main(path: str, token: str, variables: int, seed: int, calls: int, has_clock: int, *needed: int) -> None:
    rng, library = random.Random(seed), ctypes.CDLL(path)
    logger = LOGGER(lambda environment, status, category, message: None)
    for kind in ("CoSimulation", "ModelExchange"):
        getattr(library, f"fmi3Instantiate{kind}").restype = c_void_p
    counts: dict[str, list[int]] = {}

    def update(environment: Any, time: float, *others: Any) -> None:
        """Read and set random values within a step, and end it now and then."""
        refs, n = references(rng, variables)
        values, count = numbers(rng, c_double)
        for name in ("GetFloat64", "SetFloat64"):
            status = call(library, f"fmi3{name}", instances[0], refs, c_size_t(n), values, c_size_t(count))
            counts.setdefault(f"{name}WithinStep", [0] * 5)[status] += 1
        others[-2][0], others[-1][0] = rng.random() < 0.3, rng.choice((time, *NUMBERS))

    callback = UPDATE(update)
    required = (c_uint32 * len(needed))(*needed)
    instances, states = [], []
    for k in (0, 1):
        k = 0 if has_clock else k  # it has no Model Exchange
        extra = (c_bool(bool(has_clock)), c_bool(True), required, c_size_t(len(needed))) if k == 0 else ()
        last = (callback,) if k == 0 else ()
        create = library.fmi3InstantiateCoSimulation if k == 0 else library.fmi3InstantiateModelExchange
        made = create(b"x", token.encode(), b"/", c_bool(False), c_bool(True), *extra, None, logger, *last)
        instances.append(c_void_p(made))
        states.append(c_void_p())
    types = {
        "Float64": c_double,
        "Int32": c_int32,
        "Int64": c_int64,
        "Boolean": c_bool,
        "Int8": ctypes.c_int8,
    }
    flags, time, size = [c_bool() for _ in range(5)], c_double(), c_size_t()
    clock, ticks = 0.0, (c_uint32 * 1)(variables)
    about = c_uint32()
    for _ in range(calls):
        i = rng.randrange(2)
        c, state = instances[i], states[i]
        kind = rng.choice(list(types))
        refs, n = references(rng, variables)
        knowns, m = references(rng, variables)
        values, count = numbers(rng, types[kind])
        seeds, n_seeds = numbers(rng, c_double)
        other, n_other = numbers(rng, c_double)
        data = (ctypes.c_uint8 * rng.choice((0, 8, size.value)))()
        length = c_size_t(len(data))
        start = rng.choice((clock, 0.0, 5.0))
        orders = (c_int32 * n)(*(rng.randrange(3) for _ in range(n)))
        derivative = (
            refs,
            c_size_t(n),
            knowns,
            c_size_t(m),
            seeds,
            c_size_t(n_seeds),
            other,
            c_size_t(n_other),
        )
        about.value = rng.randrange(variables + 2)
        of_clock = (
            ("GetClock", (ticks, c_size_t(1), (c_bool * 1)())),
            ("SetClock", (ticks, c_size_t(1), (c_bool * 1)(True))),
            ("GetIntervalDecimal", (ticks, c_size_t(1), (c_double * 1)(), (c_int * 1)())),
            ("GetShiftDecimal", (ticks, c_size_t(1), (c_double * 1)())),
            ("EnterStepMode", ()),
        )
        name, arguments = rng.choice(
            (
                (f"Get{kind}", (refs, c_size_t(n), values, c_size_t(count))),
                (f"Set{kind}", (refs, c_size_t(n), values, c_size_t(count))),
                ("GetFloat64", (refs, c_size_t(n), seeds, c_size_t(n_seeds))),
                ("GetDirectionalDerivative", derivative),
                ("GetAdjointDerivative", derivative),
                ("GetOutputDerivatives", (refs, c_size_t(n), orders, seeds, c_size_t(n_seeds))),
                ("GetNumberOfVariableDependencies", (about, byref(size))),
                (
                    "EnterInitializationMode",
                    (c_bool(False), c_double(0), c_double(0), c_bool(False), c_double(0)),
                ),
                ("ExitInitializationMode", ()),
                (
                    "DoStep",
                    (c_double(start), c_double(0.01), c_bool(False), *map(byref, flags[:3]), byref(time)),
                ),
                ("DoStep", (c_double(start), c_double(0.01), c_bool(False), None, None, None, None)),
                ("Reset" if rng.random() < 0.05 else "EnterEventMode", ()),
                ("Terminate" if rng.random() < 0.05 else "EnterContinuousTimeMode", ()),
                ("UpdateDiscreteStates", (*map(byref, flags), byref(time))),
                ("SetContinuousStates", (seeds, c_size_t(n_seeds))),
                ("GetContinuousStates", (seeds, c_size_t(n_seeds))),
                ("GetContinuousStateDerivatives", (seeds, c_size_t(n_seeds))),
                ("GetFMUState", (byref(state),)),
                ("SetFMUState", (state,)),
                ("FreeFMUState" if rng.random() < 0.2 else "GetFMUState", (byref(state),)),
                ("SerializedFMUStateSize", (state, byref(size))),
                ("SerializeFMUState", (state, data, length)),
                ("DeserializeFMUState", (data, length, byref(state))),
                ("GetClock", (refs, c_size_t(n), (c_bool * n)())),
                *(of_clock if has_clock else ()),
            )
        )
        status = call(library, f"fmi3{name}", c, *arguments)
        if name == "DoStep" and status == 0:
            clock = time.value
        counts.setdefault(name, [0] * 5)[status] += 1
        if name == "GetNumberOfVariableDependencies" and status == 0:
            k = size.value
            places = [(t * k)() for t in (c_size_t, c_uint32, c_size_t, c_int)]
            call(library, "fmi3GetVariableDependencies", c, about, *places, c_size_t(k))
    for c, state in zip(instances, states, strict=True):
        call(library, "fmi3FreeFMUState", c, byref(state))
        library.fmi3FreeInstance(c)
    for name, found in sorted(counts.items()):
        print(name, *found)


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], *map(int, sys.argv[3:]))
