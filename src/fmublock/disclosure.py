"""What an FMU for other companies contains and lets its user see and set."""

import copy
import difflib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from fnmatch import fnmatchcase
from typing import Any

from .block import Block
from .errors import DisclosureError
from .instance import BlockError, Instance
from .variables import Access, Input, Output, Parameter, ScalarVariable, Variable

_TRUTH = {"true": True, "1": True, "false": False, "0": False}


@dataclass(frozen=True)
class Disclosure:
    """What an FMU discloses of its block: its sources, and parameters.

    Args:
        sources: include the C sources, and equations in the documentation.
        values: start values by parameter name, elements of arrays as `x[1]`; texts or numbers.
        fixed: names or patterns of parameters that can be seen but not set.
        hidden: names or patterns of parameters that can neither be seen nor set. They also leave out the
            sources, which contain the values.
    """

    sources: bool = True
    values: Mapping[str, Any] = field(default_factory=dict)
    fixed: Sequence[str] = ()
    hidden: Sequence[str] = ()

    @property
    def has_sources(self) -> bool:
        """Whether the FMU contains its sources."""
        return self.sources and not self.hidden

    def restrict(self, block: Block) -> Block:
        """Return the block with these values, and with its fixed and hidden parameters marked.

        Raises:
            DisclosureError: A name or a value is wrong, or no instance of the block could start.
        """
        if not (self.values or self.fixed or self.hidden):
            return block
        parameters = block.layout().parameters
        changed = _set_values(block, self.values)
        for patterns, access in ((self.fixed, Access.FIXED), (self.hidden, Access.HIDDEN)):
            for variable in _select(block, patterns, access):
                changed.setdefault(variable, copy.copy(variable)).access = access
        restricted = _redeclare(block, {p: changed[p] for p in parameters if p in changed})
        _check_start(block, restricted)
        return restricted


def _redeclare(block: Block, changed: Mapping[Parameter, Parameter]) -> Block:
    """Return a block of a subclass with other parameters, which states and limits refer to as well."""
    owner, layout = type(block), block.layout()
    declared: dict[str, Variable] = {p.attribute: p for p in changed.values()}
    for variable in (*layout.states, *layout.discrete_states, *layout.outputs):
        if {variable.start_parameter, *(variable.limit_parameters or ())} & changed.keys():
            declared[variable.attribute] = copied = copy.copy(variable)
            copied.start = changed.get(copied.start, copied.start) if copied.start_parameter else copied.start
            if copied.limit_parameters is not None:
                low, high = copied.limit_parameters
                copied.limits = changed.get(low, low), changed.get(high, high)
    texts = {"__module__": owner.__module__, "__qualname__": owner.__qualname__, "__doc__": owner.__doc__}
    restricted = type(owner.__name__, (owner,), {**texts, **declared})
    restricted.origin, restricted.is_restricted = owner.origin, True
    # without __init__, whose arguments are unknown here
    instance = object.__new__(restricted)
    vars(instance).update(vars(block))
    return instance


def _set_values(block: Block, values: Mapping[str, Any]) -> dict[Parameter, Parameter]:
    """Return copies of the parameters that get other start values, by the original."""
    layout, changed = block.layout(), dict[Parameter, Parameter]()
    for name, value in values.items():
        try:
            scalar = layout.scalars[layout.reference(name)]
        except KeyError:
            elements = [s.name for s in layout.scalars if s.variable.name == name]
            if elements:
                raise DisclosureError(
                    f"{name} is an array; set its elements, such as {elements[0]}."
                ) from None
            raise _unknown_parameter_error(block, name) from None
        if not isinstance(scalar.variable, Parameter):
            raise DisclosureError(
                f"{name} is {_describe_kind(scalar.variable)}; only parameters get values here."
            )
        copied = changed.setdefault(scalar.variable, copy.copy(scalar.variable))
        number = _convert(scalar, value)
        low, high = copied.range
        if not low <= number <= high:
            raise DisclosureError(f"{name} = {value} is outside its range, {low:.9g} to {high:.9g}.")
        copied.start = _replace_element(copied, scalar, number)
    return changed


def _replace_element(variable: Variable, scalar: ScalarVariable, value: Any) -> Any:
    if not scalar.index:
        return value
    likes: dict[str, Callable[[float], Any]] = {"Real": float, "Boolean": bool}
    convert = likes.get(variable.fmi_type, int)
    return variable.nested(
        [value if s.index == scalar.index else convert(s.start) for s in variable.scalars()]
    )


def _convert(scalar: ScalarVariable, value: Any) -> Any:
    """Convert a value, maybe from a text, to the type of the variable."""
    variable, text = scalar.variable, str(value).strip()
    try:
        if variable.enumeration is not None:
            members = {m.name.lower(): m for m in variable.enumeration}
            member = value if isinstance(value, IntEnum) else members.get(text.lower())
            return variable.enumeration(int(text)) if member is None else variable.enumeration(member)
        if variable.fmi_type == "Boolean":
            return _TRUTH[text.lower()]
        number = float(text) if variable.fmi_type == "Real" else int(text)
        Variable(number)  # refuses infinity and NaN
    except (KeyError, ValueError, TypeError):
        raise DisclosureError(f"{scalar.name} = {value} is not {_describe_type(variable)}.") from None
    return number


def _describe_type(variable: Variable) -> str:
    if variable.enumeration is not None:
        return f"one of {', '.join(m.name.lower() for m in variable.enumeration)}"
    descriptions = {"Real": "a finite number", "Integer": "a whole number"}
    return descriptions.get(variable.fmi_type, "true or false")


def _select(block: Block, patterns: Sequence[str], access: Access) -> list[Parameter]:
    """Return the parameters that the patterns match, arrays as a whole."""
    layout = block.layout()
    selected: list[Parameter] = []
    for pattern in patterns:
        matches = [p for p in layout.parameters if fnmatchcase(str(p.name), pattern)]
        selected += matches
        if matches:
            continue
        scalar = next((s for s in layout.scalars if pattern in (s.name, s.variable.name)), None)
        if scalar is None:
            raise _unknown_parameter_error(block, pattern)
        if isinstance(scalar.variable, Parameter):
            raise DisclosureError(
                f"{pattern} is one element of an array, which can be {access.word} as a whole only; "
                f"write {scalar.variable.name}."
            )
        raise DisclosureError(
            f"{pattern} is {_describe_kind(scalar.variable)}; only parameters can be {access.word}."
        )
    return selected


def _describe_kind(variable: Variable) -> str:
    if isinstance(variable, Input):
        return "an input"
    return "an output" if isinstance(variable, Output) else "a state"


def _unknown_parameter_error(block: Block, name: str) -> DisclosureError:
    names = [str(p.name) for p in block.layout().parameters]
    near = difflib.get_close_matches(name, names, 1)
    hint = f"did you mean {near[0]}?" if near else f"the block has {', '.join(names) or 'none'}."
    return DisclosureError(f"there is no parameter {name}; {hint}")


def _check_start(block: Block, restricted: Block) -> None:
    """Raise DisclosureError if the block with its new values cannot start, but could before."""
    refusal = _find_refusal(restricted)
    # some blocks need values from the host before they start; only new problems count
    if refusal is not None and _find_refusal(block) is None:
        raise DisclosureError(f"no instance of this FMU could start: {refusal}")


def _find_refusal(block: Block) -> str | None:
    try:
        instance = Instance(block)
        instance.enter_initialization()
        instance.exit_initialization()
    except BlockError as error:
        return str(error)
    return None
