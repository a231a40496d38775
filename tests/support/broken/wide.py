"""FMUs with variables of all types, in which any variable, or what is around it, is wrong."""

from collections.abc import Mapping
from functools import cache, partial
from pathlib import Path

from fmu_verify.verdict import Verdict
from tests.support.broken.broken import Broken, name_fault, write_fmu
from tests.support.hand_written_fmus import compile_library

_FOLDER = Path(__file__).parent
_GUID = "{31de0000-0000-4000-8000-000000000000}"

VARIABLES = {
    "u": (0, "input", "continuous", '<Real start="0" min="-10" max="10"/>'),
    "w": (1, "input", "continuous", '<Real start="0" min="-10" max="10"/>'),
    "k": (2, "parameter", "fixed", '<Real start="2"/>'),
    "d": (3, "parameter", "tunable", '<Real start="1" min="0" max="5"/>'),
    "x": (4, "output", "continuous", '<Real start="0.5"/>'),
    "der(x)": (5, "local", "continuous", '<Real derivative="5"/>'),
    "y": (6, "output", "continuous", "<Real/>"),
    "g": (7, "local", "constant", '<Real start="9.81"/>'),
    "time": (8, "independent", "continuous", "<Real/>"),
    "n": (100, "input", "discrete", '<Integer start="1" min="0" max="5"/>'),
    "m": (101, "parameter", "tunable", '<Integer start="3"/>'),
    "p": (102, "parameter", "fixed", '<Integer start="5"/>'),
    "mode_in": (103, "input", "discrete", '<Enumeration declaredType="Mode" start="1"/>'),
    "mode_p": (104, "parameter", "tunable", '<Enumeration declaredType="Mode" start="1"/>'),
    "sum": (105, "output", "discrete", "<Integer/>"),
    "mode": (106, "output", "discrete", '<Enumeration declaredType="Mode"/>'),
    "mode_2": (107, "output", "discrete", '<Enumeration declaredType="Mode"/>'),
    "count": (108, "output", "discrete", '<Integer start="0"/>'),
    "seven": (109, "local", "constant", '<Integer start="7"/>'),
    "on": (200, "input", "discrete", '<Boolean start="true"/>'),
    "latch": (201, "parameter", "tunable", '<Boolean start="false"/>'),
    "enabled": (202, "parameter", "fixed", '<Boolean start="false"/>'),
    "flag": (203, "output", "discrete", "<Boolean/>"),
    "flag_2": (204, "output", "discrete", "<Boolean/>"),
    "always": (205, "local", "constant", '<Boolean start="true"/>'),
    "label": (300, "input", "discrete", '<String start="label"/>'),
    "name": (301, "parameter", "tunable", '<String start="block"/>'),
    "tag": (302, "parameter", "fixed", '<String start="tag"/>'),
    "text": (303, "output", "discrete", "<String/>"),
    "echo": (304, "output", "discrete", "<String/>"),
    "always_text": (305, "local", "constant", '<String start="always"/>'),
}
"""Value reference, causality, variability, and the element of the type, by name."""

OUTPUTS = {
    "x": "x",
    "y": "u w x on",
    "sum": "n",
    "mode": "mode_in",
    "mode_2": "",
    "count": "",
    "flag": "on",
    "flag_2": "",
    "text": "",
    "echo": "label",
}
"""Dependencies of outputs while the FMU runs."""

INITIAL = {
    "der(x)": "u k d x",
    "y": "u w x on",
    "sum": "n m p",
    "mode": "mode_in",
    "mode_2": "mode_p",
    "flag": "on latch",
    "flag_2": "enabled",
    "text": "name",
    "echo": "label",
}
"""Dependencies in initialization mode."""

Dependencies = Mapping[str, str]


def build_wide_fmu(
    folder: Path,
    fault: str = "",
    target: str = "",
    name: str = "Wide",
    outputs: Dependencies = OUTPUTS,
    initial: Dependencies = INITIAL,
    victim: Path | None = None,
) -> Path:
    """Build the FMU in a folder.

    Args:
        folder: The folder.
        fault: What is wrong, as wide.c and wide_faults.h name it.
        target: The variable that is wrong, by name, or what a fault needs.
        name: Name of the FMU.
        outputs: Declared dependencies while it runs.
        initial: Declared dependencies in initialization mode.
        victim: A file of the user that some faults attack.
    """
    more = {} if victim is None else {"resources/victim.txt": f"{victim}\n".encode()}
    description = _describe(name, outputs, initial)
    return write_fmu(folder / f"{name}.fmu", description, _library(), f"{fault} {_reference(target)}", more)


@cache
def _library() -> bytes:
    """Compiled once, for all faults."""
    return compile_library(_FOLDER / "wide.c", {"MODEL_GUID": f'"{_GUID}"'})


def _reference(target: str) -> str:
    return str(VARIABLES[target][0]) if target in VARIABLES else target or "-"


def _describe(name: str, outputs: Dependencies, initial: Dependencies) -> str:
    index = {variable: str(k) for k, variable in enumerate(VARIABLES, 1)}

    def unknowns(declared: Dependencies) -> str:
        lines = sorted((int(index[u]), " ".join(index[k] for k in on.split())) for u, on in declared.items())
        return "".join(f'<Unknown index="{k}" dependencies="{on}"/>' for k, on in lines)

    variables = "".join(
        f'<ScalarVariable name="{variable}" valueReference="{reference}" causality="{causality}" '
        f'variability="{variability}"{_initial(variable, causality, variability)}>{element}'
        "</ScalarVariable>\n"
        for variable, (reference, causality, variability, element) in VARIABLES.items()
    )
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="{name}" guid="{_GUID}" generationTool="written by hand"
  variableNamingConvention="structured" description="A lag with variables of all types">
<CoSimulation modelIdentifier="{name}" canInterpolateInputs="true"
  canNotUseMemoryManagementFunctions="true" canGetAndSetFMUstate="true" canSerializeFMUstate="true"/>
<TypeDefinitions><SimpleType name="Mode"><Enumeration>
<Item name="slow" value="1"/><Item name="fast" value="2"/></Enumeration></SimpleType></TypeDefinitions>
<LogCategories><Category name="logStatusError"/></LogCategories>
<DefaultExperiment startTime="0" stopTime="1" stepSize="0.02"/>
<ModelVariables>
{variables}</ModelVariables>
<ModelStructure><Outputs>{unknowns(outputs)}</Outputs>
<Derivatives><Unknown index="6" dependencies="1 5"/></Derivatives>
<InitialUnknowns>{unknowns(initial)}</InitialUnknowns></ModelStructure>
</fmiModelDescription>
"""


def _initial(variable: str, causality: str, variability: str) -> str:
    if causality in ("input", "independent"):
        return ""
    exact = causality == "parameter" or variability == "constant" or variable in ("x", "count")
    return f' initial="{"exact" if exact else "calculated"}"'


def _fails(fault: str, target: str, check: str, what: str, verdict: Verdict = Verdict.FAILED) -> Broken:
    name = name_fault(fault, target)
    return Broken(
        name, what, check, lambda folder: build_wide_fmu(folder, fault, target, name), verdict=verdict
    )


_warns = partial(_fails, verdict=Verdict.WARNING)


def _lacks(output: str, known: str, what: str, *, later: bool = False) -> Broken:
    """Return an FMU whose dependencies lack one: of an output while it runs (`later`), or in both places."""

    def without(declared: Dependencies) -> Dependencies:
        return {**declared, output: " ".join(k for k in declared[output].split() if k != known)}

    outputs, initial = without(OUTPUTS), INITIAL if later else without(INITIAL)
    name = f"Lack{output.capitalize()}{known.capitalize()}{'Later' * later}".replace("_", "")
    return Broken(
        name,
        what,
        "dependencies.observed",
        lambda folder: build_wide_fmu(folder, name=name, outputs=outputs, initial=initial),
    )


# fmt: off
WIDE: list[Broken] = [
    _fails("version", "1.0", "binaries.version", "`fmi2GetVersion` returns 1.0"),
    _fails("start", "k", "values.start", "a Real parameter starts with another value than declared"),
    _fails("start", "m", "values.start", "an Integer parameter starts with another value than declared"),
    _fails("start", "latch", "values.start", "a Boolean parameter starts with another value than declared"),
    _fails("start", "name", "values.start", "a String parameter starts with another value than declared"),
    _fails("number_42", "flag", "values.booleans", "a Boolean is 42"),
    _fails("number_7_later", "mode", "values.enumerations", "an Enumeration has a value that is no item"),
    _fails("null", "text", "values.strings", "a String is NULL"),
    _fails("latin", "text", "values.strings", "a String is not UTF-8"),
    _fails("freed", "text", "values.strings", "a String is in memory that is freed"),
    _fails("unmapped", "text", "values.strings", "a String is in memory that does not exist"),
    _fails("on_the_stack", "text", "values.strings", "a String is on the stack of a function that returned"),
    _fails("reset", "k", "values.reset", "`fmi2Reset` keeps a Real parameter"),
    _fails("reset", "name", "values.reset", "`fmi2Reset` keeps a String parameter"),
    _fails("reset", "n", "values.reset", "`fmi2Reset` keeps an Integer input"),
    _fails("shared", "k", "values.shared", "all instances share a parameter"),
    _fails("shared_used", "k", "values.shared", "all instances compute with the parameter that was set last"),
    _fails("shared_used", "name", "values.shared", "all instances compute with the String that was set last"),
    _fails("state_kept", "", "state.freed", "`fmi2FreeFMUstate` keeps the pointer"),
    _fails("state", "d", "values.state", "a state lacks a tunable parameter"),
    _fails("state", "latch", "values.state", "a state lacks a Boolean"),
    _fails("state", "name", "values.state", "a state lacks a String"),
    _fails("state", "n", "values.state", "a state lacks an Integer input"),
    _fails("bytes", "d", "values.state", "the bytes of a state lack a tunable parameter"),
    _lacks("y", "on", "a dependency on a Boolean input is not declared"),
    _lacks("sum", "n", "a dependency on an Integer input is not declared"),
    _lacks("sum", "m", "a dependency on a parameter is not declared"),
    _fails("slope_unused", "", "exchange.interpolation", "derivatives of inputs are not used"),
    _fails("step_nothing", "", "steps.integrate", "`fmi2DoStep` does nothing"),
    _fails("instantiate:keep_much", "", "instance.cycles", "each instance keeps 1 MB that it never uses"),
    _fails("instantiate:file", "", "process.resources", "each instance leaves a file open"),
    _fails("instantiate:thread", "", "process.resources", "each instance leaves a thread behind"),
    _fails("instantiate:child", "", "process.resources", "each instance leaves a child process behind"),
    _fails("instantiate:orphan", "", "process.resources",
        "each instance leaves a process in another session behind"),
    _fails("step:term_itself", "", "run.completes", "`fmi2DoStep` sends SIGTERM to its process"),
    _fails("step:kill_group", "", "run.completes", "`fmi2DoStep` sends SIGKILL to its process group"),
    _fails("step:kill_parent", "", "instance.environment", "`fmi2DoStep` sends SIGKILL to its parent"),
    _warns("start", "x", "values.start", "a state starts with another value than declared"),
    _warns("unused_all", "", "exchange.inputs", "inputs are not used"),
    _warns("sign", "", "steps.integrate", "steps use an input with the wrong sign"),
    _warns("output_stops", "", "run.frozen", "an output stays the same after a time"),
    _warns("state_stops", "", "run.frozen", "a state is not integrated any more after a time"),
    _warns("unused_later", "u", "run.frozen", "an input is ignored after a time"),
    _warns("late", "d", "values.late", "a tunable parameter has no effect after initialization"),
    _warns("late", "n", "values.late", "an Integer input has no effect after initialization"),
    _warns("late", "latch", "values.late", "a tunable Boolean has no effect after initialization"),
    _warns("late", "label", "values.late", "a String input has no effect after initialization"),
    _warns("delayed", "n", "values.late", "an Integer input has its effect one step late"),
    _warns("delayed", "w", "values.late", "a Real input has its effect one step late"),
    _warns("start_ignored", "", "steps.time", "time is counted from the start of the run"),
    _warns("time_off", "", "steps.time", "the FMU's time is 0.005 s ahead after each step"),
    _warns("successful_off", "", "steps.time", "`fmi2LastSuccessfulTime` is off by a constant"),
    _warns("get:keep", "", "instance.memory", "each call of a get function keeps 100 bytes"),
    _warns("set:keep", "", "instance.memory", "each value that is set keeps 100 bytes"),
    _warns("state:keep", "", "instance.memory", "each state that is freed keeps 100 bytes"),
    _warns("step:keep", "", "instance.cycles", "each step keeps 100 bytes"),
    _warns("step:chdir", "", "process.settings", "it changes the working folder"),
    _warns("step:locale", "", "process.settings", "it changes the locale"),
    _warns("step:round", "", "process.settings", "it changes the rounding of floating-point numbers"),
    _warns("step:flush", "", "process.settings", "it lets the processor replace tiny numbers by 0"),
    _warns("step:traps", "", "process.settings", "it lets a division by 0 end the process"),
    _warns("step:handler", "", "process.settings", "it handles a signal"),
    _warns("step:write_own", "", "process.files", "it writes into its own folder"),
    _warns("step:write_own_briefly", "", "process.files", "it writes and removes a file in its own folder"),
    _warns("step:touch_own", "", "process.files", "it writes the same again into a file of its own"),
    _warns("step:write_working", "", "process.files", "it writes into the working folder"),
    _warns("step:write_home", "", "process.files", "it writes into the user's home folder"),
    _warns("step:flood_errors", "", "process.output", "it writes much to standard error"),
    _warns("unload:abort", "", "process.unload", "it aborts when its library is unloaded"),
    _fails("version", "3.0", "binaries.version", "`fmi2GetVersion` returns 3.0"),
    _fails("version_null", "", "binaries.version", "`fmi2GetVersion` returns NULL"),
    _fails("start", "mode_p", "values.start", "an Enumeration starts with another value than declared"),
    _fails("start", "label", "values.start", "a String input starts with another value than declared"),
    _fails("start", "g", "values.start", "a constant has another value than declared"),
    _fails("not_set", "p", "values.kept", "`fmi2SetInteger` ignores a parameter without an error"),
    _fails("not_set", "latch", "values.kept", "`fmi2SetBoolean` ignores a parameter without an error"),
    _fails("number_256", "flag", "values.booleans", "a Boolean is 256"),
    _fails("number_0_later", "mode", "values.enumerations", "an Enumeration becomes 0, which is no item"),
    _fails("null_later", "text", "values.strings", "a String becomes NULL after a time"),
    _fails("cut", "text", "values.strings", "a String ends within a character of UTF-8"),
    _fails("surrogate", "text", "values.strings", "a String has a surrogate, which UTF-8 excludes"),
    _fails("one_buffer", "", "values.strings", "all Strings of one call are in one buffer"),
    _fails("reset", "d", "values.reset", "`fmi2Reset` keeps a tunable parameter"),
    _fails("reset", "mode_in", "values.reset", "`fmi2Reset` keeps an Enumeration"),
    _fails("reset", "on", "values.reset", "`fmi2Reset` keeps a Boolean input"),
    _fails("shared", "enabled", "values.shared", "all instances share a Boolean parameter"),
    _fails("shared", "tag", "values.shared", "all instances share a String parameter"),
    _fails("state", "k", "values.state", "a state lacks a fixed parameter"),
    _fails("state", "tag", "values.state", "a state lacks a fixed String"),
    _fails("state", "mode_p", "values.state", "a state lacks an Enumeration"),
    _fails("bytes", "enabled", "values.state", "the bytes of a state lack a fixed Boolean"),
    _fails("state_null_crash", "", "state.freed", "`fmi2FreeFMUstate` of a NULL pointer crashes"),
    _lacks("sum", "n", "a dependency on an Integer is missing in Outputs alone", later=True),
    _lacks("echo", "label", "a dependency on a String is missing in Outputs alone", later=True),
    _lacks("mode_2", "mode_p", "a dependency on an Enumeration is not declared"),
    _fails("y_of_name", "", "dependencies.observed", "a Real depends on a String, and does not declare it"),
    _fails("text_of_on", "", "dependencies.observed",
        "a String depends on a Boolean, and does not declare it"),
    _fails("set_none_crash", "", "calls.empty", "`fmi2SetReal` of 0 variables crashes"),
    _warns("set_null_crash", "", "calls.empty", "`fmi2SetReal` of 0 variables reads an array that is NULL"),
    _fails("set_none_error", "", "calls.empty", "`fmi2SetReal` of 0 variables answers `fmi2Error`",
        Verdict.PASSED),
    _fails("unused", "n", "exchange.inputs", "one of several inputs is not used", Verdict.PASSED),
    _warns("step_double", "", "steps.integrate", "steps are twice as long as they should be"),
]
# fmt: on
"""Some of the faults, of each class."""
