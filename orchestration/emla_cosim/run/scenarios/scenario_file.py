"""Scenario files: TOML with a system and the options to run it."""

import difflib
import tomllib
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_origin

from ...base.errors import CommandError, check_choice, join_names
from ...base.option import RUN
from ...base.values import convert_value
from ...system.model import System
from ..options import list_options


@dataclass(frozen=True)
class ScenarioFile:
    """A scenario file. `system` is the name of a built-in system or the path of an SSP.

    `options` are as written in the file; their paths are relative to `folder`. Messages call the file
    `where`. If the file itself describes the system, `make` makes it from a controller and a gain set.
    """

    description: str
    system: str
    options: Mapping[str, Any]
    where: str
    folder: Path
    make: Callable[..., System] | None = None


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
    try:
        content = tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # RecursionError: too deeply nested
        raise CommandError(f"the scenario '{where}' is not TOML: {error}.") from error
    if isinstance(content.get("kind"), str):  # otherwise it is the option, a list
        check_choice(f"kind of file in '{where}':", content["kind"], KINDS)
        return KINDS[content["kind"]].read(content, where, folder)
    label = f"the scenario '{where}'"
    if "system" not in content:
        _refuse_without_kind(content, label)
    given = read_given_options(content, label, ("system", "description"))
    if "system" not in content:
        raise CommandError(f'{label} has no system; write system = "study" or the path of an SSP.')
    return ScenarioFile(
        convert_value(content.get("description", ""), str, f"'description' of {label}"),
        convert_value(content["system"], str, f"'system' of {label}"),
        given,
        where,
        folder,
    )


def _refuse_without_kind(content: Mapping[str, Any], label: str) -> None:
    """Raise CommandError for a file with keys of another kind but no `kind`."""
    for kind, about in KINDS.items():
        if found := [key for key in content if key in about.keys]:
            raise CommandError(
                f"{label} has no system, but the key '{found[0]}' of a {kind}; write kind = \"{kind}\" "
                f"for a {kind}.",
                key="kind",
            )


def read_given_options(
    content: Mapping[str, Any], label: str, own: Sequence[str], command: str = RUN
) -> dict[str, Any]:
    """Return the options of a command from the keys of a file.

    Args:
        content: Content of the file.
        label: Name of the file in messages.
        own: Other keys that the file may have.
        command: Command whose options the file may have.

    Raises:
        CommandError: If the file has an unknown key.
    """
    options = {name: option for name, option in list_options(command).items() if option.about.in_file}
    known = sorted([*options, *own])
    for key in content:
        if key not in known:
            near = difflib.get_close_matches(key, known, n=1)
            meant = f"did you mean '{near[0]}'?" if near else f"known keys: {join_names(known)}."
            raise CommandError(f"{label} has the key '{key}'; {meant}", key=key)
    given = {key: value for key, value in content.items() if key in options}
    for key, value in given.items():
        if get_origin(options[key].type) is Mapping and isinstance(value, dict):
            given[key] = dict(_flatten(value, options[key].type.__args__[1]))
    return given


def _flatten(table: Mapping[str, Any], of: Any) -> Iterator[tuple[str, Any]]:
    """Yield entries by their full name: TOML nests names with dots unless they are quoted.

    If the entries are tables themselves, names have to be quoted.
    """
    for key, value in table.items():
        if isinstance(value, dict) and not hasattr(of, "__dataclass_fields__"):
            yield from ((f"{key}.{name}", inner) for name, inner in _flatten(value, of))
        else:
            yield key, value
