"""Insert the table of options, generated from their declarations."""

from collections.abc import Iterator

from emla_cosim.base.option import OUTPUT, RUN, RUNS, STEPPING, SYSTEM, Option
from emla_cosim.run.options import list_options

_VALUES = {"Path": "PATH", "float": "NUMBER", "str": "NAME"}

PLACE = "<!-- table of options -->"


def on_page_markdown(markdown: str, **_: object) -> str:
    """Replace the placeholder by the table."""
    return markdown.replace(PLACE, "\n".join(_lines())) if PLACE in markdown else markdown


def _lines() -> Iterator[str]:
    for group in (SYSTEM, STEPPING, OUTPUT, RUNS):
        yield f"### {group}\n\n| Command line | Name elsewhere | Meaning |\n|---|---|---|"
        yield from (_row(option) for option in list_options().values() if option.about.group == group)
        yield ""


def _row(option: Option) -> str:
    about = option.about
    flag = f"{option.flag}, --no-{option.flag.removeprefix('--')}" if option.type is bool else option.flag
    choices = f" One of {', '.join(map(str, about.choices()))}." if about.choices is not None else ""
    unit = f" In {about.unit}, or with a unit." if about.unit else ""
    place = "" if about.in_file else " Not in scenario files."
    if RUN not in about.commands:
        place += f" Of {' and '.join(f'`emla {c}`' for c in about.commands)}."
    meaning = f"{about.help}{choices}{unit}{_default(option)}{place}"
    return f"| `{flag}{_value(option)}` | `{option.name}` | {meaning} |"


def _value(option: Option) -> str:
    """Return the placeholder of the value on the command line."""
    if option.about.metavar or option.type is bool:
        return f" {option.about.metavar}" if option.about.metavar else ""
    kind = str(option.type)
    if option.about.unit:
        return f" {option.about.unit.upper()}"
    return next((f" {what}" for of, what in _VALUES.items() if of in kind), "")


def _default(option: Option) -> str:
    if option.default is None or isinstance(option.default, (bool, list, dict)):
        return ""
    return f" Default: {_plain(option.default)}."


def _plain(value: object) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)
