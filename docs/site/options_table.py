"""Insert the table of options, generated from their declarations."""

from collections.abc import Iterator

from emla_cosim.base.option import OUTPUT, RUN, RUNS, STEPPING, SYSTEM, Option
from emla_cosim.run.options import list_options

PLACE = "<!-- table of options -->"


def on_page_markdown(markdown: str, **_: object) -> str:
    """Replace the placeholder by the table."""
    return markdown.replace(PLACE, "\n".join(_lines())) if PLACE in markdown else markdown


def _lines() -> Iterator[str]:
    for group in (SYSTEM, STEPPING, OUTPUT, RUNS):
        yield f"### {group}\n\n| Command line | Name elsewhere | Meaning |\n|---|---|---|"
        yield from (_row(option) for option in list_options().values() if option.group == group)
        yield ""


def _row(option: Option) -> str:
    limits = "" if option.in_file else " Not in scenario files."
    if RUN not in option.commands:
        limits += f" Of {' and '.join(f'`emla {c}`' for c in option.commands)}."
    return f"| `{option.headline}` | `{option.name}` | {option.meaning}{limits} |"
