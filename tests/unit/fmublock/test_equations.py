"""Equations that differ between symbols and floats end the export with a message that names the line."""

import struct
from collections.abc import Callable
from itertools import product
from pathlib import Path
from textwrap import indent
from typing import Any

import pytest

from fmublock import Block, BuildError, Input, Instance, Output, build, load_block
from fmublock import functions as f
from fmublock.symbolic import evaluate_symbolically
from tests.support.sessions import opened

HEAD = """import math
import random
import statistics

from fmublock import *
from fmublock.noise import normal


class Mine(Block):
    F = Input(1.0)
    w = Parameter([1.0, 2.0], shape=2)
    v = State(0.25)
    P = Output()
    Q = Output()

    def derivatives(self, v):
        return {"v": v.F}

    def helped(self, x):
        return helper(x)

    def outputs(self, v):
"""
TAIL = """

def helper(x):
    return math.sqrt(x)
"""
FIRST = len(HEAD.splitlines()) + 1
BRANCH, NUMBER = (
    "branches on a value that is known only in a run; use where",
    "needs a number that is known only in a run",
)


def define_block(folder: Path, body: str) -> type[Block]:
    """The block above with this body of `outputs`."""
    file = folder / "mine.py"
    file.write_text(HEAD + indent(body, 8 * " ") + TAIL)
    return load_block(f"{file}:Mine")


def sentence(folder: Path, body: str) -> str:
    """Return the error message about this body of `outputs`."""
    with pytest.raises(BuildError) as refused:
        evaluate_symbolically(define_block(folder, body)())
    assert "\n" not in str(refused.value)
    return str(refused.value)


@pytest.mark.parametrize("flavour", ["native", "python"])
def test_message_matches_a_build(tmp_path: Path, flavour: str) -> None:
    body = "return {'P': math.sin(v.F), 'Q': v.v}"
    with pytest.raises(BuildError) as refused:
        build(define_block(tmp_path, body), tmp_path / "Mine.fmu", flavour=flavour)
    assert str(refused.value) == sentence(tmp_path, body)


@pytest.mark.parametrize(
    ("expression", "culprit", "reason"),
    [
        ("math.sin(v.F)", None, NUMBER),
        ("minimum(math.sin(v.F), 2.0)", "math.sin(v.F)", NUMBER),
        ("2.0 * float(v.v)", "float(v.v)", NUMBER),
        ("int(v.v)", None, NUMBER),
        ("round(v.v)", None, NUMBER),
        ("math.floor(v.v)", None, NUMBER),
        ("math.fsum(v.w)", None, NUMBER),
        ("[1.0, 2.0][v.F]", None, NUMBER),
        ("max(v.v, v.F)", None, BRANCH),
        ("sorted(v.w)[0]", "sorted(v.w)", BRANCH),
        ("1.0 if v.v > 0.0 else 2.0", "v.v > 0.0", BRANCH),
        ("v.v > 0.0 and v.F > 0.0", None, BRANCH),
        ("not v.v", None, BRANCH),
        ("0.0 < v.v < 1.0", None, BRANCH),
        ("1.0 * (v.v in (1.0, 2.0))", "v.v in (1.0, 2.0)", BRANCH),
        ("v.v ** 2", None, "write a product"),
        ("2.0 ** v.v", None, "write a product"),
        ("v.v % 2.0", None, "use mod(x, y)"),
        ("v.v // 2.0", None, "use floor(x / y)"),
        ("divmod(v.v, 2.0)[0]", "divmod(v.v, 2.0)", "use floor(x / y) and mod(x, y)"),
        ("sum(v.w)", None, "use dot(a, b)"),
        ("sum([x * x for x in v.w], 0.0)", None, "use dot(a, b)"),
        ("where(v.v > 0.0, v.v, log(-1.0))", None, "holds the constant NaN"),
        ("statistics.fmean(v.w)", None, NUMBER),
        ("len(f'{v.v:.2f}')", "f'{v.v:.2f}'", "formats a value"),
        ("v.x", None, "the block's equations have no variable 'x'"),
        ("v.v.real", None, "AttributeError"),
        ("v.w * 2.0", None, "TypeError"),
        ("dot(v.w, [1.0])", None, "ValueError"),
        ("normal(v.w, 1.0)", None, "TypeError"),
        ("sqrt('4')", None, "fails"),
    ],
)
def test_expressions_that_differ_between_symbols_and_floats_are_refused(
    tmp_path: Path, expression: str, culprit: str | None, reason: str
) -> None:
    message = sentence(tmp_path, f'return {{\n    "P": v.v,\n    "Q": {expression},\n}}\n')
    assert message.startswith(f"Mine.outputs, Q: `{culprit or expression}` in line {FIRST + 2} of mine.py ")
    assert reason in message


@pytest.mark.parametrize(
    ("body", "result", "line", "message"),
    [
        ("s = math.sin(v.F)\nt = 2.0 * s\nreturn {'P': t, 'Q': v.v}", ", P", 1, "`math.sin(v.F)`"),
        ("a = 1.0\nif v.v > 0.0:\n    a = 2.0\nreturn {'P': a, 'Q': 1.0}", ", P", 2, "`v.v > 0.0`"),
        ("a = 1.0\nif v.v:\n    a = 2.0\nreturn {'P': a, 'Q': a}", ", P and Q", 2, "`if v.v:`"),
        ("a = v.F\nwhile a > 0.0:\n    a -= 1.0\nreturn {'P': 1.0, 'Q': a}", ", Q", 2, "`a > 0.0`"),
        ("t = 0.0\nfor i in range(v.F):\n    t += v.v\nreturn {'P': t, 'Q': 1.0}", ", P", 2, "`range(v.F)`"),
        ("assert v.v > 0.0\nreturn {'P': 1.0, 'Q': 1.0}", "", 1, "`v.v > 0.0`"),
        ("return {'P': math.nan, 'Q': 1.0}", "", 1, "P"),
        ("v.v = 1.0\nreturn {'P': 1.0, 'Q': 1.0}", "", 1, "`v.v`"),
    ],
)
def test_statements_that_differ_between_symbols_and_floats_are_refused(
    tmp_path: Path, body: str, result: str, line: int, message: str
) -> None:
    start = f"Mine.outputs{result}: {message} in line {FIRST + line - 1} of mine.py "
    assert sentence(tmp_path, body).startswith(start)


@pytest.mark.parametrize(
    ("body", "message"),
    [
        ("v.w[0] = 1.0\nreturn {'P': 1.0, 'Q': 1.0}", "changes a value of the block"),
        ("return {'P': random.random() * v.v, 'Q': 1.0}", "gives different equations in a second call"),
        ("self.x = getattr(self, 'x', v.v)\nreturn {'P': self.x, 'Q': 1.0}", "gives different equations"),
    ],
)
def test_methods_with_memory_or_random_numbers_are_refused(tmp_path: Path, body: str, message: str) -> None:
    assert sentence(tmp_path, body).startswith(f"Mine.outputs {message}")


def test_message_has_the_line_of_the_helper_and_the_output_of_the_method(tmp_path: Path) -> None:
    message = sentence(tmp_path, "return {'P': self.helped(v.v), 'Q': 1.0}")
    line = FIRST + TAIL.splitlines().index("    return math.sqrt(x)")
    assert message.startswith(f"Mine.outputs, P: `math.sqrt(x)` in line {line} of mine.py {NUMBER}")


def test_numpy_functions_of_symbols_are_refused(tmp_path: Path) -> None:
    """Natively only: no FMU's host has it, so that PythonFMU refuses its import."""
    for expression in (
        "np.sin(v.v)",
        "np.array([v.v, v.F]) @ np.ones(2)",
        "np.dot(v.w, v.w)",
        "float(np.max(v.w))",
    ):
        block = define_block(tmp_path, f"import numpy as np\nreturn {{'P': {expression}, 'Q': 1.0}}")
        with pytest.raises(BuildError, match=r"^Mine.outputs, P: `np\..* in line \d+ of mine.py "):
            evaluate_symbolically(block())
    scalar = define_block(tmp_path, "import numpy as np\nreturn {'P': np.float64(2.0) * v.v, 'Q': 1.0}")
    evaluate_symbolically(scalar())


# ---- what is allowed gives the same bits -------------------------------------------------------

INTEGERS: dict[str, Callable[[Any], Any]] = {
    "minus a condition": lambda v: -(v.a > v.b),
    "a condition times -1": lambda v: (v.a > v.b) * -1,
    "-1 times a condition": lambda v: -1 * (v.a > v.b),
    "a difference of conditions times one": lambda v: ((v.a > v.b) - (v.b > v.a)) * (v.a == v.b),
    "a condition over -2": lambda v: (v.a > v.b) / -2,
    "a condition times a number": lambda v: (v.a > v.b) * -1.0,
    # C may choose either of two zeros, so that none is -0.0 here
    "minus a maximum with an int": lambda v: -f.maximum(v.a + 0.0, 0),
    "minus a minimum with an int": lambda v: -f.minimum(0, v.a + 0.0),
    "minus a clamp": lambda v: -f.clamp(v.a + 0.0, 0, 1),
    "minus the logic": lambda v: -f.logical_and(v.a > 0.0, f.logical_not(v.b > 0.0)),
    "the absolute value": lambda v: -abs(v.a > v.b),
    "plus": lambda v: +v.a + 0,
    "0 minus": lambda v: 0 - v.a,
    "1 - 1": lambda v: (1 - 1) * v.a,
    "True": lambda v: v.a * True,
    "the floor": lambda v: f.floor(v.a * 0.25),
    "the sign": lambda v: f.sign(v.a) * v.b,
    "the angle": lambda v: f.arctan2(-(v.a > v.b) + v.a, v.b - 1.0),
    "a comparison with an enumeration's number": lambda v: f.where(v.a == 1, v.b, -v.b),
}


class Signs(Block):
    """All of the expressions above."""

    a = Input(0.0)
    b = Input(0.0)
    y = Output(shape=len(INTEGERS))

    def outputs(self, v: Any) -> dict[str, Any]:
        return {"y": [expression(v) for expression in INTEGERS.values()]}


def test_signs_of_zero_agree_between_c_and_python(tmp_path: Path) -> None:
    with opened(build(Signs, tmp_path / "Signs.fmu"), tmp_path / "unpacked") as session:
        slave, instance = session.instance("signs", running=False), Instance(Signs())
        for a, b in product((0.0, -0.0, 1.0, -1.0, 2.5), repeat=2):
            session.set(slave, a=a, b=b)
            instance["a"], instance["b"] = a, b
            actual = session.get(slave, *(f"y[{i + 1}]" for i in range(len(INTEGERS))))
            pairs = zip(INTEGERS, actual, instance["y"], strict=True)
            wrong = [n for n, c, python in pairs if struct.pack("d", c) != struct.pack("d", python)]
            assert wrong == [], (a, b)
