"""FMUs of FMI 3.0 that are wrong in one thing: the toy with another description, or a fault of third.c.

Those with a Clock are the toy with a clock.
"""

import re
import tempfile
from collections.abc import Mapping
from functools import cache, partial
from pathlib import Path

import fmpy
from lxml import etree

from fmu_verify.check import Verdict
from tests.support.broken.broken import Broken, read_faults
from tests.support.broken.editing import (
    Build,
    Files,
    append,
    good_files,
    set_attributes,
    setting,
    with_files,
    with_text,
    with_tree,
    without,
)
from tests.support.hand_written_fmus import compile_library
from tests.support.toy import Toy

LIBRARY = f"binaries/{fmpy.platform_tuple}/Toy{fmpy.sharedLibraryExtension}"
BUILD = "sources/buildDescription.xml"
_SOURCE = "sources/fmi3_block.c"
_NO_FAULT = b"@fault:none"
TERMINALS = "terminalsAndIcons/terminalsAndIcons.xml"
INTERVAL = 0.025
"""The interval of the clock in s, which is no multiple of the step size."""

_files, _text, _tree = (partial(make, fmi=3) for make in (with_files, with_text, with_tree))
_setting, _without = partial(setting, fmi=3), partial(without, fmi=3)


def _variable(name: str) -> str:
    return f"ModelVariables/*[@name='{name}']"


def _listed(kind: str, reference: int) -> str:
    return f"ModelStructure/{kind}[@valueReference='{reference}']"


_CLOCK = '<Clock name="clock" valueReference="99" causality="input" intervalVariability="constant"/>'
"""A Clock whose interval is missing, which the FMU does not know."""


def _terminal(variable: str) -> Build:
    """Builds the FMU with a terminal that has this variable."""
    member = f'<TerminalMemberVariable variableName="{variable}" memberName="a" variableKind="signal"/>'
    terminals = f'<Terminals><Terminal name="t" matchingRule="bus">{member}</Terminal></Terminals>'
    return _text("</GraphicalRepresentation>", f"</GraphicalRepresentation>{terminals}", TERMINALS)


def _rename_symbol(files: Files) -> None:
    old = b"fmi3ActivateModelPartition\0"
    assert old in files[LIBRARY]
    files[LIBRARY] = files[LIBRARY].replace(old, b"fmi3ActivateModelPartitioz\0")


def _renamed_platform(files: Files) -> None:
    files[LIBRARY.replace(fmpy.platform_tuple, fmpy.platform)] = files.pop(LIBRARY)


def with_function(fault: str, clock: float | None = None) -> Build:
    """Builds the FMU with a library that has a fault of third.c."""

    def edit(files: Files) -> None:
        library = _library(clock)
        assert library.count(_NO_FAULT.ljust(32, b"\0")) == 1
        files[LIBRARY] = library.replace(
            _NO_FAULT.ljust(32, b"\0"), f"@fault:{fault}".encode().ljust(32, b"\0")
        )

    return _files(edit, clock=clock)


def with_source(fault: str, clock: float | None = None) -> Build:
    """Builds the FMU with the fault in its sources, but not in its library."""

    def edit(files: Files) -> None:
        files[_SOURCE] = _with_faults(files).replace(_NO_FAULT, f"@fault:{fault}".encode())

    return _files(edit, clock=clock)


@cache
def _library(clock: float | None) -> bytes:
    """Return the library with all faults of third.c: compiled once, for one kind of the toy."""
    files = good_files(3, clock)
    with tempfile.TemporaryDirectory() as folder:
        for path, content in files.items():
            if path.startswith("sources/"):
                Path(folder, Path(path).name).write_bytes(content)
        (block := Path(folder, "fmi3_block.c")).write_bytes(_with_faults(files))
        return compile_library(block, {"FMI3_OVERRIDE_FUNCTION_PREFIX": 1})


def _with_faults(files: Files) -> bytes:
    """Return the source file of the toy, with functions of third.c in place of its own."""
    faults = Path(__file__).with_name("third.c").read_text(encoding="utf-8")
    names = dict.fromkeys(re.findall(r"\bgood_(fmi3\w+)\(", faults))
    names |= dict.fromkeys(re.findall(r"^DERIVATIVE\((\w+)", faults, flags=re.MULTILINE))
    renames = "".join(f"#undef {name}\n#define {name} good_{name}\n" for name in names)
    restores = "".join(f"#undef {name}\n" for name in names)
    head, types, rest = files[_SOURCE].decode().partition('#include "fmi3_types.h"')
    assert rest
    power = f"#define POWER {Toy.layout().reference('power')}\n"
    return f"{head}\n{renames}{types}{rest}\n{restores}{power}{faults}".encode()


def _remove_time(root: etree._Element) -> None:
    """Remove the time, also as a dependency."""
    variables = root.find("ModelVariables")
    (time,) = (v for v in variables if v.get("causality") == "independent")
    variables.remove(time)
    for unknown in root.find("ModelStructure"):
        known = [r for r in unknown.get("dependencies").split() if r != time.get("valueReference")]
        unknown.set("dependencies", " ".join(known))


def _build(folder: Path, row: Mapping[str, str], clock: float | None) -> Path:
    """Build the FMU with a fault of third.c, in its library or in its sources."""
    return (with_source if row["target"] == "sources" else with_function)(row["fault"], clock)(folder)


# fmt: off
THIRD: list[Broken] = [
    Broken("third-no-identifier", "an FMI 3.0 co-simulation without a model identifier", "description.schema",
        _setting("CoSimulation", modelIdentifier=None)),
    Broken("third-early", "FMI 3.0: early return after intermediate updates, which are not provided",
        "description.capabilities", _setting("CoSimulation", providesIntermediateUpdate=None)),
    Broken("third-same-reference", "FMI 3.0: two variables with the same value reference",
        "variables.aliases", _setting(_variable("step_count"), valueReference="13", start="7.0")),
    Broken("third-no-time", "FMI 3.0: no independent variable", "variables.attributes", _tree(_remove_time)),
    Broken("third-no-start", "FMI 3.0: a parameter without a start value", "variables.start",
        _setting(_variable("seed"), start=None)),
    Broken("third-start-above", "FMI 3.0: a start value of an array that is below its minimum",
        "variables.range", _setting(_variable("spring.k"), min="0.5")),
    Broken("third-starts", "an array of two elements with three start values", "variables.dimensions",
        _setting(_variable("spring.k"), start="3.0 0.25 1.0")),
    Broken("third-clocks", "a variable that belongs to a variable which is no Clock", "variables.clocks",
        _setting(_variable("random"), clocks="14")),
    Broken("third-clock", "a constant Clock without an interval", "variables.clocks",
        _tree(append("ModelVariables", _CLOCK), set_attributes("CoSimulation", hasEventMode="true"))),
    Broken("third-terminal", "a terminal with a variable that does not exist", "description.terminals",
        _terminal("nothing")),
    Broken("third-build", "a build description for another model identifier", "sources.description",
        _text('modelIdentifier="Toy"', 'modelIdentifier="Boy"', BUILD)),
    Broken("third-flag-case", "FMI 3.0: a capability flag with its name in FMI 2.0",
        "description.capabilities",
        _text("providesDirectionalDerivatives=", "providesDirectionalDerivative=")),
    Broken("third-icon", "the icon of a terminal that is not in the FMU", "description.terminals",
        _text("</GraphicalRepresentation>",
            '</GraphicalRepresentation><Terminals><Terminal name="t" matchingRule="bus">'
            '<TerminalGraphicalRepresentation x1="0" y1="0" x2="1" y2="1" iconBaseName="t"/>'
            "</Terminal></Terminals>", TERMINALS)),
    Broken("third-no-png", "an icon that is no PNG file", "description.terminals",
        _files(lambda files: files.update({"terminalsAndIcons/icon.png": b"GIF89a"}))),
    Broken("third-include", "a folder of headers in the build description that is not there",
        "sources.description",
        _text("</SourceFileSet>", '<IncludeDirectory name="nowhere"/></SourceFileSet>', BUILD)),
    Broken("third-static", "a static library in the build description that is not there",
        "sources.description",
        _text("</SourceFileSet>", '</SourceFileSet><Library name="solver"/>', BUILD),
        verdict=Verdict.WARNING),
    Broken("third-no-output", "FMI 3.0: an output that ModelStructure does not list", "structure.outputs",
        _without(_listed("Output", 16))),
    Broken("third-no-derivative", "FMI 3.0: a state derivative without the attribute `derivative`",
        "structure.derivatives", _setting(_variable("der(x)"), derivative=None)),
    Broken("third-no-unknown", "FMI 3.0: an initial unknown that ModelStructure does not list",
        "structure.initial_unknowns", _without(_listed("InitialUnknown", 16))),
    Broken("third-kind", "FMI 3.0: a factor that is fixed after initialization, in initialization",
        "structure.dependencies", _setting(_listed("InitialUnknown", 16), dependenciesKind="fixed")),
    Broken("third-platform", "FMI 3.0: a folder of binaries with its name in FMI 2.0", "binaries.platform",
        _files(_renamed_platform), verdict=Verdict.WARNING),
    Broken("third-symbol", "an FMI 3.0 library without a function for Scheduled Execution",
        "binaries.symbols", _files(_rename_symbol)),
    *read_faults("third", lambda folder, row, _: _build(folder, row, None)),
]
# fmt: on

CLOCKED = read_faults("clocked", lambda folder, row, _: _build(folder, row, INTERVAL))
