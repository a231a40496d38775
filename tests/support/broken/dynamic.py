"""FMUs that do one thing wrong when they are called: a good one, in C, with a fault."""

from collections.abc import Callable
from enum import IntEnum
from functools import cache
from pathlib import Path
from string import Template

import fmpy

from emla_cosim.verification.settings import Settings
from emla_cosim.verification.verdict import Verdict
from fmublock.archive import write_archive
from tests.support.broken.broken import Broken
from tests.support.handwritten_fmu import compile_library

_FOLDER = Path(__file__).parent
_GUID = "{600d0000-0000-4000-8000-000000000000}"


class Fault(IntEnum):
    """What `good.c` does wrong, as it reads it from resources/fault.txt."""

    NONE = 0
    OTHER_GUID = 1
    SEGFAULT = 2
    HANG = 3
    EXIT = 4
    ABORT = 5
    NAN_LATER = 6
    INFINITE_LATER = 7
    NEGATIVE_STATUS = 8
    PENDING = 9
    SHARED = 10
    NOT_RESTORED = 11
    NOT_SERIALIZED = 12
    CLOCK = 13
    SECONDS = 14
    ADDRESS = 15
    UNINITIALIZED = 16
    LEAK = 17
    RESET = 18
    DERIVATIVE = 19
    ORDER = 20
    DISAGREE = 21
    SPLIT_REFUSED = 22
    STEP_SIZE = 23
    PHASE_CRASH = 24
    NAN_CRASH = 25
    CATEGORY = 26
    LOG_OFF = 27
    MEMORY = 28
    TERMINATE_CRASH = 29
    FREE_CRASH = 30
    MODEL_CRASH = 31
    FREE_STATE_CRASH = 32
    STATE_SIZE = 33
    THREADS = 34
    RANGE = 35
    PRINTS = 36
    ANY_GUID = 37
    OUTPUT_DERIVATIVE = 38
    PHASE_ACCEPTED = 39
    NAN_ACCEPTED = 40
    DAMAGED_CRASH = 41
    ASKS_TO_END = 42
    DERIVATIVE_CRASH = 43
    INITIALIZATION_ERROR = 44
    NOT_RESET_BY_ANYONE = 45
    ONLY_ONCE = 46
    """A process can have one instance, which is no fault where it is said."""
    STATE_EMPTY = 47
    STATE_NOT_REUSED = 48
    DERIVATIVE_ORDER = 49
    STALE = 50


def build_good_fmu(folder: Path, fault: Fault = Fault.NONE, name: str = "Good", total: str = "2 9") -> Path:
    """Build the FMU in a folder, with one fault; `total` are the declared dependencies of this output."""
    template = Template((_FOLDER / "good.xml").read_text(encoding="utf-8"))
    path = folder / f"{name}.fmu"
    once = str(fault == Fault.ONLY_ONCE).lower()
    order = 2 if fault == Fault.DERIVATIVE_ORDER else 1
    text = template.substitute(name=name, guid=_GUID, total=total, once=once, order=order)
    content = {
        "modelDescription.xml": text.encode(),
        f"binaries/{fmpy.platform}/{name}{fmpy.sharedLibraryExtension}": _library(),
        "documentation/index.html": b"<!doctype html><title>Good</title><p>It does what it says.",
        "documentation/licenses/license.txt": b"Do what you want.",
        "resources/fault.txt": f"{fault.value}\n".encode(),
    }
    write_archive(path, content)
    return path


@cache
def _library() -> bytes:
    """Compiled once, for all faults."""
    return compile_library(_FOLDER / "good.c", {"MODEL_GUID": f'"{_GUID}"'})


def _built(fault: Fault, name: str, total: str) -> Callable[[Path], Path]:
    return lambda folder: build_good_fmu(folder, fault, name, total)


def _fails(
    fault: Fault, check: str, what: str, settings: Settings | None = None, total: str = "2 9"
) -> Broken:
    name = "".join(word.capitalize() for word in fault.name.split("_")) if fault else "Dependency"
    return Broken(name, what, check, _built(fault, name, total), settings or Settings())


def _warns(fault: Fault, check: str, what: str, verdict: Verdict = Verdict.WARNING) -> Broken:
    name = "".join(word.capitalize() for word in fault.name.split("_"))
    return Broken(name, what, check, _built(fault, name, "2 9"), verdict=verdict)


def _notes(fault: Fault, check: str, what: str) -> Broken:
    return _warns(fault, check, what, Verdict.PASSED)


_SHORT = Settings(seconds=1.5)
_SMALL = Settings(memory=100 * 2**20)

DYNAMIC: list[Broken] = [
    _fails(Fault.OTHER_GUID, "instance.created", "the library was compiled for another GUID"),
    _fails(Fault.FREE_CRASH, "instance.created", "`fmi2FreeInstance` crashes"),
    _fails(Fault.INITIALIZATION_ERROR, "run.completes", "`fmi2ExitInitializationMode` answers `fmi2Error`"),
    _fails(Fault.SEGFAULT, "run.completes", "`fmi2DoStep` crashes after a time"),
    _fails(Fault.HANG, "run.completes", "`fmi2DoStep` never returns", _SHORT),
    _fails(Fault.EXIT, "run.completes", "`fmi2DoStep` calls `exit(0)`"),
    _fails(Fault.ABORT, "run.completes", "`fmi2DoStep` calls `abort()`"),
    _fails(Fault.NEGATIVE_STATUS, "run.completes", "`fmi2DoStep` answers -1, which is no status"),
    _fails(
        Fault.PENDING,
        "run.completes",
        "`fmi2DoStep` answers `fmi2Pending`, but the FMU runs nothing asynchronously",
    ),
    _fails(Fault.MEMORY, "run.completes", "each step takes memory and keeps it, until there is none", _SMALL),
    _fails(Fault.TERMINATE_CRASH, "run.completes", "`fmi2Terminate` crashes"),
    _fails(Fault.NAN_LATER, "run.finite", "an output is NaN after a time"),
    _fails(Fault.INFINITE_LATER, "run.finite", "an output is infinite after a time"),
    _fails(Fault.CLOCK, "run.deterministic", "the result depends on the clock"),
    _fails(Fault.SECONDS, "run.deterministic", "the result depends on the second in which it runs"),
    _fails(Fault.ADDRESS, "run.deterministic", "the result depends on where an instance lies in memory"),
    _fails(Fault.UNINITIALIZED, "run.deterministic", "memory is read before it is written"),
    _fails(Fault.LEAK, "instance.cycles", "each instance leaves memory behind"),
    _fails(Fault.SHARED, "instance.independent", "all instances share their states"),
    _fails(
        Fault.NOT_RESET_BY_ANYONE,
        "instance.independent",
        "a static variable keeps what an earlier instance did",
    ),
    _fails(Fault.RESET, "instance.reset", "`fmi2Reset` forgets a state"),
    _fails(Fault.NOT_RESTORED, "state.restored", "`fmi2SetFMUstate` forgets a state"),
    _fails(Fault.FREE_STATE_CRASH, "state.restored", "`fmi2FreeFMUstate` crashes"),
    _fails(Fault.NOT_SERIALIZED, "state.serialized", "the bytes of a state lack one of its values"),
    _fails(Fault.STATE_SIZE, "state.serialized", "a state is said to need 2^60 bytes"),
    _fails(Fault.STATE_EMPTY, "state.serialized", "a state is said to need no bytes"),
    _fails(Fault.STATE_NOT_REUSED, "state.freed", "`fmi2GetFMUstate` forgets the state that it was given"),
    _fails(Fault.DERIVATIVE, "derivatives.directional", "a directional derivative is 5 % too large"),
    _fails(Fault.DERIVATIVE_CRASH, "derivatives.directional", "`fmi2GetDirectionalDerivative` crashes"),
    _fails(
        Fault.NONE,
        "dependencies.observed",
        "an output depends on an input that its dependencies exclude",
        total="9",
    ),
    _fails(Fault.ORDER, "exchange.order", "the result depends on which input is set last"),
    _fails(
        Fault.SPLIT_REFUSED, "steps.split", "another step size is refused, though variable ones are claimed"
    ),
    _fails(Fault.MODEL_CRASH, "model_exchange.runs", "`fmi2GetDerivatives` crashes"),
    _fails(Fault.CATEGORY, "log.categories", "it logs in a category that is switched off"),
    _fails(Fault.LOG_OFF, "log.categories", "it logs although logging is off"),
    _warns(Fault.ANY_GUID, "instance.guid", "any GUID is taken"),
    _notes(Fault.ASKS_TO_END, "run.completes", "it asks to end its own default experiment"),
    _warns(Fault.RANGE, "run.ranges", "an output leaves its declared range"),
    _warns(Fault.THREADS, "instance.threads", "steps of all instances use one static buffer"),
    _notes(Fault.PHASE_CRASH, "calls.phases", "`fmi2DoStep` before initialization crashes"),
    _notes(Fault.PHASE_ACCEPTED, "calls.phases", "a step after `fmi2Terminate` is answered with `fmi2OK`"),
    _warns(Fault.NAN_CRASH, "calls.nonfinite", "NaN in an input crashes"),
    _notes(Fault.NAN_ACCEPTED, "calls.nonfinite", "NaN is accepted without a message, and comes out"),
    _notes(Fault.DAMAGED_CRASH, "state.serialized", "damaged bytes of a state crash"),
    _warns(Fault.OUTPUT_DERIVATIVE, "derivatives.outputs", "the derivative of an output is not its slope"),
    _warns(Fault.DERIVATIVE_ORDER, "derivatives.outputs", "`maxOutputDerivativeOrder` is too large"),
    _warns(Fault.STALE, "steps.integrate", "after a step, values are those before it"),
    _notes(Fault.STEP_SIZE, "steps.split", "the result depends on the step size"),
    _notes(Fault.DISAGREE, "model_exchange.agrees", "model and slave have different equations"),
    _notes(Fault.PRINTS, "log.categories", "it writes to standard output"),
]
"""One for each way to go wrong, in the order of the checks; those that warn or are noted come last."""
