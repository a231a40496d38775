"""The table of options on the command line."""

import inspect
from collections.abc import Callable, Mapping, Sequence
from functools import wraps
from itertools import pairwise
from pathlib import Path
from types import NoneType
from typing import Annotated, Any, get_args, get_origin

import typer

from ...base.errors import CommandError
from ...base.option import RUNS, Option
from ...base.quantities import read_quantity
from ...base.values import parse_list
from ...run.options import list_options, read_option

SOURCE = (
    "Scenario: a name from `emla list`, a scenario file (.toml), an SSP (.ssp, .ssd, or a folder), an "
    "FMU (.fmu), or a run.json."
)
"""Help of the argument that names a scenario."""

PLAN = "Plan: a file (.toml) or a name from `emla list`; or a scenario as for `emla run`."
"""Help of the argument that names a plan."""

Scheduler = Annotated[
    str | None,
    typer.Option(
        help="Scheduler of a Dask cluster, such as tcp://10.0.0.1:8786. Default: the cores of this machine.",
        metavar="ADDRESS",
        rich_help_panel=RUNS,
    ),
]
Workers = Annotated[
    int | None,
    typer.Option(help="Number of processes on this machine. Default: one per core.", rich_help_panel=RUNS),
]
"""Options of commands that make many runs."""


def with_options(function: Callable[..., None], command: str) -> Callable[..., None]:
    """Add the options of a command to its function.

    The function gets the options that the user sets in `given`, by name.

    Raises:
        CommandError: If a text is not a value of its option.
    """
    options = list(list_options(command).values())
    own = [p for p in inspect.signature(function).parameters.values() if p.name != "given"]

    @wraps(function)
    def called(**values: Any) -> None:
        texts = [(o, values.pop(o.name)) for o in options]
        function(**values, given={o.name: _read(o, text) for o, text in texts if text is not None})

    parameters = [*own, *map(_parameter, options)]
    called.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    called.__annotations__ = {p.name: p.annotation for p in parameters}
    return called


def add_flag_values(
    arguments: Sequence[str], command: str, own: Mapping[str, str] | None = None
) -> list[str]:
    """Add its value to each flag that is written without one.

    Args:
        arguments: Arguments of the command line.
        command: Name of the command.
        own: Flags of this command alone, with the value each has when none follows.
    """
    alone = {o.flag: o.about.alone for o in list_options(command).values() if o.about.alone} | dict(own or {})
    found = list[str]()
    for argument, following in pairwise([*arguments, "-"]):
        stands = argument in alone and following.startswith("-")
        found.append(f"{argument}={alone[argument]}" if stands else argument)
    return found


def _parameter(option: Option) -> inspect.Parameter:
    about = option.about
    text = about.help
    choices = None if about.choices is None else list(about.choices())
    if choices is not None:
        text += f" One of {', '.join(map(str, choices))}."
    if about.unit:
        text += f" In {about.unit}, or with a unit as in 0.1ms."
    names = [option.flag]
    if option.type is bool:
        names = [f"{option.flag}/--no-{option.flag.removeprefix('--')}"]
    described = typer.Option(
        *names, help=text + _default(option), metavar=_metavar(option), rich_help_panel=about.group
    )
    annotation = Annotated[_text_type(option) | None, described]
    return inspect.Parameter(option.name, inspect.Parameter.KEYWORD_ONLY, default=None, annotation=annotation)


def _default(option: Option) -> str:
    """Return the default as text for the help, if it is one value."""
    default = option.default
    if default is None or isinstance(default, (bool, list, dict)):
        return ""
    return f" Default: {default:g}." if isinstance(default, float) else f" Default: {default}."


def _metavar(option: Option) -> str | None:
    """Return the placeholder of the value in the help, or None for a switch."""
    if option.about.metavar or option.type is bool:
        return option.about.metavar
    if option.about.unit:
        return "TIME"
    kinds = {Path: "PATH", float: "NUMBER", int: "N", str: "NAME"}
    return next((name for kind, name in kinds.items() if kind in (option.type, *get_args(option.type))), None)


def _text_type(option: Option) -> Any:
    """Return the type that typer reads, before `_read` converts it."""
    origin, inner = get_origin(option.plain_type), get_args(option.plain_type)
    if origin is Mapping:
        return list[str]
    if option.about.parse is not None:
        return str
    if origin is Sequence:
        return list[str if hasattr(inner[0], "of_text") else inner[0]]  # type: ignore[misc]
    if option.about.takes is not None or option.about.unit:
        return str
    return next(t for t in (*inner, option.type) if t is not NoneType)


def _read(option: Option, value: Any) -> Any:
    """Convert a value from the command line to a value for `Options.updated`."""
    if option.about.parse is not None:
        return option.about.parse(value)
    if option.about.unit:
        return read_option(option.name, value, f"the option '{option.name}'", known={option.name: option})
    if get_origin(option.type) is not Mapping:
        return value
    of = get_args(option.plain_type)[1]
    return {name: _entry(option, name, text, of) for name, text in pairs(option.flag, value).items()}


def _entry(option: Option, name: str, text: str, of: Any) -> Any:
    if of is Path:
        return Path(text)
    if option.about.arrays and text.startswith("[") and text.endswith("]"):
        try:
            return parse_list(text)
        except ValueError as error:
            raise CommandError(
                f"{option.flag} {name}={text} is not a list; write [1,2], or [[1,2],[3,4]] for a matrix."
            ) from error
    if of is not int:
        return text
    try:
        return int(text)
    except ValueError as error:
        raise CommandError(f"{option.flag} {name}={text} is not a whole number.") from error


def pairs(flag: str, texts: Sequence[str]) -> dict[str, str]:
    """Return values by name from texts NAME=VALUE. Raise CommandError for any other text."""
    found = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not (name and equals and value):
            raise CommandError(f"{flag} {text} has no name or no value; write {flag} NAME=VALUE.")
        found[name.strip()] = value.strip()
    return found


def read_time(text: str | None, flag: str) -> float | None:
    """Return a time in s from a number or a quantity; None without a text.

    Raises:
        CommandError: The text is no time.
    """
    return None if text is None else read_quantity(text, flag, "s")
