"""PythonFMU FMUs whose equations raise what no arithmetic raises."""

import _ctypes
import importlib
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from textwrap import dedent

import pytest

from fmublock import build
from fmublock.slave import release_interpreter_at_exit
from tests.support.sessions import DISCARD, FATAL, Session, opened, refused

FRAGILE = """
    from enum import IntEnum

    from fmublock import Block, DiscreteState, Input, Output, Parameter, State


    class Mistake(IntEnum):
        TYPE = 1
        KEY = 2
        ATTRIBUTE = 3
        ASSERTION = 4


    class Place(IntEnum):
        DERIVATIVES = 1
        UPDATE = 2
        OUTPUTS = 3


    class Fragile(Block):
        # symbols, on which an FMU is built, never get there

        u = Input(2.0)
        mistake = Parameter(Mistake.TYPE)
        place = Parameter(Place.DERIVATIVES)
        x = State(1.0)
        count = DiscreteState(0.0)
        y = Output()

        def derivatives(self, v):
            self.err(v, Place.DERIVATIVES)
            return {"x": v.u - 0.5 * v.x}

        def update(self, v):
            self.err(v, Place.UPDATE)
            return {"count": v.count + 1.0}

        def outputs(self, v):
            self.err(v, Place.OUTPUTS)
            return {"y": v.u * v.x}

        def err(self, v, place):
            if not isinstance(v.time, float) or v.time <= 0.5 or v.place != place:
                return
            if v.mistake == Mistake.TYPE:
                None + v.x
            if v.mistake == Mistake.KEY:
                {}["missing"]
            if v.mistake == Mistake.ATTRIBUTE:
                v.undeclared
            assert False, "50 % wrong"
"""

CAUSES = {
    1: "TypeError: unsupported operand type(s) for +: 'NoneType' and 'float'",
    2: "KeyError: 'missing'",
    3: "AttributeError: the block's equations have no variable 'undeclared'",
    4: "AssertionError: 50 % wrong",
}
NAMES = ("x", "count", "y", "u")


@pytest.fixture(scope="module")
def fragile_fmu(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("fragile")
    (folder / "fragile.py").write_text(dedent(FRAGILE))
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(folder)
        block = importlib.import_module("fragile").Fragile
        path = build(block, folder / "Fragile.fmu", flavour="python")
        del sys.modules["fragile"]
    return path


@pytest.fixture
def session(fragile_fmu: Path, tmp_path: Path) -> Iterator[Session]:
    with opened(fragile_fmu, tmp_path / "fmu") as session:
        yield session


@pytest.mark.parametrize(("mistake", "place"), [(1, 1), (2, 2), (3, 3), (4, 1)])
def test_a_step_whose_equations_raise_is_discarded_and_undone(
    session: Session, mistake: int, place: int
) -> None:
    """The log names the exception; shorter steps from there give the bits of an instance that did not try."""
    values = {"mistake": mistake, "place": place}
    tried, straight = session.instance("tried", **values), session.instance("straight", **values)
    saved = tried.getFMUstate()
    for slave in (tried, straight):
        slave.doStep(0.0, 0.25)
        session.set(slave, u=3.0)
    before = session.get(tried, *NAMES)
    for step in (0.5, 0.25 + 1e-9, 1.0):
        with refused(DISCARD):
            tried.doStep(0.25, step)
        assert session.get(tried, *NAMES) == before
    assert session.log.lines("tried") == [f"tried: step at t = 0.25 s: {CAUSES[mistake]}"] * 3
    for slave in (tried, straight):
        slave.doStep(0.25, 0.125)
        slave.doStep(0.375, 0.125)
    assert session.get(tried, *NAMES) == session.get(straight, *NAMES)
    assert session.get(tried, "count") == [3.0]
    tried.setFMUstate(saved)
    tried.freeFMUstate(saved)
    assert session.get(tried, "count", "x") == [0.0, 1.0]


def test_outputs_that_raise_in_initialization_are_logged(session: Session) -> None:
    """PythonFMU knows fmi2Fatal only; the process lives."""
    slave = session.instance("fragile", running=False, time=0.75, place=3, mistake=2)
    with refused(FATAL):
        session.get(slave, "y")
    with refused(FATAL):
        slave.exitInitializationMode()
    assert all("missing" in line for line in session.log.lines("fragile"))
    assert session.log.lines("fragile")


@pytest.mark.slow
@pytest.mark.parametrize("failure", ["slave.doStep(0.0, 1.0)", "slave.getReal([99])"])
def test_a_thousand_failures_do_not_end_the_process(
    session: Session, fragile_fmu: Path, failure: str
) -> None:
    """Of steps whose equations raise, and of calls that PythonFMU itself sees fail; in two instances."""
    (internal_step,) = session.references(["solver.internal_step"])
    code = f"""
        import fmpy
        from fmpy.fmi1 import FMICallException
        from fmpy.fmi2 import FMU2Slave
        folder = fmpy.extract({str(fragile_fmu)!r})
        description = fmpy.read_model_description(folder)
        for instance in range(2):
            slave = FMU2Slave(
                guid=description.guid, unzipDirectory=folder, modelIdentifier="Fragile"
            )
            slave.instantiate(); slave.setupExperiment()
            slave.setReal([{internal_step}], [0.25])
            slave.enterInitializationMode(); slave.exitInitializationMode()
            failures = 0
            for i in range(1000):
                try:
                    {failure}
                except FMICallException:
                    failures += 1
            slave.doStep(0.0, 0.25); slave.terminate(); slave.freeInstance()
        print(failures)
    """
    run = subprocess.run([sys.executable, "-c", dedent(code)], capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    assert run.stdout.split()[-1] == "1000"


@pytest.mark.slow
@pytest.mark.parametrize("when", ["before", "after", "never"])
def test_a_host_may_free_instances_as_it_ends(fragile_fmu: Path, tmp_path: Path, when: str) -> None:
    """Before the FMU's library releases Python, after it, or not at all; and make one more in between."""
    code = f"""
        import atexit, fmpy
        from fmpy.fmi2 import FMU2Slave

        folder = fmpy.extract({str(fragile_fmu)!r}, {str(tmp_path / "fmu")!r})
        guid = fmpy.read_model_description(folder).guid

        def stepped(name):
            slave = FMU2Slave(guid=guid, unzipDirectory=folder, modelIdentifier="Fragile", instanceName=name)
            slave.instantiate()
            slave.setupExperiment()
            slave.enterInitializationMode()
            slave.exitInitializationMode()
            slave.doStep(0.0, 0.01)
            return slave

        if {when!r} == "after":  # what is registered first is called last
            atexit.register(lambda: (stepped("late").freeInstance(), first.freeInstance(), print("freed")))
        first = stepped("first")
        if {when!r} == "before":
            atexit.register(lambda: (first.freeInstance(), print("freed")))
        """
    strict = {**os.environ, "GLIBC_TUNABLES": "glibc.malloc.tcache_count=0"}
    command = [sys.executable, "-c", dedent(code)]
    run = subprocess.run(command, capture_output=True, text=True, check=False, env=strict)
    assert (run.returncode, run.stdout.strip()) == (0, "" if when == "never" else "freed"), run.stderr


def test_a_library_with_nothing_to_release_is_left_alone(tmp_path: Path) -> None:
    for library in (Path(str(_ctypes.__file__)), tmp_path / "none.so"):
        release_interpreter_at_exit(library)
