"""Gains of controllers and observers, as tables of a joint file: all values, or a rule and its arguments."""

import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Annotated, Any, ClassVar, Literal, get_args, get_origin, get_type_hints

import msgspec

from emla_fmu import observer_gains
from emla_fmu.observer_gains import ObserverGains

from ...base.toml_structs import describe, extend_struct, one_of, quantity
from ..controllers import CONTROLLERS

OBSERVER_RULES: Mapping[str, Callable[..., ObserverGains]] = {
    "published": observer_gains.published,
    "robust": observer_gains.robust,
    "compensated": observer_gains.compensated,
    "damped": observer_gains.damped,
}
"""Rules that compute the gains of an observer."""


@dataclass(frozen=True)
class ObserverSet:
    """Gains of an observer; `estimate` is its initial position in m, if not that of the screw."""

    gains: ObserverGains
    estimate: float | None = None


@dataclass(frozen=True)
class GainSet:
    """A set of gains of a controller, with its observer.

    `on_machine` are the gains of a joint that moves a whole machine.
    """

    controller: Any
    observer: ObserverSet
    on_machine: Any


class GainTable(msgspec.Struct, frozen=True, kw_only=True):
    """A table with the arguments of a function that returns gains, and further entries."""

    function: ClassVar[Callable[..., Any]]
    arguments: ClassVar[Sequence[str]]

    def __post_init__(self) -> None:
        """Compute the gains, so that arguments that cannot be used are reported with the table."""
        self.gains()

    def gains(self) -> Any:
        """Return the gains."""
        return self.function(**{name: getattr(self, name) for name in self.arguments})


def build_gain_tables(
    name: str,
    values: Callable[..., Any],
    rules: Mapping[str, Callable[..., Any]],
    further: Sequence[tuple[str, Any] | tuple[str, Any, Any]] = (),
) -> Mapping[str | None, type[GainTable]]:
    """Return the structs of a table of gains, by its rule.

    Args:
        name: The beginning of the names of the structs.
        values: The class of the gains, for a table without a rule.
        rules: Functions that return gains, by rule.
        further: Further fields of the table.
    """
    tables: dict[str | None, type[GainTable]] = {None: _build_table(f"{name} gains", values, further)}
    for rule, function in rules.items():
        tag = ("rule", Annotated[Literal[rule], describe("rule for the gains")])  # type: ignore[valid-type]
        tables[rule] = _build_table(f"{name} gains by {rule}", function, [tag, *further])
    return tables


def _build_table(name: str, function: Callable[..., Any], further: Sequence[Any]) -> type[GainTable]:
    """Return the struct of a function: its arguments, and further fields."""
    hints = get_type_hints(function)
    fields = list[Any]()
    for argument_name, argument in inspect.signature(function).parameters.items():
        default = () if argument.default is argument.empty else (argument.default,)
        fields.append((argument_name, _get_file_type(hints[argument_name]), *default))
    about = " ".join((inspect.getdoc(function) or "").partition("\n")[0].split())
    table = extend_struct(GainTable, name.replace(" ", "_"), [*fields, *further], about)
    # a plain function would become a method of the struct
    table.function, table.arguments = staticmethod(function), [field[0] for field in fields]
    return table


def _get_file_type(hint: Any) -> Any:
    """Return the type of an argument in a file, where numbers can be texts."""
    if get_origin(hint) is tuple:
        return tuple[tuple(_get_file_type(part) for part in get_args(hint))]
    return Annotated[float, quantity("")] if hint is float else hint


@cache
def build_observer_table() -> Any:
    """Return the type of a table with gains of an observer."""
    estimate = Annotated[float, quantity("m", "initial position of the observer", 0.36)]
    tables = build_gain_tables("observer", ObserverGains, OBSERVER_RULES, [("estimate", estimate, None)])
    return Annotated[Any, one_of("rule", tables, "gains of an observer")]


def build_controllers_struct() -> type[msgspec.Struct]:
    """Return the struct of the table with the sets of gains of each controller."""
    observer = Annotated[str | build_observer_table(), describe("set [observer.NAME], or a table", "robust")]  # type: ignore[valid-type]
    fields = list[Any]()
    for name, controller in CONTROLLERS.items():
        if controller.gain_type is None:
            continue
        machine = build_gain_tables(f"{name} machine", controller.gain_type, controller.rules)
        further = [
            ("observer", observer),
            ("on_machine", Annotated[Any, one_of("rule", machine, "gains on a whole machine")], None),
        ]
        tables = build_gain_tables(name, controller.gain_type, controller.rules, further)
        set_ = Annotated[Any, one_of("rule", tables, "a set of gains")]
        sets = [(key, set_, msgspec.UNSET) for key in controller.gains]
        fields.append((name, extend_struct(msgspec.Struct, f"{name}_sets", sets), msgspec.UNSET))
    return extend_struct(msgspec.Struct, "controllers", fields)
