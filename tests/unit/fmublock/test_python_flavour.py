"""PythonFMU FMUs whose equations raise what no arithmetic raises."""

import _ctypes
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from textwrap import dedent

import pytest

from fmublock import build, load_block
from fmublock.slave import release_interpreter_at_exit
from tests.support.sessions import DISCARD, FATAL, Session, opened, refused

FRAGILE = """
    from fmublock import Block, DiscreteState, Input, Output, Parameter, State


    class Fragile(Block):
        # symbols, on which an FMU is built, never get to the mistake

        u = Input(2.0)
        mistake = Parameter(1)
        place = Parameter(1)
        x = State(1.0)
        count = DiscreteState(0.0)
        y = Output()

        def derivatives(self, v):
            self.err(v, 1)
            return {"x": v.u - 0.5 * v.x}

        def update(self, v):
            self.err(v, 2)
            return {"count": v.count + 1.0}

        def outputs(self, v):
            self.err(v, 3)
            return {"y": v.u * v.x}

        def err(self, v, place):
            if not isinstance(v.time, float) or v.time <= 0.5 or v.place != place:
                return
            if v.mistake == 1:
                None + v.x
            if v.mistake == 2:
                {}["missing"]
            if v.mistake == 3:
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
    return build(load_block(f"{folder / 'fragile.py'}:Fragile"), folder / "Fragile.fmu", flavour="python")


@pytest.fixture
def session(fragile_fmu: Path, tmp_path: Path) -> Iterator[Session]:
    with opened(fragile_fmu, tmp_path / "fmu") as session:
        yield session


@pytest.mark.parametrize(("mistake", "position"), [(1, 1), (2, 2), (3, 3), (4, 1)])
def test_step_whose_equations_raise_is_discarded_and_undone(
    session: Session, mistake: int, position: int
) -> None:
    """The log names the exception; shorter steps from there give the bits of an instance that did not try."""
    values = {"mistake": mistake, "place": position}
    rolled_back, straight = session.instance("tried", **values), session.instance("straight", **values)
    saved = rolled_back.getFMUstate()
    for slave in (rolled_back, straight):
        slave.doStep(0.0, 0.25)
        session.set(slave, u=3.0)
    before = session.get(rolled_back, *NAMES)
    for step in (0.5, 0.25 + 1e-9, 1.0):
        with refused(DISCARD):
            rolled_back.doStep(0.25, step)
        assert session.get(rolled_back, *NAMES) == before
    assert session.log.lines("tried") == [f"tried: step at t = 0.25 s: {CAUSES[mistake]}"] * 3
    for slave in (rolled_back, straight):
        slave.doStep(0.25, 0.125)
        slave.doStep(0.375, 0.125)
    assert session.get(rolled_back, *NAMES) == session.get(straight, *NAMES)
    assert session.get(rolled_back, "count") == [3.0]
    rolled_back.setFMUstate(saved)
    rolled_back.freeFMUstate(saved)
    assert session.get(rolled_back, "count", "x") == [0.0, 1.0]


def test_outputs_that_raise_in_initialization_are_logged(session: Session) -> None:
    """PythonFMU knows fmi2Fatal only; the process lives."""
    slave = session.instance("fragile", running=False, time=0.75, place=3, mistake=2)
    with refused(FATAL):
        session.get(slave, "y")
    with refused(FATAL):
        slave.exitInitializationMode()
    assert all("missing" in line for line in session.log.lines("fragile"))
    assert session.log.lines("fragile")


# ---- the process of the host -------------------------------------------------------------------

HOST = """
import atexit, sys, fmpy
from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import FMU2Slave

folder = fmpy.extract(sys.argv[1], sys.argv[2])
description = fmpy.read_model_description(folder)

def stepped(name="fragile"):
    slave = FMU2Slave(
        guid=description.guid, unzipDirectory=folder, modelIdentifier="Fragile", instanceName=name
    )
    slave.instantiate()
    slave.setupExperiment()
    slave.setReal([v.valueReference for v in description.modelVariables if "internal" in v.name], [0.25])
    slave.enterInitializationMode()
    slave.exitInitializationMode()
    slave.doStep(0.0, 0.01)
    return slave
"""

FAILURES = """
slave, failures = stepped(), 0
for i in range(1000):
    try:
        {}
    except FMICallException:
        failures += 1
slave.doStep(0.01, 0.25); slave.terminate(); slave.freeInstance(); stepped().freeInstance()
print(failures)
"""

# what is registered first is called last: before or after the FMU's library releases Python
AT_EXIT = {
    "before": """
first = stepped()
atexit.register(lambda: (first.freeInstance(), print("freed")))
""",
    "after": """
atexit.register(lambda: (stepped("late").freeInstance(), first.freeInstance(), print("freed")))
first = stepped()
""",
    "never": """
first = stepped()
print("left")
""",
}


def host(fmu: Path, folder: Path, code: str) -> str:
    """Run this in a process of its own. Return what it prints.

    Without its caches, the C library sees what was released twice when the process ends, and aborts.
    """
    strict = {**os.environ, "GLIBC_TUNABLES": "glibc.malloc.tcache_count=0"}
    command = [sys.executable, "-c", HOST + code, str(fmu), str(folder)]
    run = subprocess.run(command, capture_output=True, text=True, check=False, env=strict)
    assert run.returncode == 0, run.stderr
    return run.stdout.split()[-1]


@pytest.mark.slow
@pytest.mark.parametrize("failure", ["slave.doStep(0.01, 1.0)", "slave.getReal([99])"])
def test_thousand_failures_do_not_end_the_process(fragile_fmu: Path, tmp_path: Path, failure: str) -> None:
    """Of steps whose equations raise, and of calls that PythonFMU itself sees fail."""
    assert host(fragile_fmu, tmp_path, FAILURES.format(failure)) == "1000"


@pytest.mark.slow
def test_host_makes_and_frees_a_thousand_instances(fragile_fmu: Path, tmp_path: Path) -> None:
    code = "for i in range(1000): slave = stepped(); slave.terminate(); slave.freeInstance()"
    assert host(fragile_fmu, tmp_path, f"{code}\nprint('done')") == "done"


@pytest.mark.slow
@pytest.mark.parametrize("when", AT_EXIT)
def test_host_may_free_instances_as_it_ends(fragile_fmu: Path, tmp_path: Path, when: str) -> None:
    """Before the FMU's library releases Python, after it, or not at all; and make one more in between."""
    assert host(fragile_fmu, tmp_path, AT_EXIT[when]) == ("left" if when == "never" else "freed")


def test_library_without_python_is_not_released(tmp_path: Path) -> None:
    for library in (Path(str(_ctypes.__file__)), tmp_path / "none.so"):
        release_interpreter_at_exit(library)
