"""FMUs of other tools: checks that fail name what the standard forbids."""

from pathlib import Path

import pytest
from fmu_manipulation_toolbox.assembly import AssemblyNode
from pythonfmu import FmuBuilder

from fmu_verify.catalogue import STATIC
from fmu_verify.check import Verdict
from tests.support.broken.editing import good_bytes
from tests.support.broken.examining import examine
from tests.support.hand_written_fmus import build_faulty_fmu, build_handwritten_fmu
from tests.support.paths import FOREIGN_PLANT

NAMES = tuple(c.name for c in STATIC)
GAIN = """
from pythonfmu import Boolean, Fmi2Causality, Fmi2Slave, Fmi2Variability, Integer, Real

class Gain(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.u, self.y, self.k, self.n = 1.0, 0.0, 2.0, 3
        self.register_variable(Real("u", causality=Fmi2Causality.input))
        self.register_variable(Real("y", causality=Fmi2Causality.output))
        self.register_variable(
            Real("k", causality=Fmi2Causality.parameter, variability=Fmi2Variability.tunable)
        )
        self.register_variable(Integer("n", causality=Fmi2Causality.output))

    def do_step(self, time, step):
        self.y = self.k * self.u
        return True
"""


def python_fmu(folder: Path) -> Path:
    (folder / "gain.py").write_text(GAIN)
    return Path(FmuBuilder.build_FMU(folder / "gain.py", dest=folder))


def container(folder: Path) -> Path:
    """The good FMU within a container of FMU Manipulation Toolbox."""
    (folder / "Toy.fmu").write_bytes(good_bytes())
    node = AssemblyNode("Box.fmu", step_size=1e-2, auto_link=False, auto_input=False, auto_output=False)
    node.add_fmu("Toy.fmu", str(folder / "Toy.fmu"))
    node.add_output("Toy.fmu", "x", "x")
    node.make_fmu(folder)
    return folder / "Box.fmu"


def foreign_plant(folder: Path) -> Path:
    return build_handwritten_fmu(folder / "ForeignPlant.fmu", FOREIGN_PLANT / "foreign_plant.c")


@pytest.mark.slow
@pytest.mark.parametrize("build", [container, foreign_plant, build_faulty_fmu], ids=lambda b: b.__name__)
def test_fmu_gets_no_failure(build: object, tmp_path: Path) -> None:
    assert callable(build)
    report = examine(build(tmp_path), *NAMES)
    assert {f.check: f.sentence for f in report.of(Verdict.FAILED)} == {}
    assert {f.check for f in report.of(Verdict.WARNING)} <= {"binaries.imports"}


@pytest.mark.slow
def test_faults_of_a_python_fmu_are_reported(tmp_path: Path) -> None:
    """An Integer without variability is continuous, which none can be; and initial unknowns are lacking."""
    report = examine(python_fmu(tmp_path), *NAMES)
    assert {f.check: f.sentence for f in report.of(Verdict.FAILED)} == {
        "variables.attributes": "n is continuous, but of type Integer; only a Real can be.",
        "structure.initial_unknowns": "InitialUnknowns lacks y, n.",
    }
    assert {f.check for f in report.of(Verdict.WARNING)} == {"binaries.imports"}
    assert "PyBool_FromLong" in report["binaries.imports"].sentence
