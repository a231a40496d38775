"""What notebooks show of systems, FMUs and results: valid HTML with the numbers of the objects."""

import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import html5lib
import pytest

import emla_cosim as ec
from emla_cosim.fmu.models import fmu_path
from emla_cosim.recorders.metrics import METRICS
from emla_cosim.views.formatting import format_figure
from tests.support.sweep_results import swept

SVG = "{http://www.w3.org/2000/svg}"
HOSTILE = "</style></title><script>alert(1)</script>\x1b\u202e&<b a='"
VISIBLE = HOSTILE.replace("\x1b", r"\x1b").replace("\u202e", r"\u202e")


@pytest.fixture(scope="module")
def simulation(fmu_folder: Path) -> Iterator[ec.Simulation]:
    with ec.load("lift", fmus=fmu_folder, stop_time=0.4).prepare() as prepared:
        yield prepared


@pytest.fixture(scope="module")
def result(simulation: ec.Simulation) -> ec.Result:
    return simulation.run()


def parse(displayed: Any) -> ElementTree.Element:
    """Return the cell of an object, which is valid HTML without scripts and addresses of other sites."""
    text = f"<!DOCTYPE html><title>cell</title>{displayed._repr_html_()}"
    root = html5lib.HTMLParser(strict=True, namespaceHTMLElements=False).parse(text)
    body = root.find("body")
    assert [element.tag for element in body] == ["div"]
    assert body.find(".//script") is None
    assert all(image.get("src", "").startswith("data:image/png;base64,") for image in body.iter("img"))
    return body


def read(element: ElementTree.Element) -> str:
    """Return the text that a person sees, with single spaces."""
    style = element.find(".//style")
    hidden = "" if style is None else "".join(style.itertext())
    return " ".join("".join(element.itertext()).replace(hidden, "").split())


def cells(table: ElementTree.Element) -> list[list[str]]:
    return [[read(cell) for cell in row] for row in table.iter("tr")]


def test_numbers_are_those_of_the_metrics(result: ec.Result) -> None:
    cell = parse(result)
    (heads, *rows) = cells(cell.find(".//table"))
    assert heads == ["", "lift", ""]
    figures = result.metrics["joints"]["lift"]
    assert rows == [
        [display.label, format_figure(figures[display.name], display), display.unit]
        for display in result.displays["joints"]
    ]
    text = read(cell)
    assert text.startswith("✓ Run of lift with stop_time 0.4 Completed; all joints held.")
    assert "Idealised: no friction" in text
    assert "0 s to 0.4 s" in text
    assert len(list(cell.iter("img"))) == 1


def test_run_that_failed_and_one_that_is_not_held(simulation: ec.Simulation) -> None:
    tripped = simulation.attempt(set={"lift.plant.motor.Phi_PM": 0.001})
    assert not tripped.metrics["joints"]["lift"]["held"]
    for remark in tripped.remarks:
        assert " ".join(remark.split()) in read(parse(tripped))
    failed = simulation.attempt(require=["lift.position_error_m < 1e-9"])
    assert failed.problem is not None
    assert "✗" in read(parse(failed))
    assert " ".join(failed.problem.split()) in read(parse(failed))


def test_run_without_metrics_shows_its_signals(fmu_folder: Path) -> None:
    path = fmu_path("EmlaPlant", "native", fmu_folder)
    with ec.load(path, stop_time=0.01).prepare() as prepared:
        run = prepared.run()
    assert not any(run.metrics.get(kind) for kind in METRICS)
    heads, first, *further = cells(parse(run).find(".//table"))
    assert heads[:5] == ["signal", "minimum", "maximum", "rms", "final"]
    assert [first[0], float(first[4]), first[5]] == ["EmlaPlant.x_L", run["x_L"][-1], "m"]
    assert len(further) == 19


def test_result_without_matplotlib_or_table(
    simulation: ec.Simulation, result: ec.Result, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert "No picture: the run has no table" in read(parse(simulation.run(recorders=[])))
    table = tmp_path / "table.csv"
    deleted = simulation.run(recorders=[ec.CsvFile(table)])
    table.unlink()
    assert "No picture: [Errno 2]" in read(parse(deleted))
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    cell = parse(result)
    assert not list(cell.iter("img"))
    assert "pip install 'emla-cosim[plots]'" in read(cell)
    assert cells(cell.find(".//table"))[1] == ["held", "yes", ""]


def test_systems_show_components_and_connections(simulation: ec.Simulation, fmu_folder: Path) -> None:
    scenario = ec.load("lift", fmus=fmu_folder)
    assert repr(scenario.system) == "<System of 5 components, 21 connections>"
    assert repr(simulation).startswith("<Simulation of lift: 5 components, 21 connections, 0 s to 0.4 s")
    for displayed in (scenario, scenario.system, simulation):
        cell = parse(displayed)
        assert len(list(cell.iter(f"{SVG}rect"))) == 5
        assert [row[0] for row in cells(cell.find(".//table"))[1:]] == [
            component.name for component in scenario.system.components
        ]
        connections = [read(code) for code in cell.iter("code")]
        assert connections == [str(connection) for connection in scenario.system.connections]
    with ec.load("lift", fmus=fmu_folder).prepare() as closed:
        pass
    assert repr(closed).startswith("<closed Simulation of lift")
    parse(closed)


def test_large_systems_are_shortened() -> None:
    components = tuple(ec.Component(f"c{k}", fmu=Path("x.fmu")) for k in range(300))
    connections = tuple(ec.Connection(f"c{k}", "y", f"c{k + 1}", "u") for k in range(299))
    text = read(parse(ec.System(components, connections)))
    assert "100 more are in system.components." in text
    assert "99 more are in system.connections." in text


def test_fmu_shows_its_interface(fmu_folder: Path) -> None:
    path = fmu_path("EmlaPlant", "native", fmu_folder)
    content = ec.info(path)
    count = len(content.variables)
    assert repr(content) == f"<Info on EmlaPlant: 1 component, 0 connections, {count} variables>"
    cell = parse(content)
    facts, *tables = [cells(table) for table in cell.iter("table")]
    assert ["FMI", "2.0, CoSimulation and ModelExchange"] in facts
    assert ["binaries", ", ".join(content.fmus[0].platforms)] in facts
    headings = [read(summary) for summary in cell.iter("summary")]
    inputs = [v for v in content.variables if v.causality == "input"]
    assert headings[0] == f"{len(inputs)} inputs"
    assert [row[0] for row in tables[0][1:]] == [v.name for v in inputs]
    assert inputs[0].unit in tables[0][1][1]


def test_scenario_information_shows_fmus_and_diagram(fmu_folder: Path) -> None:
    cell = parse(ec.info("lift", fmus=fmu_folder))
    assert len(list(cell.iter(f"{SVG}rect"))) == 5
    assert [read(summary) for summary in cell.iter("summary")][:2] == ["5 FMUs", "21 connections"]


def test_analyses_show_their_reports() -> None:
    sweep = swept({"a": range(3)}, {"plain": [1.0, 2.0, 3.0]}, status=["done"] * 3)
    assert repr(sweep) == "<Sweep of made-up: 3 variants, 1 factor, sampling random>"
    assert ["plain", "1", "2", "2.9", "3", ""] in cells(parse(sweep).find(".//table"))


def test_hostile_names_are_text(result: ec.Result, fmu_folder: Path) -> None:
    components = (
        ec.Component(HOSTILE, fmu=Path(HOSTILE.replace("/", ""))),
        ec.Component("b", model="EmlaPlant", parameters={HOSTILE: HOSTILE}),
    )
    system = ec.System(components, (ec.Connection(HOSTILE, HOSTILE, "b", HOSTILE),))
    scenario = ec.Scenario(HOSTILE, HOSTILE, system, notes=[HOSTILE])
    metrics = {kind: {HOSTILE: next(iter(of.values()))} for kind, of in result.metrics.items() if of}
    run = replace(result, name=HOSTILE, remarks=[HOSTILE], notes=[HOSTILE], metrics=metrics)
    content = ec.info(fmu_path("EmlaPlant", "native", fmu_folder))
    variables = tuple(
        replace(v, name=HOSTILE, unit=HOSTILE, description=HOSTILE) for v in content.variables[:3]
    )
    fmus = tuple(replace(fmu, model=HOSTILE, path=HOSTILE, tool=HOSTILE) for fmu in content.fmus)
    info = replace(content, name=HOSTILE, description=HOSTILE, fmus=fmus, variables=variables)
    sweep = replace(swept({"a": range(3)}, {"plain": [1.0, 2.0, 3.0]}, status=["done"] * 3), name=HOSTILE)
    for displayed in (system, scenario, run, info, sweep):
        text = "".join(parse(displayed).itertext())
        assert VISIBLE in text
        assert not {"\x1b", "\u202e"} & set(text)


def test_systems_are_shown_without_packages_for_plots() -> None:
    code = (
        "import sys, emla_cosim as ec; ec.load('lift')._repr_html_(); "
        "print(sorted({'matplotlib', 'bokeh', 'scipy', 'casadi'} & set(sys.modules)))"
    )
    process = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert process.stdout.strip() == "[]"


def test_verification_shows_verdicts_and_findings(fmu_folder: Path) -> None:
    report = ec.verify(fmu_path("EmlaPlant", "native", fmu_folder), only=["archive"])
    assert repr(report).startswith("<Report: The FMU passed; checks: ")
    cell = parse(report)
    assert read(cell).startswith("✓ The FMU passed")
    (examined,) = report.examined
    heads, row = cells(cell.find(".//table"))
    assert heads[1:-1] == ["passed", "warning", "failed", "skipped"]
    assert int(row[1]) == len(examined.of(ec.Verdict.PASSED))
    finding = examined.findings[0]
    outcome = replace(finding.outcome, verdict=ec.Verdict.FAILED, sentence=HOSTILE)
    bad = replace(examined, findings=(replace(finding, outcome=outcome),), name=HOSTILE)
    text = "".join(parse(replace(report, examined=(bad,))).itertext())
    assert text.count(VISIBLE) >= 2
