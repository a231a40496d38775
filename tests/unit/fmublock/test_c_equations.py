"""The C that is written for equations: the same bits as CasADi's own evaluation, and nothing too often."""

import ctypes
import math
import random
import re
import subprocess
from collections.abc import Sequence
from operator import add, mul, neg, sub, truediv
from pathlib import Path
from typing import Any

import casadi
import numpy as np
import pytest

from emla_fmu import EmlaPlant
from fmublock import Block, DiscreteState, Input, Output, Parameter, State, cos, exp, sin, where
from fmublock.c_equations import CEquations, c_equations
from fmublock.errors import BuildError
from fmublock.graph import Rank
from fmublock.symbolic import SymbolicBlock, evaluate_symbolically
from tests.support.in_process import started
from tests.support.sessions import Session
from tests.support.tiers import mostly_slow

VALUES = 6
RANKS = [Rank.STEPWISE, Rank.FIXED, Rank.FIXED, Rank.MOVING, Rank.MOVING, Rank.STEPWISE]
DISCRETE = [5]
SEEDS = range(30)


# ---- random equations --------------------------------------------------------------------------

UNARY = (
    *(neg, casadi.fabs, casadi.sign, casadi.floor, casadi.sqrt),
    *(casadi.sin, casadi.exp, casadi.log, casadi.tanh),
    lambda x: 2.0 * x,
    lambda x: 1.0 / x,
    lambda x: casadi.SX.unary(casadi.OP_SQ, x),
    lambda x: casadi.cos(casadi.sin(x)),
)
BINARY = (add, sub, mul, truediv, casadi.fmin, casadi.fmax, casadi.fmod, casadi.atan2)


def expression(chance: random.Random, leaves: Sequence[casadi.SX], size: int) -> list[casadi.SX]:
    """So many values, each of some before."""
    existing = list(leaves)

    def any_of() -> casadi.SX:
        return chance.choice(existing)

    def condition() -> casadi.SX:
        kind = chance.randrange(4)
        first = any_of() < any_of()
        if kind == 0:
            return casadi.logic_and(first, any_of() <= any_of())
        if kind == 1:
            return casadi.logic_or(first, casadi.logic_not(any_of() == any_of()))
        return first

    makers = [
        *(lambda f=f: f(any_of()) for f in UNARY),
        *(lambda f=f: f(any_of(), any_of()) for f in BINARY),
        *[lambda: casadi.if_else(condition(), casadi.sin(any_of() / any_of()), any_of())] * 5,
        *[lambda: casadi.if_else(condition(), any_of(), casadi.exp(any_of()) + any_of())] * 5,
    ]
    for _ in range(size):
        existing.append(chance.choice(makers)())
    return existing[len(leaves) :]


def random_block(seed: int) -> SymbolicBlock:
    chance = random.Random(seed)
    time, values = casadi.SX.sym("time"), casadi.SX.sym("v", VALUES)
    constants = [casadi.SX(c) for c in (0.0, -0.0, -1.5, 3.0, math.inf)]
    expressions = expression(chance, [time, *casadi.vertsplit(values), *constants], 60)

    def function(name: str, count: int) -> casadi.Function:
        results = casadi.vertcat(*(chance.choice(expressions[-20:]) for _ in range(count)))
        return casadi.Function(name, [time, values], [results])

    return SymbolicBlock(
        function("derivatives", 3),
        function("update", len(DISCRETE)),
        function("outputs", 4),
        function("conditions", 0),
        (),
    )


EXPORTS = """
void all_values(double time, const double *v, double *k, double *next, double *result) {
    double fixed[N_FIXED + 1], stepwise[N_STEPWISE + 1];
    fixed_values(v, fixed);
    stepwise_values(v, fixed, stepwise);
    derivatives(time, v, fixed, stepwise, k);
    update_and_outputs(time, v, fixed, next, result);
}
"""


def compiled(text: str, folder: Path) -> Any:
    """The C function that computes everything, as the machine's own compiler has it."""
    source, library = folder / "equations.c", folder / "equations.so"
    source.write_text(f"#include <math.h>\n{text}\n{EXPORTS}")
    flags = ["-std=c99", "-O2", "-ffp-contract=off", "-fPIC", "-shared", "-Wall", "-Wno-unused-function"]
    process = subprocess.run(
        ["cc", *flags, str(source), "-o", str(library), "-lm"], capture_output=True, text=True, check=False
    )
    assert (process.returncode, process.stderr) == (0, "")
    function = ctypes.CDLL(str(library)).all_values
    function.argtypes = [ctypes.c_double, *[np.ctypeslib.ndpointer(np.float64)] * 4]
    return function


def same_bits(expressions: np.ndarray, expected: np.ndarray) -> bool:
    """Any NaN is as good as another, and of two zeros of a minimum either."""
    return np.array_equal(expressions, expected, equal_nan=True)


@pytest.mark.parametrize("seed", mostly_slow(SEEDS, range(8)))
def test_random_equations_have_the_bits_of_casadi(seed: int, tmp_path: Path) -> None:
    simplify = casadi.GlobalOptions.getSimplificationOnTheFly()
    casadi.GlobalOptions.setSimplificationOnTheFly(False)
    try:
        symbolic = random_block(seed)
        function = compiled(CEquations(symbolic, RANKS, DISCRETE).text(), tmp_path)
    finally:
        casadi.GlobalOptions.setSimplificationOnTheFly(simplify)
    points = np.random.default_rng(seed)
    for _ in range(50):
        time, v = points.normal(), points.normal(size=VALUES)
        v[points.integers(VALUES)] = points.choice([0.0, 1.0, -1.0, 1e300])
        k, following, result = np.empty(3), np.empty(1), np.empty(4)
        function(time, v, k, following, result)
        assert same_bits(k, np.array(symbolic.derivatives(time, v)).ravel())
        assert same_bits(following, np.array(symbolic.update(time, v)).ravel())
        v[DISCRETE] = following
        assert same_bits(result, np.array(symbolic.outputs(time, v)).ravel())


# ---- what is computed when ---------------------------------------------------------------------


class Mixed(Block):
    """Terms of every rank, twice, and one that only a parameter lets be."""

    u = Input(0.5)
    p = Parameter(2.0)
    wave = Parameter(0.0)
    x = State(1.0)
    n = DiscreteState(0.0)
    y = Output()
    z = Output()

    def derivatives(self, v: Any) -> dict[str, Any]:
        return {"x": sin(v.p) * exp(v.u) - cos(v.x)}

    def update(self, v: Any) -> dict[str, Any]:
        return {"n": v.n + cos(v.x)}

    def outputs(self, v: Any) -> dict[str, Any]:
        ripple = v.wave * sin(3.0 * v.time) / cos(2.0 * v.time)
        return {"y": sin(v.p) + cos(v.x) + v.n, "z": cos(v.x) + where(v.wave > 0.0, ripple, 0.0)}


@pytest.fixture(scope="module")
def body() -> dict[str, str]:
    """The bodies of the C functions of that block by name."""
    text = c_equations(Mixed(), evaluate_symbolically(Mixed())).text()
    return dict(re.findall(r"static void (\w+)\(.*?\) \{\n(.*?)\n\}", text, re.DOTALL))


def test_values_are_computed_where_they_can_change(body: dict[str, str]) -> None:
    assert "sin(" in body["fixed_values"] and "exp(" not in body["fixed_values"]
    assert "exp(" in body["stepwise_values"] and "sin(" not in body["stepwise_values"]
    assert body["derivatives"].count("cos(") == 1
    assert not re.search(r"sin\(|exp\(", body["derivatives"])


def test_update_and_outputs_share_common_terms(body: dict[str, str]) -> None:
    assert len(re.findall(r"cos\(v\[", body["update_and_outputs"])) == 1  # of the state, for n, y and z


def test_terms_of_a_rejected_choice_are_behind_a_branch(body: dict[str, str]) -> None:
    function_text = body["update_and_outputs"]
    (inside,) = re.findall(r"if \(fixed\[\d+\] != 0\.0\) \{\n(.*?)\n    \}", function_text, re.DOTALL)
    assert "sin(" in inside and "/" in inside
    outside = function_text.replace(inside, "")
    assert "sin(" not in outside and "/" not in outside


def test_unsupported_operations_of_casadi_are_refused() -> None:
    time, v = casadi.SX.sym("time"), casadi.SX.sym("v", VALUES)
    odd = casadi.Function("outputs", [time, v], [casadi.erf(v[3])])
    nothing = [
        casadi.Function(n, [time, v], [casadi.SX(0, 1)]) for n in ("derivatives", "update", "conditions")
    ]
    symbolic = SymbolicBlock(nothing[0], nothing[1], odd, nothing[2], ())
    with pytest.raises(BuildError, match=r"the operation \d+ of CasADi has no meaning in C"):
        CEquations(symbolic, RANKS, []).text()


# ---- what parameters decide, in an FMU ---------------------------------------------------------


def test_terms_of_parameters_follow_them(sessions: dict[str, Session]) -> None:
    """Set twice while outputs are looked at, and brought along by a state from another instance."""
    session, names = sessions["EmlaPlant"], ("a_L", "tau_m", "x_L")

    def stepped(parameters: dict[str, float], state: bytes | None = None) -> tuple[list[float], bytes]:
        slave = session.instance(running=False)
        for name, value in parameters.items():
            session.get(slave, *names)
            session.set(slave, **{name: value})
        slave.exitInitializationMode()
        if state is not None:
            slave.setFMUstate(slave.deSerializeFMUstate(state))
        before = slave.serializeFMUstate(slave.getFMUstate())
        slave.doStep(0.0, 1e-3)
        return session.get(slave, *names), before

    values_ = {"motor.J_m": 2e-3, "gearbox.eta_GB": 0.8, "start.x_L": 0.3, "F_L": 1e3}
    heavy, state = stepped(values_)
    instance = started(EmlaPlant, values_)
    instance.do_step(0.0, 1e-3)
    assert heavy == [instance[name] for name in names]
    assert stepped({}, state)[0] == heavy != stepped({})[0]
