"""A block as a running slave: phases, frozen outputs, discards, state."""

import math
import re
from pathlib import Path
from typing import Any, ClassVar

import pytest
from fmpy.validation import validate_fmu

from fmublock import (
    Block,
    BlockError,
    BuildError,
    Input,
    Instance,
    Output,
    Parameter,
    State,
    StepDiscardedError,
    build,
)
from fmublock.results import EquationError
from fmublock.symbolic import evaluate_symbolically
from tests.support.arm import Arm
from tests.support.in_process import started
from tests.support.sessions import opened
from tests.support.toy import Toy

REFERENCE = Toy.layout().reference


def test_calls_in_the_invalid_phase_are_refused() -> None:
    with pytest.raises(BlockError, match="cannot do a step in phase instantiated"):
        Instance(Toy()).do_step(0.0, 0.1)
    with pytest.raises(BlockError, match="cannot enter initialization mode in phase step"):
        started(Toy).enter_initialization()


class Reciprocal(Block):
    x = State(0.0)

    def derivatives(self, v: Any) -> dict[str, Any]:
        return {"x": 1.0 / v.x}


def test_step_whose_equation_fails_is_discarded() -> None:
    """Also one of 1e9 internal steps, the first of which fails; more of them are refused."""
    instance = started(Reciprocal, {"solver.internal_step": 2.0**-20})
    with pytest.raises(StepDiscardedError, match=r"discarded: an equation failed \(float division by zero\)"):
        instance.do_step(0.0, 1e9 * 2.0**-20)
    with pytest.raises(BlockError, match=r"needs more than 1e\+09 internal steps"):
        instance.do_step(0.0, (1e9 + 0.5) * 2.0**-20)
    assert instance.time == 0.0


def test_undeclared_variable_in_an_equation_is_refused() -> None:
    class Wrong(Block):
        u = Input()
        y = Output()

        def outputs(self, v: Any) -> dict[str, Any]:
            return {"y": v.u + v.w}

    instance = Instance(Wrong())
    with pytest.raises(AttributeError, match="no variable 'w'"):
        instance.get([1])
    with pytest.raises(BuildError, match=r"Wrong.outputs, y: `v.w` in line .* no variable 'w'"):
        evaluate_symbolically(Wrong())


class Pair(Block):
    """Results of two shapes, as `results` of the class says."""

    results: ClassVar[Any] = None
    u = Input(1.0)
    M = Output(shape=(2, 2))
    P = Output()

    def outputs(self, v: Any) -> Any:
        return {"M": [[v.u, 0.0], [0.0, v.u]], "P": v.u} if self.results is None else self.results


@pytest.mark.parametrize(
    ("results", "sentence"),
    [
        ({"P": 1.0}, "Wrong.outputs returns no value for M."),
        ({"P": 1.0, "M": [[1.0, 2.0]] * 2, "Q": 1.0, "R": 2.0}, "Wrong.outputs returns Q, R, not declared"),
        ({"P": 1.0, "M": [[1.0, 2.0]] * 3}, "Wrong.outputs: M is wrong: a list of 3 is not 2 x 2 values."),
        ({"P": 1.0, "M": [[1.0, 2.0], [3.0]]}, "Wrong.outputs: M is wrong: a list of 1 is not 2 values."),
        ({"P": 1.0, "M": 1.0}, "Wrong.outputs: M is wrong: one value is not 2 x 2 values."),
        ({"P": [1.0], "M": [[1.0, 2.0]] * 2}, "Wrong.outputs: P is wrong: a list of 1 is not one value."),
        ({"P": "1", "M": [[1.0, 2.0]] * 2}, "Wrong.outputs: P is '1', which is not a number."),
        ([1.0], r"Wrong.outputs returns \[1.0\] instead of a dict"),
    ],
)
def test_invalid_results_of_methods_are_refused_in_runs_and_exports(results: Any, sentence: str) -> None:
    block = type("Wrong", (Pair,), {"results": results})()
    with pytest.raises(EquationError, match=sentence):
        Instance(block).get([0])
    with pytest.raises(BuildError, match=sentence):
        evaluate_symbolically(block)


def test_values_have_names_and_arrays_are_lists() -> None:
    instance = Instance(Toy(), "toy")
    assert instance["spring.k"] == [3.0, 0.25]
    instance["spring.k"] = [5.0, 6.0]
    instance["spring.k[2]"] = 7
    instance["damped"] = False
    instance["x_0"] = 0.5
    assert (instance["spring.k"], instance["spring.k[1]"]) == ([5.0, 7.0], 5.0)
    assert (instance["damped"], instance["x"], instance["inverse"]) == (0.0, 0.5, 2.0)
    pair = Instance(Pair())
    pair["u"] = 2.0
    assert pair["M"] == [[2.0, 0.0], [0.0, 2.0]]
    assert (pair["M[2,2]"], pair["M[1,2]"]) == (2.0, 0.0)


@pytest.mark.parametrize(
    ("name", "value", "sentence"),
    [
        ("spring.K", 1.0, "toy: there is no variable 'spring.K'; did you mean 'spring.k'"),
        ("zzz", 1.0, "toy: there is no variable 'zzz'."),
        ("spring.k", [1.0], r"toy: \[1.0\] is not a value for spring.k: a list of 1 is not 2 values"),
        ("x_0", "much", "toy: 'much' is not a value for x_0"),
        ("x_0", [1.0], r"toy: \[1.0\] is not a value for x_0"),
        ("power", 1.0, "toy: power is computed by the block"),
    ],
)
def test_invalid_names_and_values_are_refused(name: str, value: Any, sentence: str) -> None:
    with pytest.raises(BlockError, match=sentence):
        Instance(Toy(), "toy")[name] = value


def test_every_element_starts_from_its_own_element_of_the_parameter() -> None:
    instance = Instance(Arm())
    instance["q_0"] = [1.0, 10.0, 100.0]
    instance["level"] = 4.0
    instance["M[2,3]"] = 0.0
    assert (instance["M[1,3]"], instance["M[2,1]"]) == (3.0, 4.0)  # named row by row
    assert instance["q"] == [1.0, 10.0, 100.0]
    assert instance["w"] == [4.0, 4.0]
    assert instance["y"] == [321.0, 54.0]
    with pytest.raises(BlockError, match=r"q\[2\] is computed by the block"):
        instance["q[2]"] = 1.0


def test_matrix_gives_the_same_numbers_in_every_flavour(tmp_path: Path) -> None:
    values = {"q_0[2]": 0.7, "M[2,1]": -3.5, "level": 0.25}
    names = [s.name for s in Arm.layout().scalars if s.variable in (*Arm.layout().states, Arm.y)]
    instance = Instance(Arm())
    for name, value in values.items():
        instance[name] = value
    expected = [instance[n] for n in names]
    for flavour in ("native", "python"):
        path = build(Arm, tmp_path / flavour / "Arm.fmu", flavour=flavour)
        assert validate_fmu(str(path)) == []
        with opened(path, tmp_path / f"{flavour}-unpacked") as session:
            actual = session.get(session.instance("arm", **values), *names)
        assert actual == expected, flavour


@pytest.mark.parametrize(
    ("start", "shape", "sentence"),
    [
        ([1.0, 2.0], 3, r"\[1.0, 2.0\] is not 3 values"),
        ([[1.0, 2.0], [3.0]], (2, 2), "is not 2 x 2 values"),
        ([1.0, 2.0], (), "is not one value"),
        ("1", (), "'1' is not one value"),
        (1.0, 0, "the shape 0 is neither"),
        (1.0, (2, 1.5), "is neither a number of elements nor a tuple"),
        (math.nan, (), "the start value nan is not finite"),
        (
            Parameter([1.0, 2.0], shape=2),
            3,
            "a start parameter of 2 values does not fit a variable of 3 values",
        ),
    ],
)
def test_invalid_start_values_are_refused(start: Any, shape: Any, sentence: str) -> None:
    with pytest.raises(TypeError, match=sentence):
        State(start, shape=shape)


@pytest.mark.parametrize("name", ["speed of screw", 'a"b', "x[", "1x", "größe", ""])
def test_names_are_structured_names(name: str) -> None:
    class Odd(Block):
        a = Parameter(1.0, name=name)

    with pytest.raises(TypeError, match=f"Odd has the name '{re.escape(name)}'"):
        Odd.layout()
