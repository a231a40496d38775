"""Faulty FMUs and packages: harmless faults are accepted and listed, others with `lenient`, some never."""

import json
import zipfile
from pathlib import Path

import fmpy
import numpy as np
import pytest

from emla_cosim.base.errors import CommandError
from emla_cosim.base.faults import accept_faults
from emla_cosim.fmu.interface import read_interface
from emla_cosim.ssp.reader.flat_document import read_ssp
from emla_cosim.study.loading import load
from emla_cosim.system.model import System
from fmublock.archive import write_archive
from tests.support.commands import Emla, sentence
from tests.support.hand_written_fmus import build_all_types_fmu, edit_description
from tests.support.ssp_documents import (
    binding,
    component,
    connection,
    description,
    fake_fmu,
    folder,
    packed,
    ssd,
    ssv,
    system,
)

SHORT_RUN = {"stop_time": 0.02, "step_size": 0.001}
UNKNOWN = ("<CoSimulation ", '<CoSimulation colour="red" ')


@pytest.fixture(scope="module")
def reference(fmu_folder: Path) -> Path:
    return fmu_folder / "Reference" / "Reference.fmu"


def dated(fmu: Path) -> tuple[str, str]:
    """The edit that makes the date of the model description wrong."""
    texts = str(fmpy.read_model_description(str(fmu)).generationDateAndTime)
    return f'generationDateAndTime="{texts}"', 'generationDateAndTime="2017-02-13_16_10"'


def test_harmless_faults_change_nothing_and_are_listed(reference: Path, tmp_path: Path) -> None:
    faulty = edit_description(reference, tmp_path / "x.fmu", *dated(reference))
    result = load(faulty, **SHORT_RUN).prepare().run()
    expected = load(reference, **SHORT_RUN).prepare().run()
    for name in expected.names:
        assert (result[name] == expected[name]).all()
    (problems,) = result.record["accepted_faults"].values()
    assert len(problems) == 1
    assert "generationDateAndTime" in problems[0]
    assert any("which was accepted" in remark for remark in result.remarks)
    assert expected.record["accepted_faults"] == {}


def test_units_without_a_definition_are_accepted_but_not_converted(tmp_path: Path) -> None:
    source = fake_fmu(tmp_path / "a.fmu", "y:output:m", "u:input:m", units={"K": 'K="1"'})
    edit_description(source, source, 'unit="m"', 'unit="m" displayUnit="mm"')
    with accept_faults(lenient=False) as faults:
        interface = read_interface(source)
    assert (str(interface.unit("y")), interface.variables["y"].displayUnit) == ("m", None)
    assert [p for p in faults.by_file[str(source)] if '"m" of variable "y"' in p]
    target = fake_fmu(tmp_path / "b.fmu", "u:input:mm")
    parts = (component("a", "a.fmu", "y:output"), component("b", "b.fmu", "u:input"))
    path = folder(
        tmp_path / "ssp",
        root=ssd(system("r", *parts, connection("a.y -> b.u"))),
        a__fmu=source,
        b__fmu=target,
    )
    with pytest.raises(CommandError, match="m is not defined in the UnitDefinitions of the FMU 'a'"):
        load(path)
    scenario = load(path, lenient=True)
    assert any("the number is not changed" in p for problems in scenario.accepted.values() for p in problems)


def test_parameters_without_variability_are_fixed(tmp_path: Path, emla: Emla) -> None:
    """Of all types; the message names what is missing, not its default alone."""
    valid = build_all_types_fmu(tmp_path / "whole.fmu")
    faulty = edit_description(valid, tmp_path / "x.fmu", ' variability="fixed"', "")
    name = next(v.name for v in read_interface(valid).variables.values() if v.causality == "parameter")
    text = sentence(emla("run", str(faulty), "--no-plots"), 2)
    assert "is a parameter without variability; it needs fixed or tunable, as the default, continuous" in text
    assert text.endswith("(`emla verify` shows more). `--lenient` accepts this.")
    info = emla("info", str(faulty))
    assert info.exit_code == 0 and name in info.stdout
    assert emla("run", str(faulty), "--no-plots", "--output", "faulty", "--lenient").exit_code == 0
    assert emla("run", str(valid), "--no-plots", "--output", "whole").exit_code == 0
    assert Path("faulty/results.csv").read_text() == Path("whole/results.csv").read_text()


def test_ranges_that_an_fmu_breaks_itself_are_reported(reference: Path, tmp_path: Path, emla: Emla) -> None:
    before = 'min="1e-06" start="1.0"'
    high = edit_description(reference, tmp_path / "high.fmu", before, 'min="1.5" start="1.0"')
    result = load(high, **SHORT_RUN).prepare().run()
    (problems,) = result.record["accepted_faults"].values()
    assert problems[0] == "move.duration[1] starts at 1, below its minimum of 1.5"
    empty = edit_description(reference, tmp_path / "empty.fmu", before, 'min="2.5" max="1.5" start="1.0"')
    assert "has the minimum 2.5, above its maximum of 1.5" in emla("info", str(empty)).stdout
    text = sentence(emla("run", str(empty), "--set", "move.duration[1]=2", "--no-plots"), 2)
    assert "cannot be set: the FMU declares the minimum 2.5 s, above its maximum of 1.5 s." in text


def test_limits_of_a_declared_type_count(reference: Path, tmp_path: Path, emla: Emla) -> None:
    edits = ('<Real quantity="Time" unit="s" />', '<Real quantity="Time" unit="s" min="1e-6" max="1.5" />')
    typed = edit_description(reference, tmp_path / "typed.fmu", *edits)
    text = sentence(emla("run", str(typed), "--set", "move.duration[1]=2", "--no-plots"), 2)
    assert "move.duration[1] = 2 s is out of range: it must be at least 1e-06 and at most 1.5 s." in text


def test_other_faults_need_the_option(reference: Path, tmp_path: Path, emla: Emla) -> None:
    faulty = edit_description(reference, tmp_path / "x.fmu", *UNKNOWN, *dated(reference))
    times = ("--stop-time", "0.02", "--step-size", "1 ms", "--no-plots")
    refused = emla("run", str(faulty), *times, "--output", str(tmp_path / "no"))
    assert "attribute 'colour'" in sentence(refused, 2)
    assert "`--lenient` accepts this" in sentence(refused, 2)
    result = emla("run", str(faulty), *times, "--lenient", "--output", str(tmp_path / "yes"))
    assert result.exit_code == 0, result.output
    assert "has a fault, which was accepted" in result.output.replace("\n", " ")
    record = json.loads((tmp_path / "yes" / "run.json").read_text())
    assert record["settings"]["lenient"] is True
    (problems,) = record["accepted_faults"].values()
    assert "colour" in problems[0]  # the one that the option accepted comes first
    assert len(problems) == 2
    repeated = load(tmp_path / "yes" / "run.json").prepare().run()
    expected = load(reference, **SHORT_RUN).prepare().run()
    assert (repeated["Reference.x_d"] == expected["Reference.x_d"]).all()


def test_unreadable_descriptions_are_always_refused(tmp_path: Path) -> None:
    text = description("a", "y:output:m").replace('valueReference="0"', 'valueReference="many"')
    write_archive(tmp_path / "a.fmu", {"modelDescription.xml": text.encode()})
    with pytest.raises(CommandError, match="not a valid FMU"), accept_faults(lenient=True):
        read_interface(tmp_path / "a.fmu")


@pytest.mark.parametrize(
    ("files", "word"),
    [
        ({f"binaries/{fmpy.platform}/": b""}, f"the folder 'binaries/{fmpy.platform}' is empty"),
        ({f"binaries/{fmpy.platform}/other.so": b"x"}, "has other.so, but not 'a"),
        ({"binaries/amiga/a.library": b"x"}, "only for amiga"),
        ({"sources/a.c": b"int a;"}, "only C sources; `fmpy compile`"),
        ({}, "or any other platform"),
    ],
)
def test_cause_of_a_missing_library_is_reported(files: dict[str, bytes], word: str, tmp_path: Path) -> None:
    fmu = tmp_path / "a.fmu"
    content = {"modelDescription.xml": description("a", "y:output").encode(), **files}
    with zipfile.ZipFile(fmu, "w") as archive:
        for name, data in content.items():
            archive.writestr(name, data)
    with pytest.raises(CommandError) as refused:
        load(System.of({"a": fmu}), **SHORT_RUN).prepare()
    assert f"has no binary for {fmpy.platform}" in str(refused.value)
    assert word in str(refused.value)


# ---- packages ----------------------------------------------------------------------------------


@pytest.fixture
def fmu(tmp_path: Path) -> Path:
    return fake_fmu(tmp_path / "a.fmu", "u:input:m", "y:output:m", "k:parameter:m")


def values(path: Path, lenient: bool) -> tuple[dict[str, object], list[str]]:
    """The start values of component a, and the accepted faults."""
    with accept_faults(lenient) as faults, read_ssp(path) as document:
        actual = dict(document.system.component("a").parameters)
    return actual, [p for problems in faults.by_file.values() for p in problems]


END = "</ssv:Parameters>"
SECOND = "<ssv:Parameter name='k'><ssv:Real value='{}'/></ssv:Parameter></ssv:Parameters>"
BOUND = system("r", component("a", "a.fmu", bindings=binding("k.ssv", "")))
OUTSIDE = system("r", component("a", "../a.fmu"))
PORT = 'kind="input"'
COLOURED = system("r", component("a", "a.fmu", "u:input")).replace(PORT, f'{PORT} colour="red"')


@pytest.mark.parametrize(
    ("root", "parameters", "refused", "accepted", "value"),
    [
        (BOUND, ssv(k=(9.5, "[m]")), r"\[m\] is not defined in the Units of", "number is not changed", 9.5),
        (BOUND, ssv(k=1.0).replace(END, SECOND.format(2)), "second value", "second value", 2.0),
        (COLOURED, "", "'colour' is not allowed", "colour", None),
        (OUTSIDE, "", "outside the package", "'../a.fmu' is outside the package", None),
    ],
    ids=["units", "two values", "attribute", "file"],
)
def test_faults_of_packages_need_the_option(
    root: str, parameters: str, refused: str, accepted: str, value: float | None, fmu: Path, tmp_path: Path
) -> None:
    path = folder(tmp_path / "s", root=ssd(root), a__fmu=fmu, k__ssv=parameters)
    with pytest.raises(CommandError, match=f"{refused}.*`--lenient`"):
        values(path, lenient=False)
    actual, faults = values(path, lenient=True)
    assert actual.get("k") == value
    assert any(accepted in fault for fault in faults)


def test_second_equal_value_is_accepted(fmu: Path, tmp_path: Path) -> None:
    equal = ssv(k=1.0).replace(END, SECOND.format(1))
    actual, faults = values(folder(tmp_path / "s", root=ssd(BOUND), a__fmu=fmu, k__ssv=equal), lenient=False)
    assert (actual, len(faults)) == ({"k": 1.0}, 1)


def test_some_faults_of_packages_are_never_accepted(fmu: Path, tmp_path: Path) -> None:
    incomplete = folder(tmp_path / "t", root=ssd(COLOURED).replace(' name="u"', ""), a__fmu=fmu)
    with pytest.raises(CommandError, match="'name' is required but missing"):
        values(incomplete, lenient=True)
    with pytest.raises(CommandError, match=r"outside the package\.$"):
        values(packed(tmp_path / "s.ssp", folder(tmp_path / "s", root=ssd(OUTSIDE))), lenient=True)


def test_variables_alone_are_names_in_a_single_fmu_only(reference: Path) -> None:
    with load(reference, set={"waypoint[2]": "300 mm"}, **SHORT_RUN).prepare() as simulation:
        assert simulation.run().record["components"]["Reference"]["parameters"] == {"waypoint[2]": 0.3}
    with pytest.raises(CommandError, match="no variable 'waipoint"):
        load(reference, set={"waipoint[2]": 1.0}, **SHORT_RUN).prepare()
    two = System.of({"a": reference, "b": reference})
    with pytest.raises(CommandError, match="not a variable"):
        load(two, set={"waypoint": 1.0}, **SHORT_RUN).prepare()


def test_the_reference_of_one_fmu_with_inputs_from_a_file(fmu_folder: Path, tmp_path: Path) -> None:
    """FMPy is the judge, with both tables as the cross-check writes them. It holds inputs over each step."""
    plant = fmu_folder / "EmlaPlant" / "EmlaPlant.fmu"
    times = np.linspace(0.0, 0.02, 21)
    inputs = np.array(
        list(zip(times, 20.0 * np.sin(300.0 * times), strict=True)), [("time", float), ("u_q", float)]
    )
    more = {"fmi_type": "CoSimulation", "stop_time": 0.02, "step_size": 0.001, "output_interval": 0.001}
    solved = fmpy.simulate_fmu(str(plant), input=inputs, output=["x_L", "i_q"], **more)
    assert np.ptp(solved["i_q"]) > 0.1
    for name, table in (("in", inputs), ("ref", solved)):
        rows = [
            ",".join(f'"{n}"' for n in table.dtype.names),
            *(",".join(map(repr, row)) for row in table.tolist()),
        ]
        (tmp_path / f"EmlaPlant_{name}.csv").write_text("\n".join(rows) + "\n")
    options = {
        "input": [f"{tmp_path / 'EmlaPlant_in.csv'}:interpolation=held"],
        "reference": tmp_path / "EmlaPlant_ref.csv",
    }
    options |= {"stop_time": 0.02, "step_size": 0.001, "tolerance": {"*": 1e-6}, "algorithm": "jacobi"}
    right = load(plant, **options).prepare().attempt()
    assert {c.signal for c in right.comparisons} == {"EmlaPlant.x_L", "EmlaPlant.i_q"}
    assert right.problem is None
    doubled = load(plant, **options, set={"EmlaPlant.motor.R_s": 1.0}).prepare().attempt()
    assert "EmlaPlant.i_q" in str(doubled.problem)


@pytest.mark.parametrize(("text", "value"), [("True", True), ("FALSE", False), ("", False)])
def test_booleans_of_other_spelling_are_read_with_lenient(text: str, value: bool, tmp_path: Path) -> None:
    built = build_all_types_fmu(tmp_path / "A.fmu")
    edits = ('causality="input" variability="discrete"', 'causality="parameter" variability="fixed"')
    path = edit_description(
        built, tmp_path / "B.fmu", *edits, '<Boolean start="false"/>', f'<Boolean start="{text}"/>'
    )
    with pytest.raises(CommandError, match=r"not a valid value of the atomic type 'xs:boolean'.*--lenient"):
        load(path, **SHORT_RUN)
    with load(path, **SHORT_RUN, lenient=True).prepare() as simulation:
        assert simulation.run().parameters.get("AllTypes.on", value) == value
    exported = load(path, **SHORT_RUN, lenient=True).export(tmp_path / "x.ssp")
    assert load(exported, lenient=True, **SHORT_RUN).prepare().run().steps == 20
