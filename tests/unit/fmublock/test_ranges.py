"""Start values of states outside their range end the initialization, as those of parameters do."""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from emla_cosim.fmu.models import FLAVOURS, fmu_path
from fmublock import Block, BlockError, Instance, Output, Parameter
from rsba_fmu.controller import RsbaController
from tests.support.sessions import ERROR, FATAL, Session, opened, refused

WRONG = [-5.0, -5e-324, math.nan, math.inf]


@pytest.fixture(scope="module", params=FLAVOURS)
def session(
    request: pytest.FixtureRequest, python_fmu_folder: Path, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Session]:
    path = fmu_path("RsbaController", request.param, python_fmu_folder)
    with opened(path, tmp_path_factory.mktemp("ranges")) as session:
        yield session


@pytest.mark.parametrize("value", WRONG)
def test_an_instance_refuses_it(value: float) -> None:
    instance = Instance(RsbaController(), "controller")
    instance["theta[1]"] = value
    instance.enter_initialization()
    with pytest.raises(BlockError, match=r"controller: theta\[1\] = \S+ is outside its range, 0 to inf"):
        instance.exit_initialization()
    instance["theta[1]"] = 0.0
    instance.exit_initialization()


@pytest.mark.parametrize("value", WRONG)
def test_an_fmu_refuses_it(session: Session, value: float) -> None:
    session.log.all.clear()
    slave = session.instance("controller", running=False, **{"theta[1]": value})
    with refused(ERROR, FATAL):
        slave.exitInitializationMode()
    assert any(
        "theta[1] = " in line and "outside its range" in line for line in session.log.lines("controller")
    )
    session.set(slave, **{"theta[1]": 0.0})
    slave.exitInitializationMode()


class Quotient(Block):
    """A block whose output has no value for a parameter within its range."""

    a = Parameter(0.0)
    y = Output()

    def outputs(self, v: Any) -> dict[str, Any]:
        return {"y": 1.0 / v.a}


def test_outputs_that_cannot_be_computed_are_told_in_a_sentence() -> None:
    instance = Instance(Quotient(), "quotient")
    instance.enter_initialization()
    sentence = r"^quotient: the first outputs cannot be computed: float division by zero\.$"
    with pytest.raises(BlockError, match=sentence):
        instance["y"]
    with pytest.raises(BlockError, match=sentence):
        instance.exit_initialization()
    instance["a"] = 2.0
    instance.exit_initialization()
    assert instance["y"] == 0.5
