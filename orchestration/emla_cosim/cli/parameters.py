"""Options as parameters of the command line, and the values of its texts."""

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any, get_args

import click

from ..base.errors import CommandError
from ..base.option import ARGUMENTS, Option
from ..base.values import parse_list
from ..run.options import read_option
from .completion import complete_value


class OptionParameter(click.Option):
    """A parameter with a flag, which takes texts; `option` declares it."""

    def __init__(self, option: Option) -> None:
        is_switch = option.type is bool
        flag_settings: dict[str, Any] = {"flag_value": option.flag_value} if option.flag_value else {}
        super().__init__(
            ["/".join(option.flags), *filter(None, [option.short_flag]), option.name],
            is_flag=is_switch,
            default=None,  # tells what the user did not write from what is False
            multiple=option.is_repeatable,
            type=None if is_switch else str,
            shell_complete=None if is_switch else complete_value,
            **flag_settings,
        )
        self.option = option


class ArgumentParameter(click.Argument):
    """A parameter without a flag, which takes texts; `option` declares it."""

    def __init__(self, option: Option) -> None:
        super().__init__(
            [option.name],
            required=option.is_required,
            nargs=-1 if option.is_repeatable else 1,
            type=str,
            metavar=option.headline,
            shell_complete=complete_value,
        )
        self.option = option


def make_parameters(options: Iterable[Option]) -> list[click.Parameter]:
    """Return the parameters that options declare."""
    return [ArgumentParameter(o) if o.group == ARGUMENTS else OptionParameter(o) for o in options]


def read_values(options: Iterable[Option], texts: dict[str, Any]) -> dict[str, Any]:
    """Return the values of the options that the user wrote, by name.

    Args:
        options: Options to read.
        texts: Texts by name of the option. None or an empty tuple is what the user did not write.

    Raises:
        CommandError: If a text is not a value of its option.
    """
    written = [o for o in options if texts[o.name] not in (None, ())]
    values = {o.name: _convert(o, texts[o.name]) for o in written}
    for option in written:
        value = values[option.name]
        for part in value if isinstance(value, list) else [value]:
            option.check(part)
    return values


def _convert(option: Option, text: Any) -> Any:
    """Convert a text, the texts of a repeatable option, or the state of a switch."""
    if option.parse is not None:
        return option.parse(text)
    if option.is_table:
        kind = get_args(option.plain_type)[1]
        return {
            name: _convert_entry(option, name, value, kind) for name, value in _split_pairs(option.flag, text)
        }
    if option.unit:
        return read_option(option.name, text, option.flag, allowed={option.name: option})
    if option.is_repeatable:
        return [_convert_plain(f"{option.flag} {part}", part, option.text_type) for part in text]
    return _convert_plain(f"{option.flag} {text}", text, option.text_type)


def _convert_plain(label: str, text: Any, kind: Callable[[Any], Any]) -> Any:
    """Convert a text to a number or a path, or leave it a text. Raise CommandError if it is not a number."""
    try:
        return kind(text) if kind in (int, float, Path) else text
    except ValueError as error:
        noun = "a whole number" if kind is int else "a number"
        raise CommandError(f"{label} is not {noun}.") from error


def _convert_entry(option: Option, name: str, text: str, kind: Any) -> Any:
    """Convert the value of a table's entry; for an option with arrays, it can be a list such as [1,2]."""
    label = f"{option.flag} {name}={text}"
    if option.arrays and text.startswith("[") and text.endswith("]"):
        try:
            return parse_list(text)
        except ValueError as error:
            raise CommandError(
                f"{label} is not a list; write [1,2], or [[1,2],[3,4]] for a matrix."
            ) from error
    return _convert_plain(label, text, kind)


def _split_pairs(flag: str, texts: Sequence[str]) -> Iterable[tuple[str, str]]:
    """Yield names and values from texts NAME=VALUE. Raise CommandError for any other text."""
    for text in texts:
        name, equals, value = text.partition("=")
        if not (name and equals and value):
            raise CommandError(
                f"{flag} {text or repr(text)} has no name or no value; write {flag} NAME=VALUE."
            )
        yield name.strip(), value.strip()
