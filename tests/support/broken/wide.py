"""FMUs with variables of all types, in which any variable, or what is around it, is wrong."""

from collections.abc import Mapping
from functools import cache
from pathlib import Path

from tests.support.broken.broken import read_faults, write_fmu
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


def _build(folder: Path, row: Mapping[str, str], name: str) -> Path:
    """Build the FMU of a row. Its dependencies may lack one: of an output while it runs, or in both modes."""
    if not row["fault"].startswith("lacks"):
        return build_wide_fmu(folder, row["fault"], row["target"], name)
    output, known = row["target"].split()
    outputs, initial = (
        {**declared, output: " ".join(k for k in declared[output].split() if k != known)}
        for declared in (OUTPUTS, INITIAL)
    )
    initial = INITIAL if row["fault"] == "lacks_later" else initial
    return build_wide_fmu(folder, name=name, outputs=outputs, initial=initial)


WIDE = read_faults("wide", _build)
"""Some of the faults, of each class."""
