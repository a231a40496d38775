"""The Modelica package compiles, and declares what our blocks declare, with the same values."""

from collections.abc import Mapping, Sequence

import pytest
import rumoca

from emla_cosim.study.loading import load
from emla_fmu import motion_law
from fmublock.variables import DiscreteState, Parameter, State
from tests.support.modelica_package import (
    CLASSES,
    PACKAGE,
    SCALARS,
    as_real,
    declared,
    driven,
    evaluated,
    name_in,
)

pytestmark = pytest.mark.slow

CONSTANTS = ["NEVER", "pi"]
"""What package.mo declares itself."""

PACKAGES = ["Interfaces", "Functions"]

PARTS = ["Actuator", "Electrics", "Machine"]
"""Data, and what blocks extend."""

# ---- the package's text -------------------------------------------------------------------------


def ordered() -> list[str]:
    return (PACKAGE / "package.order").read_text(encoding="utf-8").split()


def test_package_order_names_every_class() -> None:
    classes = {path.stem for path in PACKAGE.glob("*.mo")} - {"package"}
    assert sorted(ordered()) == sorted([*classes, *CONSTANTS])


@pytest.mark.parametrize("name", [n for n in ordered() if n not in CONSTANTS])
def test_every_file_is_valid_and_formatted(name: str) -> None:
    path = PACKAGE / f"{name}.mo"
    text = path.read_text(encoding="utf-8")
    assert text.startswith("within EMLA;\n")
    assert rumoca.validate(path) == []
    assert rumoca.format(text) == text


@pytest.mark.parametrize("name", [n for n in ordered() if n not in (*CONSTANTS, *PACKAGES, *PARTS)])
def test_every_class_compiles_and_is_balanced(name: str) -> None:
    model = rumoca.Session(roots=[str(PACKAGE)]).load(PACKAGE / f"{name}.mo", model=f"EMLA.{name}")
    structure = model.structure()
    assert structure.is_balanced
    assert structure.is_matched
    assert structure.n_algebraic_loops == 0


def test_functions_of_the_drive_train() -> None:
    """Those that no class uses, too."""
    k_tau, k_L = (2e4, 3e4, 4e4), motion_law.k_L(1e9, 2e9, 3e9, 4e9)
    values = evaluated(
        "  Real alpha = 2199.0;",
        [
            "EMLA.Functions.k_L(1e9, 2e9, 3e9, 4e9)",
            f"EMLA.Functions.C_eq(alpha, 0.125, {{2e4, 3e4, 4e4}}, {k_L!r})",
        ],
    )
    assert values == pytest.approx([k_L, motion_law.C_eq(2199.0, 0.125, k_tau, k_L)], rel=1e-14)


# ---- declarations and values --------------------------------------------------------------------


@pytest.mark.parametrize("model", CLASSES)
def test_declarations_are_those_of_the_fmu(model: str) -> None:
    """Unit, range, nominal value and description of every variable."""
    name = CLASSES[model]
    compiled = rumoca.Session(roots=[str(PACKAGE)]).load(PACKAGE / f"{name}.mo", model=f"EMLA.{name}")
    views = (compiled.inputs, compiled.parameters, compiled.states, compiled.outputs, compiled.algebraics)
    variables = {v.name: v for view in views for v in view}
    for scalar, variable_name in declared(model):
        ours = scalar.variable
        if isinstance(ours, DiscreteState):  # rumoca has no view of them
            continue
        declaration = variables[variable_name]
        assert declaration.unit == ours.unit, scalar.name
        if scalar.name != "solver.internal_step":  # which has only half its meaning there
            assert declaration.description == ours.description, scalar.name
        if ours.enumeration is None:
            assert (declaration.min, declaration.max, declaration.nominal) == (
                ours.minimum,
                ours.maximum,
                ours.nominal,
            ), scalar.name


@pytest.mark.parametrize("model", CLASSES)
def test_defaults_are_those_of_the_fmu(model: str) -> None:
    names = [
        n for n, s in SCALARS[model].items() if isinstance(s.variable, (Parameter, State, DiscreteState))
    ]
    assert values_in(driven(model, {}, {}), {"c": (model, names)}) == {
        f"c.{n}": SCALARS[model][n].start for n in names if name_in(model, n) is not None
    }


def test_study_has_the_values_of_the_scenario() -> None:
    """Every parameter and start value, those that the scenario leaves at their defaults included."""
    system = load("study").system
    expected, names_by_component = {}, {}
    for c in system.components:
        scalars = SCALARS[c.model]
        settable = [
            n
            for n, s in scalars.items()
            if isinstance(s.variable, (Parameter, State)) and s.variable.start_parameter is None
        ]
        names_by_component[f"study.{c.name}"] = (c.model, settable)
        expected |= {
            f"study.{c.name}.{n}": float(c.parameters.get(n, scalars[n].start))
            for n in settable
            if name_in(c.model, n) is not None
        }
    assert values_in("  EMLA.Study study;", names_by_component) == pytest.approx(expected, rel=1e-15, abs=0.0)


def values_in(content: str, names_by_component: Mapping[str, tuple[str, Sequence[str]]]) -> dict[str, float]:
    """Values at the start by component and FMI name, of what the package has."""
    expressions = {}
    for prefix, (model, names) in names_by_component.items():
        for fmi_name in names:
            if (name := name_in(model, fmi_name)) is not None:
                expressions[f"{prefix}.{fmi_name}"] = as_real(SCALARS[model][fmi_name], f"{prefix}.{name}")
    return dict(zip(expressions, evaluated(content, list(expressions.values())), strict=True))
