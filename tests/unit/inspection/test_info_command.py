"""`emla info`: tables, searches and JSON, also for invalid and hostile FMUs."""

import json
import zipfile
from pathlib import Path

import pytest
from rich.console import Console

from emla_cosim.cli.commands import info as command
from emla_cosim.views import terminal
from fmublock.archive import write_archive
from tests.support.commands import Emla, sentence


def description(variables: str, version: str = "2.0", kind: str = "CoSimulation", more: str = "") -> bytes:
    """A model description with these variables."""
    identity = "instantiationToken" if version == "3.0" else "guid"
    return f"""<?xml version="1.0" encoding="UTF-8"?>
    <fmiModelDescription fmiVersion="{version}" modelName="M" {identity}="1" {more}>
    <{kind} modelIdentifier="M"/><ModelVariables>{variables}</ModelVariables><ModelStructure/>
    </fmiModelDescription>""".encode()


def real(name: str, reference: int = 0, more: str = "") -> str:
    return (
        f'<ScalarVariable name="{name}" valueReference="{reference}" causality="parameter" '
        f'variability="fixed" {more}><Real start="1"/></ScalarVariable>'
    )


def fmu(path: Path, content: bytes) -> Path:
    write_archive(path, {"modelDescription.xml": content})
    return path


def test_piped_table_has_full_names(emla: Emla) -> None:
    output = emla("info", "lift", "--match", "*.R_s", "--set", "lift.plant.motor.R_s=0.2").stdout
    [row] = [line for line in output.splitlines() if line.lstrip().startswith("+   lift.plant.motor.R_s ")]
    expected = "+ lift.plant.motor.R_s parameter 0.2 Ohm (FMU: 0.14) >= 0 Stator resistance per phase"
    assert " ".join(row.split()) == expected
    assert "--set 'lift.plant.motor.R_s=0.2'" in output


def test_every_variable_has_a_row(emla: Emla) -> None:
    output = emla("info", "lift").stdout
    assert "15 more" not in output and "…" not in output
    for row in (
        "lift.reference.waypoint[1..9]",
        "from lift.controller.u_q",
        "to lift.observer.y",
        "5 components of 5 FMUs",
        "Runs from 0 to 10 s in steps of 0.0001 s.",
    ):
        assert row in output


@pytest.mark.parametrize("columns", [40, 80])
def test_narrow_terminal_shows_full_names(columns: int, emla: Emla, monkeypatch: pytest.MonkeyPatch) -> None:
    console = Console(force_terminal=True, width=columns, color_system=None)
    for module in (terminal, command):
        monkeypatch.setattr(module, "OUT", console)
    output = emla("info", "lift", "--match", "*.inverter.delay_in_steps_of_at_most_32").stdout
    assert "…" not in output
    cells = (line[5 : 5 + columns * 2 // 5].partition("  ")[0].strip() for line in output.splitlines())
    assert "inverter.delay_in_steps_of_at_most_32" in "".join(cells)
    assert max(len(line) for line in output.splitlines() if "─" in line) <= columns


@pytest.mark.parametrize("content", ['system = "lift"\n', "[1, 2]", '{"format": "other"}', "\x00"])
def test_other_files_are_not_replaced(emla: Emla, content: str) -> None:
    Path("mine.toml").write_text(content)
    text = sentence(emla("info", "lift", "--json", "mine.toml"), 2)
    assert "'mine.toml' was not written by emla. Choose another file for the JSON file" in text
    assert Path("mine.toml").read_text() == content


def test_json_to_standard_output_or_a_file(emla: Emla) -> None:
    content = json.loads(emla("info", "lift", "--match", "*.R_s", "--json").stdout)
    assert [v["name"] for v in content["variables"]] == ["lift.plant.motor.R_s", "lift.controller.model.R_s"]
    for _ in range(2):
        assert emla("info", "lift", "--match", "*.R_s", "--json", "x.json").stdout == ""
    assert json.loads(Path("x.json").read_text(encoding="ascii")) == content


def test_input_files_are_not_overwritten(emla: Emla) -> None:
    Path("x.csv").write_text("lift.plant.motor.R_s\n0.2\n")
    Path("x.toml").write_text('system = "lift"\nparameters = ["x.csv"]\n')
    path = fmu(Path("x.fmu"), description(real("a")))
    assert "the JSON file" in sentence(emla("info", "x.fmu", "--json", "x.fmu"), 2)
    assert path.read_bytes().startswith(b"PK")
    for arguments in (("lift", "--parameters", "x.csv"), ("x.toml",)):
        assert "'x.csv' is also the parameter set" in sentence(emla("info", *arguments, "--json", "x.csv"), 2)


def test_names_are_neither_markup_nor_control_codes(emla: Emla, tmp_path: Path) -> None:
    text = real("[bold]a[/]:warning:&#x202e;b", more='description="[link=x]y&#x9b;31m[/link]"')
    path = fmu(tmp_path / "[red]x.fmu", description(text, more='description="[/]&#x85; :bomb:"'))
    output = emla("info", str(path)).stdout
    assert r"M.[bold]a[/]:warning:\u202eb" in output
    assert r"[link=x]y\x9b31m[/link]" in output
    assert r"M: [/]" in output
    assert not set("\x1b\x9b\u202e\x85") & set(output)
    json_text = emla("info", str(path), "--json").stdout
    assert json_text.isascii()
    assert json.loads(json_text)["variables"][0]["fmu_name"] == "[bold]a[/]:warning:\u202eb"


@pytest.mark.slow
def test_ten_thousand_variables(emla: Emla, tmp_path: Path) -> None:
    many = "".join(real(f"v{i}.x", i) for i in range(10_000))
    path = fmu(tmp_path / "x.fmu", description(many))
    output = emla("info", str(path)).stdout
    assert "The first 1000 rows of 10000 variables" in output
    assert "M.v9999.x" in emla("info", str(path), "--match", "v9999.*").stdout


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (
            description('<Float64 name="a" valueReference="1"/>', version="3.0", kind="ScheduledExecution"),
            "it is neither for co-simulation nor for Model Exchange",
        ),
        (description(real("a") + real("a")), "it is not a valid FMU"),
        (description(real("a", more='nonsense="1"')), "it is not a valid FMU"),
    ],
)
def test_fmu_that_cannot_run_is_described(content: bytes, reason: str, emla: Emla, tmp_path: Path) -> None:
    path = fmu(tmp_path / "x.fmu", content)
    result = emla("info", str(path))
    assert result.exit_code == 0, result.output
    assert reason in result.stdout
    assert "M.a" in result.stdout
    assert "+ M.a" not in result.stdout
    assert sentence(emla("info", str(path), "--set", "M.a=1"), 2)


@pytest.mark.parametrize(
    "content", [b"", b"PK\x03\x04", b"<x/>", description("<"), description("", version="x"), b"<a>" * 10**5]
)
def test_invalid_fmu_gives_one_message(content: bytes, emla: Emla, tmp_path: Path) -> None:
    path = tmp_path / "x.fmu"
    path.write_bytes(content)
    assert str(path) in sentence(emla("info", str(path)), 2)
    assert str(path) in sentence(emla("info", str(fmu(path, content))), 2)


@pytest.mark.parametrize(
    ("content", "damage", "words"),
    [
        (b"<a>QQ</a>", (b"QQ", b"QR"), "Bad CRC-32"),
        (b"<a>QQ</a>", (b"</a>", b"</b>"), "cannot be read"),
        (b"<a>" + b" " * 2**24 + b"</a>", (b"", b""), "is larger than 16 MiB"),
    ],
    ids=["damaged", "not XML", "large"],
)
def test_unreadable_terminals_are_reported(
    content: bytes, damage: tuple[bytes, bytes], words: str, emla: Emla, tmp_path: Path
) -> None:
    path = tmp_path / "x.fmu"
    with zipfile.ZipFile(path, "w") as archive:  # not compressed
        archive.writestr("modelDescription.xml", description(real("x")))
        archive.writestr("terminalsAndIcons/terminalsAndIcons.xml", content)
    path.write_bytes(path.read_bytes().replace(*damage))
    info = json.loads(emla("info", str(path), "--json").stdout)
    assert info["fmus"][0]["terminals"] == [] and any(words in note for note in info["notes"])
    assert words in " ".join(emla("info", str(path)).stdout.split())


THIRD = """
<Float64 name="time" valueReference="0" causality="independent"/>
<Clock name="tick" valueReference="1" causality="input" intervalVariability="triggered"/>
<Int8 name="count" valueReference="2" causality="output" clocks="1"/>
<Float32 name="u" valueReference="3" causality="input" start="1 2 3"><Dimension start="3"/></Float32>
"""
"""Variables of FMI 3.0 with a Clock."""


TERMINALS = """<fmiTerminalsAndIcons fmiVersion="3.0"><Terminals>
<Terminal name="outer"><Terminal name="inner"/></Terminal></Terminals></fmiTerminalsAndIcons>"""


@pytest.mark.parametrize("kind", ["CoSimulation", "ScheduledExecution"])
def test_fmi_3_types_sizes_clocks_and_terminals(kind: str, emla: Emla, tmp_path: Path) -> None:
    runs = kind == "CoSimulation"
    text = description(THIRD, "3.0", kind).decode()
    text = text.replace("<ModelStructure/>", '<ModelStructure><Output valueReference="2"/></ModelStructure>')
    if runs:
        text = text.replace('modelIdentifier="M"/>', 'modelIdentifier="M" hasEventMode="true"/>')
    files = {"modelDescription.xml": text, "terminalsAndIcons/terminalsAndIcons.xml": TERMINALS}
    path = str(tmp_path / "x.fmu")
    write_archive(Path(path), {name: content.encode() for name, content in files.items()})
    message = " ".join(emla("info", path).stdout.split())
    for row in (
        "terminals outer, outer.inner",
        "M.tick triggered Clock input",
        "M.count Int8 output at tick",
    ):
        assert row in message
    assert ("M.u[1..3] Float32 input" in message) is runs and ("M.u Float32 [3] input" in message) is not runs
    assert ("cannot be run here" in message) is not runs
    info = json.loads(emla("info", path, "--json").stdout)
    assert info["fmus"][0]["capabilities"] == {kind: ["hasEventMode"] if runs else []}
    assert info["fmus"][0]["terminals"] == ["outer", "outer.inner"]
    rows = {v["fmu_name"]: v for v in info["variables"]}
    assert (rows["count"]["clocks"], rows["count"]["data_type"]) == (["tick"], "Int8")
    assert (rows["tick"]["interval_variability"], rows["tick"]["settable"]) == ("triggered", False)


MACHINE = """
kind = "machine"
description = "A boom"
dimensions = 2
ground.points.foot = [0.0, -0.6]
[bodies.boom]
joint = "revolute"
points = { pin = [0.5, 0.0], end = [2.0, 0.0] }
[actuators.ram]
from = "ground.foot"
to = "boom.pin"
length = 0.5
stroke = [0.0, 0.35]
[payload]
at = "boom.end"
m = 300.0
"""


def test_mechanics_of_a_machine_without_joints_are_shown(emla: Emla) -> None:
    Path("boom.toml").write_text(MACHINE)
    message = " ".join(emla("info", "boom.toml", "--pictures", "drawn").stdout.split())
    assert "Machine in the plane with 1 degree of freedom Payload 300 kg at boom.end" in message
    assert "boom ram triangle" in message
    assert "boom.end.x 2" in message
    assert "only the mechanics are shown" in message
    assert {path.name for path in Path("drawn").iterdir()} == {"machine.png", "forces.png", "levers.png"}
    content = json.loads(emla("info", "boom.toml", "--json").stdout)
    assert content["machine"]["actuators"][0]["stroke"] == [0.0, 0.35]


def test_machine_of_a_scenario_has_changes_and_limits(emla: Emla) -> None:
    payload, name = "machine.manipulator.payload.m", "hdrm-replay"
    default, heavy = (
        json.loads(emla("info", name, "--set", f"{payload}={m}", "--json").stdout) for m in (470, 600)
    )
    forces = [content["machine"]["actuators"][0]["start_force"] for content in (default, heavy)]
    assert forces[1] > 1.1 * forces[0]
    assert default["machine"]["actuators"][0]["largest_force"] > 100e3
    assert default["variables"]


def test_pictures_need_a_machine(emla: Emla) -> None:
    text = sentence(emla("info", "lift", "--pictures", "drawn"), 2)
    assert text == "Error: 'lift' has no machine to draw; --pictures needs a machine, such as hdrm-coupled."
    assert not Path("drawn").exists()
    Path("broken.toml").write_text(MACHINE.replace("ground.foot", "ground.feet"))
    assert "there is no point 'feet' of 'ground'" in sentence(emla("info", "broken.toml"), 2)
