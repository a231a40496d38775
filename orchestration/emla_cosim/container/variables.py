"""The variables that the FMU of a system shows."""

import re
from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import Any

from fmpy.model_description import ModelVariable

from ..base.errors import CommandError
from ..base.patterns import select_names
from ..fmu.elements import ElementVariable
from .plan import ContainerPlan

LETTERS = {"Real": "R", "Integer": "I", "Enumeration": "I", "Boolean": "B", "String": "S"}
"""The types of variables of FMI 2.0 as letters in C."""

_LETTERS_3 = {
    "Float64": "R",
    "Float32": "r",
    "Int8": "b",
    "UInt8": "c",
    "Int16": "s",
    "UInt16": "t",
    "Int32": "I",
    "UInt32": "u",
    "Int64": "E",
    "UInt64": "U",
    "Boolean": "B",
    "String": "S",
}
"""Those of FMI 3.0."""


def own_letter(variable: ModelVariable) -> str:
    """Return the type of a variable of a part as a letter in C; see shim/part_types.h."""
    if isinstance(variable, ElementVariable):
        return _LETTERS_3[variable.data_type]
    return LETTERS[str(variable.type)]


_LEFT_OUT = ("independent", "structuralParameter")
"""Causalities of variables that the FMU does not show: the size of arrays does not change in it."""


@dataclass(frozen=True)
class ContainerVariable:
    """A variable of the FMU, and that of the part which it stands for.

    Attributes:
        name: its name in the system.
        part: position of the component.
        own: the variable of the component's FMU.
        causality: input, output, parameter, calculatedParameter or local.
        start: its start value, None if it has none.
        changed: whether the start value is another one than the FMU's own.
        signal: position among the signals; -1 without one.
    """

    name: str
    part: int
    own: ModelVariable
    causality: str
    start: Any
    changed: bool
    signal: int

    def letter(self, fmi: int) -> str:
        """Return its type in C for a host of this version of FMI."""
        if fmi == 2:
            return LETTERS[str(self.own.type)]
        return "E" if self.own.type == "Enumeration" else own_letter(self.own)

    @property
    def size(self) -> int:
        """Return the number of elements of its array; 1 for a scalar."""
        return self.own.size if isinstance(self.own, ElementVariable) else 1

    @property
    def variability(self) -> str:
        """Return its variability; that of an input that became a parameter is `tunable`."""
        if self.causality == "parameter" and self.own.causality == "input":
            return "tunable"
        return str(self.own.variability)

    @property
    def initial(self) -> str | None:
        """Return how it is initialized."""
        if self.causality == "input":
            return None
        return "exact" if self.causality == "parameter" else self.own.initial or "calculated"

    @property
    def settable(self) -> bool:
        """Return whether a host may set it."""
        if self.variability == "constant":
            return False
        return self.causality in ("input", "parameter") or self.initial in ("exact", "approx")


def list_variables(
    plan: ContainerPlan, inputs: Collection[str], outputs: Collection[str], shown: Sequence[str]
) -> list[ContainerVariable]:
    """Return all variables, in the order of the components.

    Args:
        plan: The system.
        inputs: Names or patterns of the inputs, among those that nothing drives. Default: all of these.
        outputs: Names or patterns of the outputs, among those of the components.
        shown: The outputs without `outputs`. Default: all.

    Raises:
        CommandError: A name or pattern matches nothing, or two variables have one name.
    """
    found = list[ContainerVariable]()
    names = plan.network.names
    for p, part in enumerate(plan.parts):
        driven = {v.name for v in part.instance.read}
        first = plan.network.parts[p].start
        signal_of = {v.name: first + k for k, v in enumerate(part.instance.written)}
        values = {v.name: value for v, value in part.starts}
        for own in part.instance.file.variables.values():
            if own.name in driven or own.causality in _LEFT_OUT or own.type not in LETTERS:
                continue
            signal = signal_of.get(own.name, -1)
            own_name = plan.known[part.name].get(own.name, own.name)
            name = names[signal] if signal >= 0 else _full_name(part.name, own_name)
            start = values.get(own.name, own.start)
            found.append(
                ContainerVariable(name, p, own, str(own.causality), start, own.name in values, signal)
            )
    twice = [name for name, count in Counter(v.name for v in found).items() if count > 1]
    if twice:
        raise CommandError(f"two variables have the name '{twice[0]}'; rename a component.", name=twice[0])
    open_inputs = [v.name for v in found if v.causality == "input"]
    all_outputs = [v.name for v in found if v.causality == "output"]
    kept = {*_select("input", inputs, open_inputs), *_select("output", outputs or shown, all_outputs)}
    return [_shown(v, kept) for v in found]


def time_name(variables: Sequence[ContainerVariable]) -> str:
    """Return a name for the time, which is a variable in FMI 3.0, that no other variable has."""
    names, name = {v.name for v in variables}, "time"
    while name in names:
        name += "_"
    return name


def _full_name(part: str, name: str) -> str:
    """Return the name of a variable in the container; the derivative of a.x[1] is der(a.x[1])."""
    inner = re.fullmatch(r"der\((.*)\)(\[[\d,]+\])?", name)
    return f"{part}.{name}" if inner is None else f"der({part}.{inner[1]}{inner[2] or ''})"


def _shown(variable: ContainerVariable, kept: Collection[str]) -> ContainerVariable:
    """Return the variable; an output that is not shown becomes local, such an input a parameter."""
    if variable.causality not in ("input", "output") or variable.name in kept:
        return variable
    causality = "local" if variable.causality == "output" else "parameter"
    return replace(variable, causality=causality)


def _select(kind: str, patterns: Collection[str], names: Sequence[str]) -> list[str]:
    hint = "see `emla info` for the outputs."
    if kind == "input":
        hint = f"nothing drives {', '.join(names)}." if names else "every input is connected."
    selected = select_names(patterns, names, kind, hint=hint)
    return [name for name in names if not patterns or name in selected]
