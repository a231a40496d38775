"""FMUs with a Clock that are wrong in one thing: the toy with a clock and a fault of third.c."""

from functools import partial

from emla_cosim.verification.verdict import Verdict
from tests.support.broken.broken import Broken
from tests.support.broken.third import with_function, with_source

INTERVAL = 0.025
"""The interval of the clock in s, which is no multiple of the step size."""

_with_function = partial(with_function, clock=INTERVAL)

# fmt: off
CLOCKED: list[Broken] = [
    Broken("clocked-interval", "a Clock with another interval than it declares", "clocks.intervals",
        _with_function("interval")),
    Broken("clocked-between", "a clocked output that changes between two ticks", "clocks.ticks",
        _with_function("between")),
    Broken("clocked-readable", "a clocked output that can be read between two ticks", "clocks.ticks",
        _with_function("readable"), verdict=Verdict.WARNING),
    Broken("clocked-not-restored", "an FMU with a Clock whose state is not restored", "state.restored",
        _with_function("state")),
    Broken("clocked-any-mode", "a Clock that can be set in step mode", "calls.phases",
        _with_function("any_mode"), verdict=Verdict.WARNING),
    Broken("clocked-leak", "`fmi3SetClock` leaves memory behind", "sanitizer.leaks",
        with_source("clock_leak", INTERVAL)),
    Broken("clocked-endless", "an update of discrete states that always asks for another one",
        "run.completes", _with_function("endless")),
]
# fmt: on
