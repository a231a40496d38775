"""Scenario files: TOML with a system and the options to run it."""

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import msgspec

from ...base.errors import CommandError, check_choice
from ...base.option import RUN, FileOrObject
from ...base.toml_structs import describe, list_given, read_toml
from ...base.values import convert_value
from ...system.model import System
from ..options import Options
from .option_fields import with_options


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
