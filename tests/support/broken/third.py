"""FMUs of FMI 3.0 that are wrong in one thing: the toy with another description or function."""

import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path

import fmpy
from lxml import etree

from emla_cosim.verification.verdict import Verdict
from tests.support.broken.broken import Broken
from tests.support.broken.editing import Files, setting, with_files, with_text, with_tree, without
from tests.support.handwritten_fmu import compile_library

LIBRARY = f"binaries/{fmpy.platform_tuple}/Toy{fmpy.sharedLibraryExtension}"
BUILD = "sources/buildDescription.xml"
TERMINALS = "terminalsAndIcons/terminalsAndIcons.xml"

_files, _text, _tree = (partial(make, fmi=3) for make in (with_files, with_text, with_tree))
_setting, _without = partial(setting, fmi=3), partial(without, fmi=3)


def _variable(name: str) -> str:
    return f"ModelVariables/*[@name='{name}']"


def _listed(kind: str, reference: int) -> str:
    return f"ModelStructure/{kind}[@valueReference='{reference}']"


def _with_clock(root: etree._Element) -> None:
    """A Clock whose interval is missing, which the FMU does not know."""
    etree.SubElement(
        root.find("ModelVariables"),
        "Clock",
        name="clock",
        valueReference="99",
        causality="input",
        intervalVariability="constant",
    )
    root.find("CoSimulation").set("hasEventMode", "true")


def _terminal(variable: str) -> Callable[[Path], Path]:
    """Builds the FMU with a terminal that has this variable."""
    member = f'<TerminalMemberVariable variableName="{variable}" memberName="a" variableKind="signal"/>'
    terminals = f'<Terminals><Terminal name="t" matchingRule="bus">{member}</Terminal></Terminals>'
    return _text("</GraphicalRepresentation>", f"</GraphicalRepresentation>{terminals}", TERMINALS)


def _renamed_platform(files: Files) -> None:
    files[LIBRARY.replace(fmpy.platform_tuple, fmpy.platform)] = files.pop(LIBRARY)


def with_function(
    name: str, declaration: str, body: str, clock: float | None = None
) -> Callable[[Path], Path]:
    """Builds the FMU with another function in place of one, which it can call as `original`."""

    def edit(files: Files) -> None:
        text = _replace_function(files, name, declaration, body)
        with tempfile.TemporaryDirectory() as folder:
            for path, content in files.items():
                if path.startswith("sources/"):
                    Path(folder, Path(path).name).write_bytes(content)
            (block := Path(folder, "fmi3_block.c")).write_text(text)
            files[LIBRARY] = compile_library(block, {"FMI3_OVERRIDE_FUNCTION_PREFIX": 1})

    return _files(edit, clock=clock)


def with_source(name: str, declaration: str, body: str, clock: float | None = None) -> Callable[[Path], Path]:
    """Builds the FMU with another function in its sources, but not in its library."""

    def edit(files: Files) -> None:
        files["sources/fmi3_block.c"] = _replace_function(files, name, declaration, body).encode()

    return _files(edit, clock=clock)


def _replace_function(files: Files, name: str, declaration: str, body: str) -> str:
    """Return the source file with another function in place of one; without a declaration, it has none."""
    head, _, rest = files["sources/fmi3_block.c"].decode().partition('#include "fmi3_types.h"')
    assert rest
    other = f"FMI3_Export {declaration} {{ {body} }}" if declaration else ""
    return f"""{head}
#undef {name}
#define {name} original
#include "fmi3_types.h"{rest}
#undef {name}
{other}
"""


def _remove_time(root: etree._Element) -> None:
    """Remove the time, also as a dependency."""
    variables = root.find("ModelVariables")
    (time,) = (v for v in variables if v.get("causality") == "independent")
    variables.remove(time)
    for unknown in root.find("ModelStructure"):
        known = [r for r in unknown.get("dependencies").split() if r != time.get("valueReference")]
        unknown.set("dependencies", " ".join(known))


_DO_STEP = (
    "fmi3Status fmi3DoStep(fmi3Instance c, fmi3Float64 t, fmi3Float64 h, fmi3Boolean no, fmi3Boolean *event, "
    "fmi3Boolean *end, fmi3Boolean *early, fmi3Float64 *reached)"
)
_STEP = "fmi3Status status = original(c, t, h, no, event, end, early, reached);"
GET_FLOAT64 = (
    "fmi3Status fmi3GetFloat64(fmi3Instance c, const fmi3ValueReference r[], size_t n, fmi3Float64 v[], "
    "size_t m)"
)
_SET = (
    "fmi3Status fmi3SetFloat64(fmi3Instance c, const fmi3ValueReference r[], size_t n, "
    "const fmi3Float64 v[], size_t m)"
)
_DERIVE = (
    "fmi3Status {}(fmi3Instance c, const fmi3ValueReference u[], size_t nu, const fmi3ValueReference k[], "
    "size_t nk, const fmi3Float64 seed[], size_t ns, fmi3Float64 s[], size_t n)"
)
_SCALED = """
    fmi3Status status = original(c, u, nu, k, nk, seed, ns, s, n);
    for (size_t i = 0; i < n; i++) s[i] *= 1.5;
    return status;
"""
_DEPENDENCIES = (
    "fmi3Status fmi3GetVariableDependencies(fmi3Instance c, fmi3ValueReference r, size_t from[], "
    "fmi3ValueReference to[], size_t at[], fmi3DependencyKind k[], size_t n)"
)

THIRD: list[Broken] = [
    Broken(
        "third-no-identifier",
        "an FMI 3.0 co-simulation without a model identifier",
        "description.schema",
        _setting("CoSimulation", modelIdentifier=None),
    ),
    Broken(
        "third-early",
        "FMI 3.0: early return after intermediate updates, which are not provided",
        "description.capabilities",
        _setting("CoSimulation", providesIntermediateUpdate=None),
    ),
    Broken(
        "third-same-reference",
        "FMI 3.0: two variables with the same value reference",
        "variables.aliases",
        _setting(_variable("step_count"), valueReference="13", start="7.0"),
    ),
    Broken(
        "third-no-time",
        "FMI 3.0: no independent variable",
        "variables.attributes",
        _tree(_remove_time),
    ),
    Broken(
        "third-no-start",
        "FMI 3.0: a parameter without a start value",
        "variables.start",
        _setting(_variable("seed"), start=None),
    ),
    Broken(
        "third-start-above",
        "FMI 3.0: a start value of an array that is below its minimum",
        "variables.range",
        _setting(_variable("spring.k"), min="0.5"),
    ),
    Broken(
        "third-starts",
        "an array of two elements with three start values",
        "variables.dimensions",
        _setting(_variable("spring.k"), start="3.0 0.25 1.0"),
    ),
    Broken(
        "third-clocks",
        "a variable that belongs to a variable which is no Clock",
        "variables.clocks",
        _setting(_variable("random"), clocks="14"),
    ),
    Broken(
        "third-clock",
        "a constant Clock without an interval",
        "variables.clocks",
        _tree(_with_clock),
    ),
    Broken(
        "third-terminal",
        "a terminal with a variable that does not exist",
        "description.terminals",
        _terminal("nothing"),
    ),
    Broken(
        "third-build",
        "a build description for another model identifier",
        "sources.description",
        _text('modelIdentifier="Toy"', 'modelIdentifier="Boy"', BUILD),
    ),
    Broken(
        "third-no-output",
        "FMI 3.0: an output that ModelStructure does not list",
        "structure.outputs",
        _without(_listed("Output", 16)),
    ),
    Broken(
        "third-no-derivative",
        "FMI 3.0: a state derivative without the attribute `derivative`",
        "structure.derivatives",
        _setting(_variable("der(x)"), derivative=None),
    ),
    Broken(
        "third-no-unknown",
        "FMI 3.0: an initial unknown that ModelStructure does not list",
        "structure.initial_unknowns",
        _without(_listed("InitialUnknown", 16)),
    ),
    Broken(
        "third-kind",
        "FMI 3.0: a factor that is fixed after initialization, in initialization",
        "structure.dependencies",
        _setting(_listed("InitialUnknown", 16), dependenciesKind="fixed"),
    ),
    Broken(
        "third-platform",
        "FMI 3.0: a folder of binaries with its name in FMI 2.0",
        "binaries.platform",
        _files(_renamed_platform),
        verdict=Verdict.WARNING,
    ),
    Broken(
        "third-symbol",
        "an FMI 3.0 library without a function for Scheduled Execution",
        "binaries.symbols",
        with_function("fmi3ActivateModelPartition", "", ""),
    ),
    Broken(
        "third-version",
        "`fmi3GetVersion` returns 3.1",
        "binaries.version",
        with_function("fmi3GetVersion", "const char *fmi3GetVersion(void)", '(void)original; return "3.1";'),
    ),
    Broken(
        "third-event",
        "a step asks for event mode that is not used",
        "steps.events",
        with_function("fmi3DoStep", _DO_STEP, f"{_STEP} *event = fmi3True; return status;"),
    ),
    Broken(
        "third-returns",
        "a step returns early although the host does not allow it",
        "run.completes",
        with_function("fmi3DoStep", _DO_STEP, f"{_STEP} *early = fmi3True; return status;"),
    ),
    Broken(
        "third-unknown-reference",
        "values of variables that do not exist are returned",
        "calls.arguments",
        with_function("fmi3GetFloat64", GET_FLOAT64, "original(c, r, n, v, m); return fmi3OK;"),
        verdict=Verdict.WARNING,
    ),
    Broken(
        "third-not-restored",
        "FMI 3.0: a state that is not restored",
        "state.restored",
        with_function(
            "fmi3SetFMUState",
            "fmi3Status fmi3SetFMUState(fmi3Instance c, fmi3FMUState s)",
            "(void)original; return c && s ? fmi3OK : fmi3Error;",
        ),
    ),
    Broken(
        "third-directional",
        "FMI 3.0: a directional derivative that is wrong by half",
        "derivatives.directional",
        with_function(
            "fmi3GetDirectionalDerivative", _DERIVE.format("fmi3GetDirectionalDerivative"), _SCALED
        ),
    ),
    Broken(
        "third-adjoint",
        "an adjoint derivative that is wrong by half",
        "derivatives.adjoint",
        with_function("fmi3GetAdjointDerivative", _DERIVE.format("fmi3GetAdjointDerivative"), _SCALED),
    ),
    Broken(
        "third-overrun",
        "FMI 3.0: `fmi3SetFloat64` writes behind allocated memory",
        "sanitizer.address",
        with_source(
            "fmi3SetFloat64",
            _SET,
            "double *copy = malloc(m * sizeof *copy); for (size_t i = 0; i <= m; i++) copy[i] = 1.0; "
            "m += copy[m] < 0.0; free(copy); return original(c, r, n, v, m);",
        ),
    ),
    Broken(
        "third-leak",
        "FMI 3.0: each step leaves memory behind",
        "sanitizer.leaks",
        with_source("fmi3DoStep", _DO_STEP, f"{_STEP} *(char *)malloc(40) = 0; return status;"),
    ),
    Broken(
        "third-shift",
        "FMI 3.0: an int is shifted by 32 bits",
        "sanitizer.undefined",
        with_source(
            "fmi3DoStep",
            _DO_STEP,
            f"static int bits = 32; {_STEP} if ((1 << bits) == 3) status = fmi3Error; return status;",
        ),
        verdict=Verdict.WARNING,
    ),
    Broken(
        "third-element",
        "a dependency on an element that does not exist",
        "dependencies.elements",
        with_function(
            "fmi3GetVariableDependencies",
            _DEPENDENCIES,
            "fmi3Status status = original(c, r, from, to, at, k, n); if (n) at[0] += 7; return status;",
        ),
    ),
]
