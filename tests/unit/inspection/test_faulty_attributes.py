"""Model descriptions with attributes that are missing, no numbers, out of range, or without a target."""

import re
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from lxml import etree  # pyright: ignore[reportAttributeAccessIssue]

from emla_cosim.base.errors import CommandError, CosimError
from emla_cosim.fmu.document import find_attribute_fault
from emla_cosim.fmu.interface import read_interface
from emla_cosim.inspection.collector import info
from emla_cosim.study.loading import load
from tests.support.broken.examining import examine
from tests.support.commands import Emla, sentence

UNSIGNED = "a whole number from 0 to 4294967295"
POSITION = "the position of a variable, from 1 to 7"
TYPES = "Real, Integer, Boolean, String or Enumeration"
INTERVALS = "constant, fixed, tunable, changing, countdown or triggered"

FMI_2 = """<fmiModelDescription fmiVersion="2.0" modelName="m" guid="t" numberOfEventIndicators="1">
  <ModelExchange modelIdentifier="m"/>
  <CoSimulation modelIdentifier="m" maxOutputDerivativeOrder="1"/>
  <UnitDefinitions><Unit name="rpm">
    <BaseUnit rad="1" s="-1" factor="0.1" offset="0"/><DisplayUnit name="d" factor="2" offset="1"/>
  </Unit></UnitDefinitions>
  <TypeDefinitions>
    <SimpleType name="e">
      <Enumeration><Item name="a" value="1"/><Item name="b" value="2"/></Enumeration>
    </SimpleType>
    <SimpleType name="speed"><Real unit="rpm" displayUnit="d" min="0" max="10" nominal="2"/></SimpleType>
  </TypeDefinitions>
  <DefaultExperiment startTime="0" stopTime="1" stepSize="0.1" tolerance="1e-4"/>
  <ModelVariables>
    <ScalarVariable name="u" valueReference="1" causality="input">
      <Real declaredType="speed" start="1" min="0" max="5" nominal="2" unit="rpm"/>
    </ScalarVariable>
    <ScalarVariable name="y" valueReference="2" causality="output"><Real/></ScalarVariable>
    <ScalarVariable name="x" valueReference="3" initial="exact"><Real start="1"/></ScalarVariable>
    <ScalarVariable name="dx" valueReference="4" causality="local"><Real derivative="3"/></ScalarVariable>
    <ScalarVariable name="n" valueReference="5" causality="parameter" variability="fixed">
      <Integer start="1" min="0" max="7"/>
    </ScalarVariable>
    <ScalarVariable name="b" valueReference="6" causality="parameter" variability="fixed">
      <Boolean start="true"/>
    </ScalarVariable>
    <ScalarVariable name="c" valueReference="7" causality="parameter" variability="fixed">
      <Enumeration declaredType="e" start="1" min="1" max="2"/>
    </ScalarVariable>
  </ModelVariables>
  <ModelStructure>
    <Outputs><Unknown index="2" dependencies="1 3"/></Outputs>
    <Derivatives><Unknown index="4" dependencies="1"/></Derivatives>
    <InitialUnknowns><Unknown index="2" dependencies="1"/></InitialUnknowns>
  </ModelStructure>
</fmiModelDescription>"""

FMI_3 = """<fmiModelDescription fmiVersion="3.0" modelName="m" instantiationToken="t">
  <CoSimulation modelIdentifier="m" maxOutputDerivativeOrder="1" hasEventMode="true"
                recommendedIntermediateInputSmoothness="1"/>
  <UnitDefinitions><Unit name="rpm">
    <BaseUnit rad="1" s="-1" factor="0.1" offset="0"/><DisplayUnit name="d" factor="2" offset="1"/>
  </Unit></UnitDefinitions>
  <TypeDefinitions>
    <EnumerationType name="e" min="1" max="2">
      <Item name="a" value="1"/><Item name="b" value="2"/>
    </EnumerationType>
    <Float64Type name="speed" unit="rpm" displayUnit="d" min="0" max="10" nominal="2"/>
  </TypeDefinitions>
  <DefaultExperiment startTime="0" stopTime="1" stepSize="0.1" tolerance="1e-4"/>
  <ModelVariables>
    <Float64 name="time" valueReference="0" causality="independent" variability="continuous"/>
    <Float64 name="u" valueReference="1" causality="input" declaredType="speed" start="1 2" min="0" max="5"
             nominal="2" unit="rpm"><Dimension valueReference="9"/></Float64>
    <Float64 name="y" valueReference="2" causality="output"><Dimension start="2"/></Float64>
    <Float64 name="x" valueReference="3" causality="local" initial="exact" start="1"/>
    <Float64 name="dx" valueReference="4" causality="local" derivative="3"/>
    <Int8 name="n" valueReference="5" causality="parameter" variability="fixed" start="1" min="0" max="7"/>
    <Boolean name="b" valueReference="6" causality="parameter" variability="fixed" start="true"/>
    <Enumeration name="c" valueReference="7" causality="parameter" variability="fixed" declaredType="e"
                 start="1"/>
    <UInt64 name="size" valueReference="9" causality="structuralParameter" variability="fixed" start="2"/>
    <Clock name="k" valueReference="10" causality="input" intervalVariability="constant"
           intervalDecimal="0.1"/>
    <Float64 name="w" valueReference="11" causality="output" variability="discrete" clocks="10"/>
    <Binary name="raw" valueReference="12" causality="input" variability="discrete" maxSize="10">
      <Start value="00"/>
    </Binary>
  </ModelVariables>
  <ModelStructure>
    <Output valueReference="2" dependencies="1 3"/>
    <Output valueReference="11"/>
    <ContinuousStateDerivative valueReference="4" dependencies="1"/>
    <InitialUnknown valueReference="2" dependencies="1"/>
    <EventIndicator valueReference="3"/>
  </ModelStructure>
</fmiModelDescription>"""

DESCRIPTIONS = {2: FMI_2, 3: FMI_3}

NOT_NUMBERS = (
    *("name", "fmiVersion", "modelName", "guid", "instantiationToken", "modelIdentifier", "unit"),
    *("displayUnit", "declaredType", "causality", "variability", "initial", "hasEventMode"),
    *("intervalVariability", "intervalDecimal"),
)
"""Attributes with texts, and one that is read when an FMU is unpacked."""

# for each fault: the version of FMI, what is replaced by what, and below it what is reported
FAULTS_TEXT = f"""
2: valueReference="1" ->
   the variable 'u' has no valueReference; it needs {UNSIGNED}
2:valueReference="5" -> valueReference="-1"
   the variable 'n' has valueReference = '-1'; it must be {UNSIGNED}
2: index="4" ->
   Unknown of Derivatives has no index; it needs {POSITION}
2:index="4" -> index="dx"
   Unknown of Derivatives has index = 'dx'; it must be {POSITION}
2:index="4" -> index="0"
   Unknown of Derivatives has index = '0'; it must be {POSITION}
2:index="4" -> index="8"
   Unknown of Derivatives has index = '8'; it must be {POSITION}
2:<Real/> ->
   the variable 'y' has no type; it needs an element {TYPES}
2:<ModelVariables> -> <ModelVariables><ScalarVariable valueReference='9'><Real/></ScalarVariable>
   variable 1 has no name; it needs a unique one
2: value="2" ->
   Item 'b' of the type 'e' has no value; it needs a whole number
2:stepSize="0.1" -> stepSize="fast"
   DefaultExperiment has stepSize = 'fast'; it must be a number
2:factor="0.1" -> factor="a tenth"
   BaseUnit of the unit 'rpm' has factor = 'a tenth'; it must be a number
2:rad="1" -> rad="1.5"
   BaseUnit of the unit 'rpm' has rad = '1.5'; it must be a whole number
2: fmiVersion="2.0" ->
   fmiModelDescription has no fmiVersion; it needs 2.0 or 3.0
3: valueReference="3" causality ->  causality
   the variable 'x' has no valueReference; it needs {UNSIGNED}
3:valueReference="5" -> valueReference="five"
   the variable 'n' has valueReference = 'five'; it must be {UNSIGNED}
3:<Output valueReference="11"/> -> <Output/>
   Output has no valueReference; it needs {UNSIGNED}
3:<Output valueReference="11"/> -> <Output valueReference="77"/>
   Output has valueReference = '77'; no variable has this value reference
3:<Dimension start="2"/> -> <Dimension/>
   Dimension of the variable 'y' has neither start nor valueReference; it needs one of them
3:<Dimension start="2"/> -> <Dimension start="two"/>
   Dimension of the variable 'y' has start = 'two'; it must be a whole number, at least 0
3:<Dimension valueReference="9"/> -> <Dimension valueReference="8"/>
   Dimension of the variable 'u' has valueReference = '8'; no variable has this value reference
3:fixed" start="2"/> -> fixed"/>
   the variable 'size', the size of the variable 'u', has no start; it needs a whole number
3:causality="input" intervalVariability="constant" -> causality="output"
   the variable 'k' has no intervalVariability; it needs {INTERVALS}
3:clocks="10" -> clocks=""
   the variable 'w' has no clocks; it needs value references of Clocks, or must be left out
3:start="1" min="0" max="7" -> start="300" min="0" max="7"
   the variable 'n' has start = '300'; it must be a whole number from -128 to 127
3:initial="exact" start="1" -> initial="exact" start="1 2"
   the variable 'x' has start = '1 2'; it must be a number
3:start="1 2" -> start="1 b"
   the variable 'u' has start = '1 b'; each value must be a number
3:maxSize="10" -> maxSize="ten"
   the variable 'raw' has maxSize = 'ten'; it must be a whole number, at least 0
"""
FAULTS = [
    (int(version), *change.split(" -> "), fault)
    for version, change, fault in re.findall(
        r"^(\d):(.+)\n   (.+)$", FAULTS_TEXT.replace("->\n", "-> \n"), re.M
    )
]


def _write(path: Path, description: str) -> Path:
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("modelDescription.xml", description)
    return path


def _reported(read: Callable[[], Any]) -> str:
    """The error message, or the notes of what was read."""
    try:
        return " ".join(read().notes)
    except CommandError as error:
        assert error.exit_code == 2
        return str(error)


def _without_lines(message: str) -> str:
    return re.sub(r" \(line \d+\)", "", message)


@pytest.mark.parametrize(("version", "old", "new", "fault"), FAULTS)
@pytest.mark.parametrize("lenient", [False, True])
def test_info_names_element_attribute_and_what_would_be_right(
    version: int, old: str, new: str, fault: str, lenient: bool, tmp_path: Path
) -> None:
    assert DESCRIPTIONS[version].count(old) == 1
    fmu = _write(tmp_path / "m.fmu", DESCRIPTIONS[version].replace(old, new))
    options: dict[str, Any] = {"lenient": True} if lenient else {}
    reported = _reported(lambda: info(fmu, **options))
    is_accepted = lenient and "which was accepted" in reported
    assert fault in _without_lines(reported) or is_accepted, reported
    with pytest.raises(CommandError) as caught:
        read_interface(fmu)
    assert f"'{fmu}' is not a valid FMU: {fault}" in _without_lines(str(caught.value))


def test_commands_report_faults_with_exit_code_2(emla: Emla, tmp_path: Path) -> None:
    fmu = _write(tmp_path / "m.fmu", FMI_3.replace('start="2"/>', 'start="two"/>', 1))
    for arguments in (["info"], ["info", "--lenient"], ["run"], ["export"]):
        command, *options = arguments
        more = ["out.ssp"] if command == "export" else []
        message = sentence(emla(command, str(fmu), *more, *options), 2)
        assert "is not a valid FMU: Dimension of the variable 'y' (line 18) has start = 'two';" in message


def test_info_shows_readable_fmus_with_the_fault_as_a_note(emla: Emla, tmp_path: Path) -> None:
    fmu = _write(tmp_path / "m.fmu", FMI_2.replace('stepSize="0.1"', 'stepSize="fast"'))
    for options in ([], ["--lenient"]):
        result = emla("info", str(fmu), *options)
        assert result.exit_code == 0
        message = " ".join(result.output.split())
        assert "it is not a valid FMU: DefaultExperiment (line 13) has stepSize = 'fast'" in message


def test_verify_names_attributes_that_fmpy_cannot_read(tmp_path: Path) -> None:
    fmu = _write(tmp_path / "m.fmu", FMI_3.replace('<Dimension start="2"/>', "<Dimension/>"))
    findings = examine(fmu, "description.semantics").findings
    (finding,) = (finding for finding in findings if finding.check == "description.semantics")
    start = "FMPy cannot read the model description: Dimension of the variable 'y' (line 18) has neither"
    assert finding.sentence.startswith(start)


def _attributes(version: int) -> Iterator[tuple[str, str]]:
    root = etree.fromstring(DESCRIPTIONS[version])
    for element in root.iter():
        for name in element.attrib:
            yield root.getroottree().getpath(element), name


def _changed(version: int, path: str, name: str, text: str | None) -> str:
    root = etree.fromstring(DESCRIPTIONS[version])
    (element,) = root.xpath(path)
    element.attrib.pop(name)
    if text is not None:
        element.set(name, text)
    return etree.tostring(root, encoding="unicode")


@pytest.mark.parametrize("version", [2, 3])
def test_every_number_is_checked(version: int, tmp_path: Path) -> None:
    valid = _write(tmp_path / "m.fmu", DESCRIPTIONS[version])
    assert find_attribute_fault(valid, fatal=False) is None
    read_interface(valid)
    for path, name in _attributes(version):
        if name not in NOT_NUMBERS and not path.endswith("Start"):
            fault = find_attribute_fault(_write(tmp_path / "m.fmu", _changed(version, path, name, "x")))
            assert fault is not None, (path, name)
            assert f" has {name} = 'x'; " in fault


PYTHON = re.compile(
    r"literal|NoneType|argument|\w+Error|object|out of range|convert|local variable|read: \S+\.$"
)
"""Parts of messages of Python."""


@pytest.mark.slow
@pytest.mark.parametrize("text", [None, "", "x", "-1", "1.5", "7  8", "99999999999999999999", "1e400", "nan"])
@pytest.mark.parametrize("version", [2, 3])
def test_no_message_is_of_python(version: int, text: str | None, tmp_path: Path) -> None:
    for path, name in _attributes(version):
        fmu = _write(tmp_path / "m.fmu", _changed(version, path, name, text))
        for read in (lambda: info(fmu), lambda: info(fmu, lenient=True), lambda: load(fmu)):  # noqa: B023
            try:
                read()
            except CosimError as error:
                assert not PYTHON.search(str(error).replace(str(fmu), "")), (path, name, str(error))


BLANKS = [
    (2, 'dependencies="1 3"', 'dependencies=" 1\n   3 "'),
    (2, 'dependencies="1 3"', 'dependencies=" "'),
    (3, 'dependencies="1 3"', 'dependencies="1  3"'),
    (3, 'clocks="10"', 'clocks=" 10 "'),
    (3, "</TypeDefinitions>", '<BinaryType name="raw" mimeType="a/b" maxSize="5"/></TypeDefinitions>'),
    (3, "</TypeDefinitions>", '<ClockType name="tick" intervalVariability="constant"/></TypeDefinitions>'),
]


@pytest.mark.parametrize(("version", "old", "new"), BLANKS)
def test_valid_descriptions_that_fmpy_cannot_read(version: int, old: str, new: str, tmp_path: Path) -> None:
    text = DESCRIPTIONS[version].replace(old, new)
    if "ClockType" in new:
        text = text.replace("<Clock ", '<Clock declaredType="tick" ')
    expected = read_interface(_write(tmp_path / "n.fmu", DESCRIPTIONS[version]))
    interface = read_interface(_write(tmp_path / "m.fmu", text))
    assert list(interface.variables) == list(expected.variables)
    if new != 'dependencies=" "':
        input_ = next(n for n in expected.variables if n.startswith("u"))
        outputs = {n for n in expected.variables if n.startswith("y")}
        assert interface.direct.among(outputs, input_) == expected.direct.among(outputs, input_) == outputs
