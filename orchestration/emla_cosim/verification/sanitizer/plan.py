"""Write plan.h, the data of an FMU that the host in C is compiled with."""

import math
from collections.abc import Iterable, Sequence
from typing import Any

from fmpy.model_description import ModelVariable

from ...fmu.instance import kind_of
from ..host.experiment import span
from ..host.fresh_process import is_single_instance
from ..host.other_values import settable, start_of
from ..subject import Subject

_STEPS = 20
_ACCESS = {"Real": "fmi2Real", "Integer": "fmi2Integer", "Boolean": "fmi2Boolean", "String": "fmi2String"}
_PART_OF_STEP = 0.01
"""Step of Model Exchange relative to the communication step: the host integrates by Euler's rule."""


def write_plan(subject: Subject, kind: str) -> str:
    """Return the text of plan.h for a kind of an FMU."""
    start, step, _ = span(subject)
    description = subject.description
    model = kind == "ModelExchange"
    continuous = [v for v in settable(subject, "input") if kind_of(v) == "Real"]
    outputs = [v for v in description.modelVariables if v.causality == "output" and v.type == "Real"]
    defined: dict[str, Any] = {
        "IS_MODEL": int(model),
        "PREFIX": _quote(f"{subject.find_kind_element(kind).modelIdentifier}_"),
        "GUID": _quote(str(description.guid)),
        "RESOURCES": _quote((subject.folder / "resources").as_uri()),
        "START_TIME": _real(start),
        "STEP": _real(step * _PART_OF_STEP if model else step),
        "STEPS": min(_STEPS, subject.most_steps),
        "INSTANCES": 1 if is_single_instance(subject) else 2,
        "STATES": len(description.derivatives) if model else 0,
        "INDICATORS": int(description.numberOfEventIndicators or 0) if model else 0,
        "HAS_STATES": int(subject.has_capability("canGetAndSetFMUstate", kind)),
        "SERIALIZES": int(subject.has_capability("canSerializeFMUstate", kind)),
        "PROVIDES_DERIVATIVES": int(
            bool(continuous) and subject.has_capability("providesDirectionalDerivative", kind)
        ),
        "UNKNOWNS": len(outputs),
    }
    lines = [f"#define {name} {value}" for name, value in defined.items()]
    lines.append(_array("fmi2ValueReference", "UNKNOWN", [v.valueReference for v in outputs]))
    lines += _group("START", [v for v in _with_start(subject) if v.causality != "input"])
    inputs = [v for v in settable(subject, "input") if start_of(v) is not None]
    if model:  # the others cannot be set in continuous-time mode
        inputs = [v for v in inputs if v.type == "Real" and v.variability in (None, "continuous")]
    lines += _group("INPUT", inputs)
    lines += _group("ALL", description.modelVariables, values=False)
    return "\n".join([*lines, ""])


def _with_start(subject: Subject) -> list[ModelVariable]:
    """Return the variables that can be set before initialization, without aliases."""
    found: dict[tuple[str, int], ModelVariable] = {}
    for v in subject.description.modelVariables:
        allowed = v.variability != "constant" and v.initial in ("exact", "approx")
        if allowed and v.causality != "independent" and start_of(v) is not None:
            found.setdefault((kind_of(v), int(v.valueReference)), v)
    return list(found.values())


def _group(name: str, variables: Iterable[ModelVariable], values: bool = True) -> list[str]:
    """Return the arrays of a group of variables, for each type."""
    lines = []
    for kind, ctype in _ACCESS.items():
        found = [v for v in variables if kind_of(v) == kind]
        lines.append(f"#define {name}_{kind.upper()}S {len(found)}")
        lines.append(
            _array("fmi2ValueReference", f"{name}_{kind.upper()}", [v.valueReference for v in found])
        )
        if values:
            literals = [_literal(start_of(v)) for v in found]
            lines.append(_array(ctype, f"{name}_{kind.upper()}_VALUES", literals))
    return lines


def _array(ctype: str, name: str, values: Sequence[Any]) -> str:
    return f"static const {ctype} {name}[] = {{{', '.join(map(str, values)) or '0'}}};"


def _literal(value: Any) -> str:
    """Return a value of any type in C."""
    if isinstance(value, bool):
        return str(int(value))
    if isinstance(value, float):
        return _real(value)
    return _quote(value) if isinstance(value, str) else str(value)


def _real(value: float) -> str:
    return value.hex() if math.isfinite(value) else "0.0"


def _quote(text: str) -> str:
    """Return a C string literal with all bytes as octal numbers, safe for any text."""
    return '"' + "".join(f"\\{byte:03o}" for byte in text.encode()) + '"'
