"""FMUs of both flavours, through the FMI, against the block in process."""

import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import fmpy
import pytest
from fmpy.model_description import Unknown
from fmpy.validation import validate_fmu

from fmublock.description import BUILD_TIME
from tests.support.sessions import ERROR, FATAL, Session, refused


def test_model_description_of_the_toy(either: Session) -> None:
    description = either.description
    variables = {v.name: v for v in description.modelVariables}
    assert (description.modelName, description.generationDateAndTime) == ("Toy", BUILD_TIME)
    assert description.variableNamingConvention == "structured"
    kind, experiment = description.coSimulation, description.defaultExperiment
    assert kind.canGetAndSetFMUstate and kind.canSerializeFMUstate and not kind.needsExecutionTool
    assert (description.modelExchange is not None) == kind.canInterpolateInputs
    assert (experiment.stopTime, experiment.stepSize) == ("2.0", "0.01")
    mass = variables["body.mass"]
    assert (mass.unit, mass.min, mass.max, mass.start) == ("kg", "0.1", "10.0", "2.0")
    assert (mass.declaredType.name, mass.declaredType.quantity) == ("Mass", "Mass")
    assert (variables["x"].displayUnit, variables["power"].displayUnit) == ("mm", "kW")
    metre = next(u for u in description.unitDefinitions if u.name == "m")
    assert [(d.name, float(d.factor)) for d in metre.displayUnits] == [("mm", 1000.0)]
    newton = next(u for u in description.unitDefinitions if u.name == "N/m")
    assert (newton.baseUnit.kg, newton.baseUnit.m, newton.baseUnit.s) == (1, 0, -2)
    assert [i.name for i in variables["shape"].declaredType.items] == ["linear", "cubic"]
    assert (variables["damped"].type, variables["count"].type) == ("Boolean", "Integer")
    assert (variables["x"].causality, variables["x"].initial) == ("output", "calculated")
    assert (variables["v[2]"].initial, variables["v[2]"].start) == ("exact", "-0.5")


def dependencies(unknowns: list[Unknown]) -> dict[str, set[str]]:
    return {u.variable.name: {v.name for v in u.dependencies} for u in unknowns}


INITIAL_DEPENDENCIES = {"x": {"x_0"}, "power": {"force", "count", "v[1]", "seed"}, "inverse": {"x_0"}}


def test_dependencies_of_the_python_flavour_are_those_on_inputs(python_toy_fmu: Path) -> None:
    description = fmpy.read_model_description(str(python_toy_fmu))
    assert dependencies(description.outputs) == {
        "x": set(), "v[1]": set(), "v[2]": set(), "power": {"force"}, "inverse": set(),
    }  # fmt: skip
    assert dependencies(description.initialUnknowns) == INITIAL_DEPENDENCIES
    assert description.derivatives == []


def test_dependencies_of_the_native_flavour_match_the_equations(native_toy_fmu: Path) -> None:
    description = fmpy.read_model_description(str(native_toy_fmu))
    spring = {"body.mass", "spring.k[1]", "spring.k[2]", "shape", "damped"}
    assert dependencies(description.outputs) == {
        "x": {"x"}, "v[1]": {"v[1]"}, "v[2]": {"v[2]"}, "power": {"force", "v[1]"}, "inverse": {"x"},
    }  # fmt: skip
    assert dependencies(description.derivatives) == {
        "der(x)": {"v[1]"}, "der(v[1])": {"force", "x", "v[1]"}, "der(v[2])": {"v[2]"},
    }  # fmt: skip
    assert dependencies(description.initialUnknowns) == INITIAL_DEPENDENCIES | {
        "der(x)": {"v[1]"}, "der(v[1])": {"force", "x_0", "v[1]"} | spring, "der(v[2])": {"v[2]"},
    }  # fmt: skip
    assert [d.variable.derivative.name for d in description.derivatives] == ["x", "v[1]", "v[2]"]


def test_documentation_and_licence_are_inside(toy_fmu: Path) -> None:
    with zipfile.ZipFile(toy_fmu) as archive:
        page = archive.read("documentation/index.html").decode()
        assert archive.read("documentation/licenses/license.txt") == b"Do what you want."
        assert archive.read("model.png").startswith(b"\x89PNG")
    assert "<math" in page and "<mfrac>" in page
    assert "<code>spring.k[1..2]</code>" in page
    assert "http" not in page.replace("http://www.w3.org/1998/Math/MathML", "")


def test_invalid_types_and_references_are_refused(either: Session) -> None:
    slave = either.instance()
    count, force = either.references(["count", "force"])
    for call, reference in ((slave.getReal, count), (slave.getInteger, force), (slave.getReal, 10_000)):
        with refused(ERROR, FATAL):
            call([reference])
    slave.doStep(0.0, 0.1)  # still usable


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("cc") is None, reason="There is no C compiler `cc` on this machine.")
def test_sources_compile_elsewhere(native_toy_fmu: Path, tmp_path: Path) -> None:
    """`fmpy compile` builds a binary from sources/ with the host's own compiler."""
    copy = tmp_path / "Toy.fmu"
    with zipfile.ZipFile(native_toy_fmu) as original, zipfile.ZipFile(copy, "w") as stripped:
        for name in original.namelist():
            if not name.startswith("binaries/"):
                stripped.writestr(name, original.read(name))
    command = [sys.executable, "-m", "fmpy", "compile", str(copy)]
    scripts = str(Path(sys.executable).parent)  # where cmake is, which pip has installed
    environment = {**os.environ, "PATH": scripts + os.pathsep + os.environ.get("PATH", "")}
    compiled = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    assert compiled.returncode == 0, compiled.stdout + compiled.stderr
    assert validate_fmu(str(copy)) == []
    results = [fmpy.simulate_fmu(str(f), stop_time=0.5, output_interval=0.1) for f in (native_toy_fmu, copy)]
    for name in results[0].dtype.names:
        assert results[1][name] == pytest.approx(results[0][name], rel=1e-12, abs=1e-15)
