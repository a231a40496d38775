"""Structural parameters of FMI 3.0 FMUs: arrays that change their size."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import emla_cosim as ec
from emla_cosim.base.errors import CommandError, RunError
from emla_cosim.system.model import System
from tests.support.commands import Emla, sentence
from tests.support.hand_written_fmus import build_state_space_fmu
from tests.support.tiers import mostly_slow

STEP, STOP = 0.125, 1.0
A = np.array([[0.0, 1.0, 0.0], [-2.0, -0.5, 1.0], [0.0, 0.25, -1.0]])
B = np.array([[1.0, 0.0], [0.0, 2.0], [0.5, -1.0]])
C = np.array([[1.0, 2.0, 3.0]])
U = np.array([0.25, -1.5])
VALUES: dict[str, Any] = {"s.n": 3, "s.m": 2, "s.r": 1, "s.A": A, "s.B": B, "s.C": C, "s.u": U}
SECOND = {"t.n": 1, "t.m": 3, "t.A[1,1]": -1.0, "t.B": np.array([[1.0, 2.0, 4.0]]), "t.C": np.ones((2, 1))}
FEW = {"s.n": 1, "s.A[1,1]": -1.0, "s.B[1,1]": 0.5, "s.C[1,1]": 1.0, "s.C[2,1]": -3.0}


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("structure") / "StateSpace.fmu"
    return build_state_space_fmu(file)


def run(system: System, **options: Any) -> ec.Result:
    with ec.load(system, step_size=STEP, stop_time=STOP, **options).prepare() as simulation:
        return simulation.run()


def euler(a: Any, b: Any, c: Any, u: Any, steps: int = round(STOP / STEP)) -> Any:
    """Return the outputs after each step, in another way than the FMU: by powers of the discrete system."""
    n = len(a)
    step = np.eye(n + 1)
    step[:n, :n] += STEP * np.asarray(a)
    step[:n, n] = STEP * np.asarray(b) @ u
    start = np.append(np.full(n, 0.5), 1.0)
    rows = [np.linalg.matrix_power(step, k) @ start for k in range(steps + 1)]
    return np.array([c @ row[:n] for row in rows])


@pytest.mark.parametrize("options", mostly_slow([{}, {"isolate": ["s"]}], [{}]))
def test_larger_arrays_give_the_closed_form(path: Path, options: dict[str, Any]) -> None:
    expected = euler(A, B, C, U)
    system = System.of({"s": path}, [], VALUES)
    with ec.load(system, step_size=STEP, stop_time=STOP, **options).prepare() as simulation:
        for _ in range(2):  # the second run has a new instance
            result = simulation.run(signals=["s.y*", "s.x0[3]", "s.n"])
            assert [name for name in result.names if name.startswith("s.y")] == ["s.y[1]"]
            assert np.allclose(result["s.y[1]"], expected[:, 0], rtol=1e-12, atol=0.0)
            assert set(result["s.x0[3]"]) == {0.5}, "the single start value is set again for all elements"
            assert set(result["s.n"]) == {3}


@pytest.mark.parametrize(
    ("values", "matrices"),
    [
        (FEW, ([[-1.0]], [[0.5]], np.array([[1.0], [-3.0]]))),
        ({"s.n": 2, "s.m": "1"}, ([[0, 1], [-4, -1]], [[0], [1]], np.eye(2))),
    ],
    ids=["smaller", "same size"],
)
def test_arrays_of_other_sizes_give_the_closed_form(
    path: Path, values: dict[str, Any], matrices: tuple[Any, Any, Any]
) -> None:
    result = run(System.of({"s": path}, [], values))
    expected = euler(*matrices, [1.0])
    assert np.allclose(np.array([result["s.y[1]"], result["s.y[2]"]]).T, expected, rtol=1e-12, atol=0.0)


def test_whole_arrays_connect_with_their_new_sizes(path: Path) -> None:
    first = {**VALUES, "s.r": 3, "s.C": np.eye(3)}
    system = System.of({"s": path, "t": path}, ["s.y -> t.u"], {**first, **SECOND})
    result = run(system, algorithm="jacobi")
    y, x = euler(A, B, np.eye(3), U), 0.5
    for k, u in enumerate(y):
        assert np.isclose(result["t.y[1]"][k], x, rtol=1e-12)
        x += STEP * (-x + np.array([1.0, 2.0, 4.0]) @ u)
    with pytest.raises(CommandError, match=r"joins different shapes: s.y has 2 elements, t.u has 3 elements"):
        first |= {"s.r": 2, "s.C": np.ones((2, 3))}
        run(System.of({"s": path, "t": path}, ["s.y -> t.u"], {**first, **SECOND}))


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"s.n": 7}, "s.n = 7 is out of range: it must be at least 0 and at most 6"),
        ({"s.n": 0}, "s.n = 0 is not supported: .* at least one element"),
        ({"s.m": 0}, "s.m = 0 is out of range: it must be at least 1"),
        ({"s.n": 1.5}, "s.n = 1.5 is not a whole number"),
        ({"s.n": "many"}, "s.n = many is not a whole number"),
        ({"s.n": 3}, r"s.A\[1,1\] has no value: with n = 3, .* A\[1,1\] to A\[3,3\]"),
        ({**FEW, "s.A[1,2]": 1.0}, r"s has no variable 'A\[1,2\]'"),
        ({"s.m": 3, "s.B[1,3]": 1.0}, r"s.B\[1,1\] has no value: with m = 3"),
        ({"s.deaf": True}, "s.deaf is False: the FMU did not accept the value True"),
    ],
)
def test_values_that_do_not_fit_are_refused(path: Path, values: dict[str, Any], words: str) -> None:
    with pytest.raises((CommandError, RunError), match=words):
        run(System.of({"s": path}, [], values))


def test_prepared_system_keeps_its_sizes(path: Path, tmp_path: Path, on_one_cluster: None) -> None:
    system = System.of({"s": path}, [], FEW)
    with ec.load(system, step_size=STEP, stop_time=STOP).prepare() as simulation:
        with pytest.raises(CommandError, match=r"s.n cannot change between runs or variants"):
            simulation.run(set={"s.n": 2})
        assert np.isfinite(simulation.run(set={"s.C[2,1]": 4.0})["s.y[2]"]).all()
    with pytest.raises(CommandError, match=r"'s\.n' .*is a structural parameter and cannot be varied"):
        ec.sweep(system, {"s.n": [1, 2]}, step_size=STEP, stop_time=STOP, output=tmp_path / "sweep")
    swept = ec.sweep(
        system,
        {"s.C[2,1]": [1.0, 2.0]},
        metrics={"end": lambda r: float(r["s.y[2]"][-1])},
        step_size=STEP,
        stop_time=STOP,
    ).variants
    assert swept["end"][1] == 2.0 * swept["end"][0] != 0.0


@pytest.mark.parametrize("isolate", mostly_slow([[], ["s"]], [[]]))
def test_resumed_run_has_the_same_values(path: Path, isolate: list[str], tmp_path: Path) -> None:
    def part(stop: float, values: dict[str, Any] = VALUES, **options: Any) -> ec.Result:
        options = {"step_size": STEP, "stop_time": stop, "isolate": isolate, **options}
        with ec.load(System.of({"s": path}, [], values), **options).prepare() as simulation:
            return simulation.run()

    full_run = part(STOP)
    part(0.5, checkpoint=tmp_path / "c")
    rest = part(STOP, resume=tmp_path / "c")
    assert rest["s.y[1]"][-1] == full_run["s.y[1]"][-1]
    with pytest.raises(CommandError):
        part(STOP, FEW, resume=tmp_path / "c")


def test_values_come_from_the_command_line_and_from_files(path: Path, emla: Emla, tmp_path: Path) -> None:
    few = {k.replace("s.", "StateSpace."): v for k, v in FEW.items()}
    options = ["--step-size", str(STEP), "--stop-time", str(STOP)]
    settings = [f"--set={name}={value}" for name, value in few.items()]
    output = emla("info", str(path), *settings).stdout
    assert "StateSpace.C[2,1]" in output
    assert "StateSpace.C[2,2]" not in output
    table = tmp_path / "values.csv"
    table.write_text("\n".join((";".join(few), ";".join(str(x) for x in few.values()))))
    expected = run(System.of({"s": path}, [], FEW))
    for name, arguments in {"set": settings, "table": ["--parameters", str(table)]}.items():
        result = emla("run", str(path), *options, *arguments, "--output", str(tmp_path / name))
        assert result.exit_code == 0, result.output
        actual = np.genfromtxt(tmp_path / name / "results.csv", delimiter=",", names=True, deletechars="")
        assert actual["StateSpace.y[2]"][-1] == expected["s.y[2]"][-1]
    result = emla("run", str(path), *options, "--set", "n=9", "--output", str(tmp_path / "wrong"))
    assert result.exit_code == 2
    assert "n = 9 is out of range" in sentence(result, 2)


def test_packages_have_their_sizes(path: Path, tmp_path: Path) -> None:
    system = System.of(
        {"s": path, "t": path}, ["s.y -> t.u"], {**VALUES, "s.r": 3, "s.C": np.eye(3), **SECOND}
    )
    scenario = ec.load(system, step_size=STEP, stop_time=STOP)
    scenario.export(tmp_path / "sized.ssp")
    result = ec.load(tmp_path / "sized.ssp").prepare().run()
    assert np.array_equal(result["t.y[1]"], run(system)["t.y[1]"])
    with pytest.raises(CommandError, match=r"cannot change the size of s.y: its elements are connected"):
        ec.load(tmp_path / "sized.ssp", set={"s.r": 2}).prepare()
