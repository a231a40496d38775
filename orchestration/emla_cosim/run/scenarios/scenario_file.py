"""Scenario files: TOML that names a system and says how it is run."""

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
    """A scenario file; `system` is the name of a built-in one or the path of an SSP.

    `options` are those that it gives, as they are written; paths in them are relative to `folder`, and
    sentences call the file by `where`. `make` makes the system if the file describes it itself, for a
    controller and a set of gains.
    """

    description: str
    system: str
    options: Mapping[str, Any]
    where: str
    folder: Path
    make: Callable[..., System] | None = None


@dataclass(frozen=True)
class Kind:
    """A kind of file that describes a system itself, told by its key `kind`.

    `keys` are keys that no scenario file has. `read` makes a `ScenarioFile` of the content, what messages
    call the file, and its folder.
    """

    keys: Collection[str]
    read: Callable[[Mapping[str, Any], str, Path], ScenarioFile]


KINDS: dict[str, Kind] = {}
"""Kinds of such files by the value of `kind`."""


def parse_scenario(text: str, where: str, folder: Path) -> ScenarioFile:
    """Read a scenario file, or one of `KINDS`; CommandError for what is not TOML, and for unknown keys."""
    try:
        content = tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # also numbers and nestings too long to be meant
        raise CommandError(f"the scenario '{where}' is not TOML: {error}.") from error
    if "kind" in content:
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
    """Raise CommandError for a file that has keys of another kind but does not say so."""
    for kind, about in KINDS.items():
        if found := [key for key in content if key in about.keys]:
            raise CommandError(
                f"{label} has no system, but the key '{found[0]}' of a {kind}; "
                f'write kind = "{kind}" for a {kind}.',
                key="kind",
            )


def read_given_options(
    content: Mapping[str, Any], label: str, own: Sequence[str], command: str = RUN
) -> dict[str, Any]:
    """The options of a command among the keys of a file, which has the keys `own` beside them.

    Raises CommandError for any other key; sentences call the file `label`.
    """
    options = {name: option for name, option in list_options(command).items() if option.about.in_file}
    known = sorted([*options, *own])
    for key in content:
        if key not in known:
            near = difflib.get_close_matches(key, known, n=1)
            meant = f"did you mean '{near[0]}'?" if near else f"it may have {join_names(known)}."
            raise CommandError(f"{label} has the key '{key}'; {meant}", key=key)
    given = {key: value for key, value in content.items() if key in options}
    for key, value in given.items():
        if get_origin(options[key].type) is Mapping and isinstance(value, dict):
            given[key] = dict(_flatten(value, options[key].type.__args__[1]))
    return given


def _flatten(table: Mapping[str, Any], of: Any) -> Iterator[tuple[str, Any]]:
    """Entries by their whole name: TOML nests names with dots unless they are quoted.

    Where the entries are tables themselves, names have to be quoted.
    """
    for key, value in table.items():
        if isinstance(value, dict) and not hasattr(of, "__dataclass_fields__"):
            yield from ((f"{key}.{name}", inner) for name, inner in _flatten(value, of))
        else:
            yield key, value
