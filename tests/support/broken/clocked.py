"""FMUs with a Clock that are wrong in one thing: the toy with a clock and another function."""

from functools import partial

from emla_cosim.verification.verdict import Verdict
from tests.support.broken.broken import Broken
from tests.support.broken.third import GET_FLOAT64, with_function, with_source
from tests.support.toy import Toy

INTERVAL = 0.025
"""The interval of the clock in s, which is no multiple of the step size."""

_with_function = partial(with_function, clock=INTERVAL)
_POWER = Toy.layout().reference("power")

_ONE_OUTPUT = f"if (status == fmi3Error && n == 1 && m == 1 && r[0] == {_POWER})"

_SET_CLOCK = (
    "fmi3Status fmi3SetClock(fmi3Instance c, const fmi3ValueReference r[], size_t n, const fmi3Clock v[])"
)

CLOCKED: list[Broken] = [
    Broken(
        "clocked-interval",
        "a Clock with another interval than it declares",
        "clocks.intervals",
        _with_function(
            "fmi3GetIntervalDecimal",
            "fmi3Status fmi3GetIntervalDecimal(fmi3Instance c, const fmi3ValueReference r[], size_t n, "
            "fmi3Float64 v[], fmi3IntervalQualifier q[])",
            "fmi3Status status = original(c, r, n, v, q); v[0] *= 2.0; return status;",
        ),
    ),
    Broken(
        "clocked-between",
        "a clocked output that changes between two ticks",
        "clocks.ticks",
        _with_function(
            "fmi3GetFloat64",
            GET_FLOAT64,
            "static double more; fmi3Status status = original(c, r, n, v, m); "
            f"{_ONE_OUTPUT} {{ v[0] = more += 1.0; return fmi3OK; }} return status;",
        ),
    ),
    Broken(
        "clocked-readable",
        "a clocked output that can be read between two ticks",
        "clocks.ticks",
        _with_function(
            "fmi3GetFloat64",
            GET_FLOAT64,
            "fmi3Status status = original(c, r, n, v, m); "
            f"{_ONE_OUTPUT} {{ v[0] = 7.0; return fmi3OK; }} return status;",
        ),
        verdict=Verdict.WARNING,
    ),
    Broken(
        "clocked-not-restored",
        "an FMU with a Clock whose state is not restored",
        "state.restored",
        _with_function(
            "fmi3SetFMUState",
            "fmi3Status fmi3SetFMUState(fmi3Instance c, fmi3FMUState s)",
            "(void)original; return c && s ? fmi3OK : fmi3Error;",
        ),
    ),
    Broken(
        "clocked-any-mode",
        "a Clock that can be set in step mode",
        "calls.phases",
        _with_function(
            "fmi3SetClock",
            _SET_CLOCK,
            "original(c, r, n, v); return fmi3OK;",
        ),
        verdict=Verdict.WARNING,
    ),
    Broken(
        "clocked-leak",
        "`fmi3SetClock` leaves memory behind",
        "sanitizer.leaks",
        with_source(
            "fmi3SetClock", _SET_CLOCK, "*(char *)malloc(40) = 0; return original(c, r, n, v);", INTERVAL
        ),
    ),
    Broken(
        "clocked-endless",
        "an update of discrete states that always asks for another one",
        "run.completes",
        _with_function(
            "fmi3UpdateDiscreteStates",
            "fmi3Status fmi3UpdateDiscreteStates(fmi3Instance c, fmi3Boolean *more, fmi3Boolean *ends, "
            "fmi3Boolean *nominals, fmi3Boolean *states, fmi3Boolean *defined, fmi3Float64 *next)",
            "fmi3Status status = original(c, more, ends, nominals, states, defined, next); *more = fmi3True; "
            "return status;",
        ),
    ),
]
