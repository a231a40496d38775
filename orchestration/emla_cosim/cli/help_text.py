"""The help of a command, which cuts no word at any width."""

import os
import re
import textwrap
from collections.abc import Iterable, Iterator, Sequence

import click

from ..base.option import OTHER_OPTIONS, OUTPUT, RUNS, STEPPING, SYSTEM

_INDENT, _DEEP_INDENT = "  ", "      "


_RANK = {group: rank for rank, group in enumerate((SYSTEM, STEPPING, OUTPUT, RUNS), 1)}
"""Order of the groups that several commands have."""


_MOST_LETTERS_BESIDE = 12
"""Most letters of names beside which their meanings stand."""


def format_help(
    command: click.Command,
    ctx: click.Context,
    entries: Iterable[tuple[str, str, str]],
    commands: tuple[str, Sequence[str]],
    width: int,
) -> str:
    """Return the help of a command.

    Args:
        command: Command to describe.
        ctx: Context of the command.
        entries: Group, name and meaning of each argument, option or command. Groups come in this order, those
            that several commands have after the others.
        commands: Title and lines of the last paragraph, which has commands to copy.
        width: Columns of the terminal.
    """
    switches = [
        (OTHER_OPTIONS, ", ".join(p.opts), p.help or "")
        for p in command.get_params(ctx)
        if isinstance(p, click.Option) and not p.hidden and not hasattr(p, "option")
    ]
    groups = dict[str, list[tuple[str, str]]]()
    for group, name, meaning in (*sorted(entries, key=lambda entry: _RANK.get(entry[0], 0)), *switches):
        groups.setdefault(group, []).append((name, meaning))
    paragraphs = [_wrap(command.get_usage(ctx), width), _wrap(command.help or "", width)]
    paragraphs += [
        [_format_title(f"{title}:"), *_list_lines(group, width)] for title, group in groups.items()
    ]
    title, lines = commands
    if lines:
        paragraphs.append(
            [_format_title(f"{title}:"), *(part for line in lines for part in _break_command(line, width))]
        )
    return "\n\n".join("\n".join(lines) for lines in paragraphs) + "\n"


def _list_lines(entries: Sequence[tuple[str, str]], width: int) -> Iterator[str]:
    """Yield names with their meanings: beside the names if all are short, otherwise below them."""
    are_short = max(len(name) for name, _ in entries) <= _MOST_LETTERS_BESIDE
    for name, meaning in entries:
        if are_short:
            indent = " " * (_MOST_LETTERS_BESIDE + 4)
            yield from _wrap(meaning, width, f"  {name:{_MOST_LETTERS_BESIDE}}  ", indent)
        else:
            yield _INDENT + name
            yield from _wrap(meaning, width, _DEEP_INDENT, _DEEP_INDENT)


def _wrap(text: str, width: int, first_indent: str = "", indent: str = "") -> list[str]:
    """Break a text at its spaces only."""
    return textwrap.wrap(
        text,
        width,
        initial_indent=first_indent,
        subsequent_indent=indent,
        break_long_words=False,
        break_on_hyphens=False,
    )


def _break_command(command: str, width: int) -> Iterator[str]:
    """Yield the lines of a command, which a shell reads as one; quoted texts stay whole."""
    line = _INDENT
    for word in re.findall(r"(?:'[^']*'|\S)+", command):
        if line.strip() and len(line) + len(word) + 2 > width:
            yield f"{line}\\"
            line = _DEEP_INDENT
        line += f"{word} "
    yield line.rstrip()


def _format_title(title: str) -> str:
    return title if "NO_COLOR" in os.environ else click.style(title, bold=True)
