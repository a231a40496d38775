"""FMUs that do one thing wrong when they are called: a good one, in C, with a fault."""

from collections.abc import Mapping
from functools import cache, partial
from pathlib import Path
from string import Template

from fmu_verify.settings import Settings
from fmu_verify.verdict import Verdict
from tests.support.broken.broken import Broken, name_fault, write_fmu
from tests.support.hand_written_fmus import compile_library

_FOLDER = Path(__file__).parent
GUID = "{600d0000-0000-4000-8000-000000000000}"


def build_good_fmu(
    folder: Path,
    fault: str = "",
    name: str = "Good",
    total: str = "2 9",
    sources: Mapping[str, bytes] | None = None,
) -> Path:
    """Build the FMU in a folder.

    Args:
        folder: The folder.
        fault: What is wrong, as good.c names it.
        name: Name of the FMU.
        total: Declared dependencies of this output.
        sources: Its source files by name, of which the first one is listed.
    """
    listed = "".join(f'<SourceFiles><File name="{file}"/></SourceFiles>' for file in [*(sources or {})][:1])
    description = Template((_FOLDER / "good.xml").read_text(encoding="utf-8")).substitute(
        name=name,
        guid=GUID,
        total=total,
        kinds=' dependenciesKind="constant constant"' if total == "2 9" else "",
        once=str(fault == "ONLY_ONCE").lower(),
        order=2 if fault == "DERIVATIVE_ORDER" else 1,
        sources=listed,
    )
    files = {f"sources/{file}": content for file, content in (sources or {}).items()}
    return write_fmu(folder / f"{name}.fmu", description, _library(), fault, files)


@cache
def _library() -> bytes:
    """Compiled once, for all faults."""
    return compile_library(_FOLDER / "good.c", {"MODEL_GUID": f'"{GUID}"'})


def _fails(
    fault: str,
    check: str,
    what: str,
    settings: Settings | None = None,
    total: str = "2 9",
    verdict: Verdict = Verdict.FAILED,
) -> Broken:
    name = name_fault(fault or "Dependency")
    return Broken(
        name,
        what,
        check,
        lambda folder: build_good_fmu(folder, fault, name, total),
        settings or Settings(),
        verdict,
    )


_warns = partial(_fails, verdict=Verdict.WARNING)
_notes = partial(_fails, verdict=Verdict.PASSED)
_SHORT = Settings(seconds=1.5)
_SMALL = Settings(memory=100 * 2**20)

# fmt: off
DYNAMIC: list[Broken] = [
    _fails("ENVIRONMENT", "instance.environment", "it crashes where `componentEnvironment` is NULL"),
    _fails("OTHER_GUID", "instance.created", "the library was compiled for another GUID"),
    _fails("FREE_CRASH", "instance.created", "`fmi2FreeInstance` crashes"),
    _fails("ENDLESS", "events.iteration", "`fmi2NewDiscreteStates` always asks for another update"),
    _fails("ENDLESS_LATER", "events.iteration", "an event iteration in the run does not end"),
    _fails("INITIALIZATION_ERROR", "run.completes", "`fmi2ExitInitializationMode` answers `fmi2Error`"),
    _fails("SEGFAULT", "run.completes", "`fmi2DoStep` crashes after a time"),
    _fails("HANG", "run.completes", "`fmi2DoStep` never returns", _SHORT),
    _fails("EXIT", "run.completes", "`fmi2DoStep` calls `exit(0)`"),
    _fails("ABORT", "run.completes", "`fmi2DoStep` calls `abort()`"),
    _fails("NEGATIVE_STATUS", "run.completes", "`fmi2DoStep` answers -1, which is no status"),
    _fails("PENDING", "run.completes",
        "`fmi2DoStep` answers `fmi2Pending`, but the FMU runs nothing asynchronously"),
    _fails("MEMORY", "run.completes", "each step takes memory and keeps it, until there is none", _SMALL),
    _fails("TERMINATE_CRASH", "run.completes", "`fmi2Terminate` crashes"),
    _fails("NAN_LATER", "run.finite", "an output is NaN after a time"),
    _fails("INFINITE_LATER", "run.finite", "an output is infinite after a time"),
    _fails("CLOCK", "run.deterministic", "the result depends on the clock"),
    _fails("SECONDS", "run.deterministic", "the result depends on the second in which it runs"),
    _fails("ADDRESS", "run.deterministic", "the result depends on where an instance lies in memory"),
    _fails("UNINITIALIZED", "run.deterministic", "memory is read before it is written"),
    _fails("LEAK", "instance.cycles", "each instance leaves memory behind"),
    _fails("SHARED", "instance.independent", "all instances share their states"),
    _fails("NOT_RESET_BY_ANYONE", "instance.independent",
        "a static variable keeps what an earlier instance did"),
    _fails("RESET", "instance.reset", "`fmi2Reset` forgets a state"),
    _fails("NOT_RESTORED", "state.restored", "`fmi2SetFMUstate` forgets a state"),
    _fails("FREE_STATE_CRASH", "state.restored", "`fmi2FreeFMUstate` crashes"),
    _fails("NOT_SERIALIZED", "state.serialized", "the bytes of a state lack one of its values"),
    _fails("STATE_ADDRESS", "state.serialized", "the bytes of a state contain an address that is used"),
    _fails("STATE_SIZE", "state.serialized", "a state is said to need 2^60 bytes"),
    _fails("STATE_EMPTY", "state.serialized", "a state is said to need no bytes"),
    _fails("STATE_NOT_REUSED", "state.freed", "`fmi2GetFMUstate` forgets the state that it was given"),
    _fails("DERIVATIVE", "derivatives.directional", "a directional derivative is 5 % too large"),
    _fails("DERIVATIVE_FIRST", "derivatives.directional",
        "directional derivatives are right for the first unknown only"),
    _fails("DERIVATIVE_SECOND", "derivatives.directional",
        "directional derivatives by a second known are twice as large"),
    _fails("DERIVATIVE_STATE", "derivatives.directional",
        "directional derivatives by states have the wrong sign"),
    _fails("DERIVATIVE_LATER", "derivatives.directional", "directional derivatives are wrong after a time"),
    _fails("DERIVATIVE_CRASH", "derivatives.directional", "`fmi2GetDirectionalDerivative` crashes"),
    _fails("", "dependencies.observed", "an output depends on an input that its dependencies exclude",
        total="9"),
    _fails("ORDER", "exchange.order", "the result depends on which input is set last"),
    _fails("SPLIT_REFUSED", "steps.split", "another step size is refused, though variable ones are claimed"),
    _fails("MODEL_CRASH", "model_exchange.runs", "`fmi2GetDerivatives` crashes"),
    _fails("DERIVATIVES_SWAPPED", "model_exchange.states",
        "`fmi2GetDerivatives` returns the derivatives in another order than that of ModelStructure"),
    _fails("JUMP", "model_exchange.states", "an event changes a state, but does not say so"),
    _fails("TWO_INDICATORS", "calls.buffers", "`fmi2GetEventIndicators` writes one value too many"),
    _fails("NOT_FINAL", "values.final", "an output is 0 after `fmi2Terminate`"),
    _fails("CATEGORY", "log.categories", "it logs in a category that is switched off"),
    _fails("LOG_OFF", "log.categories", "it logs although logging is off"),
    _warns("OTHER_ENVIRONMENT", "instance.environment",
        "messages come with another pointer than `componentEnvironment`"),
    _warns("ANY_GUID", "instance.guid", "any GUID is taken"),
    _notes("ASKS_TO_END", "run.completes", "it asks to end its own default experiment"),
    _warns("RANGE", "run.ranges", "an output leaves its declared range"),
    _warns("NAN_INITIAL", "values.initial", "an output is NaN in initialization mode"),
    _warns("INDIRECT", "values.direct",
        "an output follows an input in the next step, on which it depends directly"),
    _warns("STEP_IGNORED", "steps.split", "`fmi2DoStep` always integrates by the same length"),
    _warns("RELATION", "model_exchange.states", "a derivative jumps in continuous-time mode"),
    _warns("EVENT_KICK", "model_exchange.split", "each call of `fmi2NewDiscreteStates` changes a state"),
    _warns("OUTPUT_DERIVATIVE_LATE", "derivatives.outputs",
        "the derivative of an output is that at the start of the step"),
    _warns("THREADS", "instance.threads", "steps of all instances use one static buffer"),
    _notes("PHASE_CRASH", "calls.phases", "`fmi2DoStep` before initialization crashes"),
    _notes("PHASE_ACCEPTED", "calls.phases", "a step after `fmi2Terminate` is answered with `fmi2OK`"),
    _warns("NAN_CRASH", "calls.nonfinite", "NaN in an input crashes"),
    _notes("NAN_ACCEPTED", "calls.nonfinite", "NaN is accepted without a message, and comes out"),
    _notes("DAMAGED_CRASH", "state.serialized", "damaged bytes of a state crash"),
    _warns("OUTPUT_DERIVATIVE", "derivatives.outputs", "the derivative of an output is not its slope"),
    _warns("DERIVATIVE_ORDER", "derivatives.outputs", "`maxOutputDerivativeOrder` is too large"),
    _warns("STALE", "steps.time", "after a step, values are those before it"),
    _notes("STEP_SIZE", "steps.split", "the result depends on the step size"),
    _notes("DISAGREE", "model_exchange.agrees", "model and slave have different equations"),
    _notes("SILENT", "log.errors", "errors come without a message"),
    _notes("PRINTS", "log.categories", "it writes to standard output"),
]
# fmt: on
"""One for each way to go wrong, in the order of the checks; those that warn or are noted come last."""
