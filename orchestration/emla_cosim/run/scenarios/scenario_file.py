"""Scenario files: TOML with a system and the options to run it; registries of the built-in ones."""

import dataclasses
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Annotated, Any, Literal, get_args, get_origin

import msgspec

from ...base.errors import CommandError, check_choice
from ...base.option import RUN, FileOrObject, Option
from ...base.table_entries import Location
from ...base.toml_structs import (
    Struct,
    describe,
    extend_struct,
    list_given,
    quantity,
    read_toml,
    type_in_file,
)
from ...base.values import convert_value
from ...system.model import System, Value
from ..options import Options, list_options, read_option


def with_options(table: type[Struct], name: str, command: str) -> type[Struct]:
    """Return a struct with the fields of another one and the options of a command that files can have.

    Args:
        table: The other struct; its fields have priority over options of the same name.
        name: The name of the struct.
        command: The command.
    """
    fields = [
        (option.name, _make_field_type(option), msgspec.UNSET)
        for option in list_options(command).values()
        if option.in_file and option.name not in table.__struct_fields__
    ]
    return extend_struct(table, name, fields)


def _make_field_type(option: Option) -> Any:
    """Return the type of an option in a scenario file, with how to read and describe its value."""

    def read(value: Any, at: Location, folder: Path | None) -> Any:
        return read_option(option.name, value, at.label, folder)

    settings: dict[str, Any] = {}
    if get_origin(option.type) is Mapping:
        has_tables = dataclasses.is_dataclass(get_args(option.type)[1])
        settings["extra"] = {"is_value": lambda _: has_tables}
        settings["extra_json_schema"] = {} if has_tables else {"x-dotted": True}
    return Annotated[_make_option_type(option), describe(option.help, read=read, **settings)]


def _make_option_type(option: Option) -> Any:
    """Return the type of the value as TOML has it, from which the schema follows."""
    type_ = option.plain_type
    if option.choices is not None:
        names = Literal[tuple(option.choices())]  # type: ignore[misc]
        return list[names] if get_origin(type_) is Sequence else names
    if option.unit:
        return Annotated[float, quantity(option.unit)]
    if option.arrays:
        return dict[str, float | bool | str | Annotated[list[Any], msgspec.Meta(min_length=1)]]
    return type_in_file(type_)


@dataclass(frozen=True)
class ScenarioFile:
    """A scenario file. `system` is the name of a built-in system or the path of an SSP.

    `options` are values by name. Paths in the file are relative to `folder`. Messages call the file `where`.
    If the file itself describes the system, `make` makes it from a controller and a gain set. A machine has
    `defaults`, which returns options for those that are set, with lower priority than `options`, and the data
    `sheets` of its joints by name.
    """

    description: str
    system: str
    options: Mapping[str, Any]
    where: str
    folder: Path
    make: Callable[..., System] | None = None
    defaults: Callable[[Options], Mapping[str, Any]] | None = None
    sheets: Mapping[str, FileOrObject] = field(default_factory=dict)


class ScenarioTable(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A scenario: a system, and options to run it. All options of `emla run` can be here, but a few."""

    system: Annotated[
        str, describe("name of a built-in system, or path of an SSP, FMU or joint file", "study")
    ]
    description: Annotated[str, describe("purpose, in one line")] = ""


def scenario_struct() -> type[ScenarioTable]:
    """Return the struct of scenario files, with the options of a run."""
    return with_options(ScenarioTable, "Scenario", RUN)


@dataclass(frozen=True)
class Kind:
    """A kind of file that describes a system itself. Its key `kind` names it.

    `keys` are keys that scenario files do not have. `read` makes a `ScenarioFile` from the content, the name
    for messages, and the folder.
    """

    keys: Collection[str]
    read: Callable[[Mapping[str, Any], str, Path], ScenarioFile]


KINDS: dict[str, Kind] = {}
"""Kinds of such files by the value of `kind`."""


def parse_scenario(text: str, where: str, folder: Path) -> ScenarioFile:
    """Parse a scenario file, or one of `KINDS`. Raise CommandError for invalid TOML and unknown keys."""
    label = f"the scenario '{where}'"
    content = read_toml(text, label)
    if isinstance(content.get("kind"), str):  # otherwise it is the option, a list
        check_choice(f"kind of file in '{where}':", content["kind"], KINDS)
        return KINDS[content["kind"]].read(content, where, folder)
    if "system" not in content:
        _refuse_without_kind(content, label)
    table = convert_value(content, scenario_struct(), label, folder)
    options = list_given(table, ScenarioTable.__struct_fields__)
    return ScenarioFile(table.description, table.system, options, where, folder)


def _refuse_without_kind(content: Mapping[str, Any], label: str) -> None:
    """Raise CommandError for a file with keys of another kind but no `kind`."""
    for kind, about in KINDS.items():
        if unexpected := [key for key in content if key in about.keys]:
            raise CommandError(
                f"{label} has no system, but the key '{unexpected[0]}' of a {kind}; write kind = \"{kind}\" "
                f"for a {kind}.",
                key="kind",
            )


SYSTEMS: dict[str, Callable[..., System]] = {}
"""Functions that make a system from a controller and a gain set, by name; None means the default."""

FOLLOWING: set[str] = set()
"""Systems that can also be made from a trajectory file, with the argument `trajectory`."""

CHANGES: dict[
    str,
    Callable[
        [str, Mapping[str, Any], Mapping[str, Value], Mapping[str, FileOrObject]], Mapping[str, FileOrObject]
    ],
] = {}
"""Functions that make objects for the joints of a system, by option, such as `actuator`. They take the name
of the system, files or objects by joint, other values by JOINT.TABLE.ENTRY, and the objects that the joints
have without. They raise CommandError.
"""

EXTENSIONS: dict[str, Callable[[System], System]] = {}
"""Functions that return a built-in system with further components, by the option that adds them."""

STEPPING: list[Callable[[System, Mapping[str, Any]], Mapping[str, Any]]] = []
"""Functions that return further options of the algorithm for a built-in system, from those that are set."""

REMARKS: list[Callable[[System, Options], Sequence[str]]] = []
"""Functions that check a built-in system. They return remarks without full stops or raise CommandError."""

SCENARIOS: dict[str, Callable[[], str]] = {}
"""Functions that return the text of a scenario file, by scenario."""

PLANS: dict[str, Callable[[], str]] = {}
"""Functions that return the text of a sweep plan, by plan."""

TUNINGS: dict[str, Callable[[], str]] = {}
"""Functions that return the text of a tuning plan, by plan."""


@cache
def find_built_in(name: str) -> ScenarioFile:
    """Return the scenario file of a built-in scenario."""
    return parse_scenario(SCENARIOS[name](), name, Path())
