"""The Modelica package in modelica/EMLA, compiled and simulated by rumoca, beside our blocks."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import rumoca
from numpy.typing import NDArray

from emla_cosim.fmu.models import MODELS
from emla_cosim.system.model import System
from fmublock.variables import Input, ScalarVariable, State, Variable

PACKAGE = Path(__file__).parents[2] / "modelica" / "EMLA"
MISSING = {
    *("FocController", "CacController", "AnatcController", "SignalFault"),
    *("EmlaCompliantPlant", "LoadObserver", "ScrewCommand", "EmlaAxis", "EmlaCompliantAxis"),
    *("HoldingBrake", "SharedSupply"),
}
"""FMUs alone: controllers that RSBA is compared with, faults, other loads, brakes, and a shared supply."""
CLASSES = {model: model.removeprefix("Emla") for model in MODELS if model not in MISSING}
"""Name of the class in the package by our model."""

RENAMED = {"model": "known", **{name: f"{name}_terms" for name in ("d_2", "d_3", "d_4")}}
"""Groups of parameters whose FMI name is a keyword of Modelica, or the name of an output as well."""

VARIABLES_IN_GROUPS = {
    "d_2.random": "random",
    "supply.sag": "sag",
    "motor.temperature_rise": "temperature_rise",
    "motor.load": "motor_load",
    "payload.m": "payload_m",
}
"""Variables that change, and stand in a group of parameters by their FMI name."""

SAMPLED = ("delay", "u_q_late", "u_d_late", "u_q_line", "u_d_line", "u_measured")
"""What the inverter has because it is sampled: a computing delay, and the last value of the supply."""

SCALARS = {model: {s.name: s for s in block.layout().scalars} for model, block in MODELS.items()}
"""Every variable of our models by FMI name."""

Array = NDArray[np.floating[Any]]


LACKING = (
    *("motor.alpha_R", "motor.cogging.amplitude", "motor.cogging.periods"),
    *("screw.lead_error", "screw.wobble", "sensor.eccentricity"),
)
"""Parameters of effects that the package does not have; they are off by default."""


def name_in(model: str, fmi_name: str) -> str | None:
    """Name in the package of a variable of one of our models; None if there is none."""
    if fmi_name == "d_2.sample":  # counts what the clock of sample() counts
        return None
    if fmi_name == "solver.internal_step" and model != "RsbaController":  # tools have their own solvers
        return None
    if fmi_name == "interpolate" or fmi_name.startswith("before."):  # continuous inputs need no last values
        return None
    if fmi_name in LACKING:
        return None
    if fmi_name in VARIABLES_IN_GROUPS:
        return VARIABLES_IN_GROUPS[fmi_name]
    if fmi_name.startswith("inverter.") and fmi_name.removeprefix("inverter.").startswith(SAMPLED):
        return None  # everything acts at once there
    group, dot, rest = fmi_name.partition(".")
    return RENAMED.get(group, group) + dot + rest if dot else fmi_name


def compiled(source: str, model: str) -> rumoca.Model:
    """A model of this text, which may use the package."""
    return rumoca.Session(roots=[str(PACKAGE)]).loads(source, model=model)


def simulated(model: rumoca.Model, times: Array, tolerance: float = 1e-10) -> dict[str, Array]:
    """All variables at evenly spaced times from 0 on, after the events of those times."""
    config = rumoca.SimConfig(solver="rk-like", rtol=tolerance, atol=1e-8 * tolerance)
    result = model.simulate(t=(0.0, float(times[-1])), dt=float(times[1]), config=config)
    rows = np.searchsorted(result.time, times + 1e-3 * times[1], side="right") - 1
    assert np.allclose(np.asarray(result.time)[rows], times, rtol=0.0, atol=1e-6 * times[1])
    return {name: np.asarray(result[name])[rows] for name in result.names}


def driven(model: str, values: Mapping[str, Any], inputs: Mapping[str, str]) -> str:
    """One of our models as `c` with these start values and inputs: declaration and equations.

    Inputs are expressions of `time` by name; those not given are 0.
    """
    names = [s.name for s in SCALARS[model].values() if isinstance(s.variable, Input)]
    lines = [f"  c.{name_in(model, name)} = {inputs.get(name, '0.0')};" for name in names]
    return "\n".join([f"  EMLA.{CLASSES[model]} c({modifications(model, values)});", "equation", *lines])


def evaluated(content: str, expressions: Sequence[str]) -> list[float]:
    """Values at the start of expressions in a model with this content: declarations, then equations."""
    lines = [f"  Real v{i} = {expression};" for i, expression in enumerate(expressions)]
    source = "\n".join(["model Evaluated", *lines, content, "end Evaluated;"])
    values = simulated(compiled(source, "Evaluated"), np.array([0.0, 1e-9]), 1e-6)
    return [float(values[f"v{i}"][0]) for i in range(len(expressions))]


def as_real(scalar: ScalarVariable, name: str) -> str:
    """The expression that gives a variable of this Modelica name as a Real."""
    kind = scalar.variable.fmi_type
    if kind == "Boolean":
        return f"if {name} then 1.0 else 0.0"
    return f"Integer({name})" if kind == "Enumeration" else name


def modifications(model: str, values: Mapping[str, Any]) -> str:
    """Start values by FMI name as the modification of a component: "motor(R_s = 0.2), i_q(start = 1.0)".

    Of an array, all elements have to be given.
    """
    literals: dict[str, list[str]] = {}
    for fmi_name, value in values.items():
        scalar = SCALARS[model][fmi_name]
        name = name_in(model, fmi_name)
        if name is None:
            continue
        name = name.rpartition("[")[0] if scalar.index else name
        name += ".start" if isinstance(scalar.variable, State) else ""
        literals.setdefault(name, []).append(_literal(scalar.variable, value))
    return _modified({name: _array(elements) for name, elements in literals.items()})


def joint_source(joint: str, system: System) -> str:
    """A declared `EMLA.Joint` with all parameters of that joint of the system."""
    components = [c for c in system.components if c.name.startswith(f"{joint}.")]
    inside = (f"{c.name.split('.')[1]}({modifications(c.model, c.parameters)})" for c in components)
    return f"  EMLA.Joint {joint}({', '.join(inside)});"


def declared(model: str) -> Iterator[tuple[ScalarVariable, str]]:
    """Every variable of one of our models that the package has, once per array, and its name there.

    But for P: one array there, four variables here.
    """
    for scalar in SCALARS[model].values():
        name = name_in(model, scalar.name)
        if name is not None and not any(scalar.index) and not name.startswith("P["):
            yield scalar, name.rpartition("[")[0] if scalar.index else name


def _modified(values: Mapping[str, str]) -> str:
    """Values by dotted name as a modification, group by group, as deep as names go."""
    groups: dict[str, dict[str, str]] = {}
    for name, value in values.items():
        group, _, rest = name.partition(".")
        groups.setdefault(group, {})[rest] = value
    texts = (
        f"{group} = {inside['']}" if "" in inside else f"{group}({_modified(inside)})"
        for group, inside in groups.items()
    )
    return ", ".join(texts)


def _array(values: list[str]) -> str:
    return values[0] if len(values) == 1 else f"{{{', '.join(values)}}}"


def _literal(variable: Variable, value: Any) -> str:
    return str(bool(value)).lower() if variable.fmi_type == "Boolean" else repr(value)
