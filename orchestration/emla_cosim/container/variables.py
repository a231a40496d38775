"""The variables of the FMU of a system."""

import re
from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import Any

from fmpy.model_description import ModelVariable

from ..base.errors import CommandError
from ..base.wording import select_names
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


def find_letter(variable: ModelVariable) -> str:
    """Return the type of a variable of a part as a letter in C; see shim/part_types.h."""
    if isinstance(variable, ElementVariable):
        return _LETTERS_3[variable.data_type]
    return LETTERS[str(variable.type)]


_HIDDEN = ("independent", "structuralParameter")
"""Causalities of variables that the FMU does not have: the sizes of its arrays are fixed."""


@dataclass(frozen=True)
class ContainerVariable:
    """A variable of the FMU, and the variable of the part that it represents.

    Attributes:
        name: its name in the system.
        part: position of the component.
        part_variable: the variable of the component's FMU.
        causality: input, output, parameter, calculatedParameter or local.
        start: its start value, None if it has none.
        is_overridden: whether the start value differs from that of the FMU.
        signal: position among the signals; -1 without one.
    """

    name: str
    part: int
    origin: ModelVariable
    causality: str
    start: Any
    is_overridden: bool
    signal: int

    def letter(self, fmi: int) -> str:
        """Return its type in C for a host of this version of FMI."""
        if fmi == 2:
            return LETTERS[str(self.origin.type)]
        return "E" if self.origin.type == "Enumeration" else find_letter(self.origin)

    @property
    def size(self) -> int:
        """Return the number of elements of its array; 1 for a scalar."""
        return self.origin.size if isinstance(self.origin, ElementVariable) else 1

    @property
    def variability(self) -> str:
        """Return its variability; that of an input that became a parameter is `tunable`."""
        if self.causality == "parameter" and self.origin.causality == "input":
            return "tunable"
        return str(self.origin.variability)

    @property
    def initial(self) -> str | None:
        """Return how it is initialized."""
        if self.causality == "input":
            return None
        return "exact" if self.causality == "parameter" else self.origin.initial or "calculated"

    @property
    def is_settable(self) -> bool:
        """Return whether a host may set it."""
        if self.variability == "constant":
            return False
        return self.causality in ("input", "parameter") or self.initial in ("exact", "approx")


def list_variables(
    plan: ContainerPlan, inputs: Collection[str], outputs: Collection[str], defaults: Sequence[str]
) -> list[ContainerVariable]:
    """Return all variables, in the order of the components.

    Args:
        plan: The system.
        inputs: Names or patterns of the inputs, among those that nothing drives. Default: all of these.
        outputs: Names or patterns of the outputs, among those of the components.
        defaults: The outputs without `outputs`. Default: all.

    Raises:
        CommandError: A name or pattern matches nothing, or two variables have one name.
    """
    variables = list[ContainerVariable]()
    names = plan.network.names
    for p, part in enumerate(plan.parts):
        driven = {v.name for v in part.instance.read}
        first = plan.network.parts[p].start
        signal_of = {v.name: first + k for k, v in enumerate(part.instance.written)}
        values = {v.name: value for v, value in part.starts}
        for origin in part.instance.file.variables.values():
            if origin.name in driven or origin.causality in _HIDDEN or origin.type not in LETTERS:
                continue
            signal = signal_of.get(origin.name, -1)
            system_name = plan.system_names[part.name].get(origin.name, origin.name)
            name = names[signal] if signal >= 0 else _make_full_name(part.name, system_name)
            # a start value of the system replaces that of the FMU
            start = values.get(origin.name, origin.start)
            variables.append(
                ContainerVariable(
                    name, p, origin, str(origin.causality), start, origin.name in values, signal
                )
            )
    duplicates = [name for name, count in Counter(v.name for v in variables).items() if count > 1]
    if duplicates:
        raise CommandError(
            f"two variables have the name '{duplicates[0]}'; rename a component.", name=duplicates[0]
        )
    open_inputs = [v.name for v in variables if v.causality == "input"]
    all_outputs = [v.name for v in variables if v.causality == "output"]
    selected = {*_select("input", inputs, open_inputs), *_select("output", outputs or defaults, all_outputs)}
    return [_hide_if_unselected(v, selected) for v in variables]


def choose_time_name(variables: Sequence[ContainerVariable]) -> str:
    """Return a name for the time, which is a variable in FMI 3.0, that no other variable has."""
    names, name = {v.name for v in variables}, "time"
    while name in names:
        name += "_"
    return name


def _make_full_name(part: str, name: str) -> str:
    """Return the name of a variable in the container; the derivative of a.x[1] is der(a.x[1])."""
    inner = re.fullmatch(r"der\((.*)\)(\[[\d,]+\])?", name)
    return f"{part}.{name}" if inner is None else f"der({part}.{inner[1]}{inner[2] or ''})"


def _hide_if_unselected(variable: ContainerVariable, selected: Collection[str]) -> ContainerVariable:
    """Return the variable; an output that is not selected becomes local, such an input a parameter."""
    if variable.causality not in ("input", "output") or variable.name in selected:
        return variable
    # a host can still set the input, as a tunable parameter
    causality = "local" if variable.causality == "output" else "parameter"
    return replace(variable, causality=causality)


def _select(kind: str, patterns: Collection[str], names: Sequence[str]) -> list[str]:
    hint = "see `emla info` for the outputs."
    if kind == "input":
        hint = f"nothing drives {', '.join(names)}." if names else "every input is connected."
    selected = select_names(patterns, names, kind, hint=hint)
    return [name for name in names if not patterns or name in selected]
