"""The rooms of the orchestration: what lies at the top, no circles, and no late imports without a reason."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import networkx

from tests.support.paths import ROOT

TOP = ROOT / "orchestration/emla_cosim"

START = "`emla --help`, completion and errors must not wait for what one command needs"
ON_DEMAND = "loads a library that is slow to import and that most calls do not need"
NOTHING = "pytest loads the plugin everywhere; without --fmu it must cost nothing"
SELDOM = "reads or writes documents that most runs do not have; importing it takes part of every start"
BY_VALUE = "Dask sends the function by value, so that workers without the package can start"
RESULT = "a result is data; its methods that show or compare it reach what does that when they are called"

LATE = {
    "cli.app": (
        START,
        {
            "cli.completion",
            "cli.commands.error_exit",
            "cli.commands.options",
            "cli.commands.verbosity",
            "run.options",
        },
    ),
    "cli.commands.error_exit": (START, {"views.terminal"}),
    "cli.commands.verbosity": (START, {"views.terminal"}),
    "cli.completion": (START, {"study.controllers", "fmu.models", "run.options"}),
    "cli.program": (
        START,
        {"cli.app", "cli.completion", "cli.commands.crash_rescue", "sandbox.black_box", "sandbox.guard"},
    ),
    "identification.folder": (ON_DEMAND, {"identification.page"}),
    "master.stepping.forwarding": (ON_DEMAND, {"master.stepping.compiled_functions"}),
    "master.stepping.compilation": (ON_DEMAND, {"master.stepping.kernel", "master.stepping.trial_kernel"}),
    "run.preparation": (SELDOM, {"run.parameter_files"}),
    "run.replacement": (SELDOM, {"ssp.documents.parameter_sets", "ssp.documents.ssd_data"}),
    "run.scenarios.loading": (SELDOM, {"ssp.reader.flat_document"}),
    "run.scenarios.scenario": (
        ON_DEMAND,
        {"c_code.writer", "container.writer", "ssp.writer.package_writer"},
    ),
    "master.stepping.profiler": (ON_DEMAND, {"master.stepping.kernel"}),
    "recorders.signal_figures": (ON_DEMAND, {"master.stepping.kernel"}),
    "run.result": (
        RESULT,
        {
            "recorders.stored",
            "views.animation",
            "views.output_folder",
            "views.plots.overlay",
            "views.terminal",
        },
    ),
    "sizing.folder": (ON_DEMAND, {"sizing.page"}),
    "study.joint": (ON_DEMAND, {"fmu.interface"}),
    "sweeps.worker": (BY_VALUE, {"sweeps.worker"}),
    "verification.check_runner": (ON_DEMAND, {"verification.host.hosted_instance"}),
    "verification.checks.systems": (ON_DEMAND, {"study.loading"}),
    "verification.pytest_plugin": (
        NOTHING,
        {
            "base.errors",
            "recorders.tubes.tolerance",
            "verification.catalogue",
            "verification.examination",
            "verification.compute_once",
            "verification.settings",
            "verification.verdict",
            "verification.runner",
        },
    ),
    "verification.references.reference_files": (ON_DEMAND, {"recorders.csv_file"}),
    "verification.report": (ON_DEMAND, {"verification.junit", "verification.page"}),
    "views.output_folder": (ON_DEMAND, {"views.run_page.page"}),
    "views.plots.panel_drawing": (ON_DEMAND, {"views.plots.scales"}),
    "views.terminal": (START, {"recorders.tubes.signal_check"}),
}
"""Modules that import others of ours inside functions, why, and which."""


def name_of(file: Path) -> str:
    parts = file.relative_to(TOP).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = {name_of(file): file for file in TOP.rglob("*.py")}


def imported(node: ast.ImportFrom, file: Path) -> Iterator[str]:
    """Modules of ours that a statement imports."""
    if node.level:
        package = list(file.relative_to(TOP).parent.parts)
        parts = package[: len(package) - node.level + 1] + (node.module.split(".") if node.module else [])
    elif (node.module or "").partition(".")[0] == "emla_cosim":
        parts = (node.module or "").split(".")[1:]
    else:
        return
    for alias in node.names:
        whole = ".".join([*parts, alias.name])
        yield whole if whole in MODULES else ".".join(parts)


def statements(file: Path) -> Iterator[tuple[ast.ImportFrom, bool]]:
    """Imports of a file, and whether they are inside a function."""
    tree = ast.parse(file.read_text(encoding="utf-8"))
    functions = [n for n in ast.walk(tree) if isinstance(n, ast.FunctionDef | ast.AsyncFunctionDef)]
    late = {id(node) for function in functions for node in ast.walk(function)}
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom):
            yield node, id(node) in late


def test_hardly_a_module_lies_outside_of_the_rooms() -> None:
    loose = {file.name for file in TOP.iterdir() if file.is_file()}
    assert loose == {"__init__.py", "__init__.pyi", "__main__.py", "py.typed"}


def test_no_imports_go_in_circles() -> None:
    """Also not inside functions or for type checkers; a result, which can show itself, is the exception."""
    graph = networkx.DiGraph()
    for name, file in MODULES.items():
        for node, _ in statements(file):
            graph.add_edges_from((name, other) for other in imported(node, file))
    shown = [other for other in LATE["run.result"][1] if other.startswith("views.")]
    graph.remove_edges_from([("run.result", other) for other in shown])
    assert [sorted(c) for c in networkx.strongly_connected_components(graph) if len(c) > 1] == []
    rooms = {(a.partition(".")[0], b.partition(".")[0]) for a, b in graph.edges}
    between = networkx.DiGraph((a, b) for a, b in rooms if a != b)
    assert networkx.is_directed_acyclic_graph(between)


def test_imports_inside_functions_have_a_reason() -> None:
    found: dict[str, set[str]] = {}
    for name, file in MODULES.items():
        late = {other for node, inside in statements(file) if inside for other in imported(node, file)}
        if late:
            found[name] = late
    assert found == {name: others for name, (_, others) in LATE.items()}


def test_the_page_on_the_architecture_names_every_room_and_only_files_that_are_there() -> None:
    page = (ROOT / "ARCHITECTURE.md").read_text(encoding="utf-8")
    named = set(re.findall(r"`([\w/]+(?:\.py|\.pyi|\.toml|/))`", page))
    assert {f"{room.name}/" for room in TOP.iterdir() if (room / "__init__.py").exists()} <= named
    there = [
        f"/{f.relative_to(ROOT).as_posix()}{'/' * f.is_dir()}" for f in (*ROOT.glob("*"), *TOP.rglob("*"))
    ]
    there += [
        f"/{file.relative_to(ROOT).as_posix()}"
        for file in (*ROOT.glob("src/**/*.py"), *ROOT.glob("tests/*.py"))
    ]
    assert [name for name in sorted(named) if not any(path.endswith(f"/{name}") for path in there)] == []
