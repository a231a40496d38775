"""FMUs for other companies: without sources, with fixed and hidden parameters, judged by FMPy."""

import re
import shutil
import zipfile
from collections.abc import Iterator
from enum import IntEnum
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fmpy import read_model_description, simulate_fmu
from fmpy.fmi2 import FMU2Slave
from fmpy.validation import validate_fmu

from fmublock import Block, Disclosure, Input, Output, Parameter, State, build, where
from fmublock.__main__ import main
from fmublock.errors import DisclosureError
from fmublock.recipe import Recipe
from tests.support.cart import Cart
from tests.support.sessions import Session, opened, refused


class Law(IntEnum):
    """How the spring's force grows."""

    LINEAR = 1
    CUBIC = 2


class Spring(Block):
    """A mass on a spring.

    The secret equation is $F = -k x$.
    """

    F = Input(unit="N", description="Force")
    k = Parameter(12.5, unit="N/m", minimum=0.0, name="spring.k", description="Stiffness")
    law = Parameter(Law.LINEAR, name="spring.law", description="Law of the force")
    m = Parameter(2.0, unit="kg", minimum=0.1, name="body.m", description="Mass")
    gains = Parameter([1.0, 2.0], shape=2, name="gains", description="Gains of the output")
    is_damped = Parameter(True, name="damper.on", description="Whether there is a damper")
    x_start = Parameter(0.5, unit="m", name="start.x", description="Start")
    x_max = Parameter(0.6, unit="m", name="stop.x", description="Longest way")
    x = State(x_start, unit="m", limits=x_max, description="Position")
    v = State(0.0, unit="m/s", description="Speed")
    y = Output(description="Weighted sum")

    def derivatives(self, v: Any) -> dict[str, Any]:
        force = v.k * where(v.law == Law.CUBIC, v.x * v.x * v.x, v.x)
        return {"x": v.v, "v": (v.F - force - where(v.is_damped, 3.0 * v.v, 0.0)) / v.m}

    def outputs(self, v: Any) -> dict[str, Any]:
        return {"y": v.gains[0] * v.x + v.gains[1] * v.v}

    def conditions(self, v: Any) -> dict[str, Any]:
        return {"start.x must not exceed 5 m": v.x_start <= 5.0}


VALUES = {"spring.k": 7.654321, "spring.law": "cubic", "gains[2]": 0.25}
VALUES |= {"damper.on": False, "start.x": 0.4375}
DISCLOSURE = Disclosure(
    values=VALUES, fixed=["body.m", "gains"], hidden=["spring.*", "damper.on", "start.x", "stop.x"]
)


SECRET = rb"spring\.[kl]|damper|stop\.x|7\.654321|0\.4375|secret|Stiffness"
"""What no file of the restricted FMU may contain."""


@pytest.fixture(scope="module")
def full(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The FMU with everything."""
    return build(Spring, tmp_path_factory.mktemp("full") / "Spring.fmu")


@pytest.fixture(scope="module")
def restricted(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The FMU for another company."""
    return build(Spring, tmp_path_factory.mktemp("restricted") / "Spring.fmu", disclosure=DISCLOSURE)


def run(fmu: Path, fmi_type: str, start_values: dict[str, Any]) -> np.ndarray:
    rows = np.array([(0.0, 0.0), (2.0, 5.0)], dtype=[("time", float), ("F", float)])
    return simulate_fmu(
        str(fmu), stop_time=2.0, output_interval=0.01, input=rows, start_values=start_values,
        fmi_type=fmi_type, output=["x", "v", "y"],
    )  # fmt: skip


@pytest.mark.parametrize("fmi_type", ["CoSimulation", "ModelExchange"])
def test_results_match_the_full_fmu(full: Path, restricted: Path, fmi_type: str) -> None:
    values = {**VALUES, "spring.law": 2}
    assert run(restricted, fmi_type, {}).tobytes() == run(full, fmi_type, values).tobytes()
    assert run(full, fmi_type, {}).tobytes() != run(full, fmi_type, values).tobytes()


def test_hidden_names_and_values_are_in_no_readable_file(full: Path, restricted: Path) -> None:
    assert validate_fmu(str(restricted)) == []
    with zipfile.ZipFile(restricted) as archive:
        files = {name: archive.read(name) for name in archive.namelist()}
    assert not any(name.startswith("sources/") for name in files)
    description = files["modelDescription.xml"].decode()
    assert "SourceFiles" not in description
    assert "Law" not in description
    for name, content in files.items():
        assert not re.search(SECRET, content), name
        assert not re.search(rb"generated\.h|fixed_values|/tmp/|\.cache", content), name
    variables = {v.name: v for v in read_model_description(str(restricted)).modelVariables}
    assert {"spring.k", "spring.law", "start.x", "stop.x"}.isdisjoint(variables)
    assert (variables["body.m"].variability, variables["body.m"].start) == ("constant", "2.0")
    assert variables["gains[2]"].start == "0.25"
    assert variables["der(x)"].derivative is variables["x"]
    assert "secret" in zipfile.ZipFile(full).read("documentation/index.html").decode()


@pytest.fixture
def session(restricted: Path, tmp_path: Path) -> Iterator[Session]:
    with opened(restricted, tmp_path) as session:
        yield session


def test_hidden_and_fixed_variables_cannot_be_accessed(session: Session) -> None:
    slave = session.instance(running=False)
    k, m, start, y = (Spring.layout().reference(n) for n in ("spring.k", "body.m", "start.x", "y"))
    for call, message in (
        (lambda: slave.setReal([k], [1.0]), "there is no variable with value reference 1"),
        (lambda: slave.setReal([m], [1.0]), "body.m is fixed in this FMU and cannot be set"),
        (lambda: slave.getReal([start]), "there is no variable with value reference"),
        (lambda: slave.getDirectionalDerivative([y], [m], [1.0]), "body.m"),
    ):
        with refused():
            call()
        assert message in session.log.lines("toy")[-1]
    assert session.get(slave, "body.m") == [2.0]


def test_serialized_states_have_no_hidden_value_and_continue_with_the_same_bits(session: Session) -> None:
    """Also in another instance; limits that are hidden are not in the log."""

    def go_on(slave: FMU2Slave) -> list[float]:
        for k in range(100, 200):
            slave.doStep(k * 0.01, 0.01)
        return session.get(slave, "x", "v")

    slave = session.instance(F=9.0)
    for k in range(100):
        slave.doStep(k * 0.01, 0.01)
    data = slave.serializeFMUState(slave.getFMUState())
    for value, is_inside in ((7.654321, False), (0.6, False), (2.0, True)):
        assert (np.float64(value).tobytes() in bytes(data)) == is_inside
    expected = go_on(slave)
    (line,) = session.log.lines("toy")
    assert "left its limits at" in line and "0.6 " not in line
    for each in (slave, session.instance("other")):
        each.setFMUState(each.deSerializeFMUstate(data))
        assert go_on(each) == expected


@pytest.mark.parametrize(
    ("disclosure", "message"),
    [
        (Disclosure(hidden=["spring.kk"]), r"there is no parameter spring\.kk; did you mean spring\.k\?"),
        (Disclosure(hidden=["F"]), "F is an input; only parameters can be hidden"),
        (Disclosure(fixed=["x"]), "x is a state; only parameters can be fixed"),
        (Disclosure(hidden=["gains[1]"]), "one element of an array.* write gains"),
        (Disclosure(values={"gains": 1}), r"gains is an array; set its elements, such as gains\[1\]"),
        (Disclosure(values={"y": 1}), "y is an output; only parameters"),
        (Disclosure(values={"spring.k": "-1"}), "outside its range, 0 to inf"),
        (Disclosure(values={"spring.k": "stiff"}), "is not a finite number"),
        (Disclosure(values={"spring.k": "inf"}), "is not a finite number"),
        (Disclosure(values={"spring.law": "square"}), "is not one of linear, cubic"),
        (Disclosure(values={"damper.on": "2"}), "is not true or false"),
        (Disclosure(values={"start.x": 6}), "no instance of this FMU could start: .*must not exceed 5 m"),
    ],
)
def test_invalid_disclosures_are_refused(disclosure: Disclosure, message: str) -> None:
    with pytest.raises(DisclosureError, match=message):
        Recipe.of(Spring, "native", disclosure=disclosure)


def test_readable_fmus_cannot_hide(tmp_path: Path) -> None:
    for disclosure in (Disclosure(sources=False), Disclosure(fixed=["body.m"])):
        with pytest.raises(DisclosureError, match="build a native FMU"):
            build(Spring, tmp_path / "Spring.fmu", flavour="python", disclosure=disclosure)


def test_disclosures_have_different_keys() -> None:
    name = ["v_max"]
    changes = ({}, {"sources": False}, {"hidden": name}, {"fixed": name}, {"values": {"v_max": 3.0}})
    keys = {Recipe.of(Cart, "native", disclosure=Disclosure(**change)).key() for change in changes}
    assert len(keys) == len(changes) and None not in keys


def test_command_hides_and_refuses(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copy(__file__, tmp_path / "mine.py")
    monkeypatch.chdir(tmp_path)
    assert main(["build", "mine.py:Spring", "--hide", "nothing"]) == 2
    assert "there is no parameter nothing" in capsys.readouterr().err
    assert main(["build", "mine.py:Spring", "--set", "spring.k"]) == 2
    assert "write --set NAME=VALUE" in capsys.readouterr().err
    assert main(["build", "mine.py:Spring", "--no-sources", "--set", "spring.k=3"]) == 0
    with zipfile.ZipFile("Spring.fmu") as archive:
        assert "sources/fmi2_block.c" not in archive.namelist()
    variables = {v.name: v.start for v in read_model_description("Spring.fmu").modelVariables}
    assert variables["spring.k"] == "3.0"
